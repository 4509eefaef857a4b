//! `robot.toml`: what a URDF cannot say.
//!
//! ```toml
//! base = "floating"                      # or "fixed"; default: floating if the robot has feet
//! locked = ["neck_yaw", "head_pitch"]    # held rigidly at their nominal position
//! policy = ["left_*", "right_*"]         # the joints the policy moves, in its order; default: all with an actuator
//! overlap_pairs = [["left_foot", "right_foot"]]
//!
//! [[joint]]                              # later entries win; `*` stands for any characters
//! match = ["*_hip_pitch", "*_knee"]
//! kp = 300.0
//! kp_scale = 1.0                         # stiffness the joint really has over kp, the one that is set
//! kd = 5.0
//! torque_limit = 50.0                    # default: the URDF's effort
//! speed_limit = 4.0                      # default: the URDF's velocity
//! armature = 0.1
//! damping = 0.0                          # default: the URDF's dynamics
//! friction = 0.0
//! nominal = 0.2
//! limits = [-1.0, 1.0]                   # default: the URDF's
//!
//! [[foot]]
//! name = "left"
//! link = "left_foot"
//! sole = [0.03, 0.0, -0.05]              # centre of the sole in the link frame, m
//! rpy = [0.0, 0.0, 0.0]                  # orientation of the sole in the link frame
//! size = [0.2, 0.1]                      # length along x, width along y, m
//!
//! [mirror]
//! left = "left"                          # the words that tell left and right joints apart
//! right = "right"
//! signs = { left_elbow = -1.0 }          # only where the sign does not follow from the axes
//!
//! [[contact]]                            # more points that touch the ground
//! link = "trunk"
//! points = [[0.0, 0.0, 0.3]]
//!
//! [[effect]]                             # see `crate::effect` for names and parameters
//! id = "stribeck_friction"
//! match = ["*_knee"]
//! torque = 0.4
//! velocity = 0.2
//!
//! [[effect]]                             # a measured torque, linear between the points of its grid
//! id = "residual_torque"
//! match = ["left_knee"]
//! over = ["position"]
//! position = [-1.0, 0.0, 1.0]
//! values = [0.1, 0.0, -0.1]              # friction = true where it is dry friction
//!
//! [[range]]                              # an effect's values that environments draw, uniformly; `identify` writes its intervals
//! id = "stribeck_friction"
//! match = ["*_knee"]
//! torque = [0.3, 0.5]
//! ```

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;

use super::Base;
use super::source::{RobotError, Source};

/// Largest magnitude of any value, SI units: beyond it lie mistakes and overflow.
const MAX_VALUE: f64 = 1e9;
/// Largest armature, kg m^2 or kg: a thousand times that of a geared servo as large as a leg. What carries more does not move.
const MAX_ARMATURE: f64 = 1e3;

/// A robot's TOML as written.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    pub base: Option<BaseSetting>,
    pub locked: Vec<Spanned<String>>,
    pub policy: Option<Vec<Spanned<String>>>,
    pub overlap_pairs: Vec<[Spanned<String>; 2]>,
    pub joint: Vec<Spanned<JointEntry>>,
    pub foot: Vec<FootEntry>,
    pub mirror: Option<Mirror>,
    pub contact: Vec<ContactEntry>,
    pub effect: Vec<EffectEntry>,
    pub range: Vec<EffectEntry>,
}

/// The keys of an `[[effect]]` or a `[[range]]`: which there are depends on its id.
pub(super) type EffectEntry = BTreeMap<Spanned<String>, Spanned<toml::Value>>;

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum BaseSetting {
    Floating,
    Fixed,
}

impl From<BaseSetting> for Base {
    fn from(setting: BaseSetting) -> Self {
        match setting {
            BaseSetting::Floating => Base::Floating,
            BaseSetting::Fixed => Base::Fixed,
        }
    }
}

