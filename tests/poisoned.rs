//! Numbers that go bad at random moments of training, in the state of the engine and in what sensors and reward read of it: each is traced
//! to its environment and term, costs its episode and nothing else, and training goes on.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{IsometryMatrix3, Vector3};
use omniwalk::config::Layers;
use omniwalk::settings::{DEFAULT, Settings};
use omniwalk::train::trainer::Trainer;
use omniwalk::train::{health, metrics};
use omniwalk_env::config::EnvConfig;
use omniwalk_env::engine::{BaseState, Configured, Drive, Engine, EngineError, JointState, Maker, Start, World};
use omniwalk_env::ground::Ground;
use omniwalk_env::robot::{self, Robot};
use omniwalk_env::task::episode::Fault;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const ENVIRONMENTS: usize = 16;
const STEPS: usize = 32;

/// What is made bad, for one control step.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Poison {
    /// A force on the base, and with it the state of the engine.
    State(f64),
    /// The base's angular velocity as the gyro reads it.
    Gyro(f64),
    /// The base's velocity as the reward reads it.
    Velocity,
}

/// A poison with the control step, of all that are done, and the environment it befalls.
#[derive(Clone, Copy, Debug)]
struct Injection {
    step: usize,
    environment: usize,
    poison: Poison,
}

/// Engines that are as configured but for the injections.
struct Poisoned {
    injections: Vec<Injection>,
    /// Environments that have an engine.
    made: AtomicUsize,
}

impl Maker for Poisoned {
    fn width(&self, config: &EnvConfig, environments: usize) -> usize {
        Configured.width(config, environments)
    }

    fn make(
        &self,
        robot: &Robot,
        ground: &Ground,
        config: &EnvConfig,
        worlds: usize,
    ) -> Result<Box<dyn Engine>, EngineError> {
        let first = self.made.fetch_add(worlds, Ordering::Relaxed);
        let own = self
            .injections
            .iter()
            .filter(|it| (first..first + worlds).contains(&it.environment));
        Ok(Box::new(Victim {
            engine: Configured.make(robot, ground, config, worlds)?,
            injections: own
                .map(|it| Injection {
                    environment: it.environment - first,
                    ..*it
                })
                .collect(),
            substeps: config.substeps() as usize,
            done: 0,
        }))
    }
}

/// An engine some of whose worlds are poisoned; `environment` of its injections is the world.
struct Victim {
    engine: Box<dyn Engine>,
    injections: Vec<Injection>,
    /// Physics steps of a control step.
    substeps: usize,
    /// Physics steps done.
    done: usize,
}

impl Victim {
    /// What befalls `world` in the control step of the physics step number `step`.
    fn poison(&self, world: usize, step: usize) -> Option<Poison> {
        let hit = |it: &&Injection| it.environment == world && it.step == step / self.substeps;
        self.injections.iter().find(hit).map(|it| it.poison)
    }
}

impl Engine for Victim {
    fn step(&mut self, drive: &Drive) {
        for world in 0..self.engine.worlds() {
            if let Some(Poison::State(force)) = self.poison(world, self.done) {
                self.engine.push(world, Vector3::new(0.0, force, 0.0));
            }
        }
        self.engine.step(drive);
        self.done += 1;
    }

    fn base(&self, world: usize) -> BaseState {
        let mut base = self.engine.base(world);
        // Asked for at the end of a control step, and in a reset before the first.
        match self.done.checked_sub(1).and_then(|step| self.poison(world, step)) {
            Some(Poison::Gyro(rate)) => base.angular_velocity.y = rate,
            Some(Poison::Velocity) => base.linear_velocity.x = f64::NAN,
            _ => {}
        }
        base
    }

    fn reset(&mut self, world: usize, start: &Start, model: &World) {
        self.engine.reset(world, start, model);
        // The next episode is spared.
        if let Some(last) = self.done.checked_sub(1) {
            let now = last / self.substeps;
            self.injections.retain(|it| it.environment != world || it.step > now);
        }
    }

    fn worlds(&self) -> usize {
        self.engine.worlds()
    }

    fn joints(&self) -> &JointState {
        self.engine.joints()
    }

    fn foot_force(&self, world: usize, foot: usize) -> Vector3<f64> {
        self.engine.foot_force(world, foot)
    }

    fn foot_loads(&self) -> &[f64] {
        self.engine.foot_loads()
    }

    fn link_poses(&mut self, links: &[usize], poses: &mut [IsometryMatrix3<f64>]) {
        self.engine.link_poses(links, poses);
    }

    fn push(&mut self, world: usize, force: Vector3<f64>) {
        self.engine.push(world, force);
    }

    fn is_finite(&self, world: usize) -> bool {
        self.engine.is_finite(world)
    }

    fn save(&self, world: usize, bytes: &mut Vec<u8>) {
        self.engine.save(world, bytes);
    }

    fn load(&mut self, world: usize, bytes: &[u8]) -> Result<(), String> {
        self.engine.load(world, bytes)
    }
}

fn robot() -> Arc<Robot> {
    Arc::new(robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("robots/nimbro_op2x")).unwrap())
}

