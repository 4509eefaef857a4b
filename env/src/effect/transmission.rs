//! What lies between motor and joint: a spring, a gap. Both are one model of two masses.
//!
//! The rotor (the joint's armature) is a body of its own, coupled to the joint by a spring and a damper that act
//! outside the gap. The spring is implicit on both sides: the rotor's step is solved here against where the joint is
//! going, the joint's in the engine against where the rotor went.

use super::catalogue::{Bounds, Info, Parameter, Place, Scale, Site, positive};

pub(super) const BACKLASH: Info = Info {
    id: "backlash",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[
        Parameter {
            name: "gap",
            scale: Scale::Position,
            neutral: Some(0.0),
            starts: &[0.01, 0.05],
            bounds: positive(1.0),
            default: None,
            what: "free play between motor and joint",
        },
        ENCODER,
    ],
    what: "the motor moves the joint only at the ends of a gap",
};

pub(super) const ELASTICITY: Info = Info {
    id: "elasticity",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[
        Parameter {
            name: "compliance",
            scale: Scale::Compliance,
            neutral: Some(0.0),
            starts: &[0.05, 0.2],
            bounds: positive(1e6),
            default: None,
            what: "twist per torque between motor and joint",
        },
        ENCODER,
    ],
    what: "motor and joint are coupled by a spring",
};

const ENCODER: Parameter = Parameter {
    name: "encoder",
    scale: Scale::One,
    neutral: None,
    starts: &[],
    bounds: Bounds { lower: 0.0, upper: 1.0 },
    default: Some(0.0),
    what: "where the encoder sits: 0 at the joint, 1 at the motor",
};

/// Stiffest coupling: angular frequency of the rotor on it, rad/s. Beats of 12 ms are short against everything a servo does.
const STIFFEST: f64 = 500.0;
/// Damping ratio of the rotor on the coupling.
const DAMPING_RATIO: f64 = 0.7;
/// Bound of a torque that is not bounded, N m or N: far beyond all and finite in single precision.
const STRONGEST: f64 = 1e12;
/// Inertia of a rotor whose armature is not known, as a share of what the joint moves.
const LEAST_ROTOR: f64 = 0.02;

/// Parameters of one joint.
#[derive(Clone, Debug, Default)]
pub(super) struct Transmission {
    pub gap: f64,
    pub compliance: f64,
    pub motor_encoder: bool,
    /// Inertia of the rotor, kg m^2 or kg.
    pub rotor: f64,
    stiffness: f64,
    damping: f64,
}

/// Rotor position and velocity at the joint.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rotor {
    pub position: f64,
    pub velocity: f64,
}

/// A spring-damper that holds the joint, in the terms of [`crate::engine::Drive`].
pub(super) struct Coupling {
    pub target: f64,
    pub stiffness: f64,
    pub damping: f64,
    pub feed_forward: f64,
    pub torque_min: f64,
    pub torque_max: f64,
}

/// The servo as the rotor sees it: `torque = clamp(stiffness (target - q) - damping dq + feed_forward)`.
pub(super) struct Servo {
    pub target: f64,
    pub stiffness: f64,
    pub damping: f64,
    pub feed_forward: f64,
    pub torque_min: f64,
    pub torque_max: f64,
}

impl Transmission {
    /// Whether motor and joint are two bodies.
    pub fn is_split(&self) -> bool {
        self.gap > 0.0 || self.compliance > 0.0
    }

    /// Chooses the coupling for a joint that moves `inertia` beside the rotor's `armature`.
    pub fn couple(&mut self, armature: f64, inertia: f64) {
        self.rotor = armature.max(LEAST_ROTOR * inertia);
        let stiffest = self.rotor * STIFFEST * STIFFEST;
        self.stiffness = if self.compliance > 0.0 {
            (1.0 / self.compliance).min(stiffest)
        } else {
            stiffest
        };
        let critical = 2.0 * (self.rotor * self.stiffness).sqrt();
        self.damping = if self.gap > 0.0 { DAMPING_RATIO } else { 0.1 } * critical;
    }

    /// Moves the rotor by a step of `dt` s under `servo`, beside a joint at `position` with `velocity`.
    /// Returns the coupling for the joint's step, and the motor's torque.
    pub fn step(&self, rotor: &mut Rotor, servo: &Servo, position: f64, velocity: f64, dt: f64) -> (Coupling, f64) {
        let half = 0.5 * self.gap;
        let play = rotor.position + dt * rotor.velocity - position - dt * velocity;
        // Which end of the gap is touched, and by how much.
        let side = if play > half {
            half
        } else if play < -half {
            -half
        } else if self.gap > 0.0 {
            f64::NAN
        } else {
            0.0
        };
        let touching = !side.is_nan();
        let (k, b) = if touching {
            (self.stiffness, self.damping)
        } else {
            (0.0, 0.0)
        };
        let side = if touching { side } else { 0.0 };
        let target = position + dt * velocity + side;
        let solve = |k_servo: f64, d_servo: f64, torque: f64| {
            let load = k * (target - rotor.position) + b * velocity;
            let free = self.rotor * rotor.velocity + dt * (torque - k_servo * rotor.position + load);
            free / (self.rotor + dt * (d_servo + b) + dt * dt * (k_servo + k))
        };
        let wanted = servo.stiffness * servo.target + servo.feed_forward;
        // A servo that works with the joint's encoder has no stiffness against the rotor.
        let (own, against) = if self.motor_encoder {
            ((servo.stiffness, servo.damping), wanted)
        } else {
            let torque = servo.stiffness * (servo.target - position) - servo.damping * velocity + servo.feed_forward;
            ((0.0, 0.0), torque)
        };
        let mut next = solve(own.0, own.1, against);
        let torque = against - own.0 * (rotor.position + dt * next) - own.1 * next;
        let limited = torque.clamp(servo.torque_min, servo.torque_max);
        if limited != torque {
            next = solve(0.0, 0.0, limited);
        }
        rotor.velocity = next;
        rotor.position += dt * next;
        let pushing = if side > 0.0 {
            (0.0, STRONGEST)
        } else {
            (-STRONGEST, 0.0)
        };
        let (torque_min, torque_max) = match (touching, self.gap > 0.0) {
            (false, _) => (0.0, 0.0),
            (true, true) => pushing,
            (true, false) => (-STRONGEST, STRONGEST),
        };
        let coupling = Coupling {
            target: rotor.position - side,
            stiffness: k,
            damping: b,
            feed_forward: b * rotor.velocity,
            torque_min,
            torque_max,
        };
        (coupling, limited)
    }
}
