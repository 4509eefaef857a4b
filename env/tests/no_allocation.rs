//! Stepping a batch allocates nothing, except where an episode ends. Looked at with the engine `lanes`: rapier's own
//! solver allocates in every step.

mod support;

use omniwalk_allocations::Counting;
use omniwalk_env::Batch;
use omniwalk_env::batch::{Collect, Outcomes};
use omniwalk_env::config::EngineKind;
use support::{config, robot};

#[global_allocator]
static ALLOCATOR: Counting = Counting::new();

/// The nominal pose for everybody.
struct Still;

impl Collect for Still {
    type Part = Vec<f32>;

    fn act<'p>(&self, actions: &'p mut Vec<f32>, _: usize, _: &[f32]) -> &'p [f32] {
        actions
    }

    fn take(&self, _: &mut Vec<f32>, _: usize, _: &Outcomes<'_>) {}
}

#[test]
fn a_step_without_episode_ends_allocates_nothing() {
    // Inside a pool, so that handing work to it, which is once a step, is not counted.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let mut config = config(EngineKind::Lanes);
        config.task.random_first_length = false;
        config.push.enabled = true;
        config.push.force = 1.0;
        config.task.overlap_margin = 0.0;
        let mut batch = Batch::new(robot("nimbro_op2x"), &config, 20, 1).unwrap();
        let actions = vec![0.5; 20 * batch.shared().spec.action_len()];
        (0..40).for_each(|_| batch.step(&actions));
        let before = ALLOCATOR.count();
        for _ in 0..200 {
            batch.step(&actions);
            assert!(batch.ends().iter().all(Option::is_none));
        }
        assert_eq!(ALLOCATOR.count() - before, 0);
        let mut parts: Vec<_> = batch.groups().map(|group| vec![0.5; group.len() * 16]).collect();
        batch.reset();
        batch.roll(40, &Still, &mut parts);
        let before = ALLOCATOR.count();
        batch.roll(200, &Still, &mut parts);
        assert_eq!(batch.take_episodes().count(), 0);
        assert_eq!(ALLOCATOR.count() - before, 0);
    });
}
