//! Whether commands and readings are of one time, and of one joint.

use super::*;

#[test]
fn on_the_ground_one_joint_among_others_may_be_moved_by_what_it_stands_on() {
    let hand = r#"<joint name="wrist" type="revolute"><parent link="lower"/><child link="hand"/><axis xyz="0 1 0"/><origin xyz="0 0 -0.2"/>
<limit lower="-2" upper="2" effort="5" velocity="8"/></joint><link name="hand"><inertial><mass value="0.1"/>
<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#;
    let mut robot = robot(&ARM.replace("</robot>", hand));
    let mut log = good(6.0);
    log.joints.push(joint("wrist", 6.0));
    log.joints[1].position = series(6.0, |t| 300.0 * noise(t));
    let mut faults = |base| {
        robot.base = base;
        let check = Check::new(std::slice::from_ref(&log), &robot);
        let of = |pile: &[Finding]| pile.iter().any(|finding| finding.fault == Fault::Unrelated);
        (of(&check.refusals), of(&check.remarks))
    };
    assert_eq!(faults(Base::Fixed), (true, false));
    assert_eq!(faults(Base::Floating), (false, true));
}

#[test]
fn a_clock_that_is_set_and_commands_that_outlast_it_are_refused_once() {
    let mut log = good(6.0);
    for joint in &mut log.joints {
        joint.position.time.iter_mut().skip(300).for_each(|time| *time += 1.7e9);
    }
    let mut told = good(6.0);
    told.joints[1]
        .command
        .time
        .iter_mut()
        .skip(300)
        .for_each(|time| *time += 1.7e9);
    let mut other = log.clone();
    scaled(&mut other.joints[0].position, 0.9);
    let check = Check::new(&[log, other, told], &arm());
    let said: Vec<String> = check.refusals.iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].starts_with("log: shoulder: time jumps: the longest pause, of 19675.9 days, is after 2.99 s"));
    assert!(
        said[0].contains("and 1 more joints jump: split the log there"),
        "{}",
        said[0]
    );
    assert!(
        said[1].contains("elbow: commands are from 0.000 s to 1700000005.990 s"),
        "{}",
        said[1]
    );
}

#[test]
fn a_motor_that_is_off_need_not_follow_and_what_is_odd_is_noted() {
    let mut log = good(6.0);
    let shoulder = &mut log.joints[0];
    shoulder.enabled = Series {
        time: vec![0.0],
        value: vec![0.0],
    };
    shoulder.command = Series::default();
    log.joints[1].velocity = series(6.0, |_| 0.0);
    log.joints[1].effort = series(6.0, |t| told("elbow", t).clamp(-0.5, 0.5));
    log.notes.push("another clock".into());
    log.joints.push(joint("wrist", 6.0));
    let check = Check::new(&[log], &arm());
    assert!(check.usable(), "{check}");
    let faults: Vec<Fault> = check.remarks.iter().map(|finding| finding.fault).collect();
    for fault in [Fault::Stuck, Fault::Saturated, Fault::Note, Fault::UnknownJoint] {
        assert!(faults.contains(&fault), "{fault:?} in {check}");
    }
}

#[test]
fn a_joint_that_follows_while_its_motor_is_said_to_be_off_is_refused() {
    let mut log = good(6.0);
    log.joints[0].enabled = Series {
        time: vec![0.0],
        value: vec![0.0],
    };
    let check = Check::new(&[log], &arm());
    let faults: Vec<Fault> = check.refusals.iter().map(|finding| finding.fault).collect();
    assert_eq!(faults, [Fault::Switch], "{check}");
}

#[test]
fn commands_that_are_missing_are_remarked_and_where_most_are_refused() {
    let without = |from: f64, to: f64| {
        let mut log = good(6.0);
        let command = &mut log.joints[0].command;
        let kept: Vec<(f64, f64)> = command
            .time
            .iter()
            .copied()
            .zip(command.value.iter().copied())
            .collect();
        (command.time, command.value) = kept.into_iter().filter(|(t, _)| !(from..to).contains(t)).unzip();
        Check::new(&[log], &arm())
    };
    let some = without(2.0, 3.5);
    assert!(some.usable(), "{some}");
    let said = some.remarks.iter().map(ToString::to_string).collect::<String>();
    assert!(
        said.contains("shoulder: commands are missing, for 1.51 s at most, from 1.99 s on"),
        "{said}"
    );
    let most = without(1.0, 5.0);
    assert!(
        most.refusals.iter().any(|finding| finding.fault == Fault::NoCommand),
        "{most}"
    );
}

#[test]
fn clocks_that_are_far_apart_are_refused_with_how_far_or_that_it_is_farther() {
    let said = |apart: f64| {
        let mut log = good(12.0);
        for joint in &mut log.joints {
            joint.command.time.iter_mut().for_each(|time| *time += apart);
        }
        let check = Check::new(&[log], &arm());
        let refused = check
            .refusals
            .iter()
            .find(|finding| finding.fault == Fault::ClockOffset);
        refused.map(ToString::to_string).unwrap_or_default()
    };
    // Joints follow 50 ms later.
    for apart in [-0.1, 0.0, 0.06] {
        assert_eq!(said(apart), "", "{apart}");
    }
    assert!(said(0.15).contains("moves 100 ms before its command"), "{}", said(0.15));
    assert!(
        said(-0.35).contains("moves 400 ms after its command"),
        "{}",
        said(-0.35)
    );
    assert!(said(-0.99).contains("at least 1000 ms after"), "{}", said(-0.99));
}

#[test]
fn a_position_ahead_of_its_command_is_noted_unless_the_motion_is_too_slow_to_tell() {
    let noted = |log: Recording| {
        let check = Check::new(&[log], &arm());
        check.remarks.iter().any(|finding| finding.fault == Fault::ClockOffset)
    };
    let mut late = good(6.0);
    for joint in &mut late.joints {
        joint.command.time.iter_mut().for_each(|time| *time += 0.08);
    }
    assert!(noted(late) && !noted(good(6.0)));
    // A lift that comes to rest early, where the joint sticks.
    let mut slow = good(6.0);
    for joint in &mut slow.joints {
        joint.command = series(6.0, |t| (0.3 * t).min(1.5) - 0.1 * (t - 4.0).max(0.0));
        joint.position = series(6.0, |t| (0.3 * t).min(0.9) + noise(t));
        joint.velocity = Series::default();
    }
    assert!(!noted(slow));
}
