//! `omniwalk report`.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde_json::Value;

use super::load;
use crate::eval::suites::Suite;
use crate::report::canvas::Canvas;
use crate::report::curves::Curves;
use crate::report::evaluation::{Evaluation, Picture};
use crate::report::html::{About, page};
use crate::report::motion::Motion;
use crate::report::{film, gait, health, learning, load as loads};
use crate::run::sessions::{Session, Sessions};
use crate::run::{RunFolder, create_folder, files_of, write_atomic};
use crate::terminal::{quoted, say, tell};

/// Largest text file of a run that is read, bytes.
const MAX_TEXT_BYTES: u64 = 16 << 20;

/// Draws learning curves of runs; of the first, gait, loads of the joints and filmstrip of its fastest rollout, and what its evaluation measured.
///
/// Writes learning.png, gait.png, load.png, filmstrip.png, eval_falls.png, eval_error.png, eval_grid.png and eval_push.png, each if there is
/// something to draw, and report.html, which holds the pictures, the evaluation and the configuration. Works while a run is still training; without rollouts (see `omniwalk eval`) there are only curves.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run folders; several are drawn over each other, one colour a run.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Where the files go [default: the first run].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with the runs; nothing is written then.
pub fn run(args: &Args) -> Result<()> {
    let runs: Vec<RunFolder> = args
        .runs
        .iter()
        .map(|path| RunFolder::open(path))
        .collect::<Result<_, _>>()?;
    let about: Vec<About> = runs.iter().map(about).collect::<Result<_>>()?;
    let curves = runs.iter().zip(&about);
    let curves: Vec<Curves> = curves
        .map(|(run, about)| curves_of(run, about))
        .collect::<Result<_>>()?;
    let mut pictures = vec![("learning.png", learning::draw(&curves)?)];
    pictures.extend(motion_pictures(&runs[0])?);
    pictures.extend(evaluation_pictures(&runs[0], &about[0])?);
    let encoded = pictures.iter().map(|(name, canvas)| Ok((*name, Canvas::png(canvas)?)));
    let pictures: Vec<(&str, Vec<u8>)> = encoded.collect::<Result<_>>()?;
    let mut shown = pictures.clone();
    shown.extend(velocity(&runs[0], &about[0])?);
    let html = page(&shown, &about, env!("CARGO_PKG_VERSION"));

    let folder = args.out.as_deref().unwrap_or(runs[0].path());
    create_folder(folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
    pictures
        .iter()
        .try_for_each(|(name, png)| write(&folder.join(name), png))?;
    write(&folder.join("report.html"), html.as_bytes())
}

fn curves_of(run: &RunFolder, about: &About) -> Result<Curves> {
    if !run.metrics().exists() {
        return Err(miette!("{} holds no metrics yet", run.path().display()));
    }
    let curves = Curves::read(&run.metrics(), about.name.clone())?;
    match curves.steps() {
        0 => Err(miette!("{} holds no metrics yet", run.path().display())),
        _ => Ok(curves),
    }
}

/// Gait and filmstrip, if there is a rollout.
fn motion_pictures(run: &RunFolder) -> Result<Vec<(&'static str, Canvas)>> {
    // Before the first evaluation there is no such folder.
    let logs = files_of(&run.rollouts(), "mcap").unwrap_or_default();
    if logs.is_empty() {
        return Ok(Vec::new());
    }
    let robot = load::robot(&run.path().join("robot"))?;
    let mut fastest: Option<Motion> = None;
    for log in logs {
        match Motion::read(&log, &robot) {
            Ok(motion) if fastest.as_ref().is_none_or(|other| motion.speed() > other.speed()) => fastest = Some(motion),
            Ok(_) => {}
            // An evaluation may be writing it.
            Err(error) => tell(format_args!("warning: left out: {error}")),
        }
    }
    let Some(motion) = fastest else {
        return Ok(Vec::new());
    };
    say(format_args!("rollout: {}", motion.path.display()))?;
    let mut pictures = vec![("filmstrip.png", film::draw(&motion, &robot)?)];
    if !robot.feet.is_empty() {
        pictures.insert(0, ("gait.png", gait::draw(&motion, &robot)?));
    }
    pictures.extend(loads::draw(&motion, &robot)?.map(|canvas| ("load.png", canvas)));
    Ok(pictures)
}

/// Errors, falls and pushes, if the run was evaluated.
fn evaluation_pictures(run: &RunFolder, about: &About) -> Result<Vec<Picture>> {
    let Some(eval) = &about.eval else {
        return Ok(Vec::new());
    };
    let evaluation = Evaluation::read(eval);
    let evaluation = evaluation.wrap_err_with(|| format!("cannot draw {}", run.path().join("eval.json").display()))?;
    Ok(evaluation.pictures()?)
}

/// Velocities over time, which the suite `tracking` drew when it was played: `eval.json` does not hold them.
fn velocity(run: &RunFolder, about: &About) -> Result<Option<(&'static str, Vec<u8>)>> {
    let name = "eval_velocity.png";
    let path = run.path().join(name);
    if about.eval.as_ref().is_none_or(|eval| eval.get("tracking").is_none()) || !path.is_file() {
        return Ok(None);
    }
    let png = fs::read(&path).into_diagnostic();
    let png = png.wrap_err_with(|| format!("cannot read {}", path.display()))?;
    Ok(Some((name, png)))
}

fn about(run: &RunFolder) -> Result<About> {
    let config = read(&run.config())?;
    let table: toml::Table = toml::from_str(&config)
        .into_diagnostic()
        .wrap_err_with(|| format!("{} is not TOML", run.config().display()))?;
    let seed = table.get("train").and_then(|train| train.get("seed")?.as_integer());
    let path = run.path().join("eval.json");
    let eval: Option<Value> = match path.exists() {
        true => Some(
            serde_json::from_str(&read(&path)?)
                .into_diagnostic()
                .wrap_err_with(|| format!("{} is not JSON", path.display()))?,
        ),
        false => None,
    };
    let shown = quoted(&run.path().to_string_lossy());
    let sessions = Sessions::open(&run.sessions())?;
    let mut commands: Vec<String> = sessions.list().iter().map(Session::command).collect();
    if commands.is_empty() {
        commands.push(format!("omniwalk train {shown}/config.toml --run {shown}"));
    }
    commands.extend(eval.as_ref().map(|eval| evaluation(&shown, eval)));
    commands.push(format!("omniwalk report {shown}"));
    let missing = missing(&table, eval.as_ref());
    // The robot says how many joints the entropy is of; a run that is only curves has none.
    let robot = run.path().join("robot");
    let joints = robot.is_dir().then(|| load::robot(&robot)).transpose()?;
    let joints = joints.map(|robot| robot.policy.len());
    let warnings = match run.metrics().exists() {
        true => health::warnings(&run.metrics(), joints)?,
        false => Vec::new(),
    };
    let folder = run
        .path()
        .file_name()
        .map_or(shown.clone(), |name| name.to_string_lossy().into_owned());
    Ok(About {
        name: seed.map_or(folder.clone(), |seed| format!("{folder} (seed {seed})")),
        config,
        seed,
        eval,
        warnings,
        commands,
        programs: sessions.list().iter().map(Session::program).collect(),
        missing: missing.map(|suites| format!("omniwalk eval {shown}{suites}")),
    })
}

/// The arguments with which `omniwalk eval` plays what the page has no pictures of yet, if there is something that a policy trained as `config`
/// says can be asked.
fn missing(config: &toml::Table, eval: Option<&Value>) -> Option<String> {
    let played = |suite: &str| eval.is_some_and(|eval| eval.get(suite).is_some());
    let suites = [Suite::Falls, Suite::Tracking, Suite::Push];
    let takes = |suite: &Suite| {
        suite
            .commands()
            .iter()
            .all(|command| within(config, command) != Some(false))
    };
    if !suites.iter().all(takes) {
        return eval.is_none().then(String::new);
    }
    let open = suites.iter().map(|suite| suite.name()).filter(|name| !played(name));
    let open: Vec<&str> = open.collect();
    (!open.is_empty()).then(|| format!(" --suite {}", open.join(",")))
}

/// Whether a command is within the bounds of `config`, if it has some.
fn within(config: &toml::Table, command: &[f64; 3]) -> Option<bool> {
    let bound = |key: &str, axis: usize| config.get("command")?.get(key)?.get(axis)?.as_float();
    let mut inside = true;
    for (axis, velocity) in command.iter().enumerate() {
        inside &= (bound("lower", axis)?..=bound("upper", axis)?).contains(velocity);
    }
    Some(inside)
}

/// The command of an evaluation, from what it wrote.
fn evaluation(run: &str, eval: &Value) -> String {
    let mut command = format!("omniwalk eval {run}");
    if let Some(engine) = eval.get("engine").and_then(Value::as_str) {
        command += &format!(" --engine {engine}");
    }
    if let Some(seed) = eval.get("seed").and_then(Value::as_u64) {
        command += &format!(" --seed {seed}");
    }
    let suites: Vec<&str> = eval
        .get("suites")
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    if !suites.is_empty() {
        let forward = eval.get("forward").map(|_| "forward");
        let names: Vec<&str> = forward.into_iter().chain(suites).collect();
        command += &format!(" --suite {}", names.join(","));
    }
    let episodes = eval
        .get("episodes")
        .or_else(|| eval.pointer("/forward/rows/0/episodes"));
    if let Some(episodes) = episodes.and_then(Value::as_u64) {
        command += &format!(" --episodes {episodes}");
    }
    if let Some(seconds) = eval.get("seconds").and_then(Value::as_f64) {
        command += &format!(" --seconds {seconds}");
    }
    if eval.get("conditions").and_then(Value::as_str) == Some("nominal") {
        command += " --nominal";
    }
    command
}

fn read(path: &Path) -> Result<String> {
    let read = || {
        let mut text = String::new();
        fs::File::open(path)?.take(MAX_TEXT_BYTES).read_to_string(&mut text)?;
        Ok::<_, std::io::Error>(text)
    };
    read()
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot read {}", path.display()))
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomic(path, bytes)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))?;
    Ok(say(path.display())?)
}
