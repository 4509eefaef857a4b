//! What a report is about: a run, a policy file with its evaluation, or an evaluation alone; and what there is to say of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{Result, miette};
use omniwalk_controller::{Identity, Policy};
use omniwalk_env::robot::Robot;

use super::again::{Range, evaluated_by, missing};
use super::curves::Curves;
use super::evaluation::Evaluation;
use super::health;
use super::html::About;
use crate::command::load;
use crate::complaint::plain;
use crate::deployed::Deployed;
use crate::files;
use crate::run::sessions::{Session, Sessions};
use crate::run::{MAX_CONFIG_BYTES, RunFolder};
use crate::terminal::{quoted, tell};
use crate::train::shape::Shape;

/// Name of an evaluation's file.
const EVALUATION: &str = "eval.json";

/// What a report is about.
pub struct Subject {
    /// What the page says of it.
    pub about: About,
    /// Its learning curves; none of what is no run, or has not learned yet.
    pub curves: Option<Curves>,
    /// Its evaluation, if it has one that can be drawn.
    pub evaluation: Option<Evaluation>,
    /// Where its evaluation and rollouts are, and its pictures go.
    pub folder: PathBuf,
    kind: Kind,
}

enum Kind {
    Run(RunFolder),
    /// The file.
    Policy(PathBuf),
    Evaluation,
}

impl Subject {
    /// Reads what is at `path`: a run folder, a policy file, an `eval.json`, or the folder with one. What of a run cannot be read is
    /// told and named on the page, as long as there is something else to draw.
    ///
    /// # Errors
    /// When `path` is none of these, is damaged, or holds nothing that can be drawn.
    pub fn open(path: &Path) -> Result<Self> {
        let is_evaluation = path.is_file() && path.file_name().is_some_and(|name| name == EVALUATION);
        if path.is_file() && !is_evaluation {
            return Self::policy(path);
        }
        let folder = match path.parent() {
            Some(folder) if is_evaluation && folder.as_os_str().is_empty() => Path::new("."),
            Some(folder) if is_evaluation => folder,
            _ => path,
        };
        let policy = folder.with_extension("omni");
        match RunFolder::open(folder) {
            Ok(run) => Self::run(run, is_evaluation),
            Err(_) if folder.extension().is_some_and(|it| it == "eval") && policy.is_file() => Self::policy(&policy),
            Err(_) if folder.join(EVALUATION).exists() => Self::alone(folder),
            Err(no_run) => Err(no_run.into()),
        }
    }

    /// The robot of its rollouts, unless nobody knows.
    pub fn robot(&self) -> Option<Result<Arc<Robot>>> {
        match &self.kind {
            Kind::Run(run) => Some(load::robot(&run.robot())),
            Kind::Policy(path) => Some(Deployed::open(path, None, &[]).map(|deployed| deployed.robot)),
            Kind::Evaluation => None,
        }
    }

    /// `needed` is whether the evaluation was asked for.
    fn run(run: RunFolder, needed: bool) -> Result<Self> {
        let (mut warnings, config, table) = configuration(&run);
        let seed = table.get("train").and_then(|train| train.get("seed")?.as_integer());
        let shown = quoted(&run.path().to_string_lossy());
        let folder = run.path().file_name();
        let folder = folder.map_or(shown.clone(), |name| name.to_string_lossy().into_owned());
        let name = seed.map_or(folder.clone(), |seed| format!("{folder} (seed {seed})"));
        let path = run.path().join(EVALUATION);
        let curves = match curves(&run, &name) {
            // What can be drawn without them is.
            Err(error) if path.exists() => {
                warnings.push(told(&error));
                None
            }
            curves => curves?,
        };
        warnings.extend(curves.as_ref().and_then(|curves| curves.damage.clone()).inspect(warn));
        let read = path.exists().then(|| Evaluation::load(&path)).transpose();
        let (eval, evaluation) = match read {
            Ok(read) => read.unzip(),
            Err(error) if needed || curves.is_none() => return Err(error),
            Err(error) => {
                warnings.push(told(&error));
                (None, None)
            }
        };
        if curves.is_none() && evaluation.is_none() {
            return Err(miette!("{} holds no metrics yet", run.path().display()));
        }
        warnings.extend(edited(&run));
        warnings.extend(outdated(&run, curves.as_ref(), evaluation.as_ref()));
        if curves.is_some() {
            let joints = joints(&run).unwrap_or_else(|error| {
                warnings.push(told(&error));
                None
            });
            warnings.extend(health::warnings(&run.metrics(), joints)?);
        }
        let (sessions, unrecorded) = sessions(&run);
        let mut commands: Vec<String> = sessions.iter().map(Session::command).collect();
        commands.extend(eval.as_ref().map(|eval| evaluated_by(&shown, eval)));
        commands.push(format!("omniwalk report {shown}"));
        let missing = missing(&Range::of(&table), eval.as_ref());
        let about = About {
            name,
            config: Some(config),
            seed,
            warnings,
            unrecorded,
            commands,
            programs: sessions.iter().map(Session::program).collect(),
            missing: missing.map(|suites| format!("omniwalk eval {shown}{suites}")),
            eval,
        };
        Ok(Self {
            about,
            curves,
            evaluation,
            folder: run.path().to_owned(),
            kind: Kind::Run(run),
        })
    }

