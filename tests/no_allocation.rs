//! An update allocates nothing while no episode ends: collecting, learning and the curriculum work in buffers made once.
//! (Engine `lanes`: rapier's own solver allocates in every step. The end of an episode allocates its record.)

use std::path::Path;
use std::sync::Arc;

use omniwalk::config::Layers;
use omniwalk::settings::{DEFAULT, Settings};
use omniwalk::train::trainer::Trainer;
use omniwalk_allocations::Counting;
use omniwalk_env::robot;

#[global_allocator]
static ALLOCATOR: Counting = Counting::new();

#[test]
fn an_update_without_episode_ends_allocates_nothing() {
    let changes = [
        "engine.kind=lanes",
        "action.scale=0.01",
        "task.random_first_length=false",
        "train.environments=20",
        "train.steps_per_update=20",
        "ppo.hidden=[16, 16]",
        "ppo.minibatch=100",
        "task.overlap_margin=0.0",
        "ppo.epochs=2",
    ];
    let layers = changes
        .iter()
        .try_fold(Layers::new(DEFAULT).unwrap(), |layers, change| layers.set(change));
    let (settings, _) = layers.unwrap().build::<Settings>().unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots/nimbro_op2x");
    let robot = Arc::new(robot::load(&folder).unwrap());
    // Inside a pool, so that handing work to it, which is once a step, is not counted.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let mut trainer = Trainer::new(&settings, robot).unwrap();
        for _ in 0..2 {
            trainer.update();
        }
        let before = ALLOCATOR.count();
        for _ in 0..5 {
            trainer.update();
        }
        assert_eq!(ALLOCATOR.count() - before, 0);
        assert_eq!(trainer.progress().window.total(), 0, "episodes ended");
    });
}
