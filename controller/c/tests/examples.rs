//! The examples in C and C++ are built by the system's compiler against both libraries, and reproduce a policy file.

#[path = "../../tests/support/mod.rs"]
mod support;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Where cargo puts the libraries of this package: beside the test's own executable.
fn libraries() -> PathBuf {
    let test = std::env::current_exe().expect("a test has a path");
    test.parent().expect("a folder").to_owned()
}

#[track_caller]
fn run(command: &mut Command) -> String {
    let Output { status, stdout, stderr } = command.output().expect("the program starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(status.success(), "{command:?}\n{}{}", text(&stdout), text(&stderr));
    text(&stdout)
}

fn build(compiler: &str, options: &[&str], source: &str, libraries: &[&str], program: &Path) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(compiler);
    command.args(["-Wall", "-Wextra", "-Werror", "-O1"]).args(options);
    command
        .arg("-I")
        .arg(folder.join("include"))
        .arg(folder.join("examples").join(source));
    run(command
        .args(libraries)
        .args(["-lpthread", "-ldl", "-lm", "-o"])
        .arg(program));
}

#[test]
fn both_examples_reproduce_the_golden_steps() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("policy.omni");
    fs::write(&file, support::policy(512).to_bytes()).expect("writes");
    let found = libraries();
    let fixed = found.join("libomniwalk_c.a");
    let program = folder.path().join("golden_c");
    build(
        "cc",
        &["-std=c99", "-pedantic"],
        "golden.c",
        &[fixed.to_str().expect("text")],
        &program,
    );
    assert_eq!(
        run(Command::new(&program).arg(&file)),
        "reproduced 60 golden steps of 2 joints\n"
    );

    let output = Command::new(&program).output().expect("starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).starts_with("usage: "));

    let program = folder.path().join("golden_cpp");
    let search = format!("-L{}", found.display());
    build(
        "c++",
        &["-std=c++17"],
        "golden.cpp",
        &[&search, "-lomniwalk_c", &format!("-Wl,-rpath,{}", found.display())],
        &program,
    );
    let text = run(Command::new(&program).arg(&file).env_remove("LD_LIBRARY_PATH"));
    assert!(
        text.contains("refused: joint `left` expected at index 0, robot has it at 1"),
        "{text}"
    );
    assert!(text.contains("reproduced 60 golden steps"), "{text}");

    // A damaged file ends in a message, not in a crash.
    let mut bytes = support::policy(512).to_bytes();
    bytes[1000] ^= 1;
    fs::write(&file, bytes).expect("writes");
    let output = Command::new(&program).arg(&file).output().expect("starts");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("damaged"));
}

#[test]
fn a_policy_inside_the_program_needs_no_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes: String = support::policy(64)
        .to_bytes()
        .iter()
        .map(|byte| format!("{byte},"))
        .collect();
    let header = "#include <stddef.h>\nextern const unsigned char omniwalk_policy[];\nextern const size_t omniwalk_policy_size;\n";
    let source = format!(
        "#include \"policy.h\"\nconst unsigned char omniwalk_policy[] = {{{bytes}}};\n\
         const size_t omniwalk_policy_size = sizeof omniwalk_policy;\n"
    );
    let place = |name: &str| folder.path().join(name);
    fs::write(place("policy.h"), header).expect("writes");
    fs::write(place("policy.c"), source).expect("writes");
    let (array, here) = (place("policy.c"), format!("-I{}", folder.path().display()));
    let fixed = libraries().join("libomniwalk_c.a");
    let program = place("golden");
    build(
        "cc",
        &["-std=c99", "-pedantic", "-DPOLICY_INSIDE", &here],
        "golden.c",
        &[array.to_str().expect("text"), fixed.to_str().expect("text")],
        &program,
    );
    assert_eq!(
        run(&mut Command::new(&program)),
        "reproduced 60 golden steps of 2 joints\n"
    );
}
