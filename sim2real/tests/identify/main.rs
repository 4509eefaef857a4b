//! Identification on logs of the project's own simulation, where the truth is known to the last digit.

mod arms;
mod bad;
mod record;
mod rig;
mod walker;

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use omniwalk_env::effect::{self, Effect, Kind, Table, Variable};
use omniwalk_env::robot::{self, Base, Robot};
use omniwalk_sim2real::identify::{Outcome, Verdict, replay};
use omniwalk_sim2real::recording::{Recording, Series};
use rig::{LIMITS_ALONE, PUSHED, RIG, identify, identify_files, identify_files_aloud, identify_into, load, logs, rig};

/// Logs that are fitted: one of each kind of motion, and another triangle.
const LOGS: u64 = 3;

/// Every name in the accepted effects and the sets that cannot be told apart.
fn named(outcome: &Outcome) -> Vec<String> {
    let accepted = outcome.accepted.iter().map(|a| a.effect.to_owned());
    accepted
        .chain(outcome.indistinguishable.iter().flatten().cloned())
        .collect()
}

#[test]
fn a_model_that_only_needs_other_values_lacks_nothing() {
    let mut truth = rig(&[]);
    truth.joints[0].passive.damping *= 2.0;
    truth.joints[0].passive.friction *= 0.5;
    let outcome = identify(&rig(&[]), logs(&truth, LOGS, 1), Some(logs(&truth, 2, 100)));
    assert_eq!(outcome.verdict, Verdict::NoMissingEffect, "{:?}", named(&outcome));
    let (nominal, refit) = (outcome.nominal.heldout.overall(), outcome.refit.heldout.overall());
    assert!(refit < 0.5 * nominal, "{nominal} {refit}");
    let retuned = |key: &str| &outcome.retuned["hinge"][key];
    let friction = truth.joints[0].passive.friction;
    let [low, high] = retuned("friction").ci95.expect("an interval");
    assert!(low <= friction && friction <= high, "{:?}", retuned("friction"));
    // Damping of servo and joint add up while the motor is neither off nor at its limits.
    let sum = truth.joints[0].passive.damping + truth.joints[0].actuator.expect("a motor").kd;
    let found = retuned("damping").value + retuned("kd").value;
    assert!((found / sum - 1.0).abs() < 0.05, "{found} for {sum}");
}

#[test]
fn a_stiffness_that_was_guessed_from_the_limit_stays_where_the_limit_is_another() {
    let nominal = load(LIMITS_ALONE);
    let mut truth = nominal.clone();
    truth.joints[0].actuator.as_mut().expect("a motor").torque_limit = 0.8;
    let folder = tempfile::tempdir().expect("a folder");
    let heldout = Some(logs(&truth, 2, 100));
    let outcome = identify_files(folder.path(), LIMITS_ALONE, &nominal, logs(&truth, LOGS, 1), heldout);
    let written = robot::load(&folder.path().join("robot")).expect("a robot");
    let [nominal, written] = [&nominal, &written].map(|robot| robot.joints[0].actuator.expect("a motor"));
    assert!((written.torque_limit / 0.8 - 1.0).abs() < 0.1, "{written:?}");
    assert_eq!(written.kp, nominal.kp);
    let [refit, last] = [&outcome.refit, &outcome.last].map(|errors| errors.fit.overall());
    assert!(last < 1.1 * refit, "{last} {refit}");
}

