//! A foot on its edge: it tips, unless rolling friction holds it.

use nalgebra::UnitQuaternion;

use super::robots;
use super::*;
use crate::engine::lanes::contact::STIFFNESS;

const MASS: f64 = 2.0;
/// Along and across the way it tips, and height, m.
const SIZE: [f64; 3] = [0.1, 0.2, 0.3];

/// Distance of the edge from the centre of mass, m.
fn reach() -> f64 {
    (0.5 * SIZE[0]).hypot(0.5 * SIZE[2])
}

/// Inertia about the edge, of 1 kg, m^2.
fn inertia() -> f64 {
    (SIZE[0].powi(2) + SIZE[2].powi(2)) / 3.0
}

/// How deep its weight presses the edge's two points, m.
fn settling() -> f64 {
    MASS * GRAVITY / (2.0 * STIFFNESS)
}

/// Angle by which a block on its edge has turned in `seconds`, with the centre of mass `offset` metres beside the edge.
fn tipping(level: Simd, dt: f64, rolling: f64, offset: f64, seconds: f64) -> f64 {
    let robot = robots::block(MASS, SIZE);
    // Turned about y over the edge until the centre of mass is `offset` beyond it.
    let tilt = (SIZE[0] / SIZE[2]).atan() + (offset / reach()).asin();
    let orientation = UnitQuaternion::from_scaled_axis(Vector3::y() * tilt);
    let edge = orientation * Vector3::new(0.5 * SIZE[0], 0.0, -0.5 * SIZE[2]);
    let begin = Start {
        // It does not drop first.
        position: -edge - Vector3::z() * settling(),
        orientation,
        ..Start::nominal(&robot)
    };
    let world = World::nominal(&robot, friction(0.8, 0.0, rolling));
    let mut engine = single(&robot, dt, level, &begin, &world);
    for _ in 0..(seconds / dt).round() as usize {
        engine.step(&Drive::idle(0, 1));
    }
    engine.base(0).orientation.angle_to(&orientation)
}

/// The same of a rigid block on a rigid edge: `I theta'' = m g r sin(theta)`, in steps far too small to matter.
fn rigid(offset: f64, seconds: f64) -> f64 {
    let per_inertia = GRAVITY * reach() / inertia();
    let begin = (offset / reach()).asin();
    let (mut angle, mut speed, steps) = (begin, 0.0, 1_000_000);
    let dt = seconds / f64::from(steps);
    for _ in 0..steps {
        speed += dt * per_inertia * f64::sin(angle);
        angle += dt * speed;
    }
    (angle - begin).abs()
}

/// Twice the angle at half the step less that at the whole one is off by second order; what halving both steps changes of that is
/// three times what is left. The engine's edge gives way by at most [`settling`]: whatever the edge moves, the centre of mass at
/// the lever's end stays behind by as much, `m r sin(theta) / I` of a turn.
#[test]
fn foot_on_its_edge_tips_as_a_rigid_body_does_without_rolling_friction() {
    for offset in [-0.005, -0.002, 0.002, 0.005] {
        let seconds = 0.3;
        let exact = rigid(offset, seconds);
        let steps = [0.002, 0.001, 0.0005];
        let angles = steps.map(|dt| tipping(Simd::Scalar, dt, 0.0, offset, seconds));
        let [first, second] = [(0, 1), (1, 2)].map(|(c, f): (usize, usize)| 2.0 * angles[f] - angles[c]);
        let lever = reach() * (exact + (offset / reach()).abs()).sin();
        let soft = settling() * lever / inertia();
        let bound = (second - first).abs() + soft;
        assert!(
            (second - exact).abs() < bound,
            "{second} rad, rigid {exact} rad, {bound} known"
        );
        // What a step rounds it carries on as it does a start that is off.
        let growth = (rigid(offset.abs() + 1e-6, seconds) - exact) * reach() / 1e-6 + 1.0;
        for level in levels() {
            let error = (tipping(level, steps[0], 0.0, offset, seconds) - angles[0]).abs();
            let bound = growth * rounding(level) * seconds / steps[0];
            assert!(error <= bound, "{}: {error} rad, {bound} rad by rounding", level.name());
        }
    }
}

#[test]
fn foot_on_its_edge_holds_while_the_com_is_within_the_rolling_coefficient() {
    let mu = 0.01;
    // Beyond the coefficient by a hundredth of it, it turns by 0.2 rad within a second: theta'' = m g (e + r theta) / I with
    // e = 1e-4 m. As much turning moves the centre of mass by e as e / r.
    let (within, beyond, turn) = (0.99 * mu, 1.01 * mu, 0.01 * mu / reach());
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
