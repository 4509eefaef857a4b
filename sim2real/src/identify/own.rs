//! The parameters that a nominal model has: which there are, and how logs override them.

use omniwalk_env::effect::{self, Effect, Kind, Scale};
use omniwalk_env::robot::{Joint, Robot};

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
}

impl Own {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::KpScale,
        Self::Kd,
        Self::TorqueLimit,
        Self::SpeedLimit,
        Self::Armature,
        Self::Damping,
        Self::Friction,
    ];

    /// Its key in a robot's TOML.
    pub fn key(self) -> &'static str {
        match self {
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
        }
    }

    /// Where it stands in a joint.
    pub fn of(self, joint: &mut Joint) -> Option<&mut f64> {
        match self {
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

    /// The effect whose value it is.
    pub fn kind(self) -> Option<Kind> {
        match self {
            Self::TorqueLimit => Some(Kind::TorqueLimit),
            Self::SpeedLimit => Some(Kind::SpeedTorqueCurve),
            Self::Armature => Some(Kind::Armature),
            Self::Damping => Some(Kind::ViscousFriction),
            Self::Friction => Some(Kind::CoulombFriction),
            Self::KpScale | Self::Kd => None,
        }
    }
}

/// Key of the mass that the last link carries.
pub const PAYLOAD: &str = "payload.mass";

/// Sets the parameter `key` of `robot`; `None` when there is no such parameter.
pub fn override_value(robot: &mut Robot, key: &str, value: f64) -> Option<()> {
    let (joint, key) = match key.strip_prefix("joint.").and_then(|rest| rest.rsplit_once('.')) {
        Some((joint, key)) => (Some(joint), key),
        None => (None, key),
    };
    if key == PAYLOAD {
        let link = robot.links.len() - 1;
        let com = robot.links[link].inertial.com;
        let payload = Effect::new(Kind::Payload, link, &[value, com.x, com.y, com.z]);
        effect::apply(robot, &payload);
        return Some(());
    }
    let mut any = None;
    for d in 0..robot.dofs.len() {
        let at = robot.dofs[d];
        if joint.is_some_and(|name| robot.joints[at].name != name) || robot.joints[at].actuator.is_none() {
            continue;
        }
        if key == "supply_voltage" {
            // Without a nominal voltage among the robot's effects there is nothing to compare it with.
            let own = robot
                .effects
                .iter_mut()
                .find(|e| e.kind == Kind::SupplyVoltage && e.target == d);
            if let Some(effect) = own {
                effect.values[0] = value;
            }
            any = Some(());
        } else if key == "kp" {
            robot.joints[at].actuator.as_mut()?.kp = value;
            any = Some(());
        } else if let Some(own) = Own::ALL.into_iter().find(|own| own.key() == key) {
            *own.of(&mut robot.joints[at])? = value;
            any = Some(());
        }
    }
    any
}
