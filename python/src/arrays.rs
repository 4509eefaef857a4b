//! NumPy arrays, and what can become one.

use std::borrow::Cow;
use std::ops::Deref;

use numpy::{
    AllowTypeChange, BorrowError, PyArray1, PyArrayDyn, PyArrayLike1, PyArrayLikeDyn, PyArrayMethods, PyReadonlyArray1,
    PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::error::refuse;
use crate::given::{found, shape, wrong};

/// Numbers in any number of dimensions.
pub type Numbers<'py> = PyArrayLikeDyn<'py, f32, AllowTypeChange>;

/// Numbers in a row: where they lie in an array, or taken out of something else.
pub enum Row<'py> {
    Array(PyReadonlyArray1<'py, f32>),
    Own(Vec<f32>),
}

impl Deref for Row<'_> {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        match self {
            // `row` keeps only arrays without gaps.
            Self::Array(array) => array.as_slice().unwrap_or_default(),
            Self::Own(numbers) => numbers,
        }
    }
}

/// The `len` numbers in a row that are `given`: an array of one dimension, a list or a tuple.
pub fn row<'py>(given: &Bound<'py, PyAny>, len: usize, argument: &str) -> PyResult<Row<'py>> {
    let array = given.extract::<PyReadonlyArray1<'py, f32>>().ok();
    if let Some(array) = array.filter(|array| array.len() == len && array.is_c_contiguous()) {
        return Ok(Row::Array(array));
    }
    let numbers = given.extract::<PyArrayLike1<'_, f32, AllowTypeChange>>().ok();
    match numbers.filter(|numbers| numbers.len() == len) {
        Some(numbers) => Ok(Row::Own(numbers.as_array().to_vec())),
        None => {
            let right = format_args!("{len} numbers, an array of one dimension or a list");
            Err(wrong(argument, right, given))
        }
    }
}

/// The entries of [`row`] as an array.
pub fn fixed<const N: usize>(given: &Bound<'_, PyAny>, argument: &str) -> PyResult<[f32; N]> {
    let mut out = [0.0; N];
    out.copy_from_slice(&row(given, N, argument)?);
    Ok(out)
}

/// The numbers in C order: where they lie, if they lie so without gaps.
pub fn in_order<'a>(numbers: &'a PyReadonlyArrayDyn<'_, f32>) -> Cow<'a, [f32]> {
    let array = numbers.as_array();
    array
        .to_slice()
        .map_or_else(|| array.iter().copied().collect(), Cow::Borrowed)
}

/// A place for results of shape `wanted`: what was given as `out`.
pub fn out<'py>(given: &Bound<'py, PyAny>, wanted: &[usize]) -> PyResult<PyReadwriteArrayDyn<'py, f32>> {
    let but = match given.cast::<PyArrayDyn<f32>>() {
        Ok(array) if array.shape() != wanted => "",
        Ok(array) if !array.is_c_contiguous() => " and gaps or another order",
        Ok(array) => match array.try_readwrite() {
            Ok(out) => return Ok(out),
            Err(BorrowError::NotWriteable) => " that is read-only",
            Err(_) => " that another argument or thread reads",
        },
        Err(_) => "",
    };
    Err(refuse(format!(
        "out must be a writable array of float32 with shape {}, in C order without gaps, not {}{but}",
        shape(given.py(), wanted),
        found(given)
    )))
}

/// A new array of `values`.
pub fn new<'py, T: numpy::Element>(py: Python<'py>, values: impl IntoIterator<Item = T>) -> Bound<'py, PyArray1<T>> {
    PyArray1::from_vec(py, values.into_iter().collect())
}
