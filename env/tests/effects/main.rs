//! Effects do what the catalogue says, in both engines, and stay stable at a millisecond.

#[path = "../support/motion.rs"]
mod motion;
mod rig;
mod sliding;

use omniwalk_env::actuators::Actuators;
use omniwalk_env::effect::{self, Effect, Kind, Table, Variable};
use omniwalk_env::engine::Engine;
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::robot::{self, Robot};
use rig::*;

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
            Kind::Backlash | Kind::Elasticity => vec![0.0, 0.0, 0.5],
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
        (Kind::StribeckFriction, &[0.2, 0.3, 0.0]),
        (Kind::StribeckFriction, &[0.2, 0.3, 1e-3]),
        (Kind::LoadDependentFriction, &[0.3, 0.1, 0.2, 0.5]),
        (Kind::DirectionalFriction, &[0.05, 0.02]),
        (Kind::Backlash, &[0.05, 0.0, 0.7]),
        (Kind::Backlash, &[0.05, 1.0, 0.05]),
        (Kind::Elasticity, &[0.05, 0.0, 0.05]),
        (Kind::Elasticity, &[0.05, 1.0, 0.7]),
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
    every_effect(&rig(&[]), cases, swing, 2.0);
}

#[test]
fn without_a_supply_a_motor_moves_nothing_in_either_engine() {
    let dead = rig(&[(Kind::SupplyVoltage, &[0.0, 12.0])]);
    for readings in [lanes(&dead, 1.0, swing), rapier(&dead, 1.0, swing)] {
        assert!(readings.iter().all(|reading| reading.abs() < 1e-9), "{readings:?}");
    }
}