#[test]
fn effects_that_the_robot_has_are_re_tuned_and_not_missing() {
    let nominal = load(PUSHED);
    let mut truth = nominal.clone();
    effect::apply(&mut truth, &Effect::new(Kind::CommandDelay, 0, &[0.025]));
    effect::apply(&mut truth, &Effect::new(Kind::ExternalForce, 0, &[0.08]));
    let folder = tempfile::tempdir().expect("a folder");
    let heldout = Some(logs(&truth, 2, 100));
    let outcome = identify_files(folder.path(), PUSHED, &nominal, logs(&truth, LOGS, 1), heldout);
    assert_eq!(outcome.verdict, Verdict::NoMissingEffect, "{:?}", named(&outcome));
    let [delay, push] = ["command_delay.time", "external_force.torque"].map(|key| outcome.retuned["hinge"][key].value);
    assert!(
        (delay - 0.025).abs() < 1e-3 && (push - 0.08).abs() < 0.01,
        "{delay} {push}"
    );
    let written = robot::load(&folder.path().join("robot")).expect("a robot");
    let of = |kind| {
        written
            .effects
            .iter()
            .filter(|own| own.kind == kind)
            .map(|own| own.values[0])
            .collect::<Vec<_>>()
    };
    assert_eq!(
        (of(Kind::CommandDelay), of(Kind::ExternalForce)),
        (vec![delay], vec![push])
    );
    // What training draws it from moves with it: the last range counts.
    let drawn = written.ranges.last().expect("a range");
    assert!(
        drawn.kind == Kind::ExternalForce && drawn.lower < push && push < drawn.upper,
        "{drawn:?}"
    );
}

/// Whether `kind` with `values` is named, alone, and its first value found.
fn is_found(kind: Kind, values: &[f64]) {
    let truth = rig(&[(kind, values)]);
    let folder = tempfile::tempdir().expect("a folder");
    let heldout = Some(logs(&truth, 2, 100));
    let outcome = identify_into(folder.path(), &rig(&[]), logs(&truth, LOGS, 1), heldout);
    let named = named(&outcome);
    assert_eq!(outcome.verdict, Verdict::Explained, "{named:?}");
    assert_eq!(named, [kind.id()]);
    let value = outcome.accepted[0].parameters[kind.info().parameters[0].name].value;
    assert!((value / values[0] - 1.0).abs() < 0.15, "{value} for {}", values[0]);
    let closed = outcome.gap_closed.expect("a gap");
    assert!(closed > 0.8, "{closed}");
    training_draws_from_the_interval(&folder.path().join("robot"), &outcome);
}

/// The robot that was written has the range of each value found: its interval, less what would be less than half the effect.
fn training_draws_from_the_interval(robot: &Path, outcome: &Outcome) {
    let robot = omniwalk_env::robot::load(robot).expect("the robot that was written");
    assert!(!robot.ranges.is_empty());
    for range in &robot.ranges {
        let found = &outcome.accepted[0].parameters[range.kind.info().parameters[range.parameter].name];
        let [low, high] = found.ci95.expect("an interval");
        assert_eq!(range.kind.id(), outcome.accepted[0].effect);
        assert!((range.upper - high).abs() < 1e-9 * high.abs() && range.lower < found.value);
        assert!((range.lower - low.max(0.5 * found.value)).abs() < 1e-9 * found.value.abs());
    }
}

#[test]
fn a_robot_that_walks_freely_is_identified_on_a_stand() {
    let fixed = rig(&[]);
    let own = logs(&fixed, 3, 0);
    let mut free = fixed.clone();
    free.base = Base::Floating;
    let refused = replay(&free, &own).map(|_| ()).expect_err("a refusal");
    assert!(refused.to_string().contains("no feet"), "{refused}");
    let errors = [&free.on_a_stand(), &fixed].map(|robot| replay(robot, &own).expect("a replay").measure.overall());
    assert!((errors[0] - errors[1]).abs() < 1e-9, "{errors:?}");
}

#[test]
fn what_is_measured_beside_positions_is_compared_too() {
    let robot = rig(&[]);
    let own = replay(&robot, &logs(&robot, 2, 0)).expect("a replay");
    let velocity = own.measure.by_quantity["joint_velocity"]["rmse"];
    let fastest = own.check.logs[0].joints[0].excitation.fastest;
    assert!(velocity < 0.01 * fastest, "{velocity} of {fastest}");
    assert!(!own.measure.by_quantity.contains_key("orientation"), "the base is held");
    let slower = rig(&[(Kind::CommandDelay, &[0.03])]);
    let late = replay(&robot, &logs(&slower, 2, 0)).expect("a replay");
    assert!(late.measure.by_quantity["joint_velocity"]["rmse"] > 5.0 * velocity);
}

