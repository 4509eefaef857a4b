//! `omniwalk report` as a user meets it.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use omniwalk::report::motion::Motion;
use omniwalk::run::RunFolder;
use omniwalk::run::checkpoint::Checkpoint;
use omniwalk::run::metrics::MetricsWriter;
use omniwalk_sim2real::log::messages::{JointState, Odometry, Twist};
use omniwalk_sim2real::log::{LogWriter, Message};

/// Exit code, stdout and stderr of `omniwalk report ARGUMENTS`.
fn report(arguments: &[&Path]) -> (i32, String, String) {
    let output = Command::cargo_bin("omniwalk")
        .unwrap()
        .arg("report")
        .args(arguments)
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// A run that has learned for a while, without evaluation.
fn learning(folder: &Path, seed: u64) {
    let run = RunFolder::create(folder, &format!("[train]\nseed = {seed}\n# <b>\n")).unwrap();
    let columns = ["reward/total", "reward/slip", "curriculum/level", "ppo/learning_rate"];
    let mut metrics = MetricsWriter::create(&run.metrics(), &columns).unwrap();
    for update in 1..50u64 {
        let x = update as f64;
        metrics
            .append(3200 * update, &[x.sqrt() * seed as f64, 0.0, x / 50.0, 1e-3 / x])
            .unwrap();
    }
}

/// Adds a robot and a rollout in which it walks at 0.4 m/s with a cycle of 0.8 s.
fn walking(folder: &Path) {
    rollout(folder, true);
}

/// [`walking`], or a rollout in which its legs do not move.
fn rollout(folder: &Path, legs_move: bool) {
    let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots/nimbro_op2x");
    fs::create_dir_all(folder.join("robot")).unwrap();
    for name in ["nimbro_op2x.urdf", "robot.toml"] {
        fs::copy(robot.join(name), folder.join("robot").join(name)).unwrap();
    }
    let height = omniwalk_env::robot::load(&robot).unwrap().base_pose.translation.z;
    fs::create_dir_all(folder.join("rollouts")).unwrap();
    let mut log = LogWriter::create(&folder.join("rollouts/walk.mcap")).unwrap();
    for step in 0..120u64 {
        let time = step as f64 * 0.025;
        let lift = |phase: f64| f64::from(legs_move) * (std::f64::consts::TAU * (time / 0.8 + phase)).sin().max(0.0);
        let mut joints = JointState::default();
        for (side, phase) in [("left", 0.0), ("right", 0.5)] {
            joints
                .name
                .extend([format!("{side}_hip_pitch"), format!("{side}_knee_pitch")]);
            joints.position.extend([-0.6 * lift(phase), 0.6 * lift(phase)]);
        }
        let mut command = Twist::default();
        command.linear.x = 0.4;
        let mut odometry = Odometry::default();
        odometry.pose.pose.position.x = 0.4 * time;
        odometry.pose.pose.position.z = height;
        odometry.pose.pose.orientation.w = 1.0;
        odometry.twist.twist.linear.x = 0.4;
        for message in [
            Message::JointStates(joints),
            Message::CmdVel(command),
            Message::Odom(Box::new(odometry)),
        ] {
            log.write(step * 25_000_000, &message).unwrap();
        }
    }
    log.finish().unwrap();
}

/// Width, height and number of distinct colours of a picture.
fn picture(path: &Path) -> (u32, u32, usize) {
    let bytes = fs::read(path).unwrap();
    assert!(bytes.len() < 300_000, "{} has {} bytes", path.display(), bytes.len());
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let colours: BTreeSet<&[u8]> = pixels.chunks_exact(3).collect();
    (info.width, info.height, colours.len())
}

#[test]
fn a_run_with_a_rollout_gives_the_same_pictures_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    learning(&run, 7);
    walking(&run);
    fs::write(run.join("rollouts/unfinished.mcap"), b"\x89MCAP0\r\n").unwrap();
    let eval =
        r#"{"engine": "rapier", "forward": {"rows": [{"command": [0.4, 0.0, 0.0], "falls": 3, "episodes": 20}]}}"#;
    fs::write(run.join("eval.json"), eval).unwrap();
    let other = folder.path().join("other");
    for out in [&run, &other] {
        let (code, _, err) = report(&[&run, Path::new("--out"), out]);
        assert_eq!(code, 0, "{err}");
        assert!(err.contains("left out") && err.contains("unfinished.mcap"), "{err}");
    }
    for name in [
        "learning.png",
        "gait.png",
        "filmstrip.png",
        "eval_falls.png",
        "report.html",
    ] {
        assert!(
            fs::read(run.join(name)).unwrap() == fs::read(other.join(name)).unwrap(),
            "{name}"
        );
    }
    // Three quantities are not zero everywhere: a row of panels.
    assert_eq!(picture(&run.join("learning.png")).1, 76 + 190);
    for name in ["learning.png", "gait.png", "filmstrip.png", "eval_falls.png"] {
        let (width, _, colours) = picture(&run.join(name));
        assert!(
            width == 1260 && colours > 100,
            "{name}: {width} wide, {colours} colours"
        );
    }
    let html = fs::read_to_string(run.join("report.html")).unwrap();
    for part in [
        "seed 7",
        "# &lt;b&gt;",
        "<td>0.400, 0.000, 0.000</td><td>3</td>",
        "omniwalk eval",
    ] {
        assert!(html.contains(part), "{part}");
    }
    assert_eq!(html.matches("data:image/png;base64,iVBOR").count(), 4);
}

