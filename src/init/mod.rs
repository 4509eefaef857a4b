//! A robot folder from a URDF alone: what a URDF cannot say is found in its shapes, masses and names, or guessed, and
//! each guess is written where its user will set it right.
//!
//! The order: the words that tell left from right (`sides`), feet and legs (`legs`), limits and gains from the
//! robot's weight (`actuators`), a standing pose (`pose`), a trial in both engines that raises the gains until the
//! robot stands, and a configuration scaled to the robot's size (`training`).

mod actuators;
mod legs;
mod pose;
mod sides;
mod training;
mod write;

use std::path::Path;
use std::sync::Arc;

use omniwalk_env::config::{EngineKind, EnvConfig};
use omniwalk_env::probe::{Hold, Standing, stand};
use omniwalk_env::robot::{self, Robot};

use actuators::Servo;
use legs::Leg;
use sides::Sides;

use crate::settings::Settings;

/// Length of the trial, s.
const STAND_SECONDS: f64 = 10.0;
/// Factors on the gains that are tried until the robot stands.
const STIFFER: [f64; 4] = [1.0, 1.5, 2.25, 3.4];

/// The files of a new robot folder, and what was guessed for them.
pub struct Draft {
    /// The robot as its folder will load.
    pub robot: Arc<Robot>,
    /// `robot.toml`.
    pub settings: String,
    /// `train.toml`, for a robot with two legs.
    pub training: Option<String>,
    /// What was found and what was guessed, a line each.
    pub notes: Vec<String>,
}

/// What is known of the robot so far.
struct Findings {
    sides: Option<Sides>,
    /// Joints that move no mass.
    locked: Vec<String>,
    legs: Vec<Leg>,
    servos: Vec<Servo>,
    nominal: Vec<(String, f64)>,
}

/// Drafts the folder of the robot in the file `urdf`; `folder` is the path by which the configuration will name it. The robot must
/// stand under the `defaults`.
///
/// # Errors
/// When the URDF makes no robot, or an engine does not take it.
pub fn draft(urdf: &Path, folder: &Path, defaults: &Settings) -> miette::Result<Draft> {
    let locked = robot::massless_joints(urdf)?;
    let bare = robot::load_with(urdf, &write::locked(&locked))?;
    let sides = Sides::find(bare.joints.iter().map(|joint| joint.name.as_str()));
    let (legs, mut notes) = legs::find(&bare, sides);
    notes.insert(0, sides::note(sides));
    if !locked.is_empty() {
        let names = locked.join(", ");
        notes.push(format!(
            "locked, as they move no mass: {names}; if they move, give their links an <inertial>"
        ));
    }
    let mut found = Findings {
        sides,
        locked,
        servos: actuators::guess(&bare, &legs),
        legs,
        nominal: Vec::new(),
    };
    found.sides = mirrored(urdf, &bare, &found, &mut notes);
    if !found.legs.is_empty() {
        let straight = robot::load_with(urdf, &write::settings(&bare, &found))?;
        found.nominal = pose::standing(&straight, &found.legs);
        notes.push("standing pose: knees bent, soles flat, centre of mass over their middle".into());
        if let Some(line) = stiffen(urdf, &bare, &mut found, &defaults.env)? {
            notes.push(line);
        }
    }
    let settings = write::settings(&bare, &found);
    let robot = Arc::new(robot::load_with(urdf, &settings)?);
    Ok(Draft {
        training: (!found.legs.is_empty()).then(|| training::text(&robot, folder, defaults)),
        robot,
        settings,
        notes,
    })
}

/// The words for left and right, if the robot's two sides are mirror images of each other.
fn mirrored(urdf: &Path, bare: &Robot, found: &Findings, notes: &mut Vec<String>) -> Option<Sides> {
    let sides = found.sides?;
    match robot::load_with(urdf, &write::settings(bare, found)) {
        Ok(_) => Some(sides),
        Err(error) => {
            notes.push(format!("no mirror map: {error}"));
            None
        }
    }
}

/// Raises the gains until the robot stands in both engines; returns what there is to say about it.
fn stiffen(urdf: &Path, bare: &Robot, found: &mut Findings, config: &EnvConfig) -> miette::Result<Option<String>> {
    let servos = found.servos.clone();
    for factor in STIFFER {
        found.servos = servos.iter().map(|servo| servo.stiffer(factor)).collect();
        let robot = Arc::new(robot::load_with(urdf, &write::settings(bare, found))?);
        if stands(&robot, config)? {
            let seconds = STAND_SECONDS;
            return Ok(Some(format!(
                "gains: with {factor} times the first guess it stands {seconds} s in both engines"
            )));
        }
    }
    found.servos = servos;
    let line = "gains: it does not stand by its servos alone, whatever they are: look at feet, pose and torque limits";
    Ok(Some(line.into()))
}

fn stands(robot: &Arc<Robot>, config: &EnvConfig) -> miette::Result<bool> {
    let mut config = config.clone();
    let mut all = true;
    for kind in EngineKind::ALL {
        config.engine.kind = kind;
        let Standing { fell_after, .. } = stand(robot, &config, Hold::Nominal, STAND_SECONDS)?;
        all &= fell_after.is_none();
    }
    Ok(all)
}
