//! Files from outside: everything the fuzzer begins with and has found, and mutations of it, through the checks of `fuzz/`, with
//! bounds on time and memory.

use std::fs;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use omniwalk_allocations::Peak;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[path = "../fuzz/src/lib.rs"]
#[expect(dead_code, reason = "the seeds are made with the rest")]
mod checks;

#[global_allocator]
static ALLOCATOR: Peak = Peak::new();

/// What a file of a few kilobytes may take: far below the gigabyte and the ten seconds that are promised.
const MOST_BYTES: usize = 256 << 20;
const LONGEST: Duration = Duration::from_secs(5);
/// Mutations of each file.
const MUTATIONS: u64 = 300;

type Check = fn(&[u8]);

const KINDS: [(&str, Check); 7] = [
    ("policy_file", checks::policy_file::check),
    ("urdf", checks::urdf::check),
    ("robot_toml", checks::robot_toml::check),
    ("config", checks::config::check),
    ("log", checks::log::check),
    ("columns", checks::columns::check),
    ("checkpoint", checks::checkpoint::check),
];

/// One test, as memory is that of the whole process.
#[test]
fn no_file_of_the_corpus_and_no_mutation_of_it_takes_long_or_much_memory_or_makes_a_reader_panic() {
    for (kind, check) in KINDS {
        let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(kind);
        let mut files: Vec<_> = fs::read_dir(&corpus)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        files.sort();
        assert!(files.len() >= 2, "{kind}");
        for file in files {
            let bytes = fs::read(&file).unwrap();
            assert!(bytes.len() <= 32 << 10, "{} is not small", file.display());
            bounded(&file.display().to_string(), check, &bytes);
            for seed in 0..MUTATIONS {
                let mutated = mutated(&bytes, seed);
                bounded(&format!("{}, mutation {seed}", file.display()), check, &mutated);
            }
        }
    }
}

/// Runs the check in a thread, so that a panic is told with the file it is of.
fn bounded(name: &str, check: Check, bytes: &[u8]) {
    let (begin, before) = (Instant::now(), ALLOCATOR.begin());
    let whole = thread::scope(|scope| scope.spawn(|| check(bytes)).join().is_ok());
    let (took, most) = (begin.elapsed(), ALLOCATOR.most() - before);
    if !whole || most >= MOST_BYTES || took >= LONGEST {
        let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join("hostile");
        fs::write(&kept, bytes).unwrap();
        let ended = if whole { "ends" } else { "panics" };
        panic!(
            "{name}: {ended} after {took:?} with {most} bytes; it is kept as {}",
            kept.display()
        );
    }
}

/// A few bytes changed, a stretch cut out or repeated, digits made others: what a fuzzer does, the same at every run.
fn mutated(bytes: &[u8], seed: u64) -> Vec<u8> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut bytes = bytes.to_vec();
    for _ in 0..random.random_range(1..6) {
        if bytes.is_empty() {
            break;
        }
        let at = random.random_range(0..bytes.len());
        let end = (at + random.random_range(1..64)).min(bytes.len());
        match random.random_range(0..6) {
            0 => bytes[at] = random.random(),
            1 => bytes[at] ^= 1 << random.random_range(0..8),
            2 => drop(bytes.drain(at..end)),
            3 => {
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            4 => bytes[at..end].fill(random.random()),
            _ => {
                let digit = b'0' + random.random_range(0..10);
                bytes[at..end]
                    .iter_mut()
                    .filter(|byte| byte.is_ascii_digit())
                    .for_each(|byte| *byte = digit);
            }
        }
    }
    bytes
}
