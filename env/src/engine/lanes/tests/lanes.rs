//! Worlds are independent, and a saved world goes on with the same bits.

use super::robots;
use super::*;

/// A world's own start, parameters and drive, different for every `seed`.
fn variant(robot: &Robot, seed: usize) -> (Start, World) {
    let mut begin = Start::nominal(robot);
    let mut own = world(robot);
    let share = seed as f64 / 40.0;
    begin.position.z += 0.02 * share;
    begin.linear_velocity = Vector3::new(0.5 * share, 0.2 - share * 0.3, 0.0);
    own.friction = Friction {
        tangential: 0.4 + share * 0.3,
        torsional: 0.01,
        rolling: 0.005 * share,
    };
    own.links[0].mass *= 1.0 + 0.1 * share;
    (begin, own)
}

pub fn drive(robot: &Robot, seeds: &[usize], step: usize) -> Drive {
    let one = hold(robot);
    let dofs = robot.dofs.len();
    let mut drive = Drive::idle(dofs, seeds.len());
    for d in 0..dofs {
        for (w, &seed) in seeds.iter().enumerate() {
            let at = d * seeds.len() + w;
            let phase = 0.05 * step as f64 + seed as f64 + d as f64;
            drive.target[at] = one.target[d] + 0.2 * phase.sin();
            drive.stiffness[at] = one.stiffness[d];
            drive.damping[at] = one.damping[d];
            drive.torque_min[at] = 0.3 * one.torque_min[d];
            drive.torque_max[at] = 0.3 * one.torque_max[d];
            drive.friction[at] = 0.5;
        }
    }
    drive
}

/// Bits of world `w`.
fn bits(engine: &Lanes, w: usize) -> Vec<u8> {
    let mut bytes = vec![];
    engine.save(w, &mut bytes);
    bytes
}

/// The bits of the worlds `seeds` after `steps`.
fn run(robot: &Robot, level: Simd, seeds: &[usize], steps: usize) -> Lanes {
    let mut engine = Lanes::new(robot, 0.005, seeds.len(), level).expect("available");
    for (w, &seed) in seeds.iter().enumerate() {
        let (begin, own) = variant(robot, seed);
        engine.reset(w, &begin, &own);
    }
    for step in 0..steps {
        engine.step(&drive(robot, seeds, step));
    }
    engine
}

#[test]
fn a_world_has_the_same_bits_in_any_lane_beside_any_others() {
    let robot = robots::biped();
    for level in levels() {
        let all: Vec<_> = (0..37).collect();
        let together = run(&robot, level, &all, 200);
        let reversed: Vec<_> = all.iter().rev().copied().collect();
        let turned = run(&robot, level, &reversed, 200);
        for seed in [0, 5, 17, 36] {
            let alone = bits(&run(&robot, level, &[seed], 200), 0);
            assert!(
                alone == bits(&together, seed),
                "{}: world {seed} among others",
                level.name()
            );
            assert!(
                alone == bits(&turned, 36 - seed),
                "{}: world {seed} in another lane",
                level.name()
            );
        }
    }
}

#[test]
fn a_broken_world_disturbs_no_other_and_recovers_by_reset() {
    let robot = robots::biped();
    for level in levels() {
        let seeds: Vec<_> = (0..20).collect();
        let undisturbed = run(&robot, level, &seeds, 100);
        let mut engine = run(&robot, level, &seeds, 0);
        let (mut begin, own) = variant(&robot, 3);
        begin.joints[2] = f64::NAN;
        engine.reset(3, &begin, &own);
        engine.push(7, Vector3::new(1e30, 0.0, 0.0));
        for step in 0..100 {
            engine.step(&drive(&robot, &seeds, step));
            assert!(!engine.is_finite(3) && !engine.is_finite(7));
        }
        for w in (0..20).filter(|w| ![3, 7].contains(w)) {
            assert!(engine.is_finite(w));
            assert!(bits(&engine, w) == bits(&undisturbed, w), "{}: world {w}", level.name());
        }
        let (begin, own) = variant(&robot, 3);
        engine.reset(3, &begin, &own);
        assert!(engine.is_finite(3));
        assert!(bits(&engine, 3) == bits(&run(&robot, level, &[3], 0), 0));
    }
}

#[test]
fn a_number_of_the_drive_that_is_none_breaks_its_world_alone() {
    type Numbers = fn(&mut Drive) -> &mut Vec<f64>;
    let fields: [(&str, Numbers); 7] = [
        ("target", |drive| &mut drive.target),
        ("stiffness", |drive| &mut drive.stiffness),
        ("damping", |drive| &mut drive.damping),
        ("feed_forward", |drive| &mut drive.feed_forward),
        ("torque_min", |drive| &mut drive.torque_min),
        ("torque_max", |drive| &mut drive.torque_max),
        ("friction", |drive| &mut drive.friction),
    ];
    let robot = robots::biped();
    let seeds: Vec<_> = (0..20).collect();
    for level in levels() {
        let mut undisturbed = run(&robot, level, &seeds, 60);
        undisturbed.step(&drive(&robot, &seeds, 60));
        for (name, numbers) in &fields {
            let mut engine = run(&robot, level, &seeds, 60);
            let mut drive = drive(&robot, &seeds, 60);
            // World 5, joint 2.
            numbers(&mut drive)[2 * seeds.len() + 5] = f64::NAN;
            engine.step(&drive);
            for w in 0..20 {
                assert_eq!(engine.is_finite(w), w != 5, "{}: {name}, world {w}", level.name());
                assert!(
                    w == 5 || bits(&engine, w) == bits(&undisturbed, w),
                    "{}: {name}, world {w}",
                    level.name()
                );
            }
        }
    }
}

#[test]
fn a_saved_world_goes_on_with_the_same_bits_in_another_batch() {
    let robot = robots::biped();
    for level in levels() {
        let seeds = [4, 9, 11];
        let mut engine = run(&robot, level, &seeds, 150);
        engine.push(1, Vector3::new(5.0, 3.0, 0.0));
        let saved = bits(&engine, 1);
        let mut other = Lanes::new(&robot, 0.005, 1, level).expect("available");
        other.load(0, &saved).expect("same robot and level");
        assert_eq!(other.joints().position[3], engine.joints().position[3 * 3 + 1]);
        for step in 150..300 {
            engine.step(&drive(&robot, &seeds, step));
            other.step(&drive(&robot, &[9], step));
        }
        assert!(bits(&engine, 1) == bits(&other, 0), "{}", level.name());
        assert!(other.load(0, &saved[1..]).is_err());
        assert!(other.load(0, b"").is_err());
    }
}
