//! `omniwalk report`.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, Result, WrapErr};

use crate::complaint::plain;
use crate::files;
use crate::report::canvas::Canvas;
use crate::report::curves::Curves;
use crate::report::html::{About, page};
use crate::report::motion::Motion;
use crate::report::subject::Subject;
use crate::report::{film, gait, learning, load as loads};
use crate::run::{create_folder, files_of, write_atomic};
use crate::terminal::{say, tell};

/// Largest picture that is read, bytes.
const MAX_PICTURE_BYTES: u64 = 16 << 20;

/// Draws learning curves of runs; of the first, gait and joint loads of its fastest rollout, a filmstrip of the six fastest, and its evaluation.
///
/// Writes learning.png, gait.png, load.png, filmstrip.png, eval_falls.png, eval_error.png, eval_grid.png and eval_push.png, each if there is
/// something to draw, and report.html, which holds the pictures, the evaluation and the configuration. Works while a run is still training;
/// without rollouts (see `omniwalk eval`) there are only curves. Of a policy file NAME.omni, what `omniwalk eval` wrote into NAME.eval is drawn.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run folders; several are drawn over each other, one colour a run. Also a policy file that was evaluated, or an eval.json.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Where the files go [default: the first run; of a policy file NAME.omni the folder NAME.eval].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with the runs; nothing is written then.
pub fn run(args: &Args) -> Result<()> {
    let mut subjects: Vec<Subject> = args
        .runs
        .iter()
        .map(|path| Subject::open(path))
        .collect::<Result<_>>()?;
    let curves: Vec<Curves> = subjects
        .iter_mut()
        .filter_map(|subject| subject.curves.take())
        .collect();
    let first = &subjects[0];
    let mut pictures = Vec::new();
    if !curves.is_empty() {
        pictures.push(("learning.png", learning::draw(&curves)?));
    }
    pictures.extend(motion_pictures(first)?);
    if let Some(evaluation) = &first.evaluation {
        pictures.extend(evaluation.pictures()?);
    }
    let encoded = pictures.iter().map(|(name, canvas)| Ok((*name, Canvas::png(canvas)?)));
    let pictures: Vec<(&str, Vec<u8>)> = encoded.collect::<Result<_>>()?;
    let mut shown = pictures.clone();
    shown.extend(velocity(first)?);

    let folder = args.out.clone().unwrap_or_else(|| first.folder.clone());
    let about: Vec<About> = subjects.into_iter().map(|subject| subject.about).collect();
    let html = page(&shown, &about, env!("CARGO_PKG_VERSION"));
    create_folder(&folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
    pictures
        .iter()
        .try_for_each(|(name, png)| write(&folder.join(name), png))?;
    write(&folder.join("report.html"), html.as_bytes())
}

/// Gait and filmstrip, if there is a rollout.
fn motion_pictures(subject: &Subject) -> Result<Vec<(&'static str, Canvas)>> {
    // Before the first evaluation there is no such folder.
    let logs = files_of(&subject.folder.join("rollouts"), "mcap").unwrap_or_default();
    if logs.is_empty() {
        return Ok(Vec::new());
    }
    let robot = match subject.robot() {
        Some(Ok(robot)) => robot,
        Some(Err(error)) => {
            tell(format_args!("warning: no gait is drawn: {}", plain(&error)));
            return Ok(Vec::new());
        }
        None => return Ok(Vec::new()),
    };
    let mut motions = Vec::new();
    for log in logs {
        match Motion::read(&log, &robot) {
            Ok(motion) => {
                motions.push(motion);
                // Of two that are as fast, the first comes first.
                motions.sort_by(|a, b| b.speed().total_cmp(&a.speed()));
                motions.truncate(film::ROWS);
            }
            // An evaluation may be writing it.
            Err(error) => tell(format_args!("warning: left out: {error}")),
        }
    }
    let Some(fastest) = motions.first() else {
        return Ok(Vec::new());
    };
    say(format_args!("rollout: {}", fastest.path.display()))?;
    let mut pictures = vec![("filmstrip.png", film::draw(&motions, &robot)?)];
    if !robot.feet.is_empty() {
        pictures.insert(0, ("gait.png", gait::draw(fastest, &robot)?));
    }
    pictures.extend(loads::draw(fastest, &robot)?.map(|canvas| ("load.png", canvas)));
    Ok(pictures)
}

/// Velocities over time, which the suite `tracking` drew when it was played: `eval.json` does not hold them.
fn velocity(subject: &Subject) -> Result<Option<(&'static str, Vec<u8>)>> {
    let name = "eval_velocity.png";
    let path = subject.folder.join(name);
    let eval = subject.about.eval.as_ref();
    if eval.is_none_or(|eval| eval.get("tracking").is_none()) || !path.is_file() {
        return Ok(None);
    }
    let png = files::read(&path, MAX_PICTURE_BYTES).into_diagnostic();
    let png = png.wrap_err_with(|| format!("cannot read {}", path.display()))?;
    Ok(Some((name, png)))
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomic(path, bytes)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))?;
    Ok(say(path.display())?)
}
