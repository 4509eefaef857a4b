//! How the checkpoints of a run walk in MuJoCo, as `train --crosscheck-every` measured it.
//!
//! ```text
//! crosscheck.csv            one row a checkpoint
//! crosscheck/               the best of them (step-N.safetensors), what is measured now, and the last report and log
//! ```

use std::fs;
use std::path::PathBuf;

use miette::miette;
use serde_json::Value;

use super::RunFolder;
use super::checkpoints::Checkpoints;
use super::metrics::Metrics;
use crate::crosscheck::closed_loop::LEAST_SURVIVAL;

/// Columns of the file, and names of TensorBoard's scalars: sequences walked to their end as a share, error of the velocity in
/// m/s and of turning in rad/s, each in MuJoCo and in the engine the policy learns in, and the ratios of MuJoCo's to
/// the engine's that the cross-check's third gate judges.
pub const COLUMNS: [&str; 8] = [
    "transfer/survival_mujoco",
    "transfer/survival_engine",
    "transfer/survival_ratio",
    "transfer/error_xy_mps_mujoco",
    "transfer/error_xy_mps_engine",
    "transfer/velocity_error_ratio",
    "transfer/error_yaw_radps_mujoco",
    "transfer/error_yaw_radps_engine",
];
const SURVIVAL: &str = COLUMNS[0];
const ERROR: &str = COLUMNS[3];

/// The values of [`COLUMNS`] in a `crosscheck.json`; NaN where nothing was measured. `None` when it holds no third gate.
pub fn values(report: &Value) -> Option<[f64; COLUMNS.len()]> {
    let gate = report.pointer("/gates/closed_loop")?;
    let engine = gate["engine"].as_str()?;
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    let (ours, theirs) = (&gate[engine], &gate["mujoco"]);
    Some([
        number(&theirs["survival"]),
        number(&ours["survival"]),
        number(&gate["survival_ratio"]),
        number(&theirs["error_xy_mps"]),
        number(&ours["error_xy_mps"]),
        number(&gate["velocity_error_ratio"]),
        number(&theirs["error_yaw_radps"]),
        number(&ours["error_yaw_radps"]),
    ])
}

/// A checkpoint with how it walks in MuJoCo.
#[derive(Clone, Debug, PartialEq)]
pub struct Transferred {
    /// Control steps it was trained for.
    pub step: u64,
    /// Its file.
    pub path: PathBuf,
    /// Share of the sequences it walks to their end in MuJoCo.
    pub survival: f64,
    /// Error of its velocity there, m/s.
    pub error: f64,
}

/// The checkpoint of `run` that transfers best: of those that survive in MuJoCo as the third gate asks, beside the one that falls least
/// often there, the one that holds velocities best there, of several the newest. Who stands still falls least.
///
/// # Errors
/// When nothing was measured, or the file of what was is gone: what to do then.
pub fn best(run: &RunFolder) -> miette::Result<Transferred> {
    let mut rows = Vec::new();
    if run.transfer().exists() {
        Metrics::scan(&run.transfer(), |so_far| {
            let at = |name: &str, values: &[f64]| {
                let column = so_far.columns.iter().position(|column| column == name);
                column.map_or(f64::NAN, |column| values[column])
            };
            rows.extend(so_far.last.iter().map(|(step, values)| Transferred {
                step: *step,
                path: checkpoint(run, *step),
                survival: at(SURVIVAL, values),
                error: at(ERROR, values),
            }));
        })?;
    }
    rows.retain(|row| !row.survival.is_nan());
    // Of all that were measured: the file of the one that fell least may have given way to a better one's.
    let most = rows.iter().map(|row| row.survival).fold(0.0, f64::max);
    rows.retain(|row| row.path.is_file());
    let kept = rows.iter().map(|row| row.survival).fold(0.0, f64::max);
    let least = (LEAST_SURVIVAL * most).min(kept);
    let sound = rows.into_iter().filter(|row| row.survival >= least);
    sound.max_by(better).ok_or_else(|| {
        miette!(
            help = format!(
                "measure while it trains: omniwalk train --resume --run {0} --steps N --crosscheck-every N\n\
                 or export the newest checkpoint, without --best-transfer, and judge it: omniwalk crosscheck {0}",
                run.path().display()
            ),
            "no checkpoint of {} was cross-checked, so that none is known to transfer best",
            run.path().display()
        )
    })
}

/// Which of two transfers better; a policy that held no velocity has no error and is the worse.
fn better(a: &Transferred, b: &Transferred) -> std::cmp::Ordering {
    let error = |row: &Transferred| if row.error.is_nan() { f64::INFINITY } else { row.error };
    error(b).total_cmp(&error(a)).then(a.step.cmp(&b.step))
}

/// Where the checkpoint of `step` is kept while and after it is measured.
pub fn checkpoint(run: &RunFolder, step: u64) -> PathBuf {
    folder(run).join(format!("step-{step:012}.safetensors"))
}

/// The folder of what is measured.
pub fn folder(run: &RunFolder) -> PathBuf {
    run.path().join("crosscheck")
}

/// Removes the checkpoints of the folder but the best: what was measured and is worse, and what never was.
pub fn tidy(run: &RunFolder) {
    let best = best(run).ok().map(|best| best.path);
    for (_, path) in Checkpoints::new(folder(run)).list() {
        if best.as_ref() != Some(&path) {
            // What stays is found and removed the next time.
            let _ = fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::run::metrics::MetricsWriter;

    /// Step, survival, error, and whether there is a file.
    type Row = (u64, f64, f64, bool);

    fn run(folder: &Path, rows: &[Row]) -> RunFolder {
        let run = RunFolder::create(folder, "").unwrap();
        fs::create_dir(super::folder(&run)).unwrap();
        let mut writer = MetricsWriter::create(&run.transfer(), &COLUMNS).unwrap();
        for &(step, survival, error, file) in rows {
            let mut values = [f64::NAN; COLUMNS.len()];
            (values[0], values[3]) = (survival, error);
            writer.append(step, &values).unwrap();
            if file {
                fs::write(checkpoint(&run, step), "").unwrap();
            }
        }
        run
    }

    #[test]
    fn the_best_falls_hardly_more_often_than_any_then_holds_velocities_best_then_is_the_newest() {
        let cases: [(&[Row], u64); 7] = [
            (&[(1, 1.0, 0.2, true), (2, 0.983, 0.03, true)], 2),
            (&[(1, 0.9, 0.01, true), (2, 1.0, 0.2, true)], 2),
            (&[(1, 1.0, 0.1, true), (2, 1.0, 0.2, true)], 1),
            (&[(1, 1.0, 0.1, true), (2, 1.0, 0.1, true)], 2),
            (&[(1, 1.0, 0.1, true), (2, 1.0, f64::NAN, true)], 1),
            (&[(1, 0.5, 0.1, true), (2, 1.0, 0.1, false)], 1),
            // What fell least gave way to what held velocities better; that does not lower the bar.
            (&[(1, 1.0, 0.1, false), (2, 0.96, 0.09, true), (3, 0.92, 0.08, true)], 2),
        ];
        for (rows, expected) in cases {
            let folder = tempfile::tempdir().unwrap();
            assert_eq!(best(&run(folder.path(), rows)).unwrap().step, expected, "{rows:?}");
        }
    }

    #[test]
    fn without_measurements_the_error_says_how_to_get_them() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::create(folder.path(), "").unwrap();
        let error = best(&run).unwrap_err();
        assert!(error.to_string().contains("was cross-checked"), "{error}");
        assert!(error.help().unwrap().to_string().contains("--crosscheck-every"));
    }
}
