//! What `train` says at its end: five figures of the newest episodes, and the next command to type.

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use omniwalk_env::task::episode::End;
use omniwalk_env::task::tracking::Tracking;
use serde_json::{Value, json};

use super::trainer::Trainer;
use crate::terminal::quoted;

/// The end of a run, or of a part of it. As text it is what a person reads.
#[derive(Debug)]
pub struct Conclusion {
    steps: u64,
    total: u64,
    minutes: f64,
    checkpoint: PathBuf,
    learned: Learned,
    warning: Option<String>,
    next: Vec<(&'static str, String)>,
}

/// The newest episodes: how long, how many fell or crossed their legs, how well they held the command, how they stepped. NaN where nothing was measured.
#[derive(Debug)]
struct Learned {
    episode_s: f64,
    fallen: f64,
    leg_overlap: f64,
    error_xy_mps: f64,
    error_yaw_radps: f64,
    alternation: f64,
}

impl Conclusion {
    /// What `trainer` has come to in the run `folder`, whose settings ask for `total` steps; `checkpoint` holds it, `warning` says
    /// what was wrong with it.
    pub fn new(trainer: &Trainer, total: u64, folder: &Path, checkpoint: &Path, warning: Option<String>) -> Self {
        let progress = trainer.progress();
        Self {
            steps: progress.steps,
            total,
            minutes: progress.seconds / 60.0,
            checkpoint: checkpoint.to_owned(),
            learned: Learned::new(trainer),
            warning,
            next: next(folder, progress.steps >= total),
        }
    }

    /// The same as one JSON object; `null` for what was not measured.
    pub fn json(&self) -> Value {
        let commands: Vec<&String> = self.next.iter().map(|(_, command)| command).collect();
        let mut end = json!({
            "finished": self.steps,
            "of": self.total,
            "minutes": self.minutes,
            "checkpoint": self.checkpoint,
            "episode_s": self.learned.episode_s,
            "fallen": self.learned.fallen,
            "leg_overlap": self.learned.leg_overlap,
            "error_xy_mps": self.learned.error_xy_mps,
            "error_yaw_radps": self.learned.error_yaw_radps,
            "alternation": self.learned.alternation,
            "next": commands,
        });
        if let Some(warning) = &self.warning {
            end["warning"] = json!(warning);
        }
        end
    }
}

impl Display for Conclusion {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let checkpoint = self.checkpoint.display();
        let (steps, total, minutes) = (self.steps, self.total, self.minutes);
        writeln!(
            f,
            "{steps} of {total} steps in {minutes:.1} minutes; checkpoint {checkpoint}"
        )?;
        write!(f, "{}", self.learned)?;
        if let Some(warning) = &self.warning {
            write!(f, "\nWARNING: {warning}")?;
        }
        let mut next = self.next.iter();
        next.try_for_each(|(what, command)| write!(f, "\n{:<8}{command}", format!("{what}:")))
    }
}

impl Learned {
    fn new(trainer: &Trainer) -> Self {
        let window = &trainer.progress().window;
        let tracking = |value: fn(&Tracking) -> f64| window.mean(|episode| episode.tracking.as_ref().map(value));
        let steps = window.mean(|episode| Some(f64::from(episode.steps)));
        Self {
            episode_s: steps * trainer.batch().shared().config.control_dt(),
            fallen: window.share(End::Fallen),
            leg_overlap: window.share(End::Overlap),
            error_xy_mps: tracking(|tracking| tracking.error_xy_mps),
            error_yaw_radps: tracking(|tracking| tracking.error_yaw_radps),
            alternation: window.mean(|episode| Some(episode.gait.alternation)),
        }
    }
}

impl Display for Learned {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let text = format!(
            "newest episodes: {:.1} s long, {:.0} % fell, {:.0} % crossed legs, error {:.2} m/s and {:.2} rad/s, {:.0} % of touchdowns alternate",
            self.episode_s,
            100.0 * self.fallen,
            100.0 * self.leg_overlap,
            self.error_xy_mps,
            self.error_yaw_radps,
            100.0 * self.alternation,
        );
        f.write_str(&text.replace("NaN", "-"))
    }
}

/// What can be done with the run in `folder` next.
pub fn next(folder: &Path, finished: bool) -> Vec<(&'static str, String)> {
    let folder = quoted(&folder.to_string_lossy());
    let train = format!("omniwalk train --resume --run {folder}");
    let on = match finished {
        true => ("extend", train + " --steps N"),
        false => ("go on", train),
    };
    vec![on, ("judge", format!("omniwalk eval {folder}"))]
}
