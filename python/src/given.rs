//! What Python gives, taken as what is wanted or refused by the argument's name.

use std::fmt::Display;

use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::error::refuse;

/// Longest text of an object that a message repeats, in bytes.
const LONGEST: usize = 60;

/// Refuses what was `given` as `argument`, which must be what is `right`.
pub fn wrong(argument: &str, right: impl Display, given: &Bound<'_, PyAny>) -> PyErr {
    refuse(format!("{argument} must be {right}, not {}", found(given)))
}

/// What an object is, in words that fit a line: of an array its type and shape.
pub fn found(given: &Bound<'_, PyAny>) -> String {
    if let Ok(array) = given.cast::<PyUntypedArray>() {
        return format!(
            "an array of {} with shape {}",
            array.dtype(),
            shape(given.py(), array.shape())
        );
    }
    if let Ok(words) = given.repr().map(|it| it.to_string())
        && words.len() <= LONGEST
    {
        return words;
    }
    let kind = given
        .get_type()
        .name()
        .map_or_else(|_| "something else".to_owned(), |it| format!("a {it}"));
    given
        .len()
        .map_or_else(|_| kind.clone(), |len| format!("{kind} of {len}"))
}

/// A shape as Python writes it.
pub fn shape(py: Python<'_>, shape: &[usize]) -> String {
    PyTuple::new(py, shape).map_or_else(|_| format!("{shape:?}"), |it| it.to_string())
}

/// What was given as `argument`, which must be what is `right`.
pub fn taken<'a, 'py, T: FromPyObject<'a, 'py>>(
    given: &'a Bound<'py, PyAny>,
    argument: &str,
    right: impl Display,
) -> PyResult<T> {
    given.extract().map_err(|_| wrong(argument, right, given))
}

/// The number given as `argument`, which must be finite.
pub fn finite<'a, 'py, T>(given: &'a Bound<'py, PyAny>, argument: &str) -> PyResult<T>
where
    T: FromPyObject<'a, 'py> + Into<f64> + Copy,
{
    let number = given.extract::<T>().ok().filter(|&it| it.into().is_finite());
    number.ok_or_else(|| wrong(argument, "a finite number", given))
}

/// The velocity given as `argument`: forward, m/s, to the left, m/s, and turning, rad/s.
pub fn velocity(given: &Bound<'_, PyAny>, argument: &str) -> PyResult<[f64; 3]> {
    let numbers = given.extract::<[f64; 3]>().ok();
    let velocity = numbers.filter(|velocity| velocity.iter().all(|it| it.is_finite()));
    velocity.ok_or_else(|| wrong(argument, "three finite numbers (m/s, m/s, rad/s)", given))
}
