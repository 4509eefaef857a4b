//! The compiled half of the Python package `omniwalk`: thin classes around the crates that training, evaluation and the robot
//! use. The other half, in `python/package/omniwalk`, speaks the APIs of Gymnasium and Stable-Baselines3.

mod arrays;
mod batch;
mod controller;
mod error;
mod given;
mod robot;
mod status;
mod view;

use pyo3::prelude::*;

/// Runs `omniwalk crosscheck` with `arguments`; its exit code.
#[pyfunction]
fn crosscheck(py: Python<'_>, arguments: Vec<String>) -> u8 {
    py.detach(|| omniwalk::command::crosscheck::main(&arguments))
}

/// The error that says what `argument` must be, and what was given instead.
#[pyfunction]
fn wrong(argument: &str, right: &str, given: &Bound<'_, PyAny>) -> PyErr {
    given::wrong(argument, right, given)
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", module.py().get_type::<error::Error>())?;
    module.add_function(wrap_pyfunction!(crosscheck, module)?)?;
    module.add_function(wrap_pyfunction!(wrong, module)?)?;
    module.add_class::<batch::Batch>()?;
    module.add_class::<controller::Controller>()?;
    module.add_class::<robot::Robot>()?;
    module.add_class::<status::OutOfRange>()?;
    module.add_class::<status::Status>()
}
