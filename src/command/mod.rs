//! The commands, one file each.

pub mod bench;
pub mod crosscheck;
pub mod eval;
pub mod excite;
pub mod export;
pub mod guide;
pub mod identify;
pub mod init;
pub mod inspect;
#[cfg(unix)]
pub mod rehearse;
pub mod replay;
pub mod report;
pub mod train;
pub mod view;

pub mod load;

/// A number of control steps, which may be grouped: 30_000_000.
fn steps(text: &str) -> Result<u64, String> {
    text.replace('_', "").parse().map_err(|error| format!("{error}"))
}

/// How many threads a command, or a batch in Python, may be given: a slip of a zero must not start a million.
pub const THREADS: std::ops::RangeInclusive<i64> = 1..=1024;
