//! The first episode of each command of an evaluation, as logs.

use std::path::PathBuf;

use miette::{IntoDiagnostic, WrapErr};
use omniwalk_env::Batch;
use omniwalk_sim2real::log::LogError;

use super::forward::{Forward, Watch};
use super::rollout::Recorder;
use crate::run::create_folder;

/// The first episode of each command, as logs: file name and environment.
pub fn first_episodes(suite: &Forward) -> Vec<(String, usize)> {
    let mut logs: Vec<(String, usize)> = Vec::new();
    for (i, [x, y, turn]) in suite.commands.iter().enumerate() {
        let mut name = format!("eval_{x:.2}_{y:.2}_{turn:.2}");
        // Commands may differ by less.
        if logs.iter().any(|(taken, _)| taken.strip_suffix(".mcap") == Some(&name)) {
            name += &format!("_{i}");
        }
        logs.push((format!("{name}.mcap"), i * suite.episodes));
    }
    logs
}

/// Logs of the first episodes of some environments.
pub struct Rollouts {
    folder: PathBuf,
    logs: Vec<(String, usize)>,
    recorders: Vec<Recorder>,
}

impl Rollouts {
    /// Those of `logs` (file name and environment), into `folder`.
    pub fn new(folder: PathBuf, logs: Vec<(String, usize)>) -> Self {
        Self {
            folder,
            logs,
            recorders: Vec::new(),
        }
    }

    /// Closes them.
    ///
    /// # Errors
    /// What the file system refuses.
    pub fn finish(self) -> Result<Vec<PathBuf>, LogError> {
        self.recorders.into_iter().map(Recorder::finish).collect()
    }
}

impl Watch for Rollouts {
    /// Only now is anything written: robot, configuration and engine fit together.
    fn start(&mut self, batch: &Batch) -> miette::Result<()> {
        create_folder(&self.folder)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot create {}", self.folder.display()))?;
        let shared = batch.shared();
        for (name, environment) in &self.logs {
            let path = self.folder.join(name);
            let mut recorder = Recorder::create(&path, *environment, &shared.robot, shared.config.control_dt())?;
            recorder.state(batch)?;
            self.recorders.push(recorder);
        }
        Ok(())
    }

    fn step(&mut self, batch: &Batch, observations: &[f32], actions: &[f32]) -> miette::Result<()> {
        self.recorders
            .iter_mut()
            .try_for_each(|recorder| Ok(recorder.step(batch, observations, actions)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_that_are_nearly_the_same_have_logs_of_their_own() {
        let suite = Forward {
            commands: vec![[0.301, 0.0, 0.0], [0.302, 0.0, 0.0], [0.3, 0.1, 0.0]],
            episodes: 2,
            seconds: 1.0,
            seed: 0,
            nominal: true,
        };
        let names = [
            "eval_0.30_0.00_0.00.mcap",
            "eval_0.30_0.00_0.00_1.mcap",
            "eval_0.30_0.10_0.00.mcap",
        ];
        let own = first_episodes(&suite);
        assert_eq!(own.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), names);
        assert_eq!(
            own.iter().map(|(_, environment)| *environment).collect::<Vec<_>>(),
            [0, 2, 4]
        );
    }
}