#[test]
fn a_world_that_breaks_stays_broken_and_panics_nowhere() {
    let table = Table {
        axes: vec![(Variable::Velocity, vec![-1.0, 0.0, 1.0])],
        values: vec![0.1, 0.0, -0.1],
        friction: true,
    };
    let mut robots = vec![with_table(table)];
    let cases: &[(Kind, &[f64])] = &[
        (Kind::CommandRateLimit, &[1.0]),
        (Kind::CommandDeadBand, &[0.05]),
        (Kind::StribeckFriction, &[0.2, 0.3, 1e-3]),
        (Kind::LoadDependentFriction, &[0.3, 0.1, 0.2, 0.5]),
        (Kind::Backlash, &[0.05, 0.0, 0.7]),
        (Kind::Backlash, &[0.05, 1.0, 0.05]),
        (Kind::Elasticity, &[0.05, 1.0, 0.7]),
    ];
    robots.extend(cases.iter().map(|case| rig(&[*case])));
    for robot in robots {
        let readings = lanes(&robot, 0.05, |t| if t < 0.02 { 0.1 } else { f64::NAN });
        assert!(readings[readings.len() - 1].is_nan(), "{:?}", robot.effects);
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
    let armature = rig(&[]).joints[0].passive.armature;
    // The rotor rides on a spring of 500 rad/s.
    let spring = armature * 500.0 * 500.0;
    for gap in [0.1, 1e-9] {
        let seconds = 3.0;
        let held = *lanes(&rig(&[(Kind::Backlash, &[gap, 1.0, 0.7])]), seconds, |_| 1.0)
            .last()
            .expect("readings");
        // The motor carries the arm either way; its encoder does not see the gap, so the arm hangs half a gap and what the
        // spring gives below it. The equation's right side changes by 0.1 of the angle: a few rounds solve it.
        let load = |motor: f64| 4.0 * (1.0 - motor);
        let arm = |motor: f64| motor - 0.5 * gap - load(motor) / spring;
        let expected = (0..100).fold(1.0, |motor: f64, _| 1.0 - GRAVITY_TORQUE * arm(motor).sin() / 4.0);
        // The servo's damper lets a radian die away with kd / 2 I.
        let left = (-0.1 / (2.0 * (INERTIA + armature)) * seconds).exp();
        assert!(
            (held - expected).abs() < left,
            "{held} of {expected}, {left} left with a gap of {gap}"
        );
    }
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
    let (speed, inertia) = ((now - before) / 0.1, INERTIA + 0.002);
    let motor = 4.0 * (up(9.999) - now) - 0.1 * speed;
    let balance = motor - (share + growth * motor) * motor - GRAVITY_TORQUE * now.sin();
    // Friction follows the motor's torque of the step before, gravity the position there; the mean speed is that of 0.05 s ago;
    // and the arm accelerates. Load and motor change by at most the weight's torque over a radian.
    let acceleration = (now - 2.0 * before + q[9799]).abs() / 0.01;
    let step = GRAVITY_TORQUE * speed * DT;
    let known = (share + 2.0 * growth * motor + 1.0) * step + (inertia + 0.1 * 0.05) * acceleration;
    assert!(balance.abs() < known, "{balance} N m, {known} N m known");
    // Held and let down slowly: friction at rest carries the arm until the motor's share is too little.
    let robot = rig(&[(Kind::LoadDependentFriction, &[share, 0.0, at_rest, 0.01])]);
    let down = |t: f64| if t < 3.0 { 1.2 } else { 1.2 - 0.05 * (t - 3.0) };
    let q = lanes(&robot, 20.0, down);
    let (held, seen) = (q[3000], 1e-7);
    let leaves = (3000..q.len()).find(|&k| q[k] < held - seen).expect("it comes down");
    let motor = 4.0 * (down(leaves as f64 * DT) - held);
    let carried = (1.0 + share + at_rest) * motor;
    let load = GRAVITY_TORQUE * held.sin();
    // From where they are equal what is carried falls steadily, and friction only gives way as the arm moves. Until that can be
    // seen the arm goes as its inertia, the damper, and springs of servo and weight say; friction is a step late, and so is it.
    let rate = (1.0 + share + at_rest) * 4.0 * 0.05;
    let (mut way, mut speed, mut late) = (0.0, 0.0, 0.0);
    while way < seen {
        let stiffness = (1.0 + share + at_rest) * 4.0 + GRAVITY_TORQUE;
        speed += 1e-7 * (rate * late - (1.0 + share + at_rest) * 0.1 * speed - stiffness * way) / inertia;
        way += 1e-7 * speed;
        late += 1e-7;
    }
    let (missing, known) = (load - carried, rate * (late + 2.0 * DT));
    assert!((0.0..known).contains(&missing), "{carried} of {load}, {known} known");
}

#[test]
fn friction_under_load_is_none_while_the_motor_turns_within_play() {
    // The rotor shakes between the teeth by what its own encoder says, and the arm swings under a push.
    let free = [
        (Kind::Backlash, &[2.0, 1.0, 0.0][..]),
        (Kind::ExternalForce, &[0.1][..]),
    ];
    let rubbing = [&free[..], &[(Kind::LoadDependentFriction, &[0.9, 0.0, 0.0, 0.1][..])]].concat();
    let [free, rubbing] = [&free[..], &rubbing].map(|effects| arm(&rig(effects), 2.0, |t| 0.5 * (20.0 * t).sin()));
    assert!(free.iter().fold(0.0, |a: f64, q| a.max(*q)) > 0.3, "it swings");
    assert_eq!(free, rubbing);
}

/// The rig with a table on its joint.
fn with_table(table: Table) -> Robot {
    let mut robot = rig(&[]);
    effect::apply(&mut robot, &Effect::of_table(0, table));
    robot
}

#[test]
fn a_table_pulls_where_it_says() {
    let robot = with_table(Table {
        axes: vec![(Variable::Position, vec![-1.0, 0.0, 1.0])],
        values: vec![0.3, 0.0, -0.3],
        friction: false,
    });
    let q = *lanes(&robot, 5.0, |_| 0.5).last().expect("readings");
    let balance = 4.0 * (0.5 - q) - GRAVITY_TORQUE * q.sin() - 0.3 * q;
    assert!(balance.abs() < 1e-6, "{balance}");
}

#[test]
fn a_table_of_dry_friction_over_time_holds_until_it_is_none() {
    let robot = with_table(Table {
        axes: vec![(Variable::Time, vec![0.0, 1.0, 1.001])],
        values: vec![5.0, 5.0, 0.0],
        friction: true,
    });
    let readings = lanes(&robot, 6.0, |_| 0.5);
    assert!(
        (readings[999] - readings[0]).abs() < 1e-12,
        "5 N m hold what pulls with 2"
    );
    let q = *readings.last().expect("readings");
    let balance = 4.0 * (0.5 - q) - GRAVITY_TORQUE * q.sin();
    assert!(balance.abs() < 1e-6, "{balance}");
}

#[test]
fn effects_come_from_the_toml_and_faults_name_their_place() {
    let robot = load("[[effect]]\nid = \"stribeck_friction\"\nmatch = [\"hinge\"]\ntorque = 0.4\nvelocity = 0.2\n")
        .expect("a robot");
    assert_eq!(
        robot.effects,
        [Effect::new(Kind::StribeckFriction, 0, &[0.4, 0.2, 0.0])]
    );
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
        (
            "[[effect]]\nid = \"residual_torque\"\nmatch = [\"hinge\"]\nover = [\"time\"]\ntime = [0.0, 1.0]\nvalues = [1.0, 2.0]\nfriction = 1\n",
            "true or false",
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
        (Kind::Elasticity, &[0.01, 1.0, 0.05]),
    ]);
    let mut engine = Lanes::new(&robot, DT, 1, Simd::Scalar).expect("an engine");
    run(&robot, &mut engine, DT, 0.1, swing);
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
        let closed = lanes(&rig(&[(Kind::Backlash, &[1e-9, encoder, 0.7])]), 2.0, swing);
        let worst = nominal
            .iter()
            .zip(&closed)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(worst < 1.0 * soft, "{worst} at encoder {encoder}, {soft} a N m");
    }
}
