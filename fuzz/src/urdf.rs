//! URDFs: whatever loads is a robot of finite numbers that either engine takes or refuses.

use std::sync::Arc;

use omniwalk_env::EnvConfig;
use omniwalk_env::config::EngineKind;
use omniwalk_env::plant::Plant;
use omniwalk_env::robot::{Robot, load_with};

use super::scratch::with_file;

/// Most degrees of freedom of a robot that is put into the engines: more take long and show nothing new.
const MOST_SIMULATED: usize = 12;

/// Loads `data` as a URDF without a TOML.
pub fn check(data: &[u8]) {
    if let Ok(robot) = with_file("urdf", data, |path| load_with(path, "")) {
        usable(robot);
    }
}

/// What is loaded can be described, controlled and simulated, or is refused with a reason.
pub fn usable(robot: Robot) {
    for link in &robot.links {
        let inertial = &link.inertial;
        assert!(inertial.mass.is_finite() && inertial.mass >= 0.0, "link {}", link.name);
        assert!(inertial.inertia.iter().all(|x| x.is_finite()), "link {}", link.name);
    }
    for joint in &robot.joints {
        assert!(joint.nominal.is_finite(), "joint {}", joint.name);
    }
    let robot = Arc::new(robot);
    let _ = (robot.joint_specs(0.3), robot.legs());
    if robot.dofs.is_empty() || robot.dofs.len() > MOST_SIMULATED {
        return;
    }
    for kind in [EngineKind::Lanes, EngineKind::Rapier] {
        simulated(&robot, kind);
    }
}

/// A few steps: numbers may leave the physically possible, and then the engine knows.
fn simulated(robot: &Arc<Robot>, kind: EngineKind) {
    let mut config: EnvConfig = toml::from_str(include_str!("../../configs/default.toml")).expect("the defaults");
    config.engine.kind = kind;
    let Ok(mut plant) = Plant::new(robot, &config, 1) else {
        return;
    };
    for _ in 0..3 {
        plant.step();
    }
    let state = plant.joints();
    let finite = state.position.iter().chain(&state.velocity).all(|x| x.is_finite());
    assert!(finite || !plant.is_finite(), "numbers that are none are not noticed");
}
