//! Friction beyond Coulomb and viscous. The bound of the engine's dry friction follows speed and load, so that sticking
//! stays exact and stable at any step.

use super::catalogue::{Info, Parameter, Place, Scale, Site, positive, signed};

pub(super) const COULOMB: Info = Info {
    id: "coulomb_friction",
    site: Site::Joint,
    place: Place::Joint("friction"),
    parameters: &[Parameter {
        name: "torque",
        scale: Scale::Torque,
        neutral: Some(0.0),
        starts: &[0.02, 0.1],
        bounds: positive(1e9),
        default: None,
        what: "dry friction",
    }],
    what: "a torque of constant size against the motion",
};

pub(super) const VISCOUS: Info = Info {
    id: "viscous_friction",
    site: Site::Joint,
    place: Place::Joint("damping"),
    parameters: &[Parameter {
        name: "damping",
        scale: Scale::Damping,
        neutral: Some(0.0),
        starts: &[0.02, 0.2],
        bounds: positive(1e9),
        default: None,
        what: "friction per speed",
    }],
    what: "a torque against the motion that grows with speed",
};

pub(super) const STRIBECK: Info = Info {
    id: "stribeck_friction",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[
        Parameter {
            name: "torque",
            scale: Scale::Torque,
            neutral: Some(0.0),
            starts: &[0.05, 0.2],
            bounds: positive(1e9),
            default: None,
            what: "friction at rest beyond the dry friction in motion",
        },
        Parameter {
            name: "velocity",
            scale: Scale::Speed,
            neutral: None,
            starts: &[0.03, 0.2],
            bounds: positive(1e6),
            default: None,
            what: "speed at which 1/e of it is left",
        },
        Parameter {
            name: "travel",
            scale: Scale::Position,
            neutral: Some(0.0),
            starts: &[1e-4, 1e-3],
            bounds: positive(1.0),
            default: Some(0.0),
            what: "way after a turn over which dry friction builds up, to 1/e of what it lacks",
        },
    ],
    // Teeth and grease give way before they slip (Dahl, A solid friction model, 1968); what is stored in them is not given back here.
    what: "dry friction grows by torque exp(-(speed/velocity)^2) towards rest",
};

pub(super) const LOAD: Info = Info {
    id: "load_dependent_friction",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[
        Parameter {
            name: "coefficient",
            scale: Scale::One,
            neutral: Some(0.0),
            starts: &[0.05, 0.2],
            bounds: positive(0.99),
            default: None,
            what: "friction over transmitted torque",
        },
        Parameter {
            name: "growth",
            scale: Scale::PerTorque,
            neutral: Some(0.0),
            starts: &[0.1, 0.4],
            bounds: positive(1e6),
            default: Some(0.0),
            what: "how much more of the coefficient there is per torque",
        },
        Parameter {
            name: "at_rest",
            scale: Scale::One,
            neutral: Some(0.0),
            starts: &[0.1],
            bounds: positive(10.0),
            default: Some(0.0),
            what: "how much more of the coefficient there is at rest",
        },
        Parameter {
            name: "velocity",
            scale: Scale::Speed,
            neutral: None,
            starts: &[0.03, 0.2],
            bounds: positive(1e6),
            default: Some(0.1),
            what: "speed at which 1/e of that is left",
        },
    ],
    // Friction of gears under load is more than proportional and falls with speed on most servos (Duclusaud, Passault and others,
    // Extended friction models for the physics simulation of servo actuators, 2024: models M4 and M6).
    what: "dry friction grows with the torque that the gear transmits (motor torque less what turns the rotor)",
};

pub(super) const DIRECTIONAL: Info = Info {
    id: "directional_friction",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[
        Parameter {
            name: "torque",
            scale: Scale::Torque,
            neutral: Some(0.0),
            starts: &[0.02, -0.02],
            bounds: signed(1e9),
            default: Some(0.0),
            what: "half of how much more dry friction there is forward than backward",
        },
        Parameter {
            name: "damping",
            scale: Scale::Damping,
            neutral: Some(0.0),
            starts: &[0.0],
            bounds: signed(1e9),
            default: Some(0.0),
            what: "half of how much more viscous friction there is forward than backward",
        },
    ],
    what: "friction differs between forward and backward",
};

/// A step shorter than this share of the travel is the rounding of a joint that sticks, and no turn.
const STILL: f64 = 1e-3;

/// Parameters of one joint.
#[derive(Clone, Debug, Default)]
pub(super) struct Friction {
    /// Dry friction of the nominal model, N m or N.
    pub coulomb: f64,
    pub stribeck: f64,
    pub stribeck_velocity: f64,
    pub travel: f64,
    pub load: f64,
    pub load_growth: f64,
    pub load_at_rest: f64,
    pub load_velocity: f64,
    pub more_forward: f64,
    pub more_damped_forward: f64,
}

impl Friction {
    /// Bound of dry friction at `velocity` under the transmitted `torque`.
    pub fn bound(&self, velocity: f64, torque: f64) -> f64 {
        let torque = torque.abs();
        let mut coefficient = self.load + self.load_growth * torque;
        if self.load_at_rest > 0.0 {
            coefficient += self.load_at_rest * left(velocity, self.load_velocity);
        }
        let mut bound = self.coulomb + coefficient * torque;
        if self.stribeck > 0.0 {
            bound += self.stribeck * left(velocity, self.stribeck_velocity);
        }
        bound
    }

    /// Share of dry friction there is after another step of `way`, rad or m. `bent` is how far what rubs gives way, in shares of how
    /// far it does before it slips, and to which side.
    pub fn built(&self, bent: &mut f64, way: f64) -> f64 {
        if self.travel <= 0.0 {
            return 1.0;
        }
        if way.abs() < STILL * self.travel {
            return bent.abs();
        }
        let direction = way.signum();
        *bent = direction + (*bent - direction) * (-way.abs() / self.travel).exp();
        (*bent * direction).max(0.0)
    }

    /// Of dry friction that would be bounded by `bound` in both directions: what it is bounded by about a torque, and that torque, so that
    /// neither direction has less than none.
    pub fn sides(&self, bound: f64) -> (f64, f64) {
        let [forward, backward] = [self.more_forward, -self.more_forward].map(|more| (bound + more).max(0.0));
        (0.5 * (forward + backward), -0.5 * (forward - backward))
    }

    /// Torque of what viscous friction differs between the directions.
    pub fn torque(&self, velocity: f64) -> f64 {
        -self.more_damped_forward * velocity.abs()
    }
}

/// Share of what there is at rest that is left at `velocity`: 1/e at the speed `typical`.
fn left(velocity: f64, typical: f64) -> f64 {
    let share = velocity / typical.max(1e-9);
    (-share * share).exp()
}
