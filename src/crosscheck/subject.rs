//! What is cross-checked: a policy with its robot and the configuration it was trained under.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{IntoDiagnostic, miette};
use omniwalk_controller::{Controller, Policy};
use omniwalk_env::EnvConfig;
use omniwalk_env::robot::Robot;
use omniwalk_env::task::shared::spec;

use crate::command::load;
use crate::config::Layers;
use crate::deployed::{Deployed, layers};
use crate::eval::suites::CONDITIONS;
use crate::export;
use crate::run::RunFolder;
use crate::settings::{DEFAULT, Settings};

/// A policy and all that belongs to it.
pub struct Subject {
    /// The policy.
    pub policy: Policy,
    /// The robot.
    pub robot: Arc<Robot>,
    /// Where its files are.
    pub robot_path: PathBuf,
    /// The configuration.
    pub settings: Settings,
    /// What conditions are laid over.
    layers: Layers,
    /// Smallest and largest command that was trained.
    pub range: [[f64; 3]; 2],
}

impl Subject {
    /// The policy of a run (of its newest checkpoint, or the one at `checkpoint`) or of a policy file, on its own robot or the
    /// one at `robot`, with `changes` (`key=value`) to the configuration.
    ///
    /// # Errors
    /// Whatever does not fit together.
    pub fn open(
        path: &Path,
        checkpoint: Option<&Path>,
        robot: Option<&Path>,
        changes: &[String],
    ) -> miette::Result<Self> {
        if path.is_file() {
            Self::of_file(path, robot, changes)
        } else {
            Self::of_run(path, checkpoint, robot, changes)
        }
    }

    fn of_file(path: &Path, robot: Option<&Path>, changes: &[String]) -> miette::Result<Self> {
        let Deployed {
            policy,
            robot: loaded,
            settings,
        } = Deployed::open(path, robot, changes)?;
        // Through the decimal numbers that were written: 0.7 and not what single precision makes of it.
        let decimal = |x: f32| x.to_string().parse().unwrap_or(f64::from(x));
        let trained = &policy.identity().curriculum;
        Ok(Self {
            range: [trained.lower, trained.upper].map(|ends| ends.map(decimal)),
            layers: layers(&policy)?,
            robot_path: robot.unwrap_or(&settings.robot.path).to_owned(),
            robot: loaded,
            settings,
            policy,
        })
    }

    fn of_run(
        path: &Path,
        checkpoint: Option<&Path>,
        robot: Option<&Path>,
        changes: &[String],
    ) -> miette::Result<Self> {
        let run = RunFolder::open(path)?;
        let (settings, _) = load::settings(Some(&run.config()), changes)?;
        let robot_path = robot.map_or_else(|| run.robot(), Path::to_owned);
        let (policy, robot) = (export::policy(path, checkpoint)?, load::robot(&robot_path)?);
        let found = spec(&robot, &settings.env);
        policy.spec().check_robot(&found).map_err(|misfit| {
            miette!(
                help =
                    "what the policy sees and how it acts stay as they were trained; give the robot it was trained for",
                "{} does not fit robot {} and `--set`: {misfit}",
                path.display(),
                robot.name
            )
        })?;
        Ok(Self {
            policy,
            robot,
            robot_path,
            layers: Layers::new(DEFAULT)?.file(&run.config())?,
            range: [settings.env.command.lower, settings.env.command.upper],
            settings,
        })
    }

    /// The conditions of the evaluation's suites, with `changes` over them.
    ///
    /// # Errors
    /// When a change is none that a configuration can have.
    pub fn conditions(&self, changes: &[String]) -> miette::Result<EnvConfig> {
        let mut layers = self.layers.clone().text("conditions.toml (built in)", CONDITIONS)?;
        for change in changes {
            layers = layers.set(change)?;
        }
        Ok(layers.build::<Settings>()?.0.env)
    }

    /// A controller with the policy.
    ///
    /// # Errors
    /// When the policy does not fit the controller.
    pub fn controller(&self) -> miette::Result<Controller> {
        Controller::new(&self.policy).into_diagnostic()
    }

    /// Whether the policy was trained for all of `commands`.
    pub fn knows(&self, commands: &[[f64; 3]]) -> bool {
        let [lower, upper] = self.range;
        commands
            .iter()
            .all(|command| (0..3).all(|k| (lower[k]..=upper[k]).contains(&command[k])))
    }
}
