//! Robots on a stand that touch the ground, in both engines against statics.

use nalgebra::{Isometry3, Point3, Vector3};
use omniwalk_env::engine::lanes::{CONTACT_STIFFNESS, Lanes, Simd};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, Start};
use omniwalk_env::robot::{Base, Foot, Geometry, JointKind, Robot, Shape};

use crate::robots::*;

/// Of the tip's ball in rapier, m. In lanes the tip is a point.
const RADIUS: f64 = 0.02;
const LENGTH: f64 = 0.5;
const COM: f64 = 0.2;
const MASS: f64 = 2.0;
/// Of the hinge above the ground, m.
const HEIGHT: f64 = 0.3;

/// A rod on a stand that leans on the ground with its tip, or one that slides down a rail onto it.
fn leaning(kind: JointKind) -> Robot {
    let along = match kind {
        JointKind::Revolute => Vector3::x(),
        JointKind::Prismatic => -Vector3::z(),
    };
    let base = link("base", None, 1.0, Vector3::zeros(), Vector3::repeat(0.01));
    let mut rod = link("rod", Some(0), MASS, along * COM, Vector3::repeat(0.02));
    let tip = Isometry3::from(along * LENGTH);
    rod.shapes.push(Shape {
        geometry: Geometry::Sphere(RADIUS),
        pose: tip,
    });
    rod.contact_points = vec![Point3::from(along * LENGTH)];
    let mut hinge = joint("hinge", 0, Vector3::zeros(), Vector3::y());
    if kind == JointKind::Prismatic {
        hinge.kind = kind;
        hinge.axis = Vector3::z_axis();
    }
    let mut robot = robot(Base::Fixed, vec![base, rod], vec![hinge]);
    robot.base_pose = Isometry3::translation(
        0.0,
        0.0,
        if kind == JointKind::Revolute {
            HEIGHT
        } else {
            LENGTH + 0.05
        },
    );
    robot.feet.push(Foot {
        name: "tip".into(),
        link: 1,
        sole: tip,
        half_extents: [0.0, 0.0],
    });
    robot
}

/// After 3 s: the mean force of half a second, the height of the tip, and by how much the joint's speed has changed meanwhile.
fn rests(engine: &mut dyn Engine, robot: &Robot, dt: f64) -> (Vector3<f64>, f64, f64) {
    let mut world = nominal(robot);
    world.friction.tangential = 0.0;
    engine.reset(0, &Start::nominal(robot), &world);
    let drive = Drive::idle(1, 1);
    (0..(2.5 / dt) as usize).for_each(|_| engine.step(&drive));
    let (mut force, before, steps) = (Vector3::zeros(), engine.joints().velocity[0], (0.5 / dt) as usize);
    for _ in 0..steps {
        engine.step(&drive);
        force += engine.foot_force(0, 0) / steps as f64;
    }
    let joints = engine.joints();
    let q = joints.position[0];
    let height = robot.base_pose.translation.z
        + match robot.joints[0].kind {
            JointKind::Revolute => -LENGTH * q.sin(),
            JointKind::Prismatic => q - LENGTH,
        };
    (force, height, joints.velocity[0] - before)
}

#[test]
fn a_robot_on_a_stand_presses_on_the_ground_as_its_levers_say() {
    for kind in [JointKind::Revolute, JointKind::Prismatic] {
        let robot = leaning(kind);
        // Without friction the ground's force is upright, and centre of mass and tip are on one line through the hinge.
        let (share, inertia, lever) = match kind {
            JointKind::Revolute => {
                let cosine = (1.0 - (HEIGHT / LENGTH).powi(2)).sqrt();
                (COM / LENGTH, 0.02 + MASS * COM * COM, LENGTH * cosine)
            }
            JointKind::Prismatic => (1.0, MASS, 1.0),
        };
        let exact = share * MASS * G;
        for dt in [1e-3, 5e-3] {
            for level in Simd::ALL.into_iter().filter(|level| level.is_available()) {
                let name = format!("{kind:?} in {} at {dt} s", level.name());
                let single = level.name().starts_with("f32");
                let epsilon = if single { f64::from(f32::EPSILON) } else { f64::EPSILON };
                let mut lanes = Lanes::new(&robot, dt, 1, level).expect("available");
                let (force, height, gained) = rests(&mut lanes, &robot, dt);
                // What the rod has gained of momentum comes on top; the height of the point is rounded, and a step's force with it.
                let rounded = 16.0 * epsilon * (HEIGHT * CONTACT_STIFFNESS + exact);
                let bound = inertia * gained.abs() / (lever * 0.5) + rounded;
                let off = (force - Vector3::z() * exact).norm();
                assert!(off < bound, "{name}: {force}, not {exact} N; {bound} N known");
                let sunk = (height + exact / CONTACT_STIFFNESS).abs();
                assert!(
                    sunk < 16.0 * epsilon + bound / CONTACT_STIFFNESS,
                    "{name}: off by {sunk} m"
                );
            }
            let name = format!("{kind:?} in rapier at {dt} s");
            let mut rapier = Rapier::new(&robot, dt, 1).expect("engine");
            let (force, height, gained) = rests(&mut rapier, &robot, dt);
            let bound = inertia * gained.abs() / (lever * 0.5) + 1e-9 * exact;
            let off = (force - Vector3::z() * exact).norm();
            assert!(off < bound, "{name}: {force}, not {exact} N; {bound} N known");
            // What rapier leaves alone, and what a contact of 30 Hz, its default, gives under gravity.
            let deep = 5e-4 + G / (std::f64::consts::TAU * 30.0).powi(2);
            assert!((0.0..deep).contains(&(RADIUS - height)), "{name}: {height} m");
        }
    }
}
