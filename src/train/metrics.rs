//! What is written down of every update: the columns of `metrics.csv` and the scalars of TensorBoard.

use omniwalk_env::task::episode::{End, Episode};
use omniwalk_env::task::gait::Gait;

use super::trainer::{Report, Trainer};

/// A figure of an update: its name and its value, NaN where nothing was measured.
pub type Figure = (&'static str, f64);

/// The figures of an update without its step. Rewards are those of the update's steps, per second. Returns (by term and in
/// all), gait and tracking are means over the last 100 finished episodes of the sampled policy; gait counts those whose
/// command moved.
pub fn figures(trainer: &Trainer, report: &Report) -> Vec<Figure> {
    let mut out = run(trainer, report);
    out.extend(episodes(trainer, report));
    out.extend(gait(trainer));
    out.extend(curriculum(trainer, report));
    out.extend(learning(report));
    out
}

/// Names of [`figures`], in order.
pub const NAMES: [&str; 63] = [
    "update",
    "seconds",
    "steps_per_second",
    "time/physics",
    "time/inference",
    "time/update",
    "reward/velocity",
    "reward/pose",
    "reward/alive",
    "reward/foot",
    "reward/action_rate",
    "reward/slip",
    "reward/tap",
    "reward/total",
    "episode/return",
    "return/velocity",
    "return/pose",
    "return/alive",
    "return/foot",
    "return/action_rate",
    "return/slip",
    "return/tap",
    "episode/steps",
    "episode/fallen",
    "episode/leg_overlap",
    "episode/lost",
    "episode/total",
    "tracking/error_xy_mps",
    "tracking/error_yaw_radps",
    "tracking/estimator_error_mps",
    "gait/alternation",
    "gait/touchdowns_per_second",
    "gait/clearance_m",
    "gait/air_time_s",
    "gait/slip_mps",
    "gait/double_support",
    "gait/flight",
    "gait/torque_nm",
    "gait/action_change",
    "curriculum/level",
    "curriculum/velocity_factor",
    "curriculum/foot_factor",
    "curriculum/velocity_kernel",
    "curriculum/foot_kernel",
    "curriculum/falls",
    "curriculum/lower_x",
    "curriculum/upper_x",
    "curriculum/lower_y",
    "curriculum/upper_y",
    "curriculum/lower_yaw",
    "curriculum/upper_yaw",
    "ppo/policy_loss",
    "ppo/value_loss",
    "ppo/entropy",
    "ppo/kl",
    "ppo/clip_fraction",
    "ppo/mode_distance",
    "ppo/learning_rate",
    "ppo/policy_gradient_norm",
    "ppo/value_gradient_norm",
    "ppo/explained_variance",
    "ppo/steps",
    "ppo/skipped",
];

fn run(trainer: &Trainer, report: &Report) -> Vec<Figure> {
    let (progress, split) = (trainer.progress(), &report.split);
    let seconds = split.physics + split.inference + split.update;
    vec![
        ("update", progress.update as f64),
        ("seconds", progress.seconds),
        ("steps_per_second", report.samples as f64 / seconds),
        ("time/physics", split.physics),
        ("time/inference", split.inference),
        ("time/update", split.update),
    ]
}

fn episodes(trainer: &Trainer, report: &Report) -> Vec<Figure> {
    let (window, terms) = (&trainer.progress().window, &report.terms);
    vec![
        ("reward/velocity", terms.velocity),
        ("reward/pose", terms.pose),
        ("reward/alive", terms.alive),
        ("reward/foot", terms.foot),
        ("reward/action_rate", terms.action_rate),
        ("reward/slip", terms.slip),
        ("reward/tap", terms.tap),
        ("reward/total", terms.total()),
        ("episode/return", window.mean(|e| Some(e.terms.total()))),
        ("return/velocity", window.mean(|e| Some(e.terms.velocity))),
        ("return/pose", window.mean(|e| Some(e.terms.pose))),
        ("return/alive", window.mean(|e| Some(e.terms.alive))),
        ("return/foot", window.mean(|e| Some(e.terms.foot))),
        ("return/action_rate", window.mean(|e| Some(e.terms.action_rate))),
        ("return/slip", window.mean(|e| Some(e.terms.slip))),
        ("return/tap", window.mean(|e| Some(e.terms.tap))),
        ("episode/steps", window.mean(|e| Some(f64::from(e.steps)))),
        ("episode/fallen", window.share(End::Fallen)),
        ("episode/leg_overlap", window.share(End::Overlap)),
        ("episode/lost", report.lost as f64),
        ("episode/total", window.total() as f64),
        (
            "tracking/error_xy_mps",
            window.mean(|e| e.tracking.map(|t| t.error_xy_mps)),
        ),
        (
            "tracking/error_yaw_radps",
            window.mean(|e| e.tracking.map(|t| t.error_yaw_radps)),
        ),
        ("tracking/estimator_error_mps", window.mean(|e| Some(e.estimator_error))),
    ]
}

fn gait(trainer: &Trainer) -> Vec<Figure> {
    let window = &trainer.progress().window;
    let gait = |value: fn(&Gait) -> f64| window.mean(|e| moving(e).then(|| value(&e.gait)));
    vec![
        ("gait/alternation", gait(|g| g.alternation)),
        ("gait/touchdowns_per_second", gait(|g| g.touchdowns_per_second)),
        ("gait/clearance_m", gait(|g| g.clearance_m)),
        ("gait/air_time_s", gait(|g| g.air_time_s)),
        ("gait/slip_mps", gait(|g| g.slip_mps)),
        ("gait/double_support", gait(|g| g.double_support)),
        ("gait/flight", gait(|g| g.flight)),
        ("gait/torque_nm", window.mean(|e| Some(e.torque))),
        ("gait/action_change", window.mean(|e| Some(e.action_change))),
    ]
}

fn curriculum(trainer: &Trainer, report: &Report) -> Vec<Figure> {
    let curriculum = &trainer.progress().curriculum;
    let (lower, upper) = trainer.bounds();
    vec![
        ("curriculum/level", curriculum.level()),
        ("curriculum/velocity_factor", curriculum.velocity_factor()),
        ("curriculum/foot_factor", curriculum.foot_factor()),
        ("curriculum/velocity_kernel", report.performance.velocity),
        ("curriculum/foot_kernel", report.performance.foot),
        ("curriculum/falls", report.performance.falls.unwrap_or(f64::NAN)),
        ("curriculum/lower_x", lower[0]),
        ("curriculum/upper_x", upper[0]),
        ("curriculum/lower_y", lower[1]),
        ("curriculum/upper_y", upper[1]),
        ("curriculum/lower_yaw", lower[2]),
        ("curriculum/upper_yaw", upper[2]),
    ]
}

fn learning(report: &Report) -> Vec<Figure> {
    let learning = &report.learning;
    vec![
        ("ppo/policy_loss", learning.policy_loss),
        ("ppo/value_loss", learning.value_loss),
        ("ppo/entropy", learning.entropy),
        ("ppo/kl", learning.kl),
        ("ppo/clip_fraction", learning.clip_fraction),
        ("ppo/mode_distance", learning.mode_distance),
        ("ppo/learning_rate", learning.learning_rate),
        ("ppo/policy_gradient_norm", learning.policy_gradient_norm),
        ("ppo/value_gradient_norm", learning.value_gradient_norm),
        ("ppo/explained_variance", learning.explained_variance),
        ("ppo/steps", learning.steps as f64),
        ("ppo/skipped", learning.skipped as f64),
    ]
}

/// Whether an episode's command asked the robot to move.
fn moving(episode: &Episode) -> bool {
    episode.desired.iter().any(|x| x.abs() > 0.05)
}