#[test]
fn what_only_some_logs_measured_beside_motion_is_left_out() {
    let robot = rig(&[]);
    let mut own = logs(&robot, 2, 0);
    for (log, name) in own.iter_mut().zip(["load", "temperature"]) {
        let joint = &mut log.joints[0];
        joint.extra.insert(name.into(), joint.position.clone());
    }
    let replayed = replay(&robot, &own).expect("a replay");
    assert!(replayed.measure.overall().is_finite());
}

/// What `series` has from `from` to `to` s, from there.
fn part(series: &Series, from: f64, to: f64) -> Series {
    let own = series
        .time
        .iter()
        .zip(&series.value)
        .filter(|(t, _)| (from..to).contains(*t));
    let (time, value) = own.map(|(t, value)| (t - from, *value)).unzip();
    Series { time, value }
}

#[test]
fn where_commands_are_lost_the_rest_of_a_log_replays_as_well_as_the_whole() {
    let robot = rig(&[]);
    // Motions that hardly rest: what a stretch begins with where a joint sticks, nobody knows.
    let whole: Vec<Recording> = [0, 3, 6].iter().flat_map(|seed| logs(&robot, 1, *seed)).collect();
    let mut lost = whole.clone();
    for log in &mut lost {
        let command = &mut log.joints[0].command;
        let kept = command.time.iter().zip(&command.value);
        let kept = kept.filter(|(t, _)| !(1.2..1.8).contains(*t));
        (command.time, command.value) = kept.map(|(t, value)| (*t, *value)).unzip();
    }
    let [whole, lost] = [whole, lost].map(|logs| replay(&robot, &logs).expect("a replay").measure.overall());
    assert!(lost < 1.2 * whole, "{lost} for {whole}");
}

#[test]
fn logs_that_are_shorter_than_the_usual_warm_up_are_compared_too() {
    let truth = rig(&[(Kind::CommandDelay, &[0.03])]);
    let log = logs(&truth, 1, 3).swap_remove(0);
    let cut = |k: i32| {
        let (from, to) = (0.6 * f64::from(k), 0.6 * f64::from(k + 1));
        let mut short = log.clone();
        let joint = &mut short.joints[0];
        for series in [&mut joint.command, &mut joint.position, &mut joint.velocity] {
            *series = part(series, from, to);
        }
        short
    };
    let short: Vec<Recording> = (0..6).map(cut).collect();
    let [own, other] = [&truth, &rig(&[])].map(|robot| replay(robot, &short).expect("a replay"));
    assert_eq!(own.trials.len(), 6);
    // Noise of 0.5 mrad leaves the start 0.1 rad/s off, which the servo takes 50 ms to make good.
    assert!(own.measure.overall() < 10.0 * record::NOISE, "{:?}", own.measure.rmse);
    assert!(
        other.measure.overall() > 3.0 * own.measure.overall(),
        "{:?}",
        other.measure.rmse
    );
}

#[test]
fn friction_that_rises_towards_rest_is_found() {
    is_found(Kind::StribeckFriction, &[0.12, 0.4, 0.0]);
}

#[test]
fn friction_under_load_is_found() {
    is_found(Kind::LoadDependentFriction, &[0.25, 0.0, 0.0, 0.1]);
}

#[test]
fn friction_under_load_that_is_half_as_much_again_at_rest_is_found() {
    is_found(Kind::LoadDependentFriction, &[0.3, 0.0, 0.15, 0.4]);
}

#[test]
fn play_is_found() {
    is_found(Kind::Backlash, &[0.06, 0.0, 0.7]);
}

#[test]
fn a_limit_of_the_target_s_speed_is_found() {
    is_found(Kind::CommandRateLimit, &[2.0]);
}

#[test]
fn a_target_that_never_catches_up_is_simulated_from_where_it_was() {
    // Half a rad/s behind targets that go at several: what is off at the start of a rollout would stay off.
    let truth = rig(&[(Kind::CommandRateLimit, &[0.5])]);
    let replay = replay(&truth, &logs(&truth, 3, 0)).expect("a replay");
    let error = replay.measure.overall();
    assert!(error < 2.0 * record::NOISE, "{error}");
}

