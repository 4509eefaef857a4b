//! Bad input through the command line: exit code 2, a message that says where and what would be right, no panic, and
//! nothing is written.

use std::fs;
use std::path::Path;

use super::support::{copy, omniwalk, refuses_in, robot, succeeds};

/// `train` with `text` as its configuration.
#[track_caller]
fn refuses_config(text: impl AsRef<[u8]>, parts: &[&str]) {
    let write = |folder: &Path| fs::write(folder.join("bad.toml"), text.as_ref()).unwrap();
    refuses_in(write, &["train", "bad.toml", "--run", "run"], parts);
}

/// `train` with a single change to a sound configuration.
#[track_caller]
fn refuses_set(change: &str, parts: &[&str]) {
    refuses_in(|_| (), &["train", "tiny.toml", "--run", "run", "--set", change], parts);
}

/// `train` and `inspect` with a robot whose URDF is NimbRo's with `from` changed to `to`.
#[track_caller]
fn refuses_robot(file: &str, from: &str, to: &str, parts: &[&str]) {
    let write = |folder: &Path| {
        copy(&robot("nimbro_op2x"), &folder.join("robot"));
        let path = folder.join("robot").join(file);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from:?} is not in {file}");
        fs::write(path, text.replacen(from, to, 1)).unwrap();
    };
    let path = ["--set", "robot.path=robot"];
    let train = [&["train", "tiny.toml", "--run", "run"], &path[..]].concat();
    refuses_in(write, &train, parts);
    refuses_in(write, &["inspect", "robot"], parts);
}

#[test]
fn a_fault_behind_seventy_thousand_columns_is_named_without_a_snippet() {
    let text = format!("ppo = {{ hidden = [8{}], epoch = 3 }}\n", " ".repeat(70_000));
    refuses_config(text, &["unknown key `ppo.epoch`", "bad.toml:1:70"]);
}

#[test]
fn a_value_of_a_megabyte_is_not_repeated() {
    for text in [
        format!("train = \"{}\"\n", "x".repeat(900_000)),
        format!("train = 3 # {}\n", "x".repeat(900_000)),
    ] {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("bad.toml"), text).unwrap();
        let output = omniwalk(folder.path(), &["train", "bad.toml", "--run", "run"]);
        let message = output.message();
        assert!(output.code == 2 && message.contains("bad.toml:1:9"), "{message:.2000}");
        assert!(message.len() < 5_000, "{} bytes", message.len());
    }
}

#[test]
fn a_value_in_the_place_of_a_table_is_refused_whatever_is_set_below_it() {
    let write = |folder: &Path| fs::write(folder.join("bad.toml"), "train = 3\n").unwrap();
    let train = ["train", "bad.toml", "--run", "run", "--steps", "1000"];
    refuses_in(write, &train, &["`train` has the wrong type", "bad.toml:1:9"]);
}

#[test]
fn a_log_that_is_none_is_called_a_log() {
    let write = |folder: &Path| fs::write(folder.join("walk.mcap"), "garbage").unwrap();
    let robot = robot("nimbro_op2x");
    let view = ["view", "walk.mcap", "--robot", robot.to_str().unwrap()];
    refuses_in(write, &view, &["walk.mcap", "MCAP"]);
}

#[test]
fn a_robot_toml_that_is_a_folder_is_refused() {
    let write = |folder: &Path| {
        copy(&robot("nimbro_op2x"), &folder.join("robot"));
        fs::remove_file(folder.join("robot/robot.toml")).unwrap();
        fs::create_dir(folder.join("robot/robot.toml")).unwrap();
    };
    let train = ["train", "tiny.toml", "--run", "run", "--set", "robot.path=robot"];
    refuses_in(write, &train, &["robot.toml"]);
}

