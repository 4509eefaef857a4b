//! `omniwalk crosscheck`, and what else speaks of it, without MuJoCo: what is missing or wrong is said. With MuJoCo it runs in
//! python/tests.

use std::fs;
use std::path::Path;

use super::support::{omniwalk, refuses_in, succeeds, tiny};

/// The walk of the repository.
fn policy() -> String {
    super::support::policy().to_str().unwrap().to_owned()
}

/// The default robot, whatever folder the command runs in.
fn robot() -> String {
    super::support::robot("nimbro_op2x").to_str().unwrap().to_owned()
}

#[track_caller]
fn refuses(prepare: impl FnOnce(&Path), arguments: &[&str], parts: &[&str]) {
    let (policy, robot) = (policy(), robot());
    refuses_in(
        prepare,
        &[&["crosscheck", &policy, "--robot", &robot], arguments].concat(),
        parts,
    );
}

#[test]
fn an_interpreter_that_is_not_there_is_named_and_so_is_the_way_out() {
    let parts = [
        "cannot start Python at no/python",
        "--python venv/bin/python",
        "environment of its own",
    ];
    refuses(|_| (), &["--python", "no/python", "--out", "out"], &parts);
}

#[cfg(unix)]
#[test]
fn an_interpreter_without_mujoco_is_told_what_to_install() {
    use std::os::unix::fs::PermissionsExt;
    let write = |folder: &Path| {
        let script =
            "#!/bin/sh\necho 'Traceback' >&2\necho \"ModuleNotFoundError: No module named 'mujoco'\" >&2\nexit 1\n";
        fs::write(folder.join("python"), script).unwrap();
        fs::set_permissions(folder.join("python"), fs::Permissions::from_mode(0o755)).unwrap();
    };
    let parts = [
        "No module named 'mujoco'",
        "./python -m pip install mujoco==",
        "numpy==",
    ];
    refuses(write, &["--python", "./python", "--out", "out"], &parts);
}

#[test]
fn nothing_is_installed_into_a_folder_that_is_somebody_elses() {
    let write = |folder: &Path| {
        fs::create_dir(folder.join("mine")).unwrap();
        fs::write(folder.join("mine/pyvenv.cfg"), "").unwrap();
    };
    let parts = [
        "mine is not empty and was not made by omniwalk",
        "--python FOLDER/bin/python",
    ];
    refuses(write, &["--venv", "mine", "--out", "out"], &parts);
}

#[test]
fn arguments_that_do_not_go_together_are_refused() {
    refuses(
        |_| (),
        &["--checkpoint", "x.safetensors"],
        &["--checkpoint is for run folders"],
    );
    refuses(|_| (), &["--seconds", "nan"], &["--seconds takes a time above 0"]);
    let far = ["--suite", "commands", "--set", "eval.commands=[[3.0, 0.0, 0.0]]"];
    refuses(
        |_| (),
        &far,
        &[
            "what `commands` asks for",
            "within the bounds the policy was trained for",
        ],
    );
    refuses(
        |_| (),
        &["--set", "ground.kind=slope"],
        &["level plane", "ground.kind=plane"],
    );
    refuses(
        |_| (),
        &["--suite", "push"],
        &["pushes alone say nothing of survival", "--suite commands,push"],
    );
    refuses_in(|_| (), &["crosscheck", "none"], &["none holds no run"]);
    refuses_in(
        |_| (),
        &["train", "tiny.toml", "--run", "run", "--python", "python3"],
        &["--crosscheck-every"],
    );
}

#[test]
fn the_best_transfer_is_refused_where_nothing_was_measured() {
    let policy = policy();
    let arguments = ["export", &policy, "--best-transfer", "--out", "a.omni"];
    refuses_in(
        |_| (),
        &arguments,
        &["--best-transfer chooses among the checkpoints of a run"],
    );
    let train = |folder: &Path| {
        let start = [
            "train",
            "tiny.toml",
            "--run",
            "run",
            "--engine",
            "lanes",
            "--steps",
            "120",
            "--quiet",
        ];
        succeeds(folder, &start);
    };
    let arguments = ["export", "run", "--best-transfer", "--out", "a.omni"];
    let parts = [
        "no checkpoint of run was cross-checked",
        "--resume --run run --steps N --crosscheck-every N",
    ];
    refuses_in(train, &arguments, &parts);
}

#[test]
fn a_cross_check_in_the_background_that_fails_is_reported_and_training_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("tiny.toml"), tiny()).unwrap();
    let train = |run: &str, more: &[&str]| {
        let start = ["train", "tiny.toml", "--run", run, "--engine", "lanes", "--quiet"];
        let output = omniwalk(folder.path(), &[&start[..], more].concat());
        assert_eq!(output.code, 0, "{}", output.err);
        (super::support::state(&folder.path().join(run)), output.message())
    };
    let (alone, _) = train("alone", &[]);
    let (beside, said) = train("beside", &["--crosscheck-every", "120", "--python", "no/python"]);
    assert!(alone == beside, "the cross-check changed the training");
    assert!(said.contains("warning: the cross-check of step 480 failed"), "{said}");
    let log = fs::read_to_string(folder.path().join("beside/crosscheck/log.txt")).unwrap();
    assert!(log.contains("cannot start Python"), "{log}");
}
