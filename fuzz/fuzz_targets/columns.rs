//! No column map with a CSV or JSON file makes the reader panic; what is read is in order.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| omniwalk_fuzz::columns::check(data));
