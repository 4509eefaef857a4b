//! No checkpoint makes the reader panic; training goes on from what it accepts.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| omniwalk_fuzz::checkpoint::check(data));
