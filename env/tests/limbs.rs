//! A robot on a stand is its limbs, each by itself.

use omniwalk_env::actuators::Actuators;
use omniwalk_env::effect::{self, Effect, Kind};
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::{Engine, Friction, Start, World};
use omniwalk_env::robot::{self, Robot};

const DT: f64 = 1e-3;

/// Where the degrees of freedom are after a second of a swing of each.
fn swung(robot: &Robot, names: &[String]) -> Vec<f64> {
    let mut engine = Lanes::new(robot, DT, 1, Simd::Scalar).expect("an engine");
    let mut actuators = Actuators::new(robot, DT, 1);
    let ground = Friction {
        tangential: 1.0,
        torsional: 0.0,
        rolling: 0.0,
    };
    let start = Start::nominal(robot);
    engine.reset(0, &start, &World::nominal(robot, ground));
    for (d, &q) in start.joints.iter().enumerate() {
        actuators.start(d, 0, (q, 0.0), q);
    }
    for step in 0..1000 {
        for (d, &q) in start.joints.iter().enumerate() {
            let joint = names
                .iter()
                .position(|name| *name == robot.dof(d).name)
                .expect("a name");
            let phase = (3.0 + joint as f64) * f64::from(step) * DT;
            actuators.set_target(d, 0, q + 0.2 * phase.sin());
        }
        engine.step(actuators.drive(engine.joints()));
        actuators.sense(engine.joints());
    }
    engine.joints().position.to_vec()
}

#[test]
fn limbs_move_as_they_do_on_the_whole_robot() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/nimbro_op2x");
    let mut whole = robot::load(std::path::Path::new(path)).expect("a robot").on_a_stand();
    let last = whole.dofs.len() - 1;
    effect::apply(&mut whole, &Effect::new(Kind::Backlash, last, &[0.02, 0.0, 0.7]));
    let names: Vec<String> = (0..=last).map(|d| whole.dof(d).name.clone()).collect();
    let all = swung(&whole, &names);
    let limbs = whole.limbs();
    assert!(limbs.len() > 1);
    let mut seen = vec![false; all.len()];
    for limb in limbs {
        for (own, &d) in swung(&limb.robot, &names).iter().zip(&limb.dofs) {
            assert!((own - all[d]).abs() < 1e-10, "{}: {own} beside {}", names[d], all[d]);
            seen[d] = true;
        }
    }
    assert!(seen.iter().all(|seen| *seen));
}

#[test]
fn a_robot_that_floats_is_one_limb() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/nimbro_op2x");
    let robot = robot::load(std::path::Path::new(path)).expect("a robot");
    let limbs = robot.limbs();
    assert_eq!(limbs.len(), 1);
    assert_eq!(limbs[0].dofs.len(), robot.dofs.len());
    assert_eq!(limbs[0].robot.feet.len(), 2);
}
