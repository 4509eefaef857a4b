//! What the command line says of itself: completions and manual pages.

use std::fs;
use std::path::Path;

use super::support::{refuses_in, succeeds};

#[test]
fn every_shell_gets_completions_that_know_the_commands() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = succeeds(folder.path(), &["completions", shell]).out;
        assert!(
            script.contains("crosscheck") && script.contains("best-transfer"),
            "{shell}: {script}"
        );
    }
    let others = "[possible values: bash, elvish, fish, powershell, zsh]";
    refuses_in(|_| (), &["completions", "tcsh"], &["tcsh", others]);
}

#[test]
fn manual_pages_describe_every_command_and_are_refused_a_folder_that_cannot_be() {
    let folder = tempfile::tempdir().unwrap();
    succeeds(folder.path(), &["man", "pages/man1"]);
    let page = |name: &str| fs::read_to_string(folder.path().join("pages/man1").join(name)).unwrap();
    assert!(
        page("omniwalk.1").contains("omniwalk\\-train(1)"),
        "{}",
        page("omniwalk.1")
    );
    assert!(page("omniwalk-train.1").contains("\\-\\-crosscheck\\-every"));
    let file = |folder: &Path| fs::write(folder.join("file"), "").unwrap();
    refuses_in(file, &["man", "file/man1"], &["cannot write manual pages to file/man1"]);
}
