//! Standing for a minute under the servos alone.

use super::robots;
use super::*;
use crate::engine::lanes::contact::STIFFNESS;

/// The longest, a middle and the shortest physics step, s.
const STEPS: [f64; 3] = [1.0 / 200.0, 1.0 / 400.0, 1.0 / 1000.0];

/// By how much rounding may change the force from step to step: of the heights of the points, on the way from the base to the
/// sole, times their stiffness.
fn tremble(robot: &Robot, level: Simd) -> f64 {
    let joints = 9.0;
    stiffness(robot) * joints * epsilon(level) * robot.base_pose.translation.z
}

/// Of all contact points, N/m.
fn stiffness(robot: &Robot) -> f64 {
    let points: usize = robot.links.iter().map(|link| link.contact_points.len()).sum();
    points as f64 * STIFFNESS
}

/// After 10 s to settle, for 50 s: the force is the weight and changes with nothing but rounding and what creeps, and nothing
/// creeps by more than 0.1 mm/s.
fn stands(robot: &Robot, world: &World, drive: &Drive, dt: f64) {
    const CREEP: f64 = 1e-4;
    let weight = Vector3::z() * robot.mass() * GRAVITY;
    for level in levels() {
        let name = format!("{} in {} at {dt} s", robot.name, level.name());
        let mut engine = single(robot, dt, level, &Start::nominal(robot), world);
        let steps = |seconds: f64| (seconds / dt) as usize;
        (0..steps(10.0)).for_each(|_| engine.step(drive));
        let settled = engine.base(0);
        let mut before = None;
        for _ in 0..steps(50.0) {
            engine.step(drive);
            let force = engine.foot_force(0, 0) + engine.foot_force(0, 1);
            let off = (force - weight).norm() / weight.norm();
            assert!(off < 1e-3, "{name}: {force}");
            let base = engine.base(0);
            // Joints at this rate move what is a metre away like this.
            let joints = engine.joints().velocity.iter().fold(0.0, |a: f64, v| a.max(v.abs()));
            let speed = base
                .linear_velocity
                .norm()
                .max(base.angular_velocity.norm())
                .max(joints);
            assert!(speed < CREEP, "{name}: moves at {speed} m/s");
            let moved = stiffness(robot) * base.linear_velocity.norm() * dt;
            let bound = tremble(robot, level) + moved;
            let change = before.map_or(0.0, |before: f64| (force.z - before).abs());
            assert!(
                change < bound,
                "{name}: trembles by {change} N, {bound} N by rounding and creep"
            );
            before = Some(force.z);
        }
        let last = engine.base(0);
        let creep = (last.position - settled.position).norm() / 50.0;
        let turn = settled.orientation.angle_to(&last.orientation) / 50.0;
        assert!(creep < CREEP && turn < CREEP, "{name}: {creep} m/s, {turn} rad/s");
    }
}

#[test]
fn weight_equals_contact_force_and_nothing_creeps_or_trembles_when_standing() {
    for robot in [robots::biped(), nimbro()] {
        for dt in STEPS {
            stands(&robot, &world(&robot), &hold(&robot), dt);
        }
    }
}

/// The middle of what the default draws for the soles, and dry friction at every joint.
#[test]
fn standing_is_as_still_with_every_friction_on() {
    let own = |robot: &Robot| World::nominal(robot, friction(0.6, 0.2, 0.1));
    let rough = |robot: &Robot| {
        let mut drive = hold(robot);
        drive.friction.fill(0.5);
        drive
    };
    for robot in [robots::biped(), nimbro()] {
        for dt in STEPS {
            stands(&robot, &own(&robot), &rough(&robot), dt);
        }
    }
}
