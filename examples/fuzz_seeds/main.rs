//! Writes those files the fuzzer begins with that nobody writes by hand: policies, logs, checkpoints.
//!
//!     cargo run --release --example fuzz_seeds

#[path = "../../fuzz/src/lib.rs"]
#[expect(dead_code, reason = "only the smallest training is taken from there")]
mod checks;

mod checkpoints;
mod logs;
mod policies;

use std::fs;
use std::path::Path;

fn main() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    for (name, files) in [
        ("policy_file", policies::files()),
        ("log", logs::files()),
        ("checkpoint", checkpoints::files()),
    ] {
        let folder = corpus.join(name);
        fs::create_dir_all(&folder).expect("a writable folder");
        for (file, bytes) in files {
            fs::write(folder.join(file), bytes).expect("a writable folder");
        }
    }
}
