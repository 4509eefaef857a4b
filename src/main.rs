//! The command line of omniwalk.
fn main() {}
