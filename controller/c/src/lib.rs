//! The controller for C and C++; `include/omniwalk.h` is made from this crate.
//!
//! [`types`] says what is passed, [`abi`] holds the functions and, with `caller`, all `unsafe` there is. No panic crosses the boundary:
//! each function catches them and returns `OW_RESULT_INTERNAL`.

pub mod abi;
mod caller;
pub mod types;
