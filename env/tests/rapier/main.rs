//! The rapier engine against mechanics.

mod batch;
mod contacts;
mod drives;
mod joints;
mod nimbro;
mod robots;
