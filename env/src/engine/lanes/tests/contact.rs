//! Ground contact against analytic results.

use nalgebra::{Point3, UnitQuaternion};

use super::robots;
use super::*;
use crate::engine::lanes::contact::STIFFNESS;
use crate::engine::lanes::engine::Batch;
use crate::engine::lanes::lane::{Lane, Single};
use crate::ground::Ground;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn friction(tangential: f64, torsional: f64, rolling: f64) -> Friction {
    Friction {
        tangential,
        torsional,
        rolling,
    }
}

/// Nothing moves, so from step to step only rounding can change the force: of the heights of the points, on the way from the base
/// to the sole, times their stiffness.
fn jitter(robot: &Robot, level: Simd) -> f64 {
    let epsilon = if level.name().starts_with("f32") {
        f64::from(f32::EPSILON)
    } else {
        f64::EPSILON
    };
    let joints = 9.0;
    let points: usize = robot.links.iter().map(|link| link.contact_points.len()).sum();
    points as f64 * 1e5 * joints * epsilon * robot.base_pose.translation.z
}

#[test]
fn weight_equals_contact_force_and_nothing_creeps_or_trembles_when_standing() {
    let robot = robots::biped();
    let weight = robot.mass() * GRAVITY;
    let drive = hold(&robot);
    for level in levels() {
        for dt in [0.005, 0.001] {
            let mut engine = single(&robot, dt, level, &Start::nominal(&robot), &world(&robot));
            let steps = (60.0 / dt) as usize;
            let (mut settled, mut before) = (None, Vector3::<f64>::zeros());
            for step in 0..steps {
                engine.step(&drive);
                let force = engine.foot_force(0, 0) + engine.foot_force(0, 1);
                if step == steps / 6 {
                    settled = Some(engine.base(0));
                }
                if step > steps / 6 {
                    assert!(
                        (force.z / weight - 1.0).abs() < 1e-3,
                        "{} at {dt}: {force}",
                        level.name()
                    );
                    assert!(force.xy().norm() < 1e-3 * weight);
                    let (change, bound) = ((force.z - before.z).abs(), jitter(&robot, level));
                    assert!(
                        change < bound,
                        "{} at {dt}: trembles by {change} N, {bound} N by rounding",
                        level.name()
                    );
                    let speed = engine.base(0).linear_velocity.norm();
                    assert!(speed < 1e-4, "{} at {dt}: moves at {speed} m/s", level.name());
                }
                before = force;
            }
            let (first, last) = (settled.expect("a step at 10 s"), engine.base(0));
            let creep = (last.position - first.position).norm() / 50.0;
            assert!(creep < 1e-4, "{} at {dt}: creeps at {creep} m/s", level.name());
            let turn = first.orientation.angle_to(&last.orientation) / 50.0;
            assert!(turn < 1e-4, "{} at {dt}: turns at {turn} rad/s", level.name());
        }
    }
}

#[test]
fn block_stops_after_the_distance_that_friction_gives() {
    let robot = robots::block(3.0, [0.3, 0.2, 0.1]);
    let (speed, mu) = (1.0, 0.5);
    let expected = speed * speed / (2.0 * mu * GRAVITY);
    for level in levels() {
        for dt in [0.004, 0.002, 0.001] {
            let mut begin = Start::nominal(&robot);
            let heading = Vector3::new(0.8, 0.6, 0.0);
            begin.linear_velocity = heading * speed;
            let world = World {
                friction: friction(mu, 0.01, 0.01),
                ..world(&robot)
            };
            let mut engine = single(&robot, dt, level, &begin, &world);
            for _ in 0..(1.0 / dt) as usize {
                engine.step(&Drive::idle(0, 1));
            }
            let way = engine.base(0).position - begin.position;
            // The velocity is constant over a step: half a step's worth of the first, and at most one of the last.
            assert!(
                (way.dot(&heading) - expected).abs() < speed * dt,
                "{} at {dt}: {way}",
                level.name()
            );
            assert!(way.cross(&heading).xy().norm() < speed * dt);
            assert!(engine.base(0).linear_velocity.norm() < 1e-4);
        }
    }
}