#[test]
fn a_robot_that_stands_is_not_said_to_walk() {
    let folder = tempfile::tempdir().unwrap();
    let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots/nimbro_op2x");
    let robot = omniwalk_env::robot::load(&robot).unwrap();
    let cycle = |legs_move: bool| {
        let run = folder.path().join(legs_move.to_string());
        learning(&run, 7);
        rollout(&run, legs_move);
        Motion::read(&run.join("rollouts/walk.mcap"), &robot)
            .unwrap()
            .cycle(&robot)
    };
    let (from, to) = cycle(true).unwrap();
    assert!((to - from - 0.8).abs() < 0.03, "{from} to {to}");
    assert_eq!(cycle(false), None);
    let (code, _, err) = report(&[&folder.path().join("false")]);
    assert_eq!((code, err.as_str()), (0, ""));
}

#[test]
fn runs_without_rollouts_are_drawn_over_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, out] = ["a", "b", "out"].map(|name| folder.path().join(name));
    learning(&a, 1);
    learning(&b, 2);
    let (code, _, err) = report(&[&a, &b, Path::new("--out"), &out]);
    assert_eq!((code, err.as_str()), (0, ""));
    let mut names: Vec<_> = fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["learning.png", "report.html"]);
    let html = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(html.contains("a (seed 1)") && html.contains("b (seed 2)") && html.contains("not evaluated yet"));
}

#[test]
fn a_run_that_came_apart_is_named_above_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let run = RunFolder::create(&folder.path().join("torn"), "[train]\nseed = 1\n").unwrap();
    let mut metrics = MetricsWriter::create(&run.metrics(), &["reward/total", "ppo/kl"]).unwrap();
    for update in 1..20u64 {
        let kl = if update > 15 { 0.7 } else { 0.01 };
        metrics.append(3200 * update, &[update as f64, kl]).unwrap();
    }
    let (code, _, err) = report(&[run.path()]);
    assert_eq!(code, 0, "{err}");
    let html = fs::read_to_string(run.path().join("report.html")).unwrap();
    let (head, _) = html.split_once("<img").unwrap();
    for part in [
        "WARNING: torn (seed 1): diverging: the policy changed by a KL of 0.70",
        "in 4 of 19 recorded updates, first after 51200 steps",
    ] {
        assert!(head.contains(part), "{part} is not in\n{head}");
    }
}

