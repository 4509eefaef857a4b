//! A policy file on a simulated robot: the settings under which the environments' controller is the file's.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::miette;
use omniwalk_controller::{FilterSpec, Policy};
use omniwalk_env::robot::Robot;
use omniwalk_env::task::shared::spec;

use crate::command::load;
use crate::config::{ConfigError, Layers};
use crate::settings::{DEFAULT, Settings};

/// A policy with a robot that it fits.
pub struct Deployed {
    /// The policy.
    pub policy: Policy,
    /// The robot.
    pub robot: Arc<Robot>,
    /// The defaults, with what the policy says in their place.
    pub settings: Settings,
}

impl Deployed {
    /// The policy in the file at `path` on the robot at `robot`, or the default one. `changes` are `key=value`.
    ///
    /// # Errors
    /// When the file is no policy, or the robot, as changed, not the one it was trained for.
    pub fn open(path: &Path, robot: Option<&Path>, changes: &[String]) -> miette::Result<Self> {
        Self::new(load::policy(path)?, path, robot, changes)
    }

    /// [`Deployed::open`] for a policy that came from `path`.
    ///
    /// # Errors
    /// Those of [`Deployed::open`].
    pub fn new(policy: Policy, path: &Path, robot: Option<&Path>, changes: &[String]) -> miette::Result<Self> {
        let mut layers = layers(&policy)?;
        for change in changes {
            layers = layers.set(change)?;
        }
        let settings = layers.build::<Settings>()?.0;
        let robot = load::robot(&find_robot(path, robot, &settings.robot.path)?)?;
        let found = spec(&robot, &settings.env);
        policy.spec().check_robot(&found).map_err(|misfit| {
            miette!(
                help = "give the robot it was trained for by --robot",
                "{} does not fit robot {}: {misfit}",
                path.display(),
                robot.name
            )
        })?;
        Ok(Self {
            policy,
            robot,
            settings,
        })
    }
}

/// Where the robot of the policy at `policy` is: where the user says, in the run that the policy lies in, or the default one. A
/// policy file says how its robot's joints are driven, but has not the bodies and shapes that a simulation needs.
fn find_robot(policy: &Path, given: Option<&Path>, default: &Path) -> miette::Result<PathBuf> {
    let of_run = policy.parent().map(|folder| folder.join("robot"));
    let places = [of_run, Some(default.to_owned())];
    match given {
        Some(robot) => Ok(robot.to_owned()),
        None => places.into_iter().flatten().find(|place| place.exists()).ok_or_else(|| {
            miette!(
                help = "give the robot it was trained for by --robot, such as --robot robots/nimbro_op2x",
                "{} does not hold the body of its robot, which a simulation needs; there is no run around it, and no {} here",
                policy.display(),
                default.display()
            )
        }),
    }
}

/// The defaults and what `policy` says of observation, action, clock, command and latency.
///
/// # Errors
/// When a value of the policy is not one that a configuration can have.
pub fn layers(policy: &Policy) -> Result<Layers, ConfigError> {
    let spec = policy.spec();
    let blocks = spec.observation.iter().filter(|block| block.name() != "clock");
    let blocks: Vec<_> = blocks.map(|block| block.name()).collect();
    let filter = match spec.action.filter {
        None => "enabled = false".to_owned(),
        Some(FilterSpec::Exponential { gain }) => format!("enabled = true\nkind = \"exponential\"\ngain = {gain:?}"),
        Some(FilterSpec::Butterworth { cutoff_hz }) => {
            format!("enabled = true\nkind = \"butterworth\"\ncutoff_hz = {cutoff_hz:?}")
        }
    };
    let law = spec.action.law.name();
    let clock = match spec.clock {
        None => "enabled = false".to_owned(),
        Some(clock) => format!(
            "enabled = true\nperiod = {:?}\nsymmetric = {}",
            clock.period,
            spec.symmetry.is_some()
        ),
    };
    let [roll, pitch] = spec.upright;
    let latency = policy.identity().latency;
    let command = &spec.command;
    let text = format!(
        "[engine]\ncontrol_hz = {}\n\
         [observation]\nblocks = {blocks:?}\ninertial_frame_period = {:?}\n\
         [action]\nlaw = {law:?}\nscale = {:?}\ntorque_clamp = {}\n\
         [action.filter]\n{filter}\n[clock]\n{clock}\n\
         [command]\nlower = {:?}\nupper = {:?}\nrate = {:?}\n\
         [task]\nmax_roll = {roll:?}\nmax_pitch = {pitch:?}\n\
         [latency]\nenabled = {}\nlower = {:?}\nupper = {:?}\n",
        spec.control_hz,
        spec.inertial_frame_period,
        spec.joints[0].action_scale,
        spec.action.torque_clamp,
        command.lower,
        command.upper,
        command.rate,
        latency[1] > 0.0,
        latency[0],
        latency[1],
    );
    Layers::new(DEFAULT)?.text("the policy file", &text)
}
