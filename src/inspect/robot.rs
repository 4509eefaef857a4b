//! Describes a robot: its joints, links and feet, and whether it stands.

use std::path::Path;
use std::sync::Arc;

use miette::Report;
use omniwalk_env::EnvError;
use omniwalk_env::config::{EngineKind, EnvConfig};
use omniwalk_env::probe::{Hold, Standing, mirror_difference, stand};
use omniwalk_env::robot::{self, Base, Robot};

use crate::config::Layers;
use crate::settings::Settings;

/// Length of the standing probe, s.
const STAND_SECONDS: f64 = 10.0;
/// Length of the mirrored motions, s: a landing and a sway.
const MIRROR_SECONDS: f64 = 1.0;

pub(super) fn describe(path: &Path, defaults: &Layers) -> Result<String, Report> {
    let robot = Arc::new(robot::load(path)?);
    let mut text = robot::describe(&robot);
    if robot.base == Base::Floating && !robot.feet.is_empty() && !robot.policy.is_empty() {
        let mut config = defaults.build::<Settings>()?.0.env;
        text += &format!(
            "\nunder its position servos alone ({} Hz physics, {} Hz control)\n",
            config.engine.physics_hz, config.engine.control_hz
        );
        for (engine, name) in [(EngineKind::Rapier, "rapier"), (EngineKind::Lanes, "lanes")] {
            config.engine.kind = engine;
            text += &match probe(&robot, &config) {
                Ok(lines) => format!("  {name}\n{lines}"),
                Err(error) => format!("  {name} does not take this robot: {error}\n"),
            };
        }
    }
    Ok(text)
}

fn probe(robot: &Arc<Robot>, config: &EnvConfig) -> Result<String, EnvError> {
    let held = stand(robot, config, Hold::Nominal, STAND_SECONDS)?;
    let yielding = stand(robot, config, Hold::Measured, STAND_SECONDS)?;
    let mut lines = format!(
        "    targets at the nominal pose   {}\n    zero increments               {}\n",
        posture(&held),
        posture(&yielding)
    );
    lines += &match held.fell_after {
        None => format!("    contact force over weight     {:.4}\n", held.force_over_weight),
        Some(_) => "    contact force over weight     not measured, it fell\n".to_owned(),
    };
    lines += &match mirror_difference(robot, config, MIRROR_SECONDS)? {
        Some(difference) => format!(
            "    mirrored start                differs by {difference:.1e} rad or m from the mirrored motion within \
             {MIRROR_SECONDS} s\n"
        ),
        None => "    mirrored start                no mirror map\n".to_owned(),
    };
    Ok(lines)
}

fn posture(standing: &Standing) -> String {
    match standing.fell_after {
        Some(after) => format!("falls within {after:.2} s"),
        None => format!(
            "stands {STAND_SECONDS} s, sinks {:.1} cm, tilts {:.3} rad, moves {:.1} cm",
            100.0 * standing.sunk,
            standing.tilt,
            100.0 * standing.moved
        ),
    }
}