#[test]
fn an_evaluation_alone_gives_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let [run, out] = ["run", "out"].map(|name| folder.path().join(name));
    learning(&run, 1);
    let reference = Path::new(env!("CARGO_MANIFEST_DIR")).join("runs/nimbro_op2x_omni/seed-1/eval.json");
    fs::copy(reference, run.join("eval.json")).unwrap();
    let (code, _, err) = report(&[&run, Path::new("--out"), &out]);
    assert_eq!((code, err.as_str()), (0, ""));
    for name in ["eval_falls.png", "eval_error.png", "eval_grid.png", "eval_push.png"] {
        let (width, _, colours) = picture(&out.join(name));
        assert!(width == 1260 && colours > 50, "{name}: {colours} colours");
    }
    let html = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(!html.contains("then report again"));
}

/// The text of standard error as one line.
fn one_line(err: &str) -> String {
    let err = err.replace(['│', '×', '╰', '─', '▶', '├'], " ");
    err.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// What the reference run's evaluation says.
fn evaluated() -> serde_json::Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("runs/nimbro_op2x_omni/seed-1/eval.json");
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn a_broken_evaluation_is_named_and_the_rest_is_drawn_unless_it_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let [run, young] = ["run", "young"].map(|name| folder.path().join(name));
    learning(&run, 1);
    RunFolder::create(&young, "[train]\nseed = 1\n").unwrap();
    for (broken, part) in [
        (r#"{"falls": {"rows": [7]}}"#, "falls.rows[0]"),
        ("{}", "it has no suite, none of forward, falls, tracking, changes, push"),
        ("rubbish", "no JSON"),
    ] {
        fs::write(run.join("eval.json"), broken).unwrap();
        fs::write(young.join("eval.json"), broken).unwrap();
        let (code, out, err) = report(&[&run]);
        let err = one_line(&err);
        assert!(code == 0 && out.contains("learning.png"), "{err}");
        assert!(
            err.contains("warning: cannot draw") && err.contains("eval.json") && err.contains(part),
            "{err}"
        );
        let html = fs::read_to_string(run.join("report.html")).unwrap();
        assert!(
            html.contains("WARNING: run (seed 1): cannot draw") && html.contains(part),
            "{html}"
        );
        fs::remove_file(run.join("report.html")).unwrap();
        for path in [&run.join("eval.json"), &young] {
            let (code, _, err) = report(&[path]);
            let err = one_line(&err);
            assert!(code == 2 && err.contains("cannot draw") && err.contains(part), "{err}");
            assert!(!run.join("report.html").exists() && !young.join("report.html").exists());
        }
    }
}

#[test]
fn an_evaluation_that_is_not_of_the_newest_policy_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    learning(&run, 1);
    let mut evaluation = evaluated();
    let mut page = |steps: u64| {
        evaluation["steps"] = steps.into();
        fs::write(run.join("eval.json"), evaluation.to_string()).unwrap();
        let (code, _, err) = report(&[&run]);
        assert_eq!((code, err.as_str()), (0, ""));
        fs::read_to_string(run.join("report.html")).unwrap()
    };
    assert!(page(3200).contains("of the policy after 3200 steps, training went on to the one after 156800"));
    assert!(!page(156_800).contains("WARNING"));
    // Thinned metrics end before the training does.
    assert!(!page(160_000).contains("WARNING"));
    let run = RunFolder::open(&run).unwrap();
    run.checkpoints().save(&Checkpoint::new(160_000), 3).unwrap();
    assert!(!page(160_000).contains("WARNING"));
    assert!(page(156_800).contains("after 156800 steps, the newest checkpoint is after 160000: evaluate it again"));
}

#[test]
fn a_robot_that_cannot_be_read_costs_the_gait_and_no_more() {
    let folder = tempfile::tempdir().unwrap();
    learning(folder.path(), 1);
    walking(folder.path());
    fs::write(folder.path().join("robot/robot.toml"), b"base = \xff").unwrap();
    let (code, out, err) = report(&[folder.path()]);
    assert_eq!(code, 0, "{err}");
    assert!(one_line(&err).contains("robot.toml"), "{err}");
    assert!(out.contains("learning.png") && !out.contains("gait.png"), "{out}");
}

#[test]
fn damaged_metrics_are_named_and_the_rest_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    learning(folder.path(), 1);
    let path = folder.path().join("metrics.csv");
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] = 0xff;
    fs::write(&path, &bytes).unwrap();
    let (code, out, err) = report(&[folder.path()]);
    assert_eq!(code, 0, "{err}");
    assert!(
        one_line(&err).contains("metrics.csv:") && out.contains("learning.png"),
        "{err}{out}"
    );
    let page = fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(page.contains("the curves have a gap there"));
}

