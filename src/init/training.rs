//! The configuration of a first training: the defaults, which learn well on NimbRo-OP2X, for a robot of another size.

use std::path::Path;

use omniwalk_env::robot::{Kinematics, Robot};

use crate::settings::Settings;

/// Mass (kg) and height of the centre of mass over the soles (m) of the robot that the defaults are for, NimbRo-OP2X, in its nominal
/// pose (`omniwalk inspect`).
const REFERENCE: (f64, f64) = (19.0, 0.63);

/// `train.toml`. Lengths grow with the height of the centre of mass, times and speeds with its square root (equal Froude
/// numbers), forces with the weight: what `defaults` ask of NimbRo-OP2X, this asks of `robot`.
pub(super) fn text(robot: &Robot, folder: &Path, defaults: &Settings) -> String {
    let kinematics = Kinematics::new(robot);
    let height = kinematics
        .center_of_mass(robot.links.iter().map(|link| &link.inertial))
        .z;
    let (length, force) = (height / REFERENCE.1, robot.mass() / REFERENCE.0);
    let time = length.sqrt();
    let path = toml::Value::String(folder.display().to_string());
    let velocity = |[x, y, turn]: [f64; 3]| [x * time, y * time, turn / time].map(round).join(", ");
    let env = &defaults.env;
    format!(
        "# A first training of {name}: the defaults, scaled from a robot of 19 kg whose centre of mass is 0.63 m high to\n\
         # one of {mass:.1} kg and {height:.2} m. Lengths as the height, times and speeds as its root, forces as the weight.\n\
         # The config.toml of its run has every other key. `path` is seen from where omniwalk is started.\n\n\
         [robot]\npath = {path}\n\n\
         [command]\nlower = [{lower}]\nupper = [{upper}]\n\n\
         [clock]\nperiod = {period}\n\n\
         [reward]\nclearance = {clearance}\nswing_hysteresis = {hysteresis}\nvelocity_filter = {filter}\n\n\
         [randomise]\ncentre_of_mass = {centre}\n\n\
         [push]\nforce = {push}\n\n\
         [curriculum]\ncore = [{core}]\n",
        name = robot.name,
        mass = robot.mass(),
        lower = velocity(env.command.lower),
        upper = velocity(env.command.upper),
        period = round(env.clock.period * time),
        clearance = round(env.reward.clearance * length),
        hysteresis = round(env.reward.swing_hysteresis * length),
        filter = round(env.reward.velocity_filter * time),
        centre = round(env.randomise.centre_of_mass * length),
        push = round(env.push.force * force),
        core = velocity(defaults.curriculum.core),
    )
}

/// The value with the two digits that a guess is worth, as a TOML float.
pub(super) fn round(value: f64) -> String {
    let digits: f64 = format!("{value:.1e}").parse().unwrap_or(value);
    format!("{digits:?}")
}

#[cfg(test)]
mod tests {
    use super::round;

    #[test]
    fn numbers_are_written_with_two_digits_and_a_point() {
        for (value, text) in [
            (0.05136, "0.051"),
            (-0.6, "-0.6"),
            (133.1, "130.0"),
            (2.0, "2.0"),
            (0.0, "0.0"),
            (0.0099, "0.0099"),
        ] {
            assert_eq!(round(value), text);
        }
    }
}
