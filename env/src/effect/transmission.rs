//! What lies between motor and joint: a spring, a gap. Both are one model of two masses.
//!
//! The rotor (the joint's armature) is a body of its own, coupled to the joint by a spring and a damper that act outside
//! the gap. Both bodies are one implicit step: the rotor's velocity after it is linear in the joint's, so what the joint
//! feels is a torque and a damping, which the engine solves with the rest of the robot; from the torque that came out, the
//! rotor's step follows. What one body gets the other gives, to rounding.

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
        damping_ratio(
            DAMPING_RATIO,
            "damping of the rotor against the ends of the gap over the critical one: how little it bounces",
        ),
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
        damping_ratio(
            SPRING_DAMPING_RATIO,
            "damping of the rotor on the spring over the critical one",
        ),
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

/// How a rotor comes to rest on what it moves the joint by: it bounces, or does not.
const fn damping_ratio(default: f64, what: &'static str) -> Parameter {
    Parameter {
        name: "damping_ratio",
        scale: Scale::One,
        neutral: None,
        starts: &[0.05, 0.25, 0.7],
        bounds: Bounds { lower: 0.0, upper: 2.0 },
        default: Some(default),
        what,
    }
}

/// Stiffest coupling: angular frequency of the rotor on it, rad/s. Beats of 12 ms are short against everything a servo does.
const STIFFEST: f64 = 500.0;
/// The same over the physics rate: a beat of twelve steps and a half. A stiffer end of a gap is met by steps too coarse for it, and robots
/// with play in every joint went non-finite in rapier at 200 Hz. At 1 kHz both bounds are one.
const STIFFEST_IN_A_STEP: f64 = 0.5;
/// Damping ratio of a rotor against the ends of its gap, where nothing else is known: it hardly bounces.
const DAMPING_RATIO: f64 = 0.7;
/// Damping ratio of a rotor on a spring.
const SPRING_DAMPING_RATIO: f64 = 0.05;
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
    /// Of the rotor against the ends of the gap.
    pub gap_damping_ratio: f64,
    /// Of the rotor on the spring.
    pub spring_damping_ratio: f64,
    /// Inertia of the rotor, kg m^2 or kg.
    pub rotor: f64,
    stiffness: f64,
    /// By how much the torque falls with the velocity at which rotor and joint part.
    damping: f64,
}

/// A rotor: where it is, and what the motor gives it in the step that is under way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rotor {
    /// Position at the joint, rad or m.
    pub position: f64,
    /// Velocity at the joint, rad/s or m/s.
    pub velocity: f64,
    /// `torque - by_rotor v_rotor - by_joint v_joint` with the velocities after the step.
    pub motor: Motor,
}

/// A motor's torque over a step, linear in the velocities at its end.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motor {
    /// Torque were both at rest, N m or N.
    pub torque: f64,
    /// Fall with the rotor's velocity, N m s/rad or N s/m.
    pub by_rotor: f64,
    /// Fall with the joint's velocity, N m s/rad or N s/m.
    pub by_joint: f64,
}

/// What a joint feels of its rotor, in the terms of [`crate::engine::Drive`]: a damper and a torque with a clamp.
pub(super) struct Coupling {
    pub damping: f64,
    pub feed_forward: f64,
    pub torque_min: f64,
    pub torque_max: f64,
}

/// `value` between `lower` and `upper`, as [`f64::clamp`], which panics where a world has broken and they are no numbers.
fn within(value: f64, lower: f64, upper: f64) -> f64 {
    if value < lower {
        lower
    } else if value > upper {
        upper
    } else {
        value
    }
}