#[test]
fn a_run_without_a_record_does_not_guess_who_trained_it() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    learning(&run, 1);
    let (code, _, err) = report(&[&run]);
    assert_eq!((code, err.as_str()), (0, ""));
    let html = fs::read_to_string(run.join("report.html")).unwrap();
    assert!(html.contains("How it was trained is not recorded: there is no sessions.toml in its folder"));
    assert!(!html.contains("omniwalk train"), "{html}");
}

#[test]
fn a_configuration_that_was_emptied_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    learning(&run, 1);
    for (text, part) in [
        ("", "config.toml is empty: it is no run's configuration"),
        ("# nothing\n", "config.toml is empty: it is no run's configuration"),
        ("[package]\nname = \"a\"\n", "config.toml is no run's configuration"),
        ("[train", "config.toml is no run's configuration"),
    ] {
        fs::write(run.join("config.toml"), text).unwrap();
        let (code, _, err) = report(&[&run]);
        assert!(code == 0 && one_line(&err).contains(part), "{err}");
        let html = fs::read_to_string(run.join("report.html")).unwrap();
        assert!(html.contains("WARNING: run: ") && html.contains(part), "{html}");
    }
}

#[test]
fn a_policy_file_is_reported_with_the_evaluation_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("runs/nimbro_op2x_omni");
    let policy = folder.path().join("walk.omni");
    fs::copy(source.join("policy.omni"), &policy).unwrap();
    let (code, _, err) = report(&[&policy]);
    let err = one_line(&err);
    assert!(
        code == 2 && err.contains("there is no") && err.contains("walk.eval/eval.json"),
        "{err}"
    );
    assert!(
        err.contains("`omniwalk eval") && err.contains("of a run, give the run folder"),
        "{err}"
    );

    let beside = folder.path().join("walk.eval");
    fs::create_dir(&beside).unwrap();
    fs::copy(source.join("seed-1/eval.json"), beside.join("eval.json")).unwrap();
    let [page, push] = ["report.html", "eval_push.png"].map(|name| beside.join(name));
    for path in [&policy, &beside, &beside.join("eval.json")] {
        let (code, _, err) = report(&[path]);
        assert_eq!((code, err.as_str()), (0, ""));
        let html = fs::read_to_string(&page).unwrap();
        for part in [
            "<h2>walk.omni</h2>",
            "seed 1",
            "omniwalk eval",
            "walk.omni --engine rapier",
            "trained by omniwalk",
        ] {
            assert!(html.contains(part), "{part}");
        }
        assert!(!html.contains("Configuration") && !html.contains("WARNING"), "{html}");
        fs::remove_file(&page).unwrap();
        fs::remove_file(&push).unwrap();
    }
    fs::remove_file(&policy).unwrap();
    let (code, _, err) = report(&[&beside]);
    assert_eq!((code, err.as_str()), (0, ""));
    let html = fs::read_to_string(&page).unwrap();
    assert!(
        html.contains("there is neither run nor policy beside the evaluation"),
        "{html}"
    );
}

#[test]
fn a_policy_file_in_a_run_is_led_to_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    learning(&run, 1);
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("runs/nimbro_op2x_omni");
    fs::copy(source.join("policy.omni"), run.join("policy.omni")).unwrap();
    let (code, _, err) = report(&[&run.join("policy.omni")]);
    let err = one_line(&err);
    assert!(code == 2 && err.contains("it lies in a run: omniwalk report"), "{err}");
}

#[test]
fn what_is_no_run_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let young = folder.path().join("young");
    RunFolder::create(&young, "[train]\nseed = 1\n").unwrap();
    for (path, part) in [(folder.path(), "no config.toml in it"), (&young, "no metrics yet")] {
        let (code, _, err) = report(&[path, Path::new("--out"), &out]);
        let err = err.replace('│', " ").split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(code == 2 && err.contains(part), "{err}");
        assert!(!out.exists());
    }
}
