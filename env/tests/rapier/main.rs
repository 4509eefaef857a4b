//! The rapier engine against mechanics.

mod batch;
mod contacts;
mod drives;
mod followers;
mod grounded;
mod joints;
mod lanes;
mod nimbro;
#[path = "../support/order.rs"]
mod order;
mod robots;
