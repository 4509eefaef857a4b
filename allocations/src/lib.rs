//! For tests that a loop allocates nothing: a global allocator that counts.
//!
//! ```
//! #[global_allocator]
//! static ALLOCATOR: omniwalk_allocations::Counting = omniwalk_allocations::Counting::new();
//!
//! let before = ALLOCATOR.count();
//! let numbers = vec![1, 2, 3];
//! assert!(ALLOCATOR.count() > before);
//! # drop(numbers);
//! ```
//!
//! The count is of all threads, those of the test harness too: a test binary that uses it has a single test.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator with a count of the allocations so far.
#[derive(Debug, Default)]
pub struct Counting(AtomicUsize);

impl Counting {
    /// With a count of zero.
    pub const fn new() -> Self {
        Self(AtomicUsize::new(0))
    }

    /// Allocations and growths so far.
    pub fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

// SAFETY: hands every call on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.0.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}
