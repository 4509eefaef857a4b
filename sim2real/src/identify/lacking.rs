//! What joints of a model lack, as it is reported: the torque over time, and what predicts it.

use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::Robot;
use serde::ser::{Serialize, SerializeStruct, Serializer};

use super::cross::Folds;
use super::fit::Data;
use super::model::Model;
use super::scales::Scales;
use super::torque::{Dependence, Form, Moment, dependence, lacking, names};

/// What a joint's simulation lacks to follow the logs.
#[derive(Clone, Debug)]
pub struct Lacking {
    /// The joint.
    pub joint: String,
    /// What the torque may depend on.
    pub names: Vec<String>,
    /// The torque over time.
    pub moments: Vec<Moment>,
    /// What predicts it on time that it was not fitted to, in order.
    pub predicted: Vec<Predicted>,
}

/// What predicts a torque.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Predicted {
    /// The variable's name.
    pub by: String,
    /// Whether against the direction of motion: friction that varies.
    pub friction: bool,
    /// Whether by its last 0.2 s, and not by what it is at the time: what is loose, swings or drags remembers.
    pub past: bool,
    /// Share of the torque's square.
    pub share: f64,
}

impl Lacking {
    /// Of `joint`, with what its torque depends on.
    pub fn new(joint: &str, names: Vec<String>, moments: Vec<Moment>, depends_on: &[Dependence]) -> Self {
        let predicted = depends_on.iter().map(|own| Predicted {
            by: names[own.variable].clone(),
            friction: own.form == Form::Friction,
            past: own.form == Form::Past,
            share: own.gain,
        });
        Self {
            joint: joint.to_owned(),
            predicted: predicted.collect(),
            names,
            moments,
        }
    }

    /// Root mean square, N m or N; none without moments.
    pub fn root(&self) -> Option<f64> {
        let squares: f64 = self.moments.iter().map(|m| m.torque * m.torque).sum();
        (!self.moments.is_empty()).then(|| (squares / self.moments.len() as f64).sqrt())
    }
}

/// In reports: joint, root mean square, and what predicts it; pages have the torque over time.
impl Serialize for Lacking {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_struct("Lacking", 3)?;
        fields.serialize_field("joint", &self.joint)?;
        fields.serialize_field("rms", &self.root())?;
        fields.serialize_field("predicted", &self.predicted)?;
        fields.end()
    }
}

/// What every joint of `robot` lacks in `data`, and what predicts that.
///
/// # Errors
/// When an engine does not take the robot.
pub fn of_joints(robot: &Robot, data: &Data, scales: &Scales) -> Result<Vec<Lacking>, EngineError> {
    let folds = Folds::new(data);
    let fold = |block: usize| folds.of_block[block];
    let all = lacking(data, &Model::default(), scales)?.into_iter().enumerate();
    let one = |(d, moments): (usize, Vec<Moment>)| {
        let names = data.trials.first().map_or_else(Vec::new, |trial| names(trial, d));
        let depends_on = dependence(&moments, &fold, folds.count);
        Lacking::new(&robot.dof(d).name, names, moments, &depends_on)
    };
    Ok(all.map(one).collect())
}
