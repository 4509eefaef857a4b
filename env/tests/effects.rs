//! Effects do what the catalogue says, in both engines, and stay stable at a millisecond.

use omniwalk_env::actuators::Actuators;
use omniwalk_env::effect::{self, Effect, Kind, Table, Variable};
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Engine, Friction, Start, World};
use omniwalk_env::robot::{self, Robot};

const DT: f64 = 1e-3;
/// Of the rig: 0.5 kg at 0.1 m.
const GRAVITY_TORQUE: f64 = 0.5 * 9.81 * 0.1;

const URDF: &str = r#"<robot name="rig"><link name="base"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#;
const TOML: &str = "base = \"fixed\"\n[[joint]]\nmatch = [\"hinge\"]\nkp = 4.0\nkd = 0.1\ntorque_limit = 2.0\nspeed_limit = 20.0\narmature = 0.002\n";

fn load(toml: &str) -> Result<Robot, robot::RobotError> {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("rig.urdf"), URDF).expect("written");
    std::fs::write(folder.path().join("robot.toml"), format!("{TOML}{toml}")).expect("written");
    robot::load(folder.path())
}

fn rig(effects: &[(Kind, &[f64])]) -> Robot {
    let mut robot = load("").expect("a robot");
    for (kind, values) in effects {
        effect::apply(&mut robot, &Effect::new(*kind, 0, values));
    }
    robot
}

/// Readings of `seconds` under `target(t)` from rest at zero.
fn run(robot: &Robot, engine: &mut dyn Engine, seconds: f64, target: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut actuators = Actuators::new(robot, DT, 1);
    let ground = Friction {
        tangential: 1.0,
        torsional: 0.0,
        rolling: 0.0,
    };
    let world = World::nominal(robot, ground);
    engine.reset(0, &Start::nominal(robot), &world);
    actuators.start(0, 0, (0.0, 0.0), 0.0);
    let steps = (seconds / DT).round() as usize;
    let step = |k: usize| {
        actuators.set_target(0, 0, target(k as f64 * DT));
        engine.step(actuators.drive(engine.joints()));
        actuators.sense(engine.joints());
        actuators.read(0, 0, &engine.joints().position)
    };
    (0..steps).map(step).collect()
}

fn lanes(robot: &Robot, seconds: f64, target: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut engine = Lanes::new(robot, DT, 1, Simd::Scalar).expect("an engine");
    run(robot, &mut engine, seconds, target)
}

fn swing(t: f64) -> f64 {
    0.8 * (3.0 * t).sin() + 0.3 * (11.0 * t).sin()
}

#[test]
fn effects_at_their_neutral_values_change_no_bit() {
    let nominal = lanes(&rig(&[]), 2.0, swing);
    for kind in Kind::ALL
        .iter()
        .filter(|kind| kind.runs() && **kind != Kind::ResidualTorque)
    {
        let values = kind.info().parameters.iter().map(|p| p.neutral.unwrap_or(1e3));
        let values: Vec<f64> = match kind {
            Kind::SupplyVoltage => vec![12.0, 12.0],
            Kind::Backlash | Kind::Elasticity => vec![0.0, 0.0],
            _ => values.collect(),
        };
        assert_eq!(lanes(&rig(&[(*kind, &values)]), 2.0, swing), nominal, "{}", kind.id());
    }
}

#[test]
fn every_effect_changes_the_motion_and_stays_within_bounds_in_both_engines() {
    let cases: &[(Kind, &[f64])] = &[
        (Kind::CommandDelay, &[0.0205]),
        (Kind::CommandRateLimit, &[1.0]),
        (Kind::CommandDeadBand, &[0.05]),
        (Kind::CommandGain, &[0.9]),
        (Kind::CommandQuantisation, &[0.1]),
        (Kind::SupplyVoltage, &[9.0, 12.0]),
        (Kind::StribeckFriction, &[0.2, 0.3]),
        (Kind::LoadDependentFriction, &[0.3, 0.1, 0.2, 0.5]),
        (Kind::DirectionalFriction, &[0.05, 0.02]),
        (Kind::Backlash, &[0.05, 0.0]),
        (Kind::Backlash, &[0.05, 1.0]),
        (Kind::Elasticity, &[0.05, 0.0]),
        (Kind::Elasticity, &[0.05, 1.0]),
        (Kind::PositionRipple, &[0.1, 0.05, 3.0]),
        (Kind::SensorOffset, &[0.05]),
        (Kind::SensorScale, &[1.1]),
        (Kind::SensorDelay, &[0.0205]),
        (Kind::ExternalForce, &[0.2]),
        (Kind::Mass, &[1.2]),
        (Kind::CentreOfMass, &[0.0, 0.0, 0.02]),
        (Kind::Payload, &[0.1, 0.0, 0.0, -0.1]),
        (Kind::CoulombFriction, &[0.1]),
        (Kind::ViscousFriction, &[0.05]),
        (Kind::Armature, &[0.01]),
        (Kind::TorqueLimit, &[0.4]),
        (Kind::SpeedTorqueCurve, &[2.0]),
    ];
    let nominal = lanes(&rig(&[]), 2.0, swing);
    for (kind, values) in cases {
        let mut robot = rig(&[]);
        let target = usize::from(kind.info().site == effect::Site::Link);
        effect::apply(&mut robot, &Effect::new(*kind, target, values));
        let moved = lanes(&robot, 2.0, swing);
        let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs()));
        assert!(difference(&moved, &nominal) > 5e-3, "{} does nothing", kind.id());
        assert!(moved.iter().all(|q| q.abs() < 2.0), "{} runs away", kind.id());
        let mut rapier = Rapier::new(&robot, DT, 1).expect("an engine");
        let beside = run(&robot, &mut rapier, 2.0, swing);
        // Two integrators of first order, apart by the acceleration times the square of a step and what sticking adds.
        assert!(
            difference(&moved, &beside) < 0.02,
            "{}: {}",
            kind.id(),
            difference(&moved, &beside)
        );
    }
}