#[test]
fn spinning_block_stops_after_the_angle_that_torsional_friction_gives() {
    let (mass, size) = (3.0, [0.3, 0.3, 0.1]);
    let robot = robots::block(mass, size);
    let (rate, mu) = (2.0, 0.03);
    let inertia = robot.links[0].inertial.inertia[(2, 2)];
    let expected = 0.5 * inertia * rate * rate / (mu * mass * GRAVITY);
    for level in levels() {
        for dt in [0.004, 0.002, 0.001] {
            let mut begin = Start::nominal(&robot);
            begin.angular_velocity = Vector3::z() * rate;
            let world = World {
                friction: friction(0.0, mu, 0.0),
                ..world(&robot)
            };
            let mut engine = single(&robot, dt, level, &begin, &world);
            for _ in 0..(1.0 / dt) as usize {
                engine.step(&Drive::idle(0, 1));
            }
            let angle = engine.base(0).orientation.scaled_axis().z;
            assert!(
                (angle - expected).abs() < rate * dt,
                "{} at {dt}: {angle} of {expected}",
                level.name()
            );
            assert!(engine.base(0).angular_velocity.norm() < 1e-3);
        }
    }
}

/// A body whose only contact point is its centre of mass turns about it against rolling friction alone.
#[test]
fn rolling_body_stops_after_the_angle_that_rolling_friction_gives() {
    let (mass, size) = (3.0, [0.3, 0.2, 0.1]);
    let mut robot = robots::block(mass, size);
    robot.links[0].contact_points = vec![Point3::origin()];
    let (rate, mu) = (2.0, 0.03);
    for level in levels() {
        for (axis, moment) in [(Vector3::x(), (0, 0)), (Vector3::y(), (1, 1))] {
            let inertia = robot.links[0].inertial.inertia[moment];
            let expected = 0.5 * inertia * rate * rate / (mu * mass * GRAVITY);
            for dt in [0.004, 0.002, 0.001] {
                let begin = Start {
                    // As deep as its weight presses the point: the normal force is there from the first step on.
                    position: Vector3::z() * (-mass * GRAVITY / 1e5),
                    angular_velocity: axis * rate,
                    ..Start::nominal(&robot)
                };
                let world = World {
                    friction: friction(0.5, 0.0, mu),
                    ..world(&robot)
                };
                let mut engine = single(&robot, dt, level, &begin, &world);
                for _ in 0..(1.0 / dt) as usize {
                    engine.step(&Drive::idle(0, 1));
                }
                let angle = engine.base(0).orientation.scaled_axis().dot(&axis);
                assert!(
                    (angle - expected).abs() < rate * dt,
                    "{} at {dt}: {angle} of {expected}",
                    level.name()
                );
                assert!(engine.base(0).angular_velocity.norm() < 1e-3);
            }
        }
    }
}

/// Angle by which a block on its edge has turned in `seconds`, with the centre of mass `offset` metres beside the edge.
fn tipping(level: Simd, dt: f64, rolling: f64, offset: f64, seconds: f64) -> f64 {
    let (width, height) = (0.1, 0.3);
    let robot = robots::block(2.0, [width, 0.2, height]);
    // Turned about y over the edge x = width / 2 until the centre of mass is `offset` beyond it.
    let reach = (0.5 * width).hypot(0.5 * height);
    let tilt = (0.5 * width).atan2(0.5 * height) + (offset / reach).asin();
    let orientation = UnitQuaternion::from_scaled_axis(Vector3::y() * tilt);
    let edge = orientation * Vector3::new(0.5 * width, 0.0, -0.5 * height);
    let begin = Start {
        // As deep as its weight presses the edge's two points: it does not drop first.
        position: -edge - Vector3::z() * (robot.mass() * GRAVITY / (2.0 * STIFFNESS)),
        orientation,
        ..Start::nominal(&robot)
    };
    let world = World {
        friction: friction(0.8, 0.0, rolling),
        ..world(&robot)
    };
    let mut engine = single(&robot, dt, level, &begin, &world);
    for _ in 0..(seconds / dt) as usize {
        engine.step(&Drive::idle(0, 1));
    }
    engine.base(0).orientation.angle_to(&orientation)
}

#[test]
fn foot_on_its_edge_tips_without_rolling_friction() {
    for level in levels() {
        for offset in [-0.005, 0.005] {
            let angle = tipping(level, 0.002, 0.0, offset, 2.0);
            assert!(angle > 0.2, "{}: {angle} rad from {offset} m", level.name());
        }
    }
}

