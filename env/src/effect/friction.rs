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
    ],
    what: "dry friction grows by torque exp(-(speed/velocity)^2) towards rest",
};

pub(super) const LOAD: Info = Info {
    id: "load_dependent_friction",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[Parameter {
        name: "coefficient",
        scale: Scale::One,
        neutral: Some(0.0),
        starts: &[0.05, 0.2],
        bounds: positive(0.99),
        default: None,
        what: "friction over transmitted torque",
    }],
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

/// Parameters of one joint.
#[derive(Clone, Debug, Default)]
pub(super) struct Friction {
    /// Dry friction of the nominal model, N m or N.
    pub coulomb: f64,
    pub stribeck: f64,
    pub stribeck_velocity: f64,
    pub load: f64,
    pub more_forward: f64,
    pub more_damped_forward: f64,
}

impl Friction {
    /// Bound of dry friction at `velocity` under the transmitted `torque`.
    pub fn bound(&self, velocity: f64, torque: f64) -> f64 {
        let mut bound = self.coulomb + self.load * torque.abs();
        if self.stribeck > 0.0 {
            let share = velocity / self.stribeck_velocity.max(1e-9);
            bound += self.stribeck * (-share * share).exp();
        }
        bound
    }

    /// Torque of what differs between the directions: the dry part is the same at rest, where friction may hold
    /// anything between its two bounds.
    pub fn torque(&self, velocity: f64) -> f64 {
        -self.more_forward - self.more_damped_forward * velocity.abs()
    }
}
