//! No MCAP file makes the reader panic or take memory beyond its size; what is read is in order.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| omniwalk_fuzz::log::check(data));
