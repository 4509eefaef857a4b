//! No URDF makes the loader panic or take long; what loads can be simulated or is refused.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| omniwalk_fuzz::urdf::check(data));
