//! The controller needs neither the standard library nor an operating system, and no allocator once a policy is loaded.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const HERE: &str = env!("CARGO_MANIFEST_DIR");

fn folder() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("bare")
}

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {errors}");
    output
}

fn build(target: Option<&str>) {
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .args(["build", "--release", "--locked", "--target-dir"])
        .arg(folder());
    cargo
        .arg("--manifest-path")
        .arg(Path::new(HERE).join("tests/bare/Cargo.toml"));
    cargo.args(target.iter().flat_map(|target| ["--target", target]));
    run(&mut cargo);
}

#[test]
fn a_library_without_the_standard_library_walks_and_allocates_nothing_once_it_is_loaded() {
    build(None);
    let program = folder().join("walk");
    let mut compiler = Command::new("cc");
    compiler.arg(Path::new(HERE).join("tests/bare/main.c"));
    run(compiler
        .arg(folder().join("release/libomniwalk_controller_bare.a"))
        .arg("-o")
        .arg(&program));
    let policies = Path::new(HERE).join("../fuzz/corpus/policy_file");
    let mut walks = 0;
    for policy in policies.read_dir().expect("the fuzzer's corpus") {
        let policy = policy.expect("a file").path();
        let output = run(Command::new(&program).arg(&policy));
        let modes = String::from_utf8_lossy(&output.stdout);
        assert_eq!(modes.trim(), "15", "{}: every mode was seen", policy.display());
        walks += 1;
    }
    assert!(walks >= 5);
}

/// Only where rustup has the target: the project does not ask for it.
#[test]
fn the_library_builds_for_a_microcontroller() {
    const TARGET: &str = "thumbv7em-none-eabihf";
    let installed = Command::new("rustc")
        .args(["--print", "sysroot"])
        .output()
        .expect("rustc");
    let sysroot = String::from_utf8_lossy(&installed.stdout);
    if Path::new(sysroot.trim()).join("lib/rustlib").join(TARGET).is_dir() {
        build(Some(TARGET));
    } else {
        eprintln!("skipped: `rustup target add {TARGET}` makes it run");
    }
}
