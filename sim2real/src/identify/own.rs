//! The parameters that a nominal model has: which there are, and how logs override them.

use std::collections::BTreeMap;

use omniwalk_env::effect::{self, Effect, Kind, Parameter, Scale};
use omniwalk_env::robot::Robot;

use super::model::Model;
pub(super) use crate::recording::overrides::PAYLOAD;
use crate::recording::overrides::{self, SUPPLY};

/// A parameter the nominal model already has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Own {
    /// Stiffness over `kp`.
    KpScale,
    /// Velocity gain.
    Kd,
    /// Largest torque.
    TorqueLimit,
    /// Speed without torque.
    SpeedLimit,
    /// Rotor inertia.
    Armature,
    /// Viscous friction.
    Damping,
    /// Dry friction.
    Friction,
    /// A number of an effect that the robot's files have.
    OfEffect {
        /// Which effect.
        kind: Kind,
        /// Which of its numbers, in the catalogue's order.
        number: usize,
    },
}

impl Own {
    /// Those that joints have without effects.
    pub const OF_JOINT: [Self; 7] = [
        Self::KpScale,
        Self::Kd,
        Self::TorqueLimit,
        Self::SpeedLimit,
        Self::Armature,
        Self::Damping,
        Self::Friction,
    ];

    /// Those of degree of freedom `dof` of `robot`, and of the effects there. What is measured (a supply's voltage), what is no number (a table)
    /// and what does nothing as it is are left as they are; so are masses and loads, which are parts of their links once a robot is read.
    pub fn all(robot: &Robot, dof: usize) -> Vec<Self> {
        let own = robot.effects.iter().filter(|effect| {
            effect.kind.runs() && effect.target == dof && effect.table.is_none() && effect.kind != Kind::SupplyVoltage
        });
        let numbers = own.flat_map(|effect| {
            let parameters = effect.kind.info().parameters.iter().zip(&effect.values).enumerate();
            let told = parameters.filter(|(_, (own, value))| !own.starts.is_empty() && own.neutral != Some(**value));
            told.map(|(number, _)| Self::OfEffect {
                kind: effect.kind,
                number,
            })
        });
        Self::OF_JOINT.into_iter().chain(numbers).collect()
    }

    /// Its parameter in the catalogue, of a number of an effect.
    pub fn parameter(self) -> Option<&'static Parameter> {
        match self {
            Self::OfEffect { kind, number } => kind.info().parameters.get(number),
            _ => None,
        }
    }

    /// What it is called: a key of a joint in a robot's TOML, or an effect and its key.
    pub fn name(self) -> String {
        match (self, self.parameter()) {
            (Self::OfEffect { kind, .. }, Some(parameter)) => format!("{}.{}", kind.id(), parameter.name),
            _ => self.key().to_owned(),
        }
    }

    /// Its key in a robot's TOML, in the entry of its joint or its effect.
    pub fn key(self) -> &'static str {
        match self {
            Self::OfEffect { .. } => self.parameter().map_or("", |parameter| parameter.name),
            Self::KpScale => "kp_scale",
            Self::Kd => "kd",
            Self::TorqueLimit => "torque_limit",
            Self::SpeedLimit => "speed_limit",
            Self::Armature => "armature",
            Self::Damping => "damping",
            Self::Friction => "friction",
        }
    }

    /// What it is measured in.
    pub fn scale(self) -> Scale {
        match self {
            Self::KpScale => Scale::One,
            Self::Kd | Self::Damping => Scale::Damping,
            Self::TorqueLimit | Self::Friction => Scale::Torque,
            Self::SpeedLimit => Scale::Speed,
            Self::Armature => Scale::Inertia,
            Self::OfEffect { .. } => self.parameter().map_or(Scale::One, |parameter| parameter.scale),
        }
    }

    /// Where it stands, on degree of freedom `dof` of a robot.
    pub fn of(self, robot: &mut Robot, dof: usize) -> Option<&mut f64> {
        let joint = &mut robot.joints[robot.dofs[dof]];
        match self {
            Self::OfEffect { kind, number } => {
                let mut effects = robot.effects.iter_mut();
                let own = effects.find(|effect| (effect.kind, effect.target) == (kind, dof))?;
                own.values.get_mut(number)
            }
            Self::Armature => Some(&mut joint.passive.armature),
            Self::Damping => Some(&mut joint.passive.damping),
            Self::Friction => Some(&mut joint.passive.friction),
            _ => {
                let actuator = joint.actuator.as_mut()?;
                Some(match self {
                    Self::KpScale => &mut actuator.kp_scale,
                    Self::Kd => &mut actuator.kd,
                    Self::TorqueLimit => &mut actuator.torque_limit,
                    _ => &mut actuator.speed_limit,
                })
            }
        }
    }

    /// The effect whose value, or of which a number, it is.
    pub fn kind(self) -> Option<Kind> {
        match self {
            Self::TorqueLimit => Some(Kind::TorqueLimit),
            Self::SpeedLimit => Some(Kind::SpeedTorqueCurve),
            Self::Armature => Some(Kind::Armature),
            Self::Damping => Some(Kind::ViscousFriction),
            Self::Friction => Some(Kind::CoulombFriction),
            Self::OfEffect { kind, .. } => Some(kind),
            Self::KpScale | Self::Kd => None,
        }
    }
}

