//! Acting and learning do not allocate once the buffers have grown.

mod support;

use omniwalk_allocations::Counting;
use omniwalk_ppo::{Agent, Inference};
use support::{Points, config};

#[global_allocator]
static ALLOCATOR: Counting = Counting::new();

#[test]
fn acting_and_learning_do_not_allocate() {
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut agent = Agent::new(config(), 4, 2, 1).unwrap();
            let mut points = Points::new(50, 40);
            let mirror = Points::mirror();
            points.iterate(&mut agent, Some(&mirror), 0);
            let (mut actions, mut values) = (vec![0.0; 100], vec![0.0; 50]);
            let keys: Vec<u64> = (0..50).collect();
            let mut buffers = Inference::default();
            let observations = &points.rollout.observations[..200];
            agent.act(&mut buffers, observations, &keys, &mut actions, &mut values);
            agent.mode(&mut buffers, observations, &mut actions);
            let before = ALLOCATOR.count();
            for key in 1..4 {
                agent.update(&points.rollout, Some(&mirror), key);
                agent.act(&mut buffers, observations, &keys, &mut actions, &mut values);
                agent.mode(&mut buffers, observations, &mut actions);
                agent.values(&mut buffers, observations, &mut values);
            }
            assert_eq!(ALLOCATOR.count() - before, 0, "allocations with {threads} threads");
        });
    }
}