/// One test for each wrong configuration file.
macro_rules! config_refused {
    ($($name:ident: $text:expr, $parts:expr;)*) => {
        $(#[test] fn $name() { refuses_config($text, &$parts); })*
    };
}

/// One test for each wrong `--set`.
macro_rules! set_refused {
    ($($name:ident: $change:expr, $parts:expr;)*) => {
        $(#[test] fn $name() { refuses_set($change, &$parts); })*
    };
}

/// One test for each wrong robot.
macro_rules! robot_refused {
    ($($name:ident: $file:expr, $from:expr => $to:expr, $parts:expr;)*) => {
        $(#[test] fn $name() { refuses_robot($file, $from, $to, &$parts); })*
    };
}

config_refused! {
    an_unknown_key: "[ppo]\nepoch = 3\n", ["unknown key `ppo.epoch`", "bad.toml:2:1", "did you mean `ppo.epochs`?"];
    an_unknown_section: "[pppo]\n", ["unknown key `pppo`", "bad.toml:1:2", "did you mean `ppo`?"];
    a_string_for_a_number: "[ppo]\nepochs = \"ten\"\n", ["`ppo.epochs` has the wrong type", "bad.toml:2:10", "it takes"];
    a_fraction_for_a_count: "[train]\nenvironments = 2.5\n", ["`train.environments`", "bad.toml:2:16"];
    a_negative_count: "[train]\nenvironments = -2\n", ["`train.environments`", "bad.toml:2:16"];
    a_value_out_of_range: "[ppo]\ngamma = 1.5\n", ["`ppo.gamma` must be 0 to 1", "bad.toml:2:9"];
    a_value_that_is_no_number: "[reward]\nclearance = nan\n", ["bad.toml:2:13", "not a number"];
    broken_toml: "[ppo]\nepochs = = 3\n", ["not valid TOML", "bad.toml:2:10"];
    a_key_given_twice: "train.seed = 1\ntrain.seed = 2\n", ["bad.toml:2:", "duplicate key"];
    text_that_is_not_utf_8: b"robot.path = \"\xff\"\n", ["cannot read bad.toml", "not UTF-8"];
    a_file_that_is_too_large: vec![b'#'; 1 << 21], ["cannot read bad.toml", "larger than 1 MiB"];
    an_unknown_engine: "[engine]\nkind = \"mujoco\"\n", ["cannot be `mujoco`", "bad.toml:2:8", "rapier, lanes"];
    an_unknown_engine_in_a_word: "engine = \"mujoco\"\n", ["`engine.kind` cannot be `mujoco`", "bad.toml:1:10", "rapier, lanes"];
    an_unknown_block: "[observation]\nblocks = [\"gyroscope\"]\n", ["bad.toml:2:11", "the choices are joint_position"];
    a_key_of_another_schedule: "[ppo.schedule]\ntype = \"fixed\"\nkl_target = 0.02\n", ["unknown key `ppo.schedule.kl_target`", "bad.toml:3:1", "there is `ppo.schedule.kl_target` only with `ppo.schedule.type = \"adaptive\"`"];
    a_section_written_as_a_list: "[[ppo]]\nepochs = 3\n", ["`ppo` has the wrong type", "bad.toml:1:", "write `[ppo]` once, not `[[ppo]]`"];
    a_list_of_schedules: "[[ppo.schedule]]\ntype = \"fixed\"\n", ["`ppo.schedule` has the wrong type", "bad.toml:1:", "write `[ppo.schedule]` once"];
    a_number_for_a_section: "ppo = 3\n", ["`ppo` has the wrong type", "bad.toml:1:7", "it takes a table"];
    a_value_that_a_default_contradicts: "[ppo]\nlearning_rate = 1e-6\n", ["`ppo.schedule.minimum` must be above 0 and at most learning_rate", "bad.toml:2:17"];
    a_rate_that_a_default_contradicts: "[engine]\ncontrol_hz = 30\n", ["`engine.physics_hz` must be a multiple of engine.control_hz = 30", "bad.toml:2:14"];
    two_wrong_values: "[ppo]\ngamma = 2.0\n[train]\nsteps = 0\n", ["`ppo.gamma`", "`train.steps` must be", "bad.toml:4:9"];
}

set_refused! {
    a_change_of_an_unknown_key: "reward.clearence=0.1", ["unknown key", "--set:1:8", "did you mean `reward.clearance`?"];
    a_change_of_the_wrong_type: "reward.clearance=high", ["`reward.clearance` has the wrong type", "--set:1:18"];
    a_change_of_a_key_that_two_tables_have: "seed=3", ["unknown key `seed`", "--set:1:1"];
    a_change_out_of_range: "latency.upper=3", ["`latency.upper` must be latency.lower to 1 s", "--set:1:15"];
    a_change_without_value: "train.seed", ["`--set` takes key=value"];
    a_physics_rate_that_is_no_multiple_of_the_control_rate: "engine.physics_hz=210", ["`engine.physics_hz` must be a multiple of engine.control_hz = 40", "such as 200"];
    a_clocked_swing_without_clock: "clock.enabled=false", ["`reward.clock_swing` must be false, or clock.enabled = true"];
    more_samples_than_fit_into_memory: "train.steps_per_update=1000000", ["`train.steps_per_update` must be"];
    more_environments_than_fit_into_memory: "train.environments=1000000", ["`train.environments` must be 1 to 8192"];
    more_evaluations_than_fit_into_memory: "eval.episodes=10000", ["`eval.episodes` must be"];
    an_endless_time_between_checkpoints: "train.checkpoint_minutes=inf", ["train.checkpoint_minutes"];
    a_core_outside_the_commands: "curriculum.core=[9.0, 0.0, 0.0]", ["`curriculum.core` must be within command.lower", "--set:1:17"];
    shares_that_are_more_than_all: "command.zero_share=0.9", ["`command.axis_share` must be at most 1 - command.zero_share"];
    a_lower_bound_above_zero: "command.lower=[0.1, 0.0, 0.0]", ["`command.lower` must be"];
    a_weight_beyond_any_learner: "reward.velocity_weight=1e300", ["`reward.velocity_weight` must be 0 to 1e6", "--set:1:24"];
    a_clock_that_never_ticks: "clock.period=0", ["`clock.period` must be 1e-6 to 1e6"];
    layers_that_are_too_wide: "ppo.hidden=[100000]", ["`ppo.hidden` must be"];
    a_block_given_twice: "observation.blocks=[\"gyro\", \"gyro\"]", ["`observation.blocks` must be a list with each block at most once"];
    a_pose_joint_that_does_not_exist: "reward.pose_joints=[\"left_tail\"]", ["reward.pose_joints", "no policy joint matches `left_tail`", "left_hip_yaw"];
    a_robot_that_does_not_exist: "robot.path=nowhere", ["nowhere: does not exist"];
    a_robot_without_a_path: "robot.path=\"\"", ["`robot.path` must be the path of a robot folder", "--set:1:12"];
    a_change_to_nan: "ppo.lambda=nan", ["the value of `ppo.lambda` cannot be used", "this is not a number", "--set:1:12"];
    a_nan_in_a_list: "command.lower=[nan, 0.0, 0.0]", ["the value of `command.lower` cannot be used", "this is not a number", "--set:1:16"];
    two_changes_in_one: "ppo.epochs=3\nppo.clip=0.1", ["one change at a time"];
    a_start_as_a_heap: "randomise.start_position=10", ["`randomise.start_position` must be 0 to 1", "--set:1:26"];
    a_robot_folder_without_urdf: "robot.path=.", ["holds 0 .urdf files"];
}

robot_refused! {
    xml_that_is_broken: "nimbro_op2x.urdf", "</robot>" => "", ["nimbro_op2x.urdf:", "not XML"];
    a_loop_of_links: "nimbro_op2x.urdf", "<child link=\"left_hip_roll_link\"/>" => "<child link=\"base_link\"/>", ["nimbro_op2x.urdf:"];
    a_moving_link_without_mass: "nimbro_op2x.urdf", "</robot>" => "<link name=\"antenna\"/><joint name=\"wag\" type=\"continuous\"><parent link=\"left_hip_yaw_link\"/><child link=\"antenna\"/><axis xyz=\"0 0 1\"/></joint></robot>", ["nimbro_op2x.urdf:", "no mass or inertia", "locked = [\"wag\"]"];
    a_revolute_joint_without_limits: "nimbro_op2x.urdf", "<limit " => "<unlimited ", ["nimbro_op2x.urdf:", "no position limits"];
    a_nan_in_the_urdf: "nimbro_op2x.urdf", "<mass value=\"" => "<mass value=\"NaN\" was=\"", ["nimbro_op2x.urdf:", "not finite"];
    a_mimic_of_an_unknown_joint: "nimbro_op2x.urdf", "<mimic joint=\"" => "<mimic joint=\"no_", ["nimbro_op2x.urdf:", "does not exist"];
    a_joint_name_given_twice: "nimbro_op2x.urdf", "<joint name=\"left_hip_roll\"" => "<joint name=\"left_hip_yaw\"", ["nimbro_op2x.urdf:", "two <joint>"];
    an_unknown_joint_in_the_toml: "robot.toml", "\"*_hip_yaw\"" => "\"*_hip_yawn\"", ["robot.toml:", "no joint matches `*_hip_yawn`"];
    an_unknown_key_in_the_toml: "robot.toml", "armature" => "armatur", ["robot.toml:", "armatur"];
    a_joint_entry_without_joints: "robot.toml", "match = [\"*_hip_yaw\"]" => "match = []", ["robot.toml:22:1", "matches no joint"];
    a_joint_entry_for_a_fixed_joint: "nimbro_op2x.urdf", "<joint name=\"left_shoulder_roll\" type=\"revolute\"" => "<joint name=\"left_shoulder_roll\" type=\"fixed\"", ["robot.toml:", "`left_shoulder_roll` matches only joints that do not move"];
    a_mass_of_nothing: "nimbro_op2x.urdf", "<mass value=\"0.315\"" => "<mass value=\"1e-300\"", ["nimbro_op2x.urdf:", "a mass of 1e-300 kg"];
    a_limit_beyond_the_world: "nimbro_op2x.urdf", "lower=\"-0.8\" upper=\"0.8\"" => "lower=\"-1e30\" upper=\"1e30\"", ["robot.toml:", "has limits of", "1e30"];
    a_policy_joint_that_turns_without_end: "nimbro_op2x.urdf", "<joint name=\"left_hip_yaw\" type=\"revolute\"" => "<joint name=\"left_hip_yaw\" type=\"continuous\"", ["robot.toml:", "`left_hip_yaw` has no position limits", "limits ="];
    a_second_mass: "nimbro_op2x.urdf", "<mass value=\"0.315\"/>" => "<mass value=\"0.315\"/>\n      <mass value=\"0.3\"/>", ["nimbro_op2x.urdf:30:7", "a second <mass> in one <inertial>"];
    a_mimic_that_follows_nothing: "nimbro_op2x.urdf", "<mimic joint=\"left_knee_pitch\" multiplier=\"-1\"" => "<mimic joint=\"left_knee_pitch\" multiplier=\"0\"", ["nimbro_op2x.urdf:", "with a multiplier of 0"];
    a_joint_that_is_held_on_one_side_only: "nimbro_op2x.urdf", "lower=\"-0.8\" upper=\"0.8\"" => "lower=\"0\" upper=\"0\"", ["robot.toml:", "the limits of", "no mirror images: 0 to 0"];
    mirror_words_that_are_the_same: "robot.toml", "right = \"right\"" => "right = \"left\"", ["robot.toml:", "told apart by the same word, `left`"];
    an_overlap_of_a_link_with_itself: "robot.toml", "\"right_ankle_roll_link\"]" => "\"left_ankle_roll_link\"]", ["robot.toml:", "one rigid body"];
    two_feet_on_one_link: "robot.toml", "link = \"right_ankle_roll_link\"" => "link = \"left_ankle_roll_link\"", ["robot.toml:", "the feet `left` and `right` are on one link"];
    a_foot_on_the_head: "robot.toml", "link = \"left_ankle_roll_link\"" => "link = \"head_pitch_link\"", ["robot.toml:", "above the robot's centre of mass"];
    an_armature_that_nothing_moves: "robot.toml", "armature = 0.08" => "armature = 1e9", ["robot.toml:", "an armature of 1e9 kg m^2"];
    a_negative_gain: "robot.toml", "kp = 400.0" => "kp = -400.0", ["robot.toml:", "impossible value"];
}

#[test]
fn a_file_where_a_folder_is_needed() {
    let file = |folder: &Path| fs::write(folder.join("file"), "").unwrap();
    for run in ["file", "file/run"] {
        refuses_in(
            file,
            &["train", "tiny.toml", "--run", run, "--quiet"],
            &["file is a file, not a folder", "--run DIR"],
        );
    }
    refuses_in(
        |folder| fs::write(folder.join("policy.omni"), "").unwrap(),
        &["train", "tiny.toml", "--run", "run", "--from", "policy.omni"],
        &["--from takes a run folder; policy.omni is a file", "runs/forward-1"],
    );
}

#[test]
fn a_configuration_that_does_not_exist() {
    refuses_in(
        |_| (),
        &["train", "none.toml", "--run", "run"],
        &["cannot read none.toml"],
    );
    refuses_in(|_| (), &["train", ".", "--run", "run"], &["cannot read ."]);
}

#[test]
fn arguments_that_make_no_sense() {
    for (arguments, part) in [
        (
            &["train", "tiny.toml", "--engine", "mujoco"][..],
            "invalid value 'mujoco' for '--engine",
        ),
        (&["train", "tiny.toml", "--threads", "0"], "0 is not in 1..=1024"),
        (&["train", "tiny.toml", "--steps", "0"], "`train.steps` must be"),
        (
            &["train", "tiny.toml", "--steps", "many"],
            "invalid value 'many' for '--steps",
        ),
        (
            &["train", "tiny.toml", "--crosscheck-every", "0"],
            "at least 1 step lies between two",
        ),
        (
            &["train", "tiny.toml", "--seed", "18446744073709551615"],
            "18446744073709551615 is not in",
        ),
        (&["train", "tiny.toml", "--resume"], "cannot be used with"),
        (&["train", "--resume"], "--resume needs --run DIR"),
        (&["train", "--resume", "--run", "none"], "none holds no run"),
        (&["train", "tiny.toml", "--run", "tiny.toml"], "tiny.toml"),
        (&["eval", "none"], "none holds no run"),
        (&["eval", "tiny.toml"], "tiny.toml: not a policy file"),
        (&["rehearse", "tiny.toml"], "tiny.toml: not a policy file"),
        (&["export", "tiny.toml"], "required arguments were not provided"),
        (&["eval", "."], "holds no run"),
        (&["export", ".", "--out", "p.omni"], "a policy.omni in the folder"),
        (&["rehearse", "."], ". is a folder, not a policy file"),
        (
            &["bench", "controller"],
            "without a policy the default robot is measured",
        ),
        (&["bench", "controller"], "`omniwalk bench controller walk.omni`"),
        (&["inspect", "none"], "cannot read none"),
        (&["inspect", "."], "is none of the files omniwalk knows"),
        (&["bench", "env", "--seconds", "0"], "0 is not in 1..=86400"),
        (&["walk"], "unrecognized subcommand"),
    ] {
        refuses_in(|_| (), arguments, &[part]);
    }
}

#[test]
fn a_robot_that_cannot_walk() {
    let pendulum = format!("robot.path={:?}", robot("pendulum"));
    refuses_set(&pendulum, &["`pendulum`", "fixed base", "floating"]);
    // Soles that no TOML describes are guessed from collision shapes; here there are none.
    let no_feet = |folder: &Path| {
        let text = fs::read_to_string(robot("nimbro_op2x").join("nimbro_op2x.urdf")).unwrap();
        let text = text.replace("<collision", "<unseen").replace("</collision", "</unseen");
        fs::create_dir(folder.join("robot")).unwrap();
        fs::write(folder.join("robot/robot.urdf"), text).unwrap();
        fs::write(folder.join("robot/robot.toml"), "base = \"floating\"\n").unwrap();
    };
    let arguments = ["train", "tiny.toml", "--run", "run", "--set", "robot.path=robot"];
    refuses_in(no_feet, &arguments, &["has no feet", "[[foot]]"]);
}

#[test]
fn a_robot_with_one_foot_whose_curriculum_waits_for_two() {
    let one_foot = |folder: &Path| {
        copy(&robot("nimbro_op2x"), &folder.join("robot"));
        let path = folder.join("robot/robot.toml");
        let text = fs::read_to_string(&path).unwrap();
        let (first, second) = (text.find("[[foot]]").unwrap(), text.rfind("[[foot]]").unwrap());
        let end = text.find("[mirror]").unwrap();
        assert!(first < second && second < end);
        fs::write(&path, format!("{}{}", &text[..second], &text[end..])).unwrap();
    };
    let train = ["train", "tiny.toml", "--run", "run", "--set", "robot.path=robot"];
    refuses_in(
        one_foot,
        &train,
        &[
            "is for two feet; robot `nimbro_op2x` has 1",
            "curriculum.velocity_gate_foot=0",
        ],
    );
    let folder = tempfile::tempdir().unwrap();
    one_foot(folder.path());
    let described = succeeds(folder.path(), &["inspect", "robot"]).out;
    assert!(described.contains("none of the reward's foot term"), "{described}");
}

#[test]
fn a_configuration_that_cannot_be_used_is_not_described_either() {
    for (text, parts) in [
        ("[ppo]\nepoch = 3\n", ["unknown key `ppo.epoch`", "bad.toml:2:1"]),
        ("[ppo]\ngamma = 7\n", ["`ppo.gamma` must be 0 to 1", "bad.toml:2:9"]),
        (
            "[ppo]\nepochs = \"3\"\n",
            ["`ppo.epochs` has the wrong type", "bad.toml:2:10"],
        ),
        ("[package]\nname = \"x\"\n", ["unknown key `package`", "bad.toml:1:2"]),
    ] {
        let write = |folder: &Path| fs::write(folder.join("bad.toml"), text).unwrap();
        refuses_in(write, &["inspect", "bad.toml"], &parts);
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_in_the_place_of_a_file_is_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("robot")).unwrap();
    for name in ["pipe.toml", "pipe.omni", "robot/pipe.urdf"] {
        let path = folder.path().join(name);
        let made = std::process::Command::new("mkfifo").arg(path).status().unwrap();
        assert!(made.success());
    }
    for arguments in [
        &["train", "pipe.toml", "--run", "run"][..],
        &["train", "--set", "robot.path=robot", "--run", "run"],
        &["inspect", "pipe.toml"],
        &["inspect", "robot"],
        &["eval", "pipe.omni"],
        &["rehearse", "pipe.omni"],
    ] {
        let output = omniwalk(folder.path(), arguments);
        assert_eq!((output.code, output.out.as_str()), (2, ""), "{arguments:?}");
        assert!(!folder.path().join("run").exists());
    }
}

#[test]
fn mirroring_a_robot_without_a_mirror_map() {
    let no_map = |folder: &Path| {
        copy(&robot("nimbro_op2x"), &folder.join("robot"));
        let path = folder.join("robot/robot.toml");
        let text = fs::read_to_string(&path).unwrap();
        let at = text.find("[mirror]").unwrap();
        let end = text[at..].find("[[").map_or(text.len(), |end| at + end);
        fs::write(&path, format!("{}{}", &text[..at], &text[end..])).unwrap();
    };
    let arguments = [
        "train",
        "tiny.toml",
        "--run",
        "run",
        "--set",
        "robot.path=robot",
        "--set",
        "train.mirror=true",
    ];
    refuses_in(
        no_map,
        &arguments,
        &["train.mirror", "no left-right mirror map", "train.mirror = false"],
    );
}
