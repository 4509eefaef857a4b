//! A batch of environments as arrays.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::available_parallelism;

use miette::IntoDiagnostic;
use numpy::{PyArray1, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use omniwalk::command::{THREADS, load};
use omniwalk_env::task::command::CommandRange;
use omniwalk_env::task::episode::End;
use omniwalk_env::task::reward::{Factors, TERM_NAMES};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{raise, refuse};
use crate::given::{self, finite, shape, taken, wrong};
use crate::view::view;

/// Environments side by side, stepped by threads of their own.
///
/// The arrays it gives are read-only views of its memory, the same ones for its whole life: every step writes over them.
#[pyclass(module = "omniwalk._native", frozen)]
pub struct Batch {
    pool: ThreadPool,
    inner: Mutex<Inner>,
    #[pyo3(get)]
    environments: usize,
    #[pyo3(get)]
    observation_len: usize,
    #[pyo3(get)]
    action_len: usize,
    #[pyo3(get)]
    control_hz: f64,
    #[pyo3(get)]
    threads: usize,
    #[pyo3(get)]
    joints: Vec<String>,
    #[pyo3(get)]
    observation_names: Vec<String>,
}

/// What a step writes. The arrays given to Python lie in it: nothing in it is replaced or changes its length.
struct Inner {
    batch: omniwalk_env::Batch,
    /// In [0, 1], as the controller takes them.
    actions: Box<[f32]>,
    rewards: Box<[f32]>,
    terms: Box<[f64]>,
    terminated: Box<[bool]>,
    truncated: Box<[bool]>,
}

impl Inner {
    fn new(batch: omniwalk_env::Batch) -> Self {
        let (n, joints) = (batch.environments(), batch.shared().spec.action_len());
        Self {
            actions: vec![0.0; n * joints].into(),
            rewards: vec![0.0; n].into(),
            terms: vec![0.0; n * TERM_NAMES.len()].into(),
            terminated: vec![false; n].into(),
            truncated: vec![false; n].into(),
            batch,
        }
    }

    fn step(&mut self) {
        self.batch.step(&self.actions);
        let terms = self.terms.chunks_exact_mut(TERM_NAMES.len()).zip(self.batch.terms());
        for ((row, terms), reward) in terms.zip(&mut self.rewards) {
            row.copy_from_slice(&terms.array());
            *reward = terms.total() as f32;
        }
        let ends = self.terminated.iter_mut().zip(&mut self.truncated);
        for ((terminated, truncated), end) in ends.zip(self.batch.ends()) {
            *terminated = matches!(end, Some(End::Fallen | End::Overlap));
            // A world that went non-finite is cut off like a time-out, as in training.
            *truncated = matches!(end, Some(End::TimeOut | End::Lost));
        }
    }
}

impl Batch {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        // Who panicked has told so; numbers half written are numbers.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn environment(&self, given: &Bound<'_, PyAny>) -> PyResult<usize> {
        let environment = given.extract().ok().filter(|&it| it < self.environments);
        environment.ok_or_else(|| {
            let right = format_args!("a whole number from 0 to {}", self.environments - 1);
            wrong("environment", right, given)
        })
    }
}

