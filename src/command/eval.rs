//! `omniwalk eval`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{IntoDiagnostic, WrapErr, miette};
use omniwalk_controller::{Controller, Misfit, Spec};
use omniwalk_env::EnvConfig;
use omniwalk_env::engine::Configured;
use omniwalk_env::robot::Robot;
use omniwalk_env::task::shared::spec;
use omniwalk_ppo::Inference;
use serde_json::{Value, json};

use super::load;
use crate::config::Layers;
use crate::deployed::{Deployed, layers};
use crate::eval::firsts::{Rollouts, first_episodes};
use crate::eval::forward::{Forward, Watch, nominal, play};
use crate::eval::player::Player;
use crate::eval::suites::{ALL, CONDITIONS, Plan, Results, Suite};
use crate::eval::table;
use crate::eval::trial::Stage;
use crate::files::can_write;
use crate::report::evaluation::{Evaluation, Picture};
use crate::run::{RunFolder, create_folder, write_atomic};
use crate::settings::{DEFAULT, Settings};
use crate::terminal::say;
use crate::train::{checkpoint, shape};

/// Plays a policy's mode and measures how it walks.
///
/// Writes the results to eval.json in the run folder, with pictures (eval_*.png) and rollouts beside it; of a policy file
/// NAME.omni into the folder NAME.eval. By itself it plays the
/// commands of the run's `[eval]` section (of a policy file, of the defaults) under the conditions the policy was trained in. The suites of DeepWalk's
/// evaluation judge every policy under the same conditions: noise, latency, and friction and actuators drawn for each
/// sequence, and beside that without any.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run folder or policy file.
    run: PathBuf,
    /// What is played; several are separated by commas.
    ///
    /// forward: the commands of the run's `[eval]` section.
    /// falls: ten commands, ten sequences of 60 s each.
    /// tracking: a sequence of commands, commands along each axis, and a grid over all three, ten sequences of 10 s each.
    /// changes: 160 random commands of 10 s, one after another.
    /// push: pushes from four sides at five commands, stronger and stronger.
    /// all: every suite but forward.
    #[arg(
        long, verbatim_doc_comment, value_delimiter = ',', default_value = "forward",
        value_parser = ["forward", "falls", "tracking", "changes", "push", "all"],
    )]
    suite: Vec<String>,
    /// Physics engine [default: rapier, in which policies are judged].
    #[arg(long, value_parser = ["rapier", "lanes"])]
    engine: Option<String>,
    /// Robot folder or URDF [default: the run's; for a policy file that of the defaults].
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Episodes for each command [default: the run's; 10 in suites, where changes has 16 for each, and push a push].
    #[arg(long, value_name = "N")]
    episodes: Option<usize>,
    /// Length of an episode [default: the run's; the suite's own in suites, where push watches as long].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Seed of the episodes.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    seed: u64,
    /// Only without noise, latency and randomisation.
    #[arg(long)]
    nominal: bool,
    /// Changes a single value of the run's configuration.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Also writes the results to FILE.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A policy with what it was trained as.
struct Loaded {
    settings: Settings,
    robot: Arc<Robot>,
    player: Player,
    steps: u64,
    /// What the conditions of suites are laid over.
    layers: Layers,
    /// Smallest and largest command that was trained.
    range: [[f64; 3]; 2],
    /// Where the results go.
    folder: PathBuf,
}

/// Sequences for each command of a suite (thesis 7.5).
const EPISODES: usize = 10;

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with the run or the arguments.
pub fn run(args: &Args) -> miette::Result<()> {
    let outputs: Vec<&Path> = args.json.iter().map(PathBuf::as_path).collect();
    let inputs = [&args.run].into_iter().chain(&args.robot);
    outputs.iter().try_for_each(|file| can_write(file))?;
    load::writable(&outputs, &inputs.map(PathBuf::as_path).collect::<Vec<_>>())?;
    let mut loaded = Loaded::open(args)?;
    loaded.can_save()?;
    let suites: Vec<Suite> = ALL
        .into_iter()
        .filter(|suite| args.suite.iter().any(|name| name == suite.name() || name == "all"))
        .collect();
    let judged = loaded.judged(args, &suites)?;
    let mut result = json!({
        "policy": args.run.display().to_string(),
        "steps": loaded.steps,
        "engine": loaded.settings.env.engine.kind.name(),
        "simd": shape::simd(&loaded.settings),
        "robot": loaded.robot.name,
        "seed": args.seed,
        "conditions": conditions(args.nominal),
    });
    if !args.set.is_empty() {
        result["set"] = json!(args.set);
    }
    if args.suite.iter().any(|name| name == "forward") {
        loaded.forward(args, &mut result)?;
        loaded.save(args, &result)?;
    }
    if suites.is_empty() {
        return Ok(());
    }
    let plan = Plan {
        episodes: args.episodes.unwrap_or(EPISODES),
        seconds: args.seconds,
    };
    result["suites"] = suites.iter().map(|suite| suite.name()).collect();
    result["episodes"] = json!(plan.episodes);
    if let Some(seconds) = plan.seconds {
        result["seconds"] = json!(seconds);
    }
    say(format_args!(
        "{} after {} steps, {}, seed {}",
        args.run.display(),
        loaded.steps,
        loaded.settings.env.engine.kind.name(),
        args.seed
    ))?;
    for suite in suites {
        result[suite.name()] = loaded.suite(args, suite, &judged, &plan)?;
        // After each: they take their time.
        loaded.save(args, &result)?;
    }
    Ok(())
}

fn conditions(nominal: bool) -> &'static str {
    if nominal { "nominal" } else { "randomised" }
}

