//! No configuration makes the loader panic; what is accepted reads back as the same.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| omniwalk_fuzz::config::check(data));