/// Why a parameter cannot be overridden.
#[derive(Clone, Debug, PartialEq)]
pub enum Refused {
    /// There is none of this name.
    Unknown,
    /// It cannot have this value; what would be right.
    Value(String),
}

/// A robot as it was in a log.
#[derive(Clone, Debug)]
pub struct Logged {
    robot: Robot,
    /// Mass on the last link, kg.
    carried: f64,
}

impl Logged {
    /// `robot` with the `overrides` of a log.
    ///
    /// # Errors
    /// The key and value that are [`Refused`].
    pub fn new(robot: &Robot, overrides: &BTreeMap<String, f64>) -> Result<Self, (String, f64, Refused)> {
        let mut robot = robot.clone();
        for (key, &value) in overrides {
            override_value(&mut robot, key, value).map_err(|refused| (key.clone(), value, refused))?;
        }
        let carried = overrides.get(PAYLOAD).copied().unwrap_or(0.0);
        Ok(Self { robot, carried })
    }

    /// With the parameters and effects of `model`. What it carried comes on top of what its links weigh by them.
    pub fn with(&self, model: &Model) -> Robot {
        let mut robot = model.robot(&self.robot);
        if self.carried > 0.0 {
            let link = robot.links.len() - 1;
            let com = robot.links[link].inertial.com;
            let payload = Effect::new(Kind::Payload, link, &[self.carried, com.x, com.y, com.z]);
            effect::apply(&mut robot, &payload);
        }
        robot
    }
}

/// Sets the parameter `key` of `robot`. What changes nothing is taken as it is: a joint without stiffness may be told to have none; a payload
/// is only looked at.
///
/// # Errors
/// [`Refused`] when there is no such parameter, or it cannot have this value.
fn override_value(robot: &mut Robot, key: &str, value: f64) -> Result<(), Refused> {
    let wrong = overrides::right_instead(key, value);
    if key == PAYLOAD {
        return wrong.map_or(Ok(()), |right| Err(Refused::Value(right)));
    }
    let (joint, name) = overrides::parts(key);
    let mut any = Err(Refused::Unknown);
    for d in 0..robot.dofs.len() {
        let own = robot.dof(d);
        if joint.is_some_and(|joint| own.name != joint) || own.actuator.is_none() {
            continue;
        }
        match (place(robot, d, name), &wrong) {
            (None, _) if name != SUPPLY => continue,
            (Some(own), Some(right)) if *own != value => return Err(Refused::Value(right.clone())),
            (Some(own), _) => *own = value,
            // Without a nominal voltage among the robot's effects there is nothing to compare it with: the check says so.
            (None, Some(right)) => return Err(Refused::Value(right.clone())),
            (None, None) => {}
        }
        any = Ok(());
    }
    any
}