impl Loaded {
    fn open(args: &Args) -> miette::Result<Self> {
        let loaded = if args.run.is_file() {
            Self::open_policy(args)
        } else {
            Self::open_run(args)
        }?;
        load::warn_of_long_steps(&loaded.robot, &loaded.settings.env);
        Ok(loaded)
    }

    fn open_policy(args: &Args) -> miette::Result<Self> {
        let Deployed {
            policy,
            robot,
            settings,
        } = Deployed::open(&args.run, args.robot.as_deref(), &changes(args))?;
        // Through the decimal numbers that were written: 0.7 and not what single precision makes of it.
        let decimal = |x: f32| x.to_string().parse().unwrap_or(f64::from(x));
        let trained = &policy.identity().curriculum;
        Ok(Self {
            layers: layers(&policy)?,
            range: [trained.lower, trained.upper].map(|ends| ends.map(decimal)),
            player: Player::Controller(Box::new(Controller::new(&policy).into_diagnostic()?)),
            steps: policy.identity().steps,
            folder: args.run.with_extension("eval"),
            settings,
            robot,
        })
    }

    fn open_run(args: &Args) -> miette::Result<Self> {
        let run = RunFolder::open(&args.run)?;
        let (settings, _) = load::settings(Some(&args.run.join("config.toml")), &changes(args))?;
        let robot = load::robot(args.robot.as_deref().unwrap_or(&args.run.join("robot")))?;
        let latest = load::latest(&run)?;
        let layout = spec(&robot, &settings.env);
        let (trained, _) = load::settings(Some(&args.run.join("config.toml")), &[])?;
        if let Some(other) = &args.robot {
            same_pose(&spec(&*load::robot(&run.robot())?, &trained.env), &layout).wrap_err_with(|| {
                format!(
                    "{} is not the robot that {} was trained for",
                    other.display(),
                    args.run.display()
                )
            })?;
        }
        spec(&robot, &trained.env).check_robot(&layout).map_err(|misfit| {
            miette::miette!(
                help = "what the policy sees and how it acts stay as they were trained; conditions can be changed: noise, latency, friction, randomise, push, engine.kind, engine.physics_hz",
                "`--set` does not fit the policy, {}",
                match misfit {
                    Misfit::Differs(found) => found.join("; "),
                    other => other.to_string(),
                }
            )
        })?;
        let agent = checkpoint::agent(
            &latest.checkpoint,
            &settings,
            layout.observation_len(),
            layout.action_len(),
        )
        .wrap_err_with(|| format!("{} does not fit robot and configuration", latest.path.display()))?;
        Ok(Self {
            layers: Layers::new(DEFAULT)?.file(&args.run.join("config.toml"))?,
            range: [settings.env.command.lower, settings.env.command.upper],
            player: Player::Learner(Box::new(agent), Inference::default()),
            steps: latest.checkpoint.step,
            folder: args.run.clone(),
            settings,
            robot,
        })
    }

    /// The conditions in which `suites` judge the policy.
    fn judged(&self, args: &Args, suites: &[Suite]) -> miette::Result<EnvConfig> {
        if args.suite.iter().any(|name| name == "forward") {
            self.within_bounds("`eval.commands`", &self.settings.eval.commands)?;
        }
        for suite in suites {
            self.within_bounds(&format!("what `{}` asks for", suite.name()), suite.commands())?;
        }
        let mut layers = self.layers.clone().text("conditions.toml (built in)", CONDITIONS)?;
        for change in changes(args) {
            layers = layers.set(&change)?;
        }
        Ok(layers.build::<Settings>()?.0.env)
    }

    /// Plays the commands of the run's own configuration.
    fn forward(&mut self, args: &Args, result: &mut Value) -> miette::Result<()> {
        let eval = &self.settings.eval;
        let suite = Forward {
            commands: eval.commands.clone(),
            episodes: eval.episodes,
            seconds: eval.seconds,
            seed: args.seed,
            nominal: args.nominal,
        };
        let mut rollouts = Rollouts::new(self.folder.join("rollouts"), first_episodes(&suite));
        let player = &mut self.player;
        let policy = |observations: &[f32], actions: &mut [f32]| player.mode(observations, actions);
        let rows = play(self.robot.clone(), &self.settings.env, &suite, policy, &mut rollouts)?;
        let files = rollouts.finish()?;
        say(format_args!(
            "{} after {} steps, {} conditions, {} episodes of {} s a command, {}",
            args.run.display(),
            self.steps,
            conditions(args.nominal),
            suite.episodes,
            suite.seconds,
            self.settings.env.engine.kind.name()
        ))?;
        say(table::dashed(table::to_text(&rows).trim_end()))?;
        for file in files {
            say(format_args!("rollout: {}", file.display()))?;
        }
        result["seconds"] = json!(suite.seconds);
        result["forward"] = json!({ "rows": table::to_json(&rows) });
        draw(&self.folder, Evaluation::read(result)?.pictures()?)
    }

