//! Stepping a batch allocates nothing, except where an episode ends. Looked at with the engine `lanes`: rapier's own
//! solver allocates in every step.

#[allow(dead_code)]
mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use omniwalk_env::Batch;
use omniwalk_env::config::EngineKind;
use support::{config, robot};

static COUNT: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: hands every call on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_without_episode_ends_allocates_nothing() {
    // Inside a pool, so that handing work to it, which is once a step, is not counted.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let mut config = config(EngineKind::Lanes);
        config.task.random_first_length = false;
        config.push.enabled = true;
        config.push.force = 1.0;
        let mut batch = Batch::new(robot("nimbro_op2x"), &config, 20, 1).unwrap();
        let actions = vec![0.5; 20 * batch.shared().spec.action_len()];
        (0..40).for_each(|_| batch.step(&actions));
        let before = COUNT.load(Ordering::Relaxed);
        for _ in 0..200 {
            batch.step(&actions);
            assert!(batch.ends().iter().all(Option::is_none));
        }
        assert_eq!(COUNT.load(Ordering::Relaxed) - before, 0);
    });
}
