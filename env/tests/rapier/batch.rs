//! Batches: independence of worlds, replay, saving, and worlds that break.

use nalgebra::{Matrix3, Vector3};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, EngineError, Start, World};

use crate::robots::*;

const DT: f64 = 5e-3;

/// A biped that falls over while its servos work, differently in each world.
fn case(world: usize) -> (Start, World) {
    let robot = biped();
    let (mut start, mut model) = (Start::nominal(&robot), nominal(&robot));
    let x = world as f64;
    start.linear_velocity = Vector3::new(0.4 + 0.1 * x, 0.1, 0.0);
    start.joints[1] = -0.1 * x;
    model.links[0].mass += 0.3 * x;
    model.links[0].com.z += 0.01 * x;
    model.links[3].inertia += Matrix3::from_diagonal_element(1e-3 * x);
    model.joints[0].damping = 0.1 * x;
    model.friction.tangential = 0.5 + 0.1 * x;
    model.friction.torsional = 0.01;
    model.friction.rolling = 0.002;
    (start, model)
}

fn drive(worlds: usize) -> Drive {
    let mut drive = servo(&biped(), worlds, 200.0, 2.0);
    drive.torque_max.fill(15.0);
    drive.torque_min.fill(-15.0);
    drive.friction.fill(0.2);
    drive
}

fn batch(worlds: usize) -> Rapier {
    let mut engine = Rapier::new(&biped(), DT, worlds).expect("engine");
    for world in 0..worlds {
        let (start, model) = case(world);
        engine.reset(world, &start, &model);
    }
    engine
}

#[test]
fn a_world_moves_alike_alone_and_in_a_batch() {
    let mut together = batch(3);
    let mut alone = Rapier::new(&biped(), DT, 1).expect("engine");
    let (start, model) = case(2);
    alone.reset(0, &start, &model);
    for _ in 0..300 {
        together.step(&drive(3));
        alone.step(&drive(1));
        assert_eq!(bits(&together, 2), bits(&alone, 0));
    }
}

#[test]
fn reset_replays_the_same_bits_whatever_happened_before() {
    let mut engine = batch(1);
    let (start, model) = case(1);
    let record = |engine: &mut Rapier| {
        engine.reset(0, &start, &model);
        (0..200)
            .map(|_| {
                engine.step(&drive(1));
                bits(engine, 0)
            })
            .collect::<Vec<_>>()
    };
    let first = record(&mut engine);
    engine.push(0, Vector3::new(50.0, 20.0, 0.0));
    (0..77).for_each(|_| engine.step(&drive(1)));
    assert!(record(&mut engine) == first);
}

#[test]
fn a_saved_world_goes_on_with_the_same_bits() {
    let mut engine = batch(2);
    engine.push(1, Vector3::new(8.0, -5.0, 0.0));
    (0..90).for_each(|_| engine.step(&drive(2)));
    let mut bytes = vec![1, 2, 3];
    engine.save(1, &mut bytes);
    let mut other = Rapier::new(&biped(), DT, 1).expect("engine");
    other.load(0, &bytes[3..]).expect("own bytes");
    assert_eq!(bits(&engine, 1), bits(&other, 0));
    assert_eq!(engine.foot_force(1, 0), other.foot_force(0, 0));
    for _ in 0..200 {
        engine.step(&drive(2));
        other.step(&drive(1));
        assert_eq!(bits(&engine, 1), bits(&other, 0));
        assert_eq!(engine.foot_force(1, 0), other.foot_force(0, 0));
    }
}

#[test]
fn bytes_of_another_robot_or_damaged_ones_are_refused() {
    let mut engine = batch(1);
    let mut bytes = Vec::new();
    engine.save(0, &mut bytes);
    let mut pendulum = Rapier::new(&pendulum(), DT, 1).expect("engine");
    assert!(pendulum.load(0, &bytes).is_err());
    assert!(engine.load(0, &bytes[..bytes.len() - 1]).is_err());
    assert!(engine.load(0, b"nonsense").is_err());
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    assert!(engine.load(0, &bytes).is_err());
}

#[test]
fn a_world_made_non_finite_is_reported_and_disturbs_no_other() {
    let mut engine = batch(2);
    let mut alone = Rapier::new(&biped(), DT, 1).expect("engine");
    let (start, model) = case(1);
    alone.reset(0, &start, &model);
    for step in 0..60 {
        let mut drive = drive(2);
        if step >= 20 {
            drive.feed_forward[0] = f64::NAN;
        }
        engine.step(&drive);
        alone.step(&self::drive(1));
        assert_eq!(engine.is_finite(0), step < 20);
        assert_eq!(bits(&engine, 1), bits(&alone, 0));
    }
    let (start, model) = case(0);
    engine.reset(0, &start, &model);
    assert!(engine.is_finite(0));
    let mut fresh = batch(1);
    engine.step(&drive(2));
    fresh.step(&drive(1));
    assert_eq!(bits(&engine, 0), bits(&fresh, 0));
}

#[test]
fn a_world_beyond_physical_bounds_is_reported() {
    let mut engine = batch(1);
    engine.push(0, Vector3::new(1e7, 0.0, 0.0));
    (0..200).for_each(|_| engine.step(&drive(1)));
    assert!(!engine.is_finite(0));
    assert!(engine.joints().position.iter().all(|q| q.is_finite()));
}

#[test]
fn impossible_engines_are_refused() {
    assert_eq!(
        Rapier::new(&biped(), 0.0, 1).err(),
        Some(EngineError::TimeStep { dt: 0.0 })
    );
    assert!(Rapier::new(&biped(), f64::NAN, 1).is_err());
    let mut box_only = biped();
    box_only.links.truncate(1);
    box_only.joints.clear();
    box_only.dofs.clear();
    box_only.feet.clear();
    assert!(Rapier::new(&box_only, DT, 1).is_err());
}