    /// Plays `suite` under the conditions `judged` and, beside that, without any randomisation.
    fn suite(&mut self, args: &Args, suite: Suite, judged: &EnvConfig, plan: &Plan) -> miette::Result<Value> {
        let mut rollouts = Rollouts::new(self.folder.join("rollouts"), suite.rollouts());
        let mut play = |nominally: bool, watch: Option<&mut dyn Watch>| {
            let mut config = judged.clone();
            if nominally {
                nominal(&mut config);
            }
            let player = &mut self.player;
            let mut stage = Stage {
                robot: self.robot.clone(),
                config,
                seed: args.seed,
                engines: &Configured,
                policy: &mut |observations, actions| player.mode(observations, actions),
            };
            let results = suite.play(&mut stage, plan, watch)?;
            say(format_args!(
                "\n{}, {} conditions\n{}",
                suite.name(),
                conditions(nominally),
                table::dashed(results.text().trim_end())
            ))?;
            miette::Result::<Box<dyn Results>>::Ok(results)
        };
        let results = play(args.nominal, Some(&mut rollouts))?;
        for file in rollouts.finish()? {
            say(format_args!("rollout: {}", file.display()))?;
        }
        let mut json = results.json();
        draw(&self.folder, results.pictures()?)?;
        draw(
            &self.folder,
            Evaluation::read(&json!({ "conditions": conditions(args.nominal), suite.name(): json }))?.pictures()?,
        )?;
        if !args.nominal {
            json["nominal"] = play(true, None)?.json();
        }
        Ok(json)
    }

    /// The controller keeps what is asked of it within the bounds it was trained for, so that other commands would not
    /// be played as they are written.
    fn within_bounds(&self, what: &str, commands: &[[f64; 3]]) -> miette::Result<()> {
        let [lower, upper] = self.range;
        let inside = |command: &[f64; 3]| (0..3).all(|k| (lower[k]..=upper[k]).contains(&command[k]));
        match commands.iter().find(|command| !inside(command)) {
            None => Ok(()),
            Some(command) => Err(miette!(
                help = "for example --suite forward --set 'eval.commands=[[0.0, 0.0, 0.0]]'",
                "{what} must be within the bounds the policy was trained for, {lower:?} to {upper:?}, and {command:?} is not"
            )),
        }
    }

    /// Whether the results can be written, before hours are spent on them.
    fn can_save(&self) -> miette::Result<()> {
        let (folder, file) = (&self.folder, self.folder.join("eval.json"));
        can_write(if folder.is_dir() { &file } else { folder }).map_err(|error| {
            error.wrap_err(format!(
                "the results would go to {}; copy the run or the policy to where you may write",
                folder.display()
            ))
        })
    }

    fn save(&self, args: &Args, result: &Value) -> miette::Result<()> {
        let text = serde_json::to_string_pretty(result).into_diagnostic()? + "\n";
        make(&self.folder)?;
        write(&self.folder.join("eval.json"), text.as_bytes())?;
        args.json.as_ref().map_or(Ok(()), |file| write(file, text.as_bytes()))
    }
}

/// What the arguments change of the configuration.
fn changes(args: &Args) -> Vec<String> {
    let mut changes = load::played(args.engine.as_deref(), &args.set);
    changes.extend(args.episodes.map(|n| format!("eval.episodes={n}")));
    changes.extend(args.seconds.map(|s| format!("eval.seconds={s:?}")));
    changes
}

/// Whether `other`'s joints are in the order of the policy's `own`, and stand as they do: gains, limits and masses may be others.
fn same_pose(own: &Spec, other: &Spec) -> miette::Result<()> {
    let names: Vec<&str> = other.joints.iter().map(|joint| joint.name.as_str()).collect();
    own.check_order(&names).into_diagnostic()?;
    let mut joints = own.joints.iter().zip(&other.joints);
    match joints.find(|(a, b)| (a.nominal - b.nominal).abs() > 1e-5) {
        Some((a, b)) => Err(miette!(
            "joint `{}`: nominal is {} in the policy and {} in the robot",
            a.name,
            a.nominal,
            b.nominal
        )),
        None => Ok(()),
    }
}

fn draw(folder: &Path, pictures: Vec<Picture>) -> miette::Result<()> {
    make(folder)?;
    pictures.into_iter().try_for_each(|(name, canvas)| {
        let path = folder.join(name);
        write(&path, &canvas.png()?)?;
        Ok(say(format_args!("picture: {}", path.display()))?)
    })
}

fn make(folder: &Path) -> miette::Result<()> {
    create_folder(folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", folder.display()))
}

fn write(path: &Path, bytes: &[u8]) -> miette::Result<()> {
    write_atomic(path, bytes)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))
}