/// What holds for the joints whose names match; as a merged result, what holds for one joint.
#[derive(Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JointEntry {
    #[serde(rename = "match")]
    pub names: Vec<Spanned<String>>,
    pub kp: Option<Spanned<f64>>,
    pub kp_scale: Option<Spanned<f64>>,
    pub kd: Option<Spanned<f64>>,
    pub torque_limit: Option<Spanned<f64>>,
    pub speed_limit: Option<Spanned<f64>>,
    pub armature: Option<Spanned<f64>>,
    pub damping: Option<Spanned<f64>>,
    pub friction: Option<Spanned<f64>>,
    pub nominal: Option<Spanned<f64>>,
    pub limits: Option<Spanned<[f64; 2]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FootEntry {
    pub name: Option<String>,
    pub link: Spanned<String>,
    pub sole: Spanned<[f64; 3]>,
    #[serde(default)]
    pub rpy: Option<Spanned<[f64; 3]>>,
    pub size: Spanned<[f64; 2]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Mirror {
    pub left: Spanned<String>,
    pub right: Spanned<String>,
    #[serde(default)]
    pub signs: BTreeMap<Spanned<String>, Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ContactEntry {
    pub link: Spanned<String>,
    pub points: Spanned<Vec<[f64; 3]>>,
}

impl Settings {
    /// Parses the TOML and checks every value by itself.
    pub fn new(source: &Source) -> Result<Self, RobotError> {
        let settings: Self = toml::from_str(&source.text).map_err(|error| {
            source.error(
                error.span().unwrap_or(0..0),
                error.message(),
                "see the robot reference for keys and types",
            )
        })?;
        for entry in &settings.joint {
            entry.get_ref().check(entry.span(), source)?;
        }
        for foot in &settings.foot {
            let rpy = foot.rpy.iter().map(|rpy| (rpy.span(), &rpy.get_ref()[..]));
            for (span, values) in rpy.chain([(foot.sole.span(), &foot.sole.get_ref()[..])]) {
                check(
                    source,
                    span,
                    values,
                    f64::NEG_INFINITY,
                    "a sole's pose is made of finite numbers",
                )?;
            }
            check(
                source,
                foot.size.span(),
                foot.size.get_ref(),
                f64::MIN_POSITIVE,
                "length and width of a sole are above zero",
            )?;
        }
        for contact in &settings.contact {
            let points = contact.points.get_ref().as_flattened();
            check(
                source,
                contact.points.span(),
                points,
                f64::NEG_INFINITY,
                "points are made of finite numbers",
            )?;
        }
        for sign in settings.mirror.iter().flat_map(|mirror| mirror.signs.values()) {
            if sign.get_ref().abs() != 1.0 {
                return Err(source.error(
                    sign.span(),
                    format!("a sign of {}", sign.get_ref()),
                    "a sign is 1 or -1",
                ));
            }
        }
        Ok(settings)
    }

    /// What holds for the joint `name`: of each key the last entry that matches and sets it.
    pub fn joint(&self, name: &str) -> JointEntry {
        let mut merged = JointEntry::default();
        let named = |entry: &&JointEntry| entry.names.iter().any(|pattern| matches(pattern.get_ref(), name));
        for entry in self.joint.iter().map(Spanned::get_ref).filter(named) {
            let JointEntry {
                names: _,
                kp,
                kp_scale,
                kd,
                torque_limit,
                speed_limit,
                armature,
                damping,
                friction,
                nominal,
                limits,
            } = entry;
            for (to, from) in [
                (&mut merged.kp, kp),
                (&mut merged.kp_scale, kp_scale),
                (&mut merged.kd, kd),
                (&mut merged.torque_limit, torque_limit),
                (&mut merged.speed_limit, speed_limit),
                (&mut merged.armature, armature),
                (&mut merged.damping, damping),
                (&mut merged.friction, friction),
                (&mut merged.nominal, nominal),
            ] {
                if from.is_some() {
                    to.clone_from(from);
                }
            }
            merged.limits = limits.clone().or(merged.limits);
        }
        merged
    }
}

impl JointEntry {
    fn check(&self, at: Range<usize>, source: &Source) -> Result<(), RobotError> {
        if self.names.is_empty() {
            let help = "name joints, for example match = [\"*_knee\"], or leave the entry out";
            return Err(source.error(at, "an entry that matches no joint", help));
        }
        for (value, lowest, help) in [
            (&self.kp, 0.0, "kp is a stiffness: zero or positive, N m/rad"),
            (&self.kp_scale, 0.0, "kp_scale is a factor: zero or positive"),
            (&self.kd, 0.0, "kd is a damping: zero or positive, N m s/rad"),
            (&self.torque_limit, f64::MIN_POSITIVE, "a torque limit is positive, N m"),
            (&self.speed_limit, f64::MIN_POSITIVE, "a speed limit is positive, rad/s"),
            (&self.armature, 0.0, "armature is an inertia: zero or positive, kg m^2"),
            (&self.damping, 0.0, "damping is zero or positive, N m s/rad"),
            (&self.friction, 0.0, "friction is zero or positive, N m"),
            (&self.nominal, f64::NEG_INFINITY, "a position is a finite number, rad"),
        ] {
            if let Some(value) = value {
                check(source, value.span(), &[*value.get_ref()], lowest, help)?;
            }
        }
        if let Some(armature) = self.armature.as_ref().filter(|value| *value.get_ref() > MAX_ARMATURE) {
            return Err(source.error(
                armature.span(),
                format!("an armature of {:e} kg m^2", armature.get_ref()),
                "a rotor's inertia times the square of its gear ratio is 0.001 to 1 kg m^2 in a humanoid",
            ));
        }
        let Some(limits) = &self.limits else { return Ok(()) };
        let [lower, upper] = *limits.get_ref();
        check(
            source,
            limits.span(),
            &[lower, upper],
            f64::NEG_INFINITY,
            "limits are finite, rad",
        )?;
        if lower >= upper {
            let message = format!("lower limit {lower} is not below upper limit {upper}");
            return Err(source.error(limits.span(), message, "write limits = [lower, upper]"));
        }
        Ok(())
    }
}

fn check(source: &Source, at: Range<usize>, values: &[f64], lowest: f64, help: &str) -> Result<(), RobotError> {
    match values
        .iter()
        .find(|value| !value.is_finite() || value.abs() > MAX_VALUE || **value < lowest)
    {
        Some(value) => Err(source.error(at, format!("impossible value {value}"), help)),
        None => Ok(()),
    }
}

/// Whether `name` matches `pattern`, in which `*` stands for any characters. Each part between stars is taken where it comes first,
/// which leaves the most for those behind it: no other place is tried.
pub(crate) fn matches(pattern: &str, name: &str) -> bool {
    let Some((head, others)) = pattern.split_once('*') else {
        return pattern == name;
    };
    let Some(mut rest) = name.strip_prefix(head) else {
        return false;
    };
    let (between, tail) = others.rsplit_once('*').unwrap_or(("", others));
    for part in between.split('*') {
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
    }
    rest.ends_with(tail)
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::matches;

    #[test]
    fn stars_stand_for_any_characters() {
        for (pattern, name) in [
            ("left_knee", "left_knee"),
            ("*", ""),
            ("*_knee", "left_knee"),
            ("left_*", "left_knee"),
            ("l*_k*e", "left_knee"),
            ("**", "x"),
            ("a*b*b", "abb"),
            ("*é*", "aéb"),
        ] {
            assert!(matches(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [
            ("", "x"),
            ("a*a", "a"),
            ("a*b*b", "ab"),
            ("*_knee", "left_knee_pitch"),
            ("x*", "left"),
        ] {
            assert!(!matches(pattern, name), "{pattern} {name}");
        }
    }

    /// Every star used to try every place: 25 of them took longer than the age of the universe.
    #[test]
    fn a_pattern_of_many_stars_is_matched_at_once() {
        let begin = Instant::now();
        assert!(!matches(&("*a".repeat(1000) + "b"), &"a".repeat(3000)));
        assert!(begin.elapsed() < Duration::from_secs(1));
    }
}