#[pymethods]
impl Batch {
    /// Environments under the configuration in the file `config`, laid over the defaults, with `changes` (`key=value`) over
    /// that: `num_envs` of them or as many as it says, stepped by `threads` or by all cores.
    #[new]
    #[pyo3(signature = (config=None, changes=Vec::new(), num_envs=None, threads=None))]
    fn new(
        py: Python<'_>,
        config: Option<&Bound<'_, PyAny>>,
        changes: Vec<String>,
        num_envs: Option<&Bound<'_, PyAny>>,
        threads: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let config = config.map(|given| taken::<PathBuf>(given, "config", "the path of a TOML file or None"));
        let config = config.transpose()?;
        let mut changes = changes;
        if let Some(given) = num_envs {
            let right = "a whole number from 1 on, or None for as many as `train.environments` says";
            let count: usize = taken(given, "num_envs", right)?;
            changes.push(format!("train.environments={count}"));
        }
        let threads = match threads {
            Some(given) => count_of_threads(given)?,
            None => available_parallelism().map_or(1, usize::from),
        };
        let made = py.detach(|| -> miette::Result<(ThreadPool, omniwalk_env::Batch)> {
            let (settings, _) = load::settings(config.as_deref(), &changes)?;
            let robot = load::robot(&settings.robot.path)?;
            let pool = ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .into_diagnostic()?;
            let (count, seed) = (settings.train.environments, settings.train.seed);
            let batch = pool.install(|| omniwalk_env::Batch::new(robot, &settings.env, count, seed))?;
            Ok((pool, batch))
        });
        let (pool, batch) = made.map_err(raise)?;
        let spec = &batch.shared().spec;
        Ok(Self {
            environments: batch.environments(),
            observation_len: spec.observation_len(),
            action_len: spec.action_len(),
            control_hz: f64::from(spec.control_hz),
            threads: pool.current_num_threads(),
            joints: spec.joints.iter().map(|joint| joint.name.clone()).collect(),
            observation_names: (0..spec.observation_len())
                .filter_map(|entry| spec.entry_name(entry))
                .collect(),
            inner: Mutex::new(Inner::new(batch)),
            pool,
        })
    }

    /// Starts the next episode everywhere, or with a `seed` over with the first episodes of that seed.
    #[pyo3(signature = (seed=None))]
    fn reset(&self, py: Python<'_>, seed: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let seed = seed.map(|given| taken(given, "seed", "a whole number from 0 to 2^64 - 1, or None"));
        let seed = seed.transpose()?;
        py.detach(|| {
            let inner = &mut *self.inner();
            self.pool.install(|| match seed {
                Some(seed) => inner.batch.reseed(seed),
                None => inner.batch.restart(),
            });
        });
        Ok(())
    }

    /// One control step with `actions` in [-1, 1], a row for each environment, an entry for each joint; what is beyond is
    /// clipped. Episodes that end start anew at once.
    fn step(&self, py: Python<'_>, actions: &Bound<'_, PyAny>) -> PyResult<()> {
        let expected = [self.environments, self.action_len];
        let array = actions.extract::<PyReadonlyArray2<'_, f32>>().ok();
        let array = array.filter(|array| array.shape() == expected);
        let slice = array.as_ref().and_then(|array| array.as_array().to_slice());
        let actions = slice.ok_or_else(|| {
            let shape = shape(py, &expected);
            let right = format_args!("an array of float32 with shape {shape}, in C order without gaps");
            wrong("actions", right, actions)
        })?;
        if let Some(at) = actions.iter().position(|action| !action.is_finite()) {
            let (environment, joint) = (at / self.action_len, &self.joints[at % self.action_len]);
            return Err(refuse(format!(
                "the action of environment {environment} for joint `{joint}` is {}",
                actions[at]
            )));
        }
        py.detach(|| {
            let inner = &mut *self.inner();
            for (to, action) in inner.actions.iter_mut().zip(actions) {
                *to = 0.5 * (1.0 + action.clamp(-1.0, 1.0));
            }
            self.pool.install(|| inner.step());
        });
        Ok(())
    }

