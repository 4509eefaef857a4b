//! Stepping a batch allocates nothing, whether or not episodes end. Looked at with the engine `lanes`: rapier's own
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
fn steps_and_rollouts_allocate_nothing_also_where_episodes_end() {
    for threads in [1, 2] {
        // Inside a pool, so that handing work to it, which is once a step, is not counted.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut config = config(EngineKind::Lanes);
            config.push.enabled = true;
            config.push.force = 80.0;
            let mut batch = Batch::new(robot("nimbro_op2x"), &config, 80, 1).unwrap();
            let actions = vec![0.5; 80 * batch.shared().spec.action_len()];
            let mut parts: Vec<_> = batch.groups().map(|group| vec![0.5; group.len() * 16]).collect();
            let mut ended = 0;
            let mut play = |batch: &mut Batch| {
                for _ in 0..200 {
                    batch.step(&actions);
                    ended += batch.take_episodes().count();
                }
                batch.roll(200, &Still, &mut parts);
                ended += batch.take_episodes().count();
            };
            play(&mut batch);
            let before = ALLOCATOR.count();
            play(&mut batch);
            assert_eq!(ALLOCATOR.count() - before, 0, "{threads} threads");
            assert!(ended > 80, "{ended} episodes ended");
        });
    }
}
