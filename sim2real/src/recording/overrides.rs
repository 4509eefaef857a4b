//! Parameters of the robot that a log may override, and the values they may have.

use omniwalk_env::effect::Kind;

/// Largest magnitude of a value, SI units, as in a robot's TOML: beyond it lie mistakes and overflow.
const MOST: f64 = 1e9;
/// Largest armature, kg m^2 or kg, as there.
const MOST_ARMATURE: f64 = 1e3;

/// Key of the mass that the last link carries.
pub(crate) const PAYLOAD: &str = "payload.mass";
/// Key of the voltage at the motors.
pub(crate) const SUPPLY: &str = "supply_voltage";

/// A parameter that can be overridden.
struct Parameter {
    key: &'static str,
    /// Whether it may be zero.
    zero: bool,
    /// What it is, and its unit.
    what: &'static str,
}

const fn parameter(key: &'static str, zero: bool, what: &'static str) -> Parameter {
    Parameter { key, zero, what }
}

const PARAMETERS: [Parameter; 10] = [
    parameter("kp", false, "stiffness, N m/rad"),
    parameter("kp_scale", false, "factor on kp"),
    parameter("kd", true, "velocity gain, N m s/rad"),
    parameter("torque_limit", false, "largest torque, N m"),
    parameter("speed_limit", false, "speed without torque, rad/s"),
    parameter("armature", true, "rotor inertia, kg m^2"),
    parameter("damping", true, "viscous friction, N m s/rad"),
    parameter("friction", true, "dry friction, N m"),
    parameter(SUPPLY, false, "voltage at the motors, V"),
    parameter(PAYLOAD, true, "mass on the last link, kg"),
];

impl Parameter {
    /// Its largest value.
    fn most(&self) -> f64 {
        let of_effect = |kind: Kind| kind.info().parameters[0].bounds.upper;
        match self.key {
            SUPPLY => of_effect(Kind::SupplyVoltage),
            PAYLOAD => of_effect(Kind::Payload),
            "armature" => MOST_ARMATURE,
            _ => MOST,
        }
    }
}

/// The joint that `key` is of, if it is one's, and the parameter's name.
pub(crate) fn parts(key: &str) -> (Option<&str>, &str) {
    match key.strip_prefix("joint.").and_then(|rest| rest.rsplit_once('.')) {
        Some((joint, name)) => (Some(joint), name),
        None => (None, key),
    }
}

fn named(key: &str) -> Option<&'static Parameter> {
    let (joint, name) = parts(key);
    let own = PARAMETERS.iter().find(|parameter| parameter.key == name);
    own.filter(|parameter| joint.is_none() || parameter.key != PAYLOAD)
}

/// Whether `key` names a parameter.
pub(crate) fn exists(key: &str) -> bool {
    named(key).is_some()
}

/// Whether `key` is of a parameter that identification fits one value of to all logs.
pub(crate) fn is_tuned(key: &str) -> bool {
    named(key).is_some_and(|parameter| !["kp", SUPPLY, PAYLOAD].contains(&parameter.key))
}

/// What would be right, for a value that `key` cannot have; `None` for one that it can, and for what names no parameter.
pub(crate) fn right_instead(key: &str, value: f64) -> Option<String> {
    let parameter = named(key)?;
    let Parameter { key, zero, what } = parameter;
    let enough = if *zero { value >= 0.0 } else { value > 0.0 };
    let least = if *zero { "zero or more" } else { "more than zero" };
    let fits = enough && value <= parameter.most();
    (!fits).then(|| format!("{key} ({what}) is {least}, and at most {}", parameter.most()))
}

/// Which parameters there are, for help.
pub(crate) fn keys() -> String {
    let keys: Vec<&str> = PARAMETERS.iter().map(|parameter| parameter.key).collect();
    format!(
        "{} can be overridden, those of joints also as joint.NAME.kp for one joint",
        keys.join(", ")
    )
}
