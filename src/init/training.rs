//! The configuration of a first training: the defaults, which learn well on NimbRo-OP2X, for a robot of another size.

use std::path::Path;

use omniwalk_env::robot::{Kinematics, Robot};

/// Mass (kg) and height of the centre of mass over the soles (m) of NimbRo-OP2X in its nominal pose (`omniwalk inspect`).
const REFERENCE: (f64, f64) = (19.0, 0.63);

/// `train.toml`. Lengths grow with the height of the centre of mass, times and speeds with its square root (equal Froude
/// numbers), forces with the weight: what the defaults ask of NimbRo-OP2X, this asks of `robot`.
pub(super) fn text(robot: &Robot, folder: &Path) -> String {
    let kinematics = Kinematics::new(robot);
    let height = kinematics
        .center_of_mass(robot.links.iter().map(|link| &link.inertial))
        .z;
    let (length, force) = (height / REFERENCE.1, robot.mass() / REFERENCE.0);
    let time = length.sqrt();
    let (speed, turn) = (0.6 * time, 0.6 / time);
    let path = toml::Value::String(folder.display().to_string());
    format!(
        "# A first training of {name}: the defaults, scaled from a robot of 19 kg whose centre of mass is 0.63 m high to\n\
         # one of {mass:.1} kg and {height:.2} m. Lengths as the height, times and speeds as its root, forces as the weight.\n\
         # The config.toml of its run has every other key. `path` is seen from where omniwalk is started.\n\n\
         [robot]\npath = {path}\n\n\
         [command]\nlower = [{back}, {back}, {right}]\nupper = [{speed}, {speed}, {turn}]\n\n\
         [clock]\nperiod = {period}\n\n\
         [reward]\nclearance = {clearance}\nswing_hysteresis = {hysteresis}\nvelocity_filter = {filter}\n\n\
         [randomise]\ncentre_of_mass = {centre}\n\n\
         [push]\nforce = {push}\n\n\
         [curriculum]\ncore = [{core}, 0.0, 0.0]\n",
        name = robot.name,
        mass = robot.mass(),
        back = round(-speed),
        right = round(-turn),
        speed = round(speed),
        turn = round(turn),
        period = round(0.6 * time),
        clearance = round(0.05 * length),
        hysteresis = round(0.01 * length),
        filter = round(0.5 * time),
        centre = round(0.02 * length),
        push = round(90.0 * force),
        core = round(0.3 * time),
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