/// A servo: `torque = clamp(stiffness (target - q) - damping dq + feed_forward)`.
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

    /// Chooses the coupling for a joint that moves `inertia` beside the rotor's `armature`, in steps of `dt` s.
    pub fn couple(&mut self, armature: f64, inertia: f64, dt: f64) {
        self.rotor = armature.max(LEAST_ROTOR * inertia);
        let stiffest = self.rotor * STIFFEST.min(STIFFEST_IN_A_STEP / dt).powi(2);
        self.stiffness = if self.compliance > 0.0 {
            (1.0 / self.compliance).min(stiffest)
        } else {
            stiffest
        };
        let ratio = if self.gap > 0.0 {
            self.gap_damping_ratio
        } else {
            self.spring_damping_ratio
        };
        // A spring that is bent as far as it will be at the end of the step damps by itself, and counts as that.
        let critical = 2.0 * (self.rotor * self.stiffness).sqrt();
        self.damping = (ratio * critical).max(dt * self.stiffness);
    }

    /// The rotor of a joint at `position` with `velocity`, with which it moves: at the end of the gap that pushes where the
    /// motor has been asked to go `ahead`, in the middle where nothing has been asked.
    pub fn rotor(&self, position: f64, velocity: f64, ahead: f64) -> Rotor {
        let lead = if ahead == 0.0 {
            0.0
        } else {
            0.5 * self.gap.copysign(ahead)
        };
        Rotor {
            position: position + lead,
            velocity,
            motor: Motor::default(),
        }
    }

    /// Begins a step of `dt` s of the rotor under `servo`, beside a joint at `position` with `velocity`: what the joint feels
    /// of it.
    pub fn begin(&self, rotor: &mut Rotor, servo: &Servo, position: f64, velocity: f64, dt: f64) -> Coupling {
        let touched = self.touched(rotor, position, velocity, dt);
        // Without contact there is neither spring nor slope.
        let (spring, slope) = touched.map_or((0.0, 0.0), |end| {
            let bent = rotor.position - end - position;
            (self.stiffness * bent, self.damping)
        });
        // The rotor's velocity after the step over `alpha + beta v` with the joint's velocity v after it.
        let answer = |motor: &Motor| {
            let inertia = self.rotor + dt * (motor.by_rotor + slope);
            let alpha = (self.rotor * rotor.velocity + dt * (motor.torque - spring)) / inertia;
            (alpha, dt * (slope - motor.by_joint) / inertia)
        };
        let resistance = servo.damping + dt * servo.stiffness;
        let wanted = |seen: f64| servo.stiffness * (servo.target - seen) + servo.feed_forward;
        let mut motor = if self.motor_encoder {
            Motor {
                torque: wanted(rotor.position),
                by_rotor: resistance,
                by_joint: 0.0,
            }
        } else {
            Motor {
                torque: wanted(position),
                by_rotor: 0.0,
                by_joint: resistance,
            }
        };
        let (alpha, beta) = answer(&motor);
        let torque = motor.at(alpha + beta * velocity, velocity);
        let limited = within(torque, servo.torque_min, servo.torque_max);
        if limited != torque {
            motor = Motor {
                torque: limited,
                ..Motor::default()
            };
        }
        rotor.motor = motor;
        let (alpha, beta) = answer(&motor);
        let (torque_min, torque_max) = match touched {
            None => (0.0, 0.0),
            // The end of a gap pushes and never pulls.
            Some(end) if end > 0.0 => (0.0, STRONGEST),
            Some(end) if end < 0.0 => (-STRONGEST, 0.0),
            Some(_) => (-STRONGEST, STRONGEST),
        };
        Coupling {
            damping: slope * (1.0 - beta),
            feed_forward: spring + slope * alpha,
            torque_min,
            torque_max,
        }
    }

    /// Ends the step of `dt` s: the joint got `torque` from the rotor and moves with `velocity` now. Returns the motor's torque.
    pub fn end(&self, rotor: &mut Rotor, torque: f64, velocity: f64, dt: f64) -> f64 {
        let motor = rotor.motor;
        let pushed = motor.torque - motor.by_joint * velocity - torque;
        rotor.velocity = (self.rotor * rotor.velocity + dt * pushed) / (self.rotor + dt * motor.by_rotor);
        rotor.position += dt * rotor.velocity;
        motor.at(rotor.velocity, velocity)
    }

    /// Which end of the gap is touched after a step at the present velocities, as the rotor's lead over the joint there; 0 for
    /// a spring without a gap.
    fn touched(&self, rotor: &Rotor, position: f64, velocity: f64, dt: f64) -> Option<f64> {
        if self.gap == 0.0 {
            return Some(0.0);
        }
        let half = 0.5 * self.gap;
        let lead = rotor.position + dt * rotor.velocity - position - dt * velocity;
        (lead.abs() > half).then_some(half.copysign(lead))
    }
}

impl Motor {
    /// The torque at these velocities.
    fn at(&self, rotor: f64, joint: f64) -> f64 {
        self.torque - self.by_rotor * rotor - self.by_joint * joint
    }
}