#[test]
fn delays_of_command_and_reading_are_named_together() {
    let truth = rig(&[(Kind::CommandDelay, &[0.02])]);
    let outcome = identify(&rig(&[]), logs(&truth, LOGS, 1), Some(logs(&truth, 2, 100)));
    let named = named(&outcome);
    assert_eq!(outcome.verdict, Verdict::Indistinguishable, "{named:?}");
    assert!(
        named.contains(&"command_delay".to_owned()) && named.contains(&"sensor_delay".to_owned()),
        "{named:?}"
    );
    // Where the motor is off, readings are late and commands are none.
    let [separation] = outcome.separation.as_slice() else {
        panic!("{:?}", outcome.separation);
    };
    assert!(
        separation.tells && separation.motion.contains("motors off"),
        "{separation}"
    );
    let alternatives = &outcome.alternatives[0];
    assert!(
        alternatives
            .iter()
            .all(|own| (own.parameters["time"].value - 0.02).abs() < 1e-3)
    );
    assert_eq!(alternatives.iter().filter(|own| own.in_robot).count(), 1);
}

#[test]
fn a_low_supply_is_named_with_what_it_scales() {
    let truth = rig(&[(Kind::SupplyVoltage, &[0.7, 1.0])]);
    let outcome = identify(&rig(&[]), logs(&truth, LOGS, 1), Some(logs(&truth, 2, 100)));
    let named = named(&outcome);
    assert_eq!(outcome.verdict, Verdict::Indistinguishable, "{named:?}");
    assert_eq!(outcome.indistinguishable.len(), 1, "{named:?}");
    assert_eq!(named[..2], ["supply_voltage", "kp_scale of hinge"]);
}

/// `robot` with an arm of 1.3 times its mass.
fn heavier(mut robot: Robot) -> Robot {
    let arm = &mut robot.links[1].inertial;
    arm.mass *= 1.3;
    arm.inertia *= 1.3;
    robot
}

#[test]
fn a_heavier_arm_is_named_with_what_it_scales() {
    // Dry friction that builds up over a hair's breadth is too little to be missing, and numbers that are re-tuned bend to it.
    for friction in [&[][..], &[(Kind::StribeckFriction, &[0.004, 0.4, 3e-4][..])]] {
        let truth = heavier(rig(friction));
        let outcome = identify(&rig(&[]), logs(&truth, LOGS + 2, 1), Some(logs(&truth, 2, 100)));
        let named = named(&outcome);
        assert_eq!(outcome.verdict, Verdict::Indistinguishable, "{named:?}");
        assert_eq!(named[..3], ["payload", "mass", "kp_scale of hinge"]);
        let payload = &outcome.separation[0];
        assert!(payload.between[0].starts_with("payload") && payload.tells, "{payload}");
        assert!(payload.motion.contains("known weight"), "{payload}");
    }
}

/// The rig with a table on its joint.
fn with_table(table: Table) -> Robot {
    let mut robot = rig(&[]);
    effect::apply(&mut robot, &Effect::of_table(0, table));
    robot
}

#[test]
fn a_spring_on_one_side_is_a_curve_and_not_several_effects() {
    let spring = with_table(Table {
        axes: vec![(Variable::Position, vec![-2.0, 0.1, 1.1])],
        values: vec![0.0, 0.0, -0.3],
        friction: false,
    });
    // Beside it re-tuning makes up for a mass, and could be made up for by one.
    let truth = heavier(spring);
    let outcome = identify(&rig(&[]), logs(&truth, LOGS, 1), Some(logs(&truth, 2, 100)));
    let named = named(&outcome);
    assert_eq!(outcome.verdict, Verdict::Unexplained, "{named:?}");
    assert_eq!(outcome.unexplained.depends_on[0], "position");
    assert!(named.is_empty(), "{named:?}");
}