#[test]
fn a_delay_moves_the_whole_answer_in_time() {
    let nominal = lanes(&rig(&[]), 2.0, swing);
    for kind in [Kind::CommandDelay, Kind::SensorDelay] {
        let late = lanes(&rig(&[(kind, &[0.017])]), 2.0, swing);
        for k in 17..2000 {
            assert!((late[k] - nominal[k - 17]).abs() < 1e-9, "{} at {k}", kind.id());
        }
    }
}

#[test]
fn an_arm_leans_on_one_end_of_its_gap_and_reaches_through_it() {
    let held = |gap: f64| {
        *lanes(&rig(&[(Kind::Backlash, &[gap, 1.0])]), 3.0, |_| 1.0)
            .last()
            .expect("readings")
    };
    // The motor carries the arm either way; its encoder does not see the gap, so the arm hangs half a gap lower and
    // gravity pulls a little less.
    let slope = 4.0 + GRAVITY_TORQUE * 0.54;
    let expected = 0.5 * 0.1 * GRAVITY_TORQUE * 0.54 / slope;
    assert!(
        (held(0.1) - held(1e-9) - expected).abs() < 0.5 * expected,
        "{} {}",
        held(0.1),
        held(1e-9)
    );
}

#[test]
fn friction_under_load_holds_what_the_motor_lets_go() {
    // Friction of 0.9 times the load holds the arm far from where its servo wants it.
    let robot = rig(&[(Kind::LoadDependentFriction, &[0.5, 0.0, 0.0, 0.1])]);
    let end = |target: fn(f64) -> f64| *lanes(&robot, 6.0, target).last().expect("readings");
    let (up, down) = (end(|t| 0.2 * t.min(5.0)), end(|t| 2.0 - 0.2 * t.min(5.0)));
    assert!(down - up > 0.05, "from below {up}, from above {down}");
}

#[test]
fn friction_under_load_grows_with_the_load_and_is_more_at_rest() {
    let (share, growth, at_rest) = (0.1, 0.4, 0.3);
    // Slowly up: the motor carries the arm and all of the friction.
    let up = |t: f64| 0.1 * t;
    let robot = rig(&[(Kind::LoadDependentFriction, &[share, growth, 0.0, 0.1])]);
    let q = lanes(&robot, 10.0, up);
    let (now, before) = (q[9999], q[9899]);
    let motor = 4.0 * (up(9.999) - now) - 0.1 * (now - before) / 0.1;
    let balance = motor - (share + growth * motor) * motor - GRAVITY_TORQUE * now.sin();
    assert!(balance.abs() < 2e-3, "{balance}");
    // Held and let down slowly: friction at rest carries the arm until the motor's share is too little.
    let robot = rig(&[(Kind::LoadDependentFriction, &[share, 0.0, at_rest, 0.01])]);
    let down = |t: f64| if t < 3.0 { 1.2 } else { 1.2 - 0.05 * (t - 3.0) };
    let q = lanes(&robot, 20.0, down);
    let held = q[3000];
    let leaves = (3000..q.len()).find(|&k| q[k] < held - 1e-4).expect("it comes down");
    let motor = 4.0 * (down(leaves as f64 * DT) - held);
    let carried = (1.0 + share + at_rest) * motor;
    let load = GRAVITY_TORQUE * held.sin();
    assert!((carried / load - 1.0).abs() < 0.02, "{carried} of {load}");
}