#[test]
fn foot_on_its_edge_holds_while_the_com_is_within_the_rolling_coefficient() {
    let mu = 0.01;
    // Beyond the coefficient by a hundredth of it, it turns by 0.2 rad within a second: theta'' = m g (e + h theta) / I with
    // e = 1e-4 m, h = 0.158 m and I = m (0.1^2 + 0.3^2) / 3. As much turning moves the centre of mass by e as e / h.
    let (within, beyond, turn) = (0.99 * mu, 1.01 * mu, 1e-4 / 0.158);
    for level in levels() {
        for dt in [0.005, 0.002] {
            for sign in [-1.0, 1.0] {
                let holds = tipping(level, dt, mu, within * sign, 2.0);
                assert!(holds < turn, "{} at {dt}: turns by {holds} rad", level.name());
                let falls = tipping(level, dt, mu, beyond * sign, 2.0);
                assert!(falls > 0.2, "{} at {dt}: turns by only {falls} rad", level.name());
            }
        }
    }
}

#[test]
fn dropped_block_comes_to_rest_on_the_ground() {
    let robot = robots::block(3.0, [0.3, 0.2, 0.1]);
    for level in levels() {
        for dt in [0.005, 0.001] {
            let mut begin = Start::nominal(&robot);
            begin.position.z += 0.5;
            let mut engine = single(&robot, dt, level, &begin, &world(&robot));
            for _ in 0..(2.0 / dt) as usize {
                engine.step(&Drive::idle(0, 1));
            }
            let base = engine.base(0);
            // Sinks in by its weight over four points of 1e5 N/m.
            let depth = 0.05 - base.position.z;
            assert!(
                (depth - 3.0 * GRAVITY / 4e5).abs() < 1e-5,
                "{} at {dt}: {depth}",
                level.name()
            );
            assert!(base.linear_velocity.norm() < 1e-4);
        }
    }
}

/// Errors of the velocity change of a step for every number of sweeps, relative to that of 2000, along a motion with
/// steps, slips and clamped drives; sorted.
fn sweep_errors(dt: f64, sweeps: &[usize]) -> Vec<Vec<f64>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/nimbro_op2x");
    let robot = crate::robot::load(std::path::Path::new(path)).expect("the robot loads");
    let begin = Start::nominal(&robot);
    let own = World {
        friction: friction(0.6, 0.02, 0.02),
        ..world(&robot)
    };
    let mut engine = Batch::<Single>::new(&Ground::Plane, &robot, dt, 1);
    let mut other = Batch::<Single>::new(&Ground::Plane, &robot, dt, 1);
    engine.reset(0, &begin, &own);
    let mut errors = vec![vec![]; sweeps.len()];
    let mut bytes = vec![];
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut drive = hold(&robot);
    drive.friction.fill(0.5);
    for step in 0..1000 {
        if step % 5 == 0 {
            for d in 0..robot.dofs.len() {
                drive.target[d] = robot.dof(d).nominal + rng.random_range(-0.15..0.15);
            }
        }
        bytes.clear();
        engine.save(0, &mut bytes);
        let mut change = |sweeps: usize| {
            other.model.sweeps = sweeps;
            other.load(0, &bytes).expect("same robot");
            other.step(&drive);
            let change = other.work.change.iter().map(|v| v.get(0));
            nalgebra::DVector::from_iterator(robot.dofs.len() + 6, change)
        };
        let exact = change(2000);
        for (errors, &count) in errors.iter_mut().zip(sweeps) {
            errors.push((change(count) - &exact).norm() / exact.norm());
        }
        engine.step(&drive);
        if engine.base(0).position.z < 0.7 * begin.position.z {
            engine.reset(0, &begin, &own);
        }
    }
    for errors in &mut errors {
        errors.sort_by(f64::total_cmp);
    }
    errors
}

/// The table in docs/performance.md, by `-- --nocapture`.
#[test]
fn sweeps_approach_the_converged_step() {
    let counts = [2, 4, 5, 8, 12, 24];
    let errors = sweep_errors(0.005, &counts);
    let at = |errors: &[f64], share: f64| errors[(share * errors.len() as f64) as usize];
    for (count, errors) in counts.iter().zip(&errors) {
        let shares = [0.5, 0.95, 0.99].map(|share| at(errors, share));
        println!(
            "{count:2} sweeps: median {:.0e}, 95 % {:.0e}, 99 % {:.0e}",
            shares[0], shares[1], shares[2]
        );
    }
    // Doubling the sweeps halves the typical error; points that slip approach more slowly.
    for (few, many) in [(0, 1), (1, 3), (2, 4), (4, 5)] {
        for (share, bound) in [(0.5, 0.5), (0.95, 0.9)] {
            let (few, many) = (at(&errors[few], share), at(&errors[many], share));
            assert!(many < bound * few, "{share}: {few} to {many}");
        }
    }
}
