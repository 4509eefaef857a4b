//! What real machines do beyond the nominal model, as small named models with parameters.
//!
//! Simulation, training and identification use the same effects: the catalogue says what there is
//! ([`Kind::info`]), a robot carries those it has ([`crate::robot::Robot::effects`]), [`apply`] puts one into a robot and
//! the actuators run it, outside the engines. Each family has its module: what the command goes through (`command`),
//! motor and supply (`drive`), dry and viscous `friction`, gears (`transmission`), mass (`body`), encoders (`sensor`), and
//! what acts from outside (`outside`).
//!
//! A value that the robot's TOML already has under `[[joint]]` is written there and nowhere else
//! ([`Place::Joint`]); all others are `[[effect]]` tables:
//!
//! ```toml
//! [[effect]]
//! id = "stribeck_friction"
//! match = ["*_knee_pitch"]       # joints; links for `mass`, `centre_of_mass` and `payload`
//! torque = 0.4
//! velocity = 0.2
//! ```

mod apply;
mod body;
mod catalogue;
mod command;
mod drive;
mod friction;
mod joint;
mod outside;
mod sensor;
mod table;
mod transmission;

pub use apply::{ROTORS_HZ, apply, decoder, engine_passive, sprung};
pub use catalogue::{Bounds, Info, Kind, Parameter, Place, Scale, Site};
pub(crate) use joint::{JointDrive, Memory, Model, Told};
pub use table::{Table, Variable};

/// An effect of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Effect {
    /// Which model.
    pub kind: Kind,
    /// Degree of freedom, or link for effects of a body.
    pub target: usize,
    /// Values of the model's parameters, in the catalogue's order.
    pub values: Vec<f64>,
    /// The table of [`Kind::ResidualTorque`].
    pub table: Option<Table>,
}

impl Effect {
    /// An effect without a table.
    pub fn new(kind: Kind, target: usize, values: &[f64]) -> Self {
        debug_assert_eq!(values.len(), kind.info().parameters.len());
        Self {
            kind,
            target,
            values: values.to_vec(),
            table: None,
        }
    }

    /// What a measured `table` gives on degree of freedom `target` ([`Kind::ResidualTorque`]).
    pub fn of_table(target: usize, table: Table) -> Self {
        Self {
            table: Some(table),
            ..Self::new(Kind::ResidualTorque, target, &[])
        }
    }
}
