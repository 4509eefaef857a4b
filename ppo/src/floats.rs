//! Arrays for vector instructions.

use std::ops::{Deref, DerefMut};

/// A cache line, bytes; also the longest vector.
const LINE: usize = 64;

/// A fixed number of `f32` of which the first lies at the beginning of a cache line. Where allocators put large arrays, every
/// second of the longest vectors would lie in two lines, which takes a product a tenth longer (docs/performance.md).
pub(crate) struct Floats {
    data: Vec<f32>,
    start: usize,
    len: usize,
}

impl Floats {
    /// Zeros.
    pub(crate) fn zeros(len: usize) -> Self {
        let slack = LINE / size_of::<f32>() - 1;
        let data = vec![0.0; len + slack];
        // An interpreter may know no offset; then the numbers lie where they lie.
        let start = data.as_ptr().align_offset(LINE).min(slack);
        Self { data, start, len }
    }
}

impl Deref for Floats {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.data[self.start..][..self.len]
    }
}

impl DerefMut for Floats {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.data[self.start..][..self.len]
    }
}
