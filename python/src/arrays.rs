//! NumPy arrays and what can become one, as slices. An array of f32 without gaps is read where it lies.

use std::borrow::Cow;

use numpy::{AllowTypeChange, PyArray1, PyArrayLike1, PyArrayLikeDyn, PyReadwriteArrayDyn};
use pyo3::{Borrowed, prelude::*};

use crate::error::refuse;

/// Numbers in a row: an array of one dimension, a list or a tuple.
pub struct Row<'py>(PyArrayLike1<'py, f32, AllowTypeChange>);

impl<'a, 'py> FromPyObject<'a, 'py> for Row<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        object.extract().map(Self).map_err(|_| {
            let shape = object.getattr("shape").and_then(|shape| shape.str()).ok();
            let found = shape.or_else(|| object.get_type().name().ok());
            refuse(match found {
                Some(found) => {
                    format!("numbers in a row are wanted, an array of one dimension or a list; this is {found}")
                }
                None => "numbers in a row are wanted, an array of one dimension or a list".to_owned(),
            })
        })
    }
}

/// A time, ns.
pub struct Time(pub u64);

impl<'a, 'py> FromPyObject<'a, 'py> for Time {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        object.extract().map(Self).map_err(|_| {
            let found = object
                .repr()
                .map_or_else(|_| "something else".to_owned(), |it| it.to_string());
            refuse(format!(
                "a time is a whole number of nanoseconds from 0 to 2^64 - 1, not {found}"
            ))
        })
    }
}

/// Numbers in any number of dimensions.
pub type Numbers<'py> = PyArrayLikeDyn<'py, f32, AllowTypeChange>;

/// The entries of `row`, which must be `len`.
pub fn entries<'a>(row: &'a Row<'_>, len: usize, what: &str) -> PyResult<Cow<'a, [f32]>> {
    let row = &row.0;
    let found = row.as_array().len();
    if found != len {
        return Err(refuse(format!("{what} has {found} numbers instead of {len}")));
    }
    Ok(row
        .as_slice()
        .map_or_else(|_| row.as_array().iter().copied().collect(), Cow::Borrowed))
}

/// The entries of `row` as an array.
pub fn fixed<const N: usize>(row: &Row<'_>, what: &str) -> PyResult<[f32; N]> {
    let mut out = [0.0; N];
    out.copy_from_slice(&entries(row, N, what)?);
    Ok(out)
}

/// A place for results: `out`, whose shape must be `shape`, or nothing where a new array is to be made.
pub fn check_out(out: Option<&PyReadwriteArrayDyn<'_, f32>>, shape: &[usize]) -> PyResult<()> {
    match out {
        Some(array) if array.as_array().shape() != shape => Err(refuse(format!(
            "out has shape {:?} instead of {shape:?}",
            array.as_array().shape()
        ))),
        Some(array) if array.as_slice().is_err() => Err(refuse("out must be an array without gaps, in C order")),
        _ => Ok(()),
    }
}

/// A new array of `values`.
pub fn new<'py, T: numpy::Element>(py: Python<'py>, values: impl IntoIterator<Item = T>) -> Bound<'py, PyArray1<T>> {
    PyArray1::from_vec(py, values.into_iter().collect())
}
