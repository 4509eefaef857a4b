//! What the fuzzer begins with, and what it has found, through the same checks as in `fuzz/`.

use std::fs;
use std::path::Path;

#[path = "../../fuzz/src/policy_file.rs"]
mod check;

#[test]
fn every_file_of_the_corpus_is_loaded_or_refused_and_walks_within_limits() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus/policy_file");
    let mut files = 0;
    for entry in corpus.read_dir().expect("the fuzzer's corpus") {
        let bytes = fs::read(entry.expect("a file").path()).expect("a readable file");
        check::check(&bytes);
        files += 1;
    }
    assert!(files >= 5);
}

#[test]
fn the_checks_of_the_fuzzer_reach_the_policy_behind_the_checksums() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus/policy_file/everything.omni");
    let mut bytes = fs::read(corpus).expect("a readable file");
    let last = bytes.len() - 1;
    // The exponent of the last golden target: the file is intact, the policy does not do what it says.
    bytes[last] ^= 0x40;
    let whole = omniwalk_controller::Policy::from_bytes(&bytes).expect_err("damaged");
    assert!(whole.to_string().contains("checksum"), "{whole}");
    assert!(check::seal(&mut bytes));
    let sealed = omniwalk_controller::Policy::from_bytes(&bytes).expect_err("another policy");
    assert!(sealed.to_string().contains("golden targets"), "{sealed}");
}
