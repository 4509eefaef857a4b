//! The controller without the standard library: were any part of it linked, its panic handler would be there twice and this would
//! not compile. Memory is taken from a fixed arena while a policy is loaded, and from nowhere afterwards.
#![no_std]

extern crate alloc;

use alloc::vec;
use core::alloc::{GlobalAlloc, Layout};
use core::cell::UnsafeCell;
use core::panic::PanicInfo;
use core::ptr::null_mut;
use core::slice;
use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use omniwalk_controller::{Controller, Mode, Policy, Sensors};

const ARENA: usize = 16 << 20;

struct Arena {
    memory: UnsafeCell<[u8; ARENA]>,
    used: AtomicUsize,
    closed: AtomicBool,
}

// SAFETY: every allocation gets bytes of its own.
unsafe impl Sync for Arena {}

// SAFETY: bytes are given out once, aligned, and never again; null once the arena is used up or closed.
unsafe impl GlobalAlloc for Arena {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let base = self.memory.get().cast::<u8>();
        let room = layout.size() + layout.align();
        let at = self.used.fetch_add(room, Ordering::Relaxed);
        if self.closed.load(Ordering::Relaxed) || at + room > ARENA {
            return null_mut();
        }
        // SAFETY: within the arena, as just checked.
        let start = unsafe { base.add(at) };
        // SAFETY: `room` holds the size behind the padding.
        unsafe { start.add(start.align_offset(layout.align())) }
    }

    unsafe fn dealloc(&self, _: *mut u8, _: Layout) {}
}

#[global_allocator]
static MEMORY: Arena = Arena {
    memory: UnsafeCell::new([0; ARENA]),
    used: AtomicUsize::new(0),
    closed: AtomicBool::new(false),
};

unsafe extern "C" {
    fn abort() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    // SAFETY: it takes nothing and does not come back.
    unsafe { abort() }
}

/// What the compiled core library refers to for unwinding, which does not happen.
#[unsafe(no_mangle)]
extern "C" fn rust_eh_personality() {}

/// Loads a policy, closes the arena and makes a thousand steps with good readings, bad ones and none. Returns a bit for each mode
/// that was seen (walking 1, holding 2, ramping 4, resting 8), or 0 for a file that is no policy. A step that allocates aborts.
///
/// # Safety
/// `bytes` points to `len` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bare_walk(bytes: *const u8, len: usize) -> i32 {
    // SAFETY: as promised by the caller.
    let bytes = unsafe { slice::from_raw_parts(bytes, len) };
    let Some((policy, mut controller)) = Policy::from_bytes(bytes)
        .ok()
        .and_then(|policy| Controller::new(&policy).ok().map(|controller| (policy, controller)))
    else {
        return 0;
    };
    let joints = policy.spec().joints.len();
    let (mut position, velocity, mut targets) = (vec![0.0; joints], vec![0.1; joints], vec![0.0; joints]);
    MEMORY.closed.store(true, Ordering::Relaxed);
    let mut seen = 0;
    for step in 0..1000u64 {
        let now = step * controller.period();
        position.fill(if step == 200 { f32::NAN } else { 0.05 });
        let sensors = Sensors {
            position: &position,
            velocity: &velocity,
            attitude: [0.01, 0.02],
            gyro: [0.1, 0.2, 0.3],
            base_velocity: (step % 2 == 0).then_some([0.1, 0.0, 0.0]),
        };
        let measured = if (300..600).contains(&step) { 0 } else { now };
        let status = controller.step(now, measured, &sensors, [0.2, 0.0, 0.1], &mut targets);
        seen |= match status.mode {
            Mode::Walking => 1,
            Mode::Holding => 2,
            Mode::Ramping => 4,
            Mode::Resting => 8,
        };
    }
    MEMORY.closed.store(false, Ordering::Relaxed);
    seen
}
