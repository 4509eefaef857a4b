//! NumPy arrays on memory of Rust, and the only `unsafe` of the binding: the numbers of thousands of environments are read
//! where the engine wrote them.
#![allow(unsafe_code)]

use numpy::ndarray::{ArrayView, Dimension, IntoDimension};
use numpy::{Element, PyArray, PyArrayMethods};
use pyo3::prelude::*;

use crate::error::refuse;

/// A read-only array of `shape` on `memory`, which lives in the object `owner`; the array keeps the owner alive.
///
/// What is written to the memory later shows in the array. That happens with Python's lock released, so who reads the array in
/// another thread meanwhile sees old and new numbers mixed.
///
/// # Safety
/// `memory` must not move or be freed before `owner` is.
///
/// # Errors
/// When the shape does not have as many entries as the memory.
pub unsafe fn view<'py, T: Element, D: Dimension>(
    memory: &[T],
    shape: impl IntoDimension<Dim = D>,
    owner: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray<T, D>>> {
    let array = ArrayView::from_shape(shape.into_dimension(), memory).map_err(refuse)?;
    // SAFETY: the memory outlives the array, as the caller promises. NumPy does not write to it: the array is made
    // read-only before anybody has it.
    let array = unsafe { PyArray::borrow_from_array(&array, owner) };
    drop(array.readwrite().make_nonwriteable());
    Ok(array)
}
