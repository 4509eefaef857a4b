//! An update allocates nothing, whether or not episodes end: collecting, learning and the curriculum work in buffers made once.
//! (Engine `lanes`: rapier's own solver allocates in every step.)

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
fn an_update_allocates_nothing_also_where_episodes_end() {
    let changes = [
        "engine.kind=lanes",
        "train.environments=80",
        "train.steps_per_update=40",
        "ppo.hidden=[16, 16]",
        "ppo.minibatch=800",
        "ppo.epochs=2",
    ];
    let layers = changes
        .iter()
        .try_fold(Layers::new(DEFAULT).unwrap(), |layers, change| layers.set(change));
    let (settings, _) = layers.unwrap().build::<Settings>().unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots/nimbro_op2x");
    let robot = Arc::new(robot::load(&folder).unwrap());
    for threads in [1, 2] {
        // Inside a pool, so that handing work to it, which is once a step, is not counted.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut trainer = Trainer::new(&settings, robot.clone()).unwrap();
            for _ in 0..4 {
                trainer.update();
            }
            let before = ALLOCATOR.count();
            for _ in 0..4 {
                trainer.update();
            }
            assert_eq!(ALLOCATOR.count() - before, 0, "{threads} threads");
            assert!(trainer.progress().window.total() > 80, "no episodes ended");
        });
    }
}