#[test]
fn a_table_pulls_where_it_says() {
    let mut robot = rig(&[]);
    let table = Table {
        axes: vec![(Variable::Position, vec![-1.0, 0.0, 1.0])],
        values: vec![0.3, 0.0, -0.3],
    };
    let effect = Effect {
        kind: Kind::ResidualTorque,
        target: 0,
        values: Vec::new(),
        table: Some(table),
    };
    effect::apply(&mut robot, &effect);
    let q = *lanes(&robot, 5.0, |_| 0.5).last().expect("readings");
    let balance = 4.0 * (0.5 - q) - GRAVITY_TORQUE * q.sin() - 0.3 * q;
    assert!(balance.abs() < 1e-6, "{balance}");
}

#[test]
fn effects_come_from_the_toml_and_faults_name_their_place() {
    let robot = load("[[effect]]\nid = \"stribeck_friction\"\nmatch = [\"hinge\"]\ntorque = 0.4\nvelocity = 0.2\n")
        .expect("a robot");
    assert_eq!(robot.effects, [Effect::new(Kind::StribeckFriction, 0, &[0.4, 0.2])]);
    assert!(robot::describe(&robot).contains("stribeck_friction"));
    for (toml, said) in [
        ("[[effect]]\nid = \"magic\"\nmatch = [\"hinge\"]\n", "no effect"),
        ("[[effect]]\nmatch = [\"hinge\"]\n", "without `id`"),
        (
            "[[effect]]\nid = \"armature\"\nmatch = [\"hinge\"]\ninertia = 1.0\n",
            "no table of its own",
        ),
        (
            "[[effect]]\nid = \"command_delay\"\nmatch = [\"knee\"]\ntime = 0.01\n",
            "no joint matches",
        ),
        (
            "[[effect]]\nid = \"command_delay\"\nmatch = [\"hinge\"]\n",
            "without `time`",
        ),
        (
            "[[effect]]\nid = \"command_delay\"\nmatch = [\"hinge\"]\ntime = -1.0\n",
            "impossible value -1",
        ),
        (
            "[[effect]]\nid = \"command_delay\"\nmatch = [\"hinge\"]\ntime = nan\n",
            "impossible value",
        ),
        (
            "[[effect]]\nid = \"command_delay\"\nmatch = [\"hinge\"]\ntime = \"long\"\n",
            "not a number",
        ),
        (
            "[[effect]]\nid = \"command_delay\"\nmatch = [\"hinge\"]\ntime = 0.01\ntiem = 1.0\n",
            "has no `tiem`",
        ),
        (
            "[[effect]]\nid = \"residual_torque\"\nmatch = [\"hinge\"]\nover = [\"position\"]\nposition = [1.0, 0.0]\nvalues = [1.0, 2.0]\n",
            "ascending",
        ),
        (
            "[[effect]]\nid = \"residual_torque\"\nmatch = [\"hinge\"]\nover = [\"position\"]\nposition = [0.0, 1.0]\nvalues = [1.0]\n",
            "1 values for 2",
        ),
    ] {
        let error = load(toml).expect_err(toml).to_string();
        assert!(error.contains(said) && error.contains("robot.toml:"), "{error}");
    }
}

#[test]
fn actuators_go_on_with_the_same_bits_after_restoring() {
    let robot = rig(&[
        (Kind::CommandDelay, &[0.02]),
        (Kind::SensorDelay, &[0.01]),
        (Kind::Elasticity, &[0.01, 1.0]),
    ]);
    let mut engine = Lanes::new(&robot, DT, 1, Simd::Scalar).expect("an engine");
    run(&robot, &mut engine, 0.1, swing);
    let mut first = Actuators::new(&robot, DT, 1);
    first.start(0, 0, (0.1, 0.0), 0.1);
    for k in 0..50 {
        first.set_target(0, 0, swing(k as f64 * DT));
        first.drive(engine.joints());
        first.sense(engine.joints());
    }
    let mut second = Actuators::new(&robot, DT, 1);
    second.restore(&first.save()).expect("the same effects");
    assert_eq!(first.drive(engine.joints()), second.drive(engine.joints()));
    assert!(second.restore(&[0.0]).is_err());
}

#[test]
fn a_gap_of_nothing_is_no_gap() {
    // The rotor rides on a spring of 500 rad/s: accelerated by a rad/s^2 it lags by 4 urad, and under a torque of a N m the
    // spring of this rotor gives by so many rad.
    let nominal = lanes(&rig(&[]), 2.0, swing);
    let armature = rig(&[]).joints[0].passive.armature;
    let soft = 1.0 / (armature * 500.0 * 500.0);
    for encoder in [0.0, 1.0] {
        let closed = lanes(&rig(&[(Kind::Backlash, &[1e-9, encoder])]), 2.0, swing);
        let worst = nominal
            .iter()
            .zip(&closed)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(worst < 1.0 * soft, "{worst} at encoder {encoder}, {soft} a N m");
    }
}