    fn policy(path: &Path) -> Result<Self> {
        let policy = load::policy(path)?;
        let folder = path.with_extension("eval");
        let file = folder.join(EVALUATION);
        let shown = quoted(&path.to_string_lossy());
        if !file.exists() {
            let run = path.parent().filter(|folder| folder.join("config.toml").is_file());
            let help = match run {
                Some(run) => format!("it lies in a run: omniwalk report {}", quoted(&run.to_string_lossy())),
                None => format!("`omniwalk eval {shown}` writes it; of a run, give the run folder"),
            };
            return Err(miette!(
                help = help,
                "nothing to report of {}: there is no {}",
                path.display(),
                file.display()
            ));
        }
        let (eval, evaluation) = Evaluation::load(&file)?;
        let Identity { seed, steps, .. } = *policy.identity();
        let other = evaluation.steps.filter(|evaluated| *evaluated != steps);
        let warnings = other.map(|evaluated| {
            format!(
                "{EVALUATION} is of a policy after {evaluated} steps, the file of one after {steps}: evaluate it again"
            )
        });
        let about = About {
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            seed: i64::try_from(seed).ok(),
            warnings: warnings.into_iter().collect(),
            commands: vec![evaluated_by(&shown, &eval), format!("omniwalk report {shown}")],
            programs: vec![policy.identity().program.clone()],
            missing: missing(&range(&policy), Some(&eval)).map(|suites| format!("omniwalk eval {shown}{suites}")),
            eval: Some(eval),
            ..About::default()
        };
        Ok(Self {
            about,
            curves: None,
            evaluation: Some(evaluation),
            folder,
            kind: Kind::Policy(path.to_owned()),
        })
    }

    fn alone(folder: &Path) -> Result<Self> {
        let (eval, evaluation) = Evaluation::load(&folder.join(EVALUATION))?;
        let shown = quoted(&folder.to_string_lossy());
        let about = About {
            name: folder.join(EVALUATION).display().to_string(),
            unrecorded: Some("there is neither run nor policy beside the evaluation".to_owned()),
            commands: vec![format!("omniwalk report {shown}")],
            eval: Some(eval),
            ..About::default()
        };
        Ok(Self {
            about,
            curves: None,
            evaluation: Some(evaluation),
            folder: folder.to_owned(),
            kind: Kind::Evaluation,
        })
    }
}

fn warn(said: &String) {
    tell(format_args!("warning: {said}"));
}

/// Tells the error as a warning, and gives it as one line for the page.
fn told(error: &miette::Report) -> String {
    let said = plain(error);
    warn(&said);
    said.replace("\n ", ";")
}

/// The configuration of `run`, as text and as values, with what is wrong with it.
fn configuration(run: &RunFolder) -> (Vec<String>, String, toml::Table) {
    let path = run.config();
    let read = files::read(&path, MAX_CONFIG_BYTES).map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    let text = read.unwrap_or_default();
    let wrong = match run.emptied() {
        Some(emptied) => Some(miette!("{emptied}")),
        None => load::settings(Some(&path), &[])
            .err()
            .map(|error| miette::Report::new(error).wrap_err(format!("{} is no run's configuration", path.display()))),
    };
    let table = toml::from_str(&text).unwrap_or_default();
    (wrong.iter().map(told).collect(), text, table)
}

/// The learning curves of `run`, if it has some.
fn curves(run: &RunFolder, name: &str) -> Result<Option<Curves>> {
    if !run.metrics().exists() {
        return Ok(None);
    }
    let curves = Curves::read(&run.metrics(), name.to_owned())?;
    Ok((curves.steps() > 0).then_some(curves))
}

/// Who trained `run`, and why that is not known where it is not.
fn sessions(run: &RunFolder) -> (Vec<Session>, Option<String>) {
    match Sessions::open(&run.sessions()) {
        Ok(sessions) if sessions.list().is_empty() => {
            (Vec::new(), Some("there is no sessions.toml in its folder".to_owned()))
        }
        Ok(sessions) => (sessions.list().to_vec(), None),
        Err(error) => (Vec::new(), Some(told(&error.into()))),
    }
}

/// The robot says how many joints the entropy is of; a run that is only curves has none.
fn joints(run: &RunFolder) -> Result<Option<usize>> {
    let robot = run.robot().is_dir().then(|| load::robot(&run.robot())).transpose()?;
    Ok(robot.map(|robot| robot.policy.len()))
}

/// Says that the robot or the configuration are not those that the newest checkpoint was trained with.
fn edited(run: &RunFolder) -> Option<String> {
    let (settings, _) = load::settings(Some(&run.config()), &[]).ok()?;
    let latest = run.checkpoints().latest().ok()??;
    let shape = Shape::new(&settings, &run.robot()).ok()?;
    let error = shape.check(&latest.checkpoint).err()?;
    Some(told(&error.into()))
}

/// Says that the evaluation is not of the newest policy.
fn outdated(run: &RunFolder, curves: Option<&Curves>, evaluation: Option<&Evaluation>) -> Option<String> {
    let evaluated = evaluation?.steps?;
    let newest = run.checkpoints().list().last().map(|(step, _)| *step);
    let (newest, whose) = match (newest, curves.map_or(0, Curves::steps)) {
        (Some(step), _) => ((step != evaluated).then_some(step)?, "the newest checkpoint is"),
        // Without checkpoints, the metrics may have been thinned, and end before the training did.
        (None, step) => ((step > evaluated).then_some(step)?, "training went on to the one"),
    };
    Some(format!(
        "{EVALUATION} is of the policy after {evaluated} steps, {whose} after {newest}: evaluate it again"
    ))
}

/// The commands `policy` was trained for.
fn range(policy: &Policy) -> Range {
    // Through the decimal numbers that were written: 0.7 and not what single precision makes of it.
    let decimal = |x: f32| x.to_string().parse().unwrap_or(f64::from(x));
    let trained = &policy.identity().curriculum;
    Range(Some([trained.lower, trained.upper].map(|ends| ends.map(decimal))))
}
