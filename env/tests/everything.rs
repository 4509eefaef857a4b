//! Every effect of the catalogue, noise, latency, randomisation and pushes at once, at all rates, in both engines.

mod support;

use std::sync::Arc;

use omniwalk_env::Batch;
use omniwalk_env::config::{EngineKind, EnvConfig};
use omniwalk_env::effect::{self, Bounds, Effect, Kind, Parameter, Scale, Site};
use omniwalk_env::engine::GRAVITY;
use omniwalk_env::random::Stream;
use omniwalk_env::robot::Robot;
use omniwalk_env::task::episode::End;
use omniwalk_env::task::reward::Terms;
use support::{config, robot};

/// All that 40 Hz of control divide and that the physics is for.
const RATES: [u32; 5] = [200, 320, 400, 600, 1000];
const SECONDS: u32 = 3;

/// A tenth of what the catalogue starts to look for, from where the parameter does nothing.
fn mild(parameter: &Parameter, torque: f64) -> f64 {
    let typical = match parameter.scale {
        Scale::One | Scale::Position | Scale::Mass | Scale::Frequency => 1.0,
        Scale::Time | Scale::Length => 0.1,
        Scale::Speed => 5.0,
        Scale::Torque => torque,
        Scale::PerTorque => 1.0 / torque,
        Scale::Damping => torque / 5.0,
        Scale::Compliance => 1.0 / torque,
        Scale::Inertia => 0.01,
        Scale::Voltage => 12.0,
    };
    let Bounds { lower, upper } = parameter.bounds;
    let neutral = parameter.neutral.or(parameter.default).filter(|n| n.is_finite());
    let start = parameter.starts.first().map(|start| start * typical);
    let value = match (neutral, start) {
        (Some(neutral), Some(start)) => neutral + 0.1 * (start - neutral),
        (Some(value), None) | (None, Some(value)) => value,
        (None, None) => typical,
    };
    value.clamp(lower, upper)
}

/// The robot with every effect at every servo and every link; the table of residual torque takes a measurement.
fn with_everything(robot: &Robot) -> Robot {
    let mut robot = robot.clone();
    for kind in Kind::ALL.iter().copied().filter(|&kind| kind != Kind::ResidualTorque) {
        let info = kind.info();
        let targets = match info.site {
            Site::Joint => 0..robot.dofs.len(),
            Site::Link => 0..robot.links.len(),
        };
        for target in targets {
            let torque = match (info.site, robot.dofs.get(target).map(|_| robot.dof(target).actuator)) {
                (Site::Joint, Some(Some(actuator))) => actuator.torque_limit,
                (Site::Joint, _) => continue,
                (Site::Link, _) => 1.0,
            };
            let values: Vec<_> = info.parameters.iter().map(|p| mild(p, torque)).collect();
            effect::apply(&mut robot, &Effect::new(kind, target, &values));
        }
    }
    robot
}

fn everything_on(engine: EngineKind, rate: u32) -> EnvConfig {
    let mut config = config(engine);
    config.engine.physics_hz = rate;
    config.task.random_first_length = false;
    config.task.overlap_margin = 0.0;
    for enabled in [
        &mut config.noise.enabled,
        &mut config.latency.enabled,
        &mut config.friction.enabled,
        &mut config.push.enabled,
    ] {
        *enabled = true;
    }
    config
}

/// What has been seen of the joints: the highest speed, and how far one was beyond its limits, rad/s and rad.
#[derive(Default)]
struct Seen {
    fastest: f64,
    beyond: f64,
}

impl Seen {
    /// Looks at all environments of a batch on a level plane.
    fn look(&mut self, batch: &Batch, robot: &Robot) {
        let lowest = batch.shared().config.task.min_height * robot.base_pose.translation.z;
        for e in 0..batch.environments() {
            let (_, engine, world) = batch.look(e);
            // Who has fallen has started anew.
            let height = engine.base(world).position.z;
            assert!(
                height > lowest,
                "environment {e} goes on at {height} m, {lowest} m is fallen"
            );
            for foot in 0..robot.feet.len() {
                let load = engine.foot_force(world, foot).z;
                assert!(
                    load >= -f64::EPSILON * robot.mass() * GRAVITY,
                    "the ground pulls foot {foot} with {load} N"
                );
            }
            let joints = engine.joints();
            for d in 0..robot.dofs.len() {
                let at = d * engine.worlds() + world;
                let (lower, upper) = robot.limits(d);
                let q = joints.position[at];
                self.beyond = self.beyond.max(lower - q).max(q - upper);
                self.fastest = self.fastest.max(joints.velocity[at].abs());
            }
        }
    }
}

/// Plays `action` and counts the ends of episodes.
fn ends(config: &EnvConfig, robot: &Arc<Robot>, mut action: impl FnMut() -> f32) -> Vec<End> {
    let mut batch = Batch::new(robot.clone(), config, 2, 5).expect("both engines take the robot");
    let mut actions = vec![0.5; 2 * batch.shared().spec.action_len()];
    let (mut ends, mut seen) = (vec![], Seen::default());
    for _ in 0..SECONDS * config.engine.control_hz {
        actions.iter_mut().for_each(|a| *a = action());
        batch.step(&actions);
        assert!(batch.observations().iter().all(|o| o.is_finite()));
        assert!(batch.terms().iter().flat_map(Terms::array).all(f64::is_finite));
        seen.look(&batch, robot);
        ends.extend(batch.ends().iter().flatten());
    }
    // A joint that comes to its limit passes it by what it moves in a step, no more.
    let Seen { fastest, beyond } = seen;
    let passed = fastest / f64::from(config.engine.physics_hz);
    assert!(
        beyond <= passed,
        "{beyond} rad beyond a limit, {passed} rad in a step at {fastest} rad/s"
    );
    ends
}

#[test]
fn nothing_is_lost_at_any_rate_with_everything_on() {
    let robot = Arc::new(with_everything(&robot("nimbro_op2x")));
    for engine in EngineKind::ALL {
        for rate in RATES {
            let mut stream = Stream::new(3, 0, 0);
            let ends = ends(&everything_on(engine, rate), &robot, || {
                (0.5 + stream.normal(0.2)).clamp(0.0, 1.0) as f32
            });
            assert!(!ends.contains(&End::Lost), "{engine:?} at {rate} Hz: {ends:?}");
        }
    }
}
