//! omniwalk through its command line, as a user runs it.

mod bad_input;
mod bad_run;
mod close_the_loop;
mod crosscheck;
mod determinism;
mod end_to_end;
mod export;
mod guide;
mod init;
mod record;
#[cfg(unix)]
mod rehearse;
mod run_folder;
mod suites;
mod support;
