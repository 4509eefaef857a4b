//! No bytes make the loader of policy files panic, read past their end, or accept what a robot must not run.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| omniwalk_fuzz::policy_file::check(data));
