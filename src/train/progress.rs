//! What a person sees while training runs.

use std::fmt::{self, Display, Formatter};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use super::metrics::Figure;
use crate::terminal::{OutputError, say};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Map, Value, json};

/// How training reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// A line for people; a progress bar on a terminal.
    Text,
    /// A JSON object an update.
    Json,
}

/// The reward's terms and what a line calls them.
const TERMS: [(&str, &str); 7] = [
    ("velocity", "v"),
    ("pose", "pose"),
    ("alive", "alive"),
    ("foot", "foot"),
    ("action_rate", "calm"),
    ("slip", "slip"),
    ("tap", "tap"),
];

/// Seconds between lines when the output is no terminal.
const INTERVAL: Duration = Duration::from_secs(20);

/// The progress of one run.
pub struct Reporter {
    bar: Option<ProgressBar>,
    format: LogFormat,
    quiet: bool,
    last: Option<Instant>,
    /// Whether something was wrong with the last update.
    ill: bool,
    illness: Option<Illness>,
    total: u64,
}

/// That something was wrong with updates.
#[derive(Debug)]
pub struct Illness {
    /// How many.
    updates: usize,
    /// What was wrong with the last of them.
    last: String,
}

impl Display for Illness {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let s = if self.updates == 1 { "" } else { "s" };
        write!(f, "in {} update{s}, at last: {}", self.updates, self.last)
    }
}

impl Reporter {
    /// A display for a run of `total` steps.
    pub fn new(total: u64, format: LogFormat, quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal() && format == LogFormat::Text && !quiet;
        let bar = terminal.then(|| {
            let bar = ProgressBar::new(total);
            if let Ok(style) = ProgressStyle::with_template("{bar:24} {percent:>3} % {msg}") {
                bar.set_style(style);
            }
            bar
        });
        Self {
            bar,
            format,
            quiet,
            last: None,
            ill: false,
            illness: None,
            total,
        }
    }

    /// Shows the figures of the update that ended at `steps`, and what is wrong with it, at once when it was not before; this process began at `started` with `first_step`.
    ///
    /// # Errors
    /// When standard output takes no more.
    pub fn update(
        &mut self,
        steps: u64,
        figures: &[Figure],
        symptom: Option<String>,
        started: &Instant,
        first_step: u64,
    ) -> Result<(), OutputError> {
        let figure = |name: &str| match name {
            "steps" => steps as f64,
            name => figures
                .iter()
                .find(|(key, _)| *key == name)
                .map_or(f64::NAN, |(_, value)| *value),
        };
        if let Some(bar) = &self.bar {
            bar.set_position(steps);
            bar.set_message(line(&figure, self.left(steps, started, first_step), symptom.as_deref()));
        } else if self.format == LogFormat::Json && !self.quiet {
            let values = figures.iter().map(|(key, value)| ((*key).to_owned(), json!(value)));
            let mut object: Map<String, Value> =
                [("steps".to_owned(), json!(steps))].into_iter().chain(values).collect();
            object.extend(symptom.clone().map(|symptom| ("warning".to_owned(), json!(symptom))));
            say(Value::Object(object))?;
        } else if !self.quiet && (self.is_due() || symptom.is_some() && !self.ill) {
            self.last = Some(Instant::now());
            say(line(&figure, self.left(steps, started, first_step), symptom.as_deref()))?;
        }
        self.ill = symptom.is_some();
        if let Some(last) = symptom {
            let updates = 1 + self.illness.take().map_or(0, |before| before.updates);
            self.illness = Some(Illness { updates, last });
        }
        Ok(())
    }

    /// What was wrong with the updates so far, if anything was.
    pub fn illness(&self) -> Option<&Illness> {
        self.illness.as_ref()
    }

    /// Ends the bar, so that later lines stand below it.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.abandon();
        }
    }

    fn is_due(&self) -> bool {
        self.last.is_none_or(|last| last.elapsed() >= INTERVAL)
    }

    fn left(&self, steps: u64, started: &Instant, first_step: u64) -> Duration {
        let done = steps.saturating_sub(first_step).max(1) as f64;
        let rest = self.total.saturating_sub(steps) as f64;
        Duration::from_secs_f64(started.elapsed().as_secs_f64() * rest / done)
    }
}

fn line(figure: &impl Fn(&str) -> f64, left: Duration, symptom: Option<&str>) -> String {
    let split = ["time/physics", "time/inference", "time/update"].map(figure);
    let total: f64 = split.iter().sum();
    let share = split.map(|x| (100.0 * x / total).round());
    let terms = TERMS.map(|(term, name)| (name, figure(&format!("reward/{term}"))));
    let terms = terms.iter().filter(|(_, value)| *value != 0.0);
    let terms: Vec<String> = terms.map(|(name, value)| format!("{name} {value:.1}")).collect();
    format!(
        "{:.2} M steps, {:.0}/s (physics {:.0} %, inference {:.0} %, update {:.0} %) | reward/s {:.1}: {} | episode {:.0}, {:.0} % fell, {:.0} % crossed legs | error {:.2} m/s | gait {:.1}/s, alternating {:.0} %, air {:.2} s | \
         level {:.2} C_v {:.2} C_foot {:.2} | {} left",
        figure("steps") * 1e-6,
        figure("steps_per_second"),
        share[0],
        share[1],
        share[2],
        figure("reward/total"),
        terms.join(" "),
        figure("episode/steps"),
        100.0 * figure("episode/fallen"),
        100.0 * figure("episode/leg_overlap"),
        figure("tracking/error_xy_mps"),
        figure("gait/touchdowns_per_second"),
        100.0 * figure("gait/alternation"),
        figure("gait/air_time_s"),
        figure("curriculum/level"),
        figure("curriculum/velocity_factor"),
        figure("curriculum/foot_factor"),
        minutes(left),
    )
    .replace("NaN", "-")
        + &symptom.map_or_else(String::new, |symptom| format!(" | WARNING: {symptom}"))
}

fn minutes(time: Duration) -> String {
    let seconds = time.as_secs();
    format!("{}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}
