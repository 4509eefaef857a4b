//! What the examples share.

use std::error::Error;

use omniwalk_env::engine::Engine;
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::robot::Robot;

/// One world of `rapier`, or of one of the lane types by its name.
pub fn make_engine(name: &str, robot: &Robot, dt: f64) -> Result<Box<dyn Engine>, Box<dyn Error>> {
    if name == "rapier" {
        return Ok(Box::new(Rapier::new(robot, dt, 1)?));
    }
    let level = Simd::ALL.into_iter().find(|level| level.name() == name);
    let level = level.ok_or_else(|| format!("no engine {name:?}; there are rapier and the lane types"))?;
    Ok(Box::new(Lanes::new(robot, dt, 1, level)?))
}
