//! For tests: global allocators that count. [`Counting`] says that a loop allocates nothing, [`Peak`] how much was in use at once.
//!
//! ```
//! #[global_allocator]
//! static ALLOCATOR: omniwalk_allocations::Counting = omniwalk_allocations::Counting::new();
//!
//! # let test = || {
//! let before = ALLOCATOR.count();
//! let numbers = vec![1, 2, 3];
//! assert!(ALLOCATOR.count() > before);
//! # drop(numbers);
//! # };
//! # std::thread::spawn(test).join().unwrap();
//! ```
//!
//! [`Counting`] counts all threads but the process's first. That one is the test harness's: it allocates while it keeps
//! its books of a test that has begun. Tests run in threads of their own; a binary that counts has a single one.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator with a count of the allocations so far.
#[derive(Debug, Default)]
pub struct Counting {
    allocations: AtomicUsize,
    /// The thread that allocated first, before any other was there; 0 until it has.
    first_thread: AtomicUsize,
}

impl Counting {
    /// With a count of zero.
    pub const fn new() -> Self {
        Self {
            allocations: AtomicUsize::new(0),
            first_thread: AtomicUsize::new(0),
        }
    }

    /// Allocations and growths so far.
    pub fn count(&self) -> usize {
        self.allocations.load(Ordering::Relaxed)
    }

    fn record(&self) {
        let this = thread();
        let first = self
            .first_thread
            .compare_exchange(0, this, Ordering::Relaxed, Ordering::Relaxed);
        if first.is_err_and(|first| first != this) {
            self.allocations.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// What tells this thread from the others that live: an address of its own. Asking allocates nothing.
fn thread() -> usize {
    thread_local!(static HERE: u8 = const { 0 });
    HERE.with(|here| std::ptr::from_ref(here).addr())
}

// SAFETY: hands every call on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.record();
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// The system's allocator with the bytes in use and the most there were.
#[derive(Debug, Default)]
pub struct Peak {
    now: AtomicUsize,
    most: AtomicUsize,
}

impl Peak {
    /// With nothing in use.
    pub const fn new() -> Self {
        Self {
            now: AtomicUsize::new(0),
            most: AtomicUsize::new(0),
        }
    }

    /// Bytes in use, from which the most begins anew.
    pub fn begin(&self) -> usize {
        let now = self.now.load(Ordering::Relaxed);
        self.most.store(now, Ordering::Relaxed);
        now
    }

    /// The most bytes that were in use at once since [`Peak::begin`], by all threads.
    pub fn most(&self) -> usize {
        self.most.load(Ordering::Relaxed)
    }

    fn take(&self, bytes: usize) {
        let now = self.now.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.most.fetch_max(now, Ordering::Relaxed);
    }
}

// SAFETY: hands every call on to the system's allocator.
unsafe impl GlobalAlloc for Peak {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.take(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        self.take(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        self.now.fetch_sub(layout.size(), Ordering::Relaxed);
        unsafe { System.dealloc(pointer, layout) }
    }
}