#[test]
fn friction_that_grows_while_a_log_lasts_is_a_table_over_time() {
    let truth = with_table(Table {
        axes: vec![(Variable::Time, vec![0.0, 2.0, 6.0])],
        values: vec![-0.05, 0.1, 0.15],
        friction: true,
    });
    let outcome = identify(&rig(&[]), logs(&truth, LOGS + 2, 1), Some(logs(&truth, 2, 100)));
    let named = named(&outcome);
    assert_eq!(outcome.verdict, Verdict::Unexplained, "{named:?}");
    assert_eq!(outcome.unexplained.depends_on[0], "time");
    assert!(named.is_empty(), "{named:?}");
    let closed = outcome.gap_closed.expect("a gap");
    assert!(
        closed > 0.6,
        "a table of it goes into the robot, and closes {closed} of the gap; six tenths are asked of what is in no library"
    );
}

#[test]
fn held_out_logs_change_nothing_but_the_report() {
    let truth = rig(&[(Kind::SensorOffset, &[0.05])]);
    let mut degrees = logs(&truth, 1, 50).swap_remove(0);
    degrees.name = "degrees".into();
    degrees.joints[0]
        .position
        .value
        .iter_mut()
        .for_each(|q| *q = q.to_degrees());
    let with = |held, left_out: bool| {
        let folder = tempfile::tempdir().expect("a folder");
        let outcome = identify_into(folder.path(), &rig(&[]), logs(&truth, 3, 1), Some(held));
        assert_eq!(
            outcome.heldout.contains("left out: degrees"),
            left_out,
            "{}",
            outcome.heldout
        );
        assert!(outcome.heldout_error.is_none() && outcome.last.heldout.overall() < 0.1);
        let written = ["robot.toml", "robot.urdf"]
            .map(|file| std::fs::read(folder.path().join("robot").join(file)).expect("written"));
        let mut report = serde_json::to_value(&outcome).expect("plain data");
        strip_heldout(&mut report);
        (report.to_string(), written)
    };
    let own = with(logs(&truth, 2, 100), false);
    let others = with([vec![degrees], logs(&rig(&[]), 1, 7)].concat(), true);
    assert_eq!(own, others);
}

/// Takes what is said of held-out logs out of a report: errors there, and which they are.
fn strip_heldout(report: &mut serde_json::Value) {
    match report {
        serde_json::Value::Object(fields) => {
            fields.retain(|key, _| !key.starts_with("heldout") && key != "gap_closed");
            fields.values_mut().for_each(strip_heldout);
        }
        serde_json::Value::Array(items) => items.iter_mut().for_each(strip_heldout),
        _ => {}
    }
}

#[test]
fn threads_change_no_bit() {
    let truth = rig(&[(Kind::SensorOffset, &[0.05])]);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        let outcome = pool.install(|| identify(&rig(&[]), logs(&truth, 3, 1), None));
        serde_json::to_string(&outcome).expect("plain data")
    };
    assert_eq!(with(1), with(2));
}

/// Whether what is `identified` into a folder, and told of, goes on to the same bits where it was interrupted at the line that begins with `at`.
fn goes_on(at: &str, identified: impl Fn(&Path, &dyn Fn(&str)) -> Outcome) {
    let json = |outcome: &Outcome| serde_json::to_string(outcome).expect("plain data");
    let [whole, interrupted] = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
    let expected = json(&identified(whole.path(), &|_| ()));
    let stop = |line: &str| assert!(!line.starts_with(at), "interrupted");
    catch_unwind(AssertUnwindSafe(|| identified(interrupted.path(), &stop))).expect_err("an interruption");
    let unfinished = interrupted.path().join("unfinished");
    assert!(unfinished.exists());
    let heard = RefCell::new(Vec::new());
    let again = identified(interrupted.path(), &|line| heard.borrow_mut().push(line.to_owned()));
    assert!(
        heard.borrow().iter().any(|line| line.contains("goes on where")),
        "{heard:?}"
    );
    assert_eq!(json(&again), expected);
    assert!(!unfinished.exists());
}

#[test]
fn what_was_interrupted_goes_on_to_the_same_bits() {
    let mut truth = rig(&[]);
    truth.joints[0].passive.damping *= 2.0;
    goes_on("re-tuned", |folder, log| {
        identify_files_aloud((folder, RIG), &rig(&[]), logs(&truth, 3, 1), None, log)
    });
}
