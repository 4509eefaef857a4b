//! No robot.toml makes the loader panic or take long; what loads can be simulated or is refused.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| omniwalk_fuzz::robot_toml::check(data));
