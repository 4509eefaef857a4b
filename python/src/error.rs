//! Errors of Rust as exceptions of Python: one class, with the message the command line would give.

use std::fmt::Display;

use miette::Report;
use omniwalk::complaint;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

create_exception!(
    omniwalk,
    Error,
    PyValueError,
    "What omniwalk cannot do, and what would be right."
);

/// A report as an exception.
pub fn raise(report: impl Into<Report>) -> PyErr {
    Error::new_err(complaint::plain(&report.into()))
}

/// A message as an exception.
pub fn refuse(message: impl Display) -> PyErr {
    Error::new_err(message.to_string())
}