fn settings(engine: &str) -> Settings {
    let changes = [
        &format!("engine.kind={engine}"),
        // What a sensor reads is in the observation of the same step.
        "latency.enabled=false",
        "train.environments=16",
        "train.steps_per_update=32",
        "ppo.hidden=[32, 32]",
        "ppo.minibatch=128",
        "ppo.epochs=2",
    ];
    let layers = Layers::new(DEFAULT).unwrap();
    let layers = changes.iter().try_fold(layers, |layers, change| layers.set(change));
    layers.unwrap().build::<Settings>().unwrap().0
}

fn injections(chance: &mut ChaCha8Rng, count: usize, updates: usize) -> Vec<Injection> {
    let mut all: Vec<Injection> = Vec::new();
    while all.len() < count {
        let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][chance.random_range(0..3)];
        let poison = [Poison::State(bad), Poison::Gyro(bad), Poison::Velocity][chance.random_range(0..3)];
        let (step, environment) = (
            chance.random_range(0..updates * STEPS),
            chance.random_range(0..ENVIRONMENTS),
        );
        if !all.iter().any(|it| (it.step, it.environment) == (step, environment)) {
            all.push(Injection {
                step,
                environment,
                poison,
            });
        }
    }
    all.sort_by_key(|it| (it.step, it.environment));
    all
}

/// Trains with `count` injections and looks at every update.
fn survives(engine: &str, count: usize, updates: usize) {
    let mut chance = ChaCha8Rng::seed_from_u64(20);
    let injections = injections(&mut chance, count, updates);
    let robot = robot();
    let settings = settings(engine);
    let maker = Poisoned {
        injections: injections.clone(),
        made: AtomicUsize::new(0),
    };
    let mut trainer = Trainer::with_engines(&settings, robot.clone(), &maker).unwrap();
    let mut sound = Trainer::new(&settings, robot).unwrap();
    for update in 0..updates {
        let own: Vec<&Injection> = injections.iter().filter(|it| it.step / STEPS == update).collect();
        let report = trainer.update();
        assert_eq!(report.lost, own.len() as u64, "update {update}: {own:?}");
        assert_eq!(report.learning.skipped, 0, "update {update}");
        assert!(trainer.agent().is_finite());
        let named = report
            .fault
            .map(|(environment, fault)| (environment, kind(&trainer, fault)));
        assert_eq!(
            named,
            own.first().map(|it| (it.environment, name(it.poison))),
            "update {update}"
        );
        let figures = metrics::figures(&trainer, &report);
        let symptom = health::symptom(&trainer, &report, &figures).unwrap_or_default();
        health::check(&trainer, &report, Some(&symptom)).unwrap();
        if let Some(first) = own.first() {
            let said = format!(
                "{} episodes lost; the first in environment {}, where",
                own.len(),
                first.environment
            );
            assert!(
                symptom.starts_with(&said) && symptom.contains(name(first.poison)),
                "{symptom}"
            );
        }
        if update == 0 {
            sound.update();
            let width = trainer.spec().observation_len();
            let rows = |trainer: &Trainer| {
                trainer
                    .batch()
                    .observations()
                    .chunks(width)
                    .map(<[f32]>::to_vec)
                    .collect::<Vec<_>>()
            };
            let (rows, alone) = (rows(&trainer), rows(&sound));
            let spared = (0..ENVIRONMENTS).filter(|e| own.iter().all(|it| it.environment != *e));
            spared.for_each(|e| assert!(rows[e] == alone[e], "environment {e} was disturbed"));
        }
    }
}

/// Part of what a poison is called in the message.
fn name(poison: Poison) -> &'static str {
    match poison {
        Poison::State(_) => "the physics",
        Poison::Gyro(_) => "gyro",
        Poison::Velocity => "term velocity",
    }
}

fn kind(trainer: &Trainer, fault: Fault) -> &'static str {
    match fault {
        Fault::Physics => "the physics",
        Fault::Observation(entry) if trainer.spec().entry_name(entry).unwrap().contains("gyro") => "gyro",
        Fault::Reward("velocity") => "term velocity",
        _ => "another",
    }
}

#[test]
fn two_hundred_bad_numbers_at_random_moments_cost_two_hundred_episodes() {
    survives("lanes", 200, 40);
}

#[test]
fn bad_numbers_at_random_moments_cost_their_episodes_in_rapier() {
    survives("rapier", 60, 12);
}

#[test]
fn training_ends_where_no_world_can_be_stepped() {
    let everywhere = (0..STEPS).flat_map(|step| (0..ENVIRONMENTS).map(move |environment| (step, environment)));
    let injections = everywhere.map(|(step, environment)| Injection {
        step,
        environment,
        poison: Poison::State(f64::NAN),
    });
    let maker = Poisoned {
        injections: injections.collect(),
        made: AtomicUsize::new(0),
    };
    let mut trainer = Trainer::with_engines(&settings("lanes"), robot(), &maker).unwrap();
    let before = trainer.agent().save();
    let report = trainer.update();
    let dead = health::check(&trainer, &report, None).unwrap_err().to_string();
    assert!(
        dead.contains("every world went non-finite in every step of update 1"),
        "{dead}"
    );
    assert!(trainer.agent().save() == before);
}
