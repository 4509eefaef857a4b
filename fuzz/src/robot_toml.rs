//! `robot.toml` beside a URDF of two legs: every key has something to match.

use omniwalk_env::robot::load_with;

use super::scratch::with_file;
use super::urdf::usable;

const URDF: &[u8] = include_bytes!("../corpus/urdf/two_legs.urdf");

/// Loads `data` as the TOML of the two-legged robot.
pub fn check(data: &[u8]) {
    let Ok(toml) = std::str::from_utf8(data) else {
        return;
    };
    if let Ok(robot) = with_file("urdf", URDF, |path| load_with(path, toml)) {
        usable(robot);
    }
}