/// Where the parameter `name` of degree of freedom `d`, which has a motor, stands.
fn place<'r>(robot: &'r mut Robot, d: usize, name: &str) -> Option<&'r mut f64> {
    if name == SUPPLY {
        let mut effects = robot.effects.iter_mut();
        let own = effects.find(|e| e.kind == Kind::SupplyVoltage && e.target == d)?;
        return own.values.first_mut();
    }
    if name == "kp" {
        return Some(&mut robot.joints[robot.dofs[d]].actuator.as_mut()?.kp);
    }
    Own::OF_JOINT.into_iter().find(|own| own.key() == name)?.of(robot, d)
}

#[cfg(test)]
mod tests {
    use super::super::model::Term;
    use super::*;

    const URDF: &str = r#"<robot name="arm"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#;
    const TOML: &str = "base = \"fixed\"\n[[joint]]\nmatch = [\"*\"]\nkp = 0.0\nkd = 1.0\ntorque_limit = 5.0\nspeed_limit = 9.0\n\
        [[effect]]\nid = \"supply_voltage\"\nmatch = [\"*\"]\nactual = 12.0\nnominal = 12.0\n";

    fn arm() -> Robot {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("arm.urdf"), URDF).expect("written");
        std::fs::write(folder.path().join("robot.toml"), TOML).expect("written");
        omniwalk_env::robot::load(folder.path()).expect("a robot")
    }

    #[test]
    fn every_parameter_that_is_known_can_be_overridden_and_no_other_and_by_no_value_that_it_cannot_have() {
        let good = [
            "kp",
            "kp_scale",
            "kd",
            "torque_limit",
            "speed_limit",
            "armature",
            "damping",
            "friction",
            SUPPLY,
            PAYLOAD,
        ];
        for key in good {
            let of_joint = format!("joint.hinge.{key}");
            assert!(overrides::exists(key), "{key}");
            assert_eq!(override_value(&mut arm(), key, 2.0), Ok(()), "{key}");
            let right = if key == PAYLOAD { Err(Refused::Unknown) } else { Ok(()) };
            assert_eq!(override_value(&mut arm(), &of_joint, 2.0), right, "{of_joint}");
            for value in [-1.0, f64::NAN, f64::INFINITY, 2e9] {
                let refused = override_value(&mut arm(), key, value);
                assert!(matches!(refused, Err(Refused::Value(_))), "{key} {value}");
            }
        }
        for (key, zero) in [("kd", true), ("torque_limit", false), (SUPPLY, false), (PAYLOAD, true)] {
            assert_eq!(override_value(&mut arm(), key, 0.0).is_ok(), zero, "{key}");
        }
        assert_eq!(override_value(&mut arm(), "joint.knee.kp", 2.0), Err(Refused::Unknown));
        // What it has already.
        assert_eq!(override_value(&mut arm(), "kp", 0.0), Ok(()));
        let mut robot = arm();
        override_value(&mut robot, SUPPLY, 9.0).expect("a voltage");
        assert_eq!(robot.effects[0].values, [9.0, 12.0]);
    }

    #[test]
    fn what_is_carried_comes_on_top_of_what_a_link_weighs_by_a_model() {
        let carried = BTreeMap::from([(PAYLOAD.to_owned(), 0.5)]);
        let logged = Logged::new(&arm(), &carried).expect("a payload");
        let heavier = Term {
            kind: Kind::Mass,
            target: 1,
            values: vec![2.0],
            free: vec![0],
            table: None,
            held: false,
        };
        let model = Model {
            tuned: Vec::new(),
            terms: vec![heavier],
        };
        assert_eq!(logged.with(&model).links[1].inertial.mass, 2.5);
        assert_eq!(logged.with(&Model::default()).links[1].inertial.mass, 1.5);
    }
}