    /// Observations that wait for an action: f32, a row for each environment.
    #[getter]
    fn observations<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let it = slf.get();
        let shape = [it.environments, it.observation_len];
        // SAFETY: the batch's arrays stay where they are, see `Inner`.
        unsafe { view(it.inner().batch.observations(), shape, slf.clone().into_any()) }
    }

    /// The last observations of the episodes that ended in the last step; other rows are meaningless.
    #[getter]
    fn final_observations<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let it = slf.get();
        let shape = [it.environments, it.observation_len];
        // SAFETY: as above.
        unsafe { view(it.inner().batch.final_observations(), shape, slf.clone().into_any()) }
    }

    /// Rewards of the last step: f32, one for each environment.
    #[getter]
    fn rewards<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let it = slf.get();
        // SAFETY: as above.
        unsafe { view(&it.inner().rewards, [it.environments], slf.clone().into_any()) }
    }

    /// The rewards' terms in the order of `term_names`: f64, a row for each environment.
    #[getter]
    fn terms<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let it = slf.get();
        let shape = [it.environments, TERM_NAMES.len()];
        // SAFETY: as above.
        unsafe { view(&it.inner().terms, shape, slf.clone().into_any()) }
    }

    /// Where the robot fell, or its legs passed through each other, in the last step.
    #[getter]
    fn terminated<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let it = slf.get();
        // SAFETY: as above.
        unsafe { view(&it.inner().terminated, [it.environments], slf.clone().into_any()) }
    }

    /// Where the time was over in the last step.
    #[getter]
    fn truncated<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let it = slf.get();
        // SAFETY: as above.
        unsafe { view(&it.inner().truncated, [it.environments], slf.clone().into_any()) }
    }

    /// Names of the rewards' terms.
    #[getter]
    fn term_names(&self) -> [&'static str; TERM_NAMES.len()] {
        TERM_NAMES
    }

    /// The episodes that ended since the last call, as JSON.
    fn take_episodes(&self) -> PyResult<String> {
        let episodes: Vec<_> = self.inner().batch.take_episodes().collect();
        serde_json::to_string(&episodes).map_err(refuse)
    }

    /// The desired velocity of an environment, m/s, m/s, rad/s.
    fn desired(&self, environment: &Bound<'_, PyAny>) -> PyResult<[f64; 3]> {
        let environment = self.environment(environment)?;
        Ok(self.inner().batch.look(environment).0.desired())
    }

    /// Sets the desired velocity of an environment (m/s, m/s, rad/s), from its next observation on and in later episodes.
    fn set_desired(&self, environment: &Bound<'_, PyAny>, velocity: &Bound<'_, PyAny>) -> PyResult<()> {
        let (environment, velocity) = (self.environment(environment)?, given::velocity(velocity, "velocity")?);
        self.inner().batch.set_desired_of(environment, velocity);
        Ok(())
    }

    /// Sets where every environment draws desired velocities from, from its next draw on (m/s, m/s, rad/s). How many are
    /// zero and how many keep to an axis stays what the configuration says.
    fn set_command_range(&self, lower: &Bound<'_, PyAny>, upper: &Bound<'_, PyAny>) -> PyResult<()> {
        let (lower, upper) = (given::velocity(lower, "lower")?, given::velocity(upper, "upper")?);
        if let Some(axis) = (0..3).find(|&axis| lower[axis] > upper[axis]) {
            return Err(refuse(format!(
                "lower[{axis}] = {} is above upper[{axis}] = {}",
                lower[axis], upper[axis]
            )));
        }
        let mut inner = self.inner();
        let command = &inner.batch.shared().config.command;
        let (zero_share, axis_share) = (command.zero_share, command.axis_share);
        inner.batch.set_range(CommandRange {
            lower,
            upper,
            zero_share,
            axis_share,
        });
        Ok(())
    }

    /// Sets the curriculum's factors on the velocity and the foot term of the reward, and on the largest force of pushes; all
    /// are 1 at first.
    fn set_factors(
        &self,
        velocity: &Bound<'_, PyAny>,
        foot: &Bound<'_, PyAny>,
        push: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let factors = Factors {
            velocity: finite(velocity, "velocity")?,
            foot: finite(foot, "foot")?,
            push: finite(push, "push")?,
        };
        if factors.push < 0.0 {
            return Err(wrong("push", "a number from 0 on", push));
        }
        self.inner().batch.set_factors(factors);
        Ok(())
    }
}

fn count_of_threads(given: &Bound<'_, PyAny>) -> PyResult<usize> {
    let count = given.extract().ok().filter(|count| THREADS.contains(count));
    let count = count.and_then(|count| usize::try_from(count).ok());
    count.ok_or_else(|| {
        let (least, most) = (THREADS.start(), THREADS.end());
        let right = format_args!("a whole number from {least} to {most}, or None for all cores");
        wrong("threads", right, given)
    })
}
