//! The controller of a robot: the very code of training and of the C library.

use std::path::PathBuf;

use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use omniwalk::command::load;
use omniwalk::deployed::layers;
use omniwalk::settings::Settings;
use omniwalk_controller as rust;
use omniwalk_controller::{JointSpec, Policy, Sensors, Spec};
use omniwalk_env::task::shared::spec;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arrays::{self, Numbers, Row};
use crate::error::{raise, refuse};
use crate::given::{finite, taken, wrong};
use crate::robot::Robot;
use crate::status::Status;

/// A policy in its loop on a robot.
#[pyclass(module = "omniwalk")]
pub struct Controller {
    policy: Policy,
    controller: rust::Controller,
    targets: Vec<f32>,
}

/// What a time must be.
const NANOSECONDS: &str = "a whole number of nanoseconds from 0 to 2^64 - 1";

/// What an order of joints must be.
const NAMES: &str = "a list of the names of joints";

/// Readings of the joints, given in the policy's order or by name.
fn readings<'py>(given: &Bound<'py, PyAny>, joints: &[JointSpec], argument: &str) -> PyResult<Row<'py>> {
    match given.cast::<PyDict>() {
        Ok(values) => {
            let each = joints.iter().map(|joint| reading(values, &joint.name, argument));
            each.collect::<PyResult<_>>().map(Row::Own)
        }
        Err(_) => arrays::row(given, joints.len(), argument),
    }
}

fn reading(values: &Bound<'_, PyDict>, joint: &str, argument: &str) -> PyResult<f32> {
    let value = values.get_item(joint)?.ok_or_else(|| {
        refuse(format!(
            "{argument} has no entry for joint `{joint}`, which the policy moves"
        ))
    })?;
    value
        .extract()
        .map_err(|_| wrong(&format!("{argument} of joint `{joint}`"), "a number", &value))
}

impl Controller {
    fn spec(&self) -> &Spec {
        self.policy.spec()
    }

    fn numbers<'py>(&self, py: Python<'py>, number: impl Fn(&JointSpec) -> f32) -> Bound<'py, PyArray1<f32>> {
        arrays::new(py, self.spec().joints.iter().map(number))
    }
}

#[pymethods]
impl Controller {
    /// The policy in a file, given by its path or as its bytes. The file is checked and reproduces its golden vectors, or is
    /// refused. `portable` does without the instructions that not every processor has.
    #[new]
    #[pyo3(signature = (policy, *, portable=false))]
    fn new(policy: &Bound<'_, PyAny>, portable: bool) -> PyResult<Self> {
        let policy = if let Ok(bytes) = policy.cast::<PyBytes>() {
            Policy::from_bytes(bytes.as_bytes()).map_err(refuse)?
        } else {
            let path: PathBuf = taken(policy, "policy", "the path of a policy file, or its bytes")?;
            load::policy(&path).map_err(raise)?
        };
        let controller = if portable {
            rust::Controller::portable(&policy)
        } else {
            rust::Controller::new(&policy)
        };
        Ok(Self {
            targets: vec![0.0; policy.spec().action_len()],
            controller: controller.map_err(refuse)?,
            policy,
        })
    }

    /// Names of the policy's joints, in the order of every array.
    #[getter]
    fn joints(&self) -> Vec<&str> {
        self.spec().joints.iter().map(|joint| joint.name.as_str()).collect()
    }

    /// Names of the observation's entries.
    #[getter]
    fn observation_names(&self) -> Vec<String> {
        let spec = self.spec();
        (0..spec.observation_len())
            .filter_map(|entry| spec.entry_name(entry))
            .collect()
    }

    /// Nominal pose, rad or m.
    #[getter]
    fn nominal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.numbers(py, |joint| joint.nominal)
    }

    /// Lower position limits, rad or m.
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.numbers(py, |joint| joint.lower)
    }

    /// Upper position limits, rad or m.
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.numbers(py, |joint| joint.upper)
    }

    /// Position gains of the actuators, N m/rad or N/m.
    #[getter]
    fn kp<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.numbers(py, |joint| joint.kp)
    }

    /// Velocity gains of the actuators, N m s/rad or N s/m.
    #[getter]
    fn kd<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.numbers(py, |joint| joint.kd)
    }

    /// Torque limits of the actuators, N m or N.
    #[getter]
    fn torque_limit<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.numbers(py, |joint| joint.torque_limit)
    }

    /// Smallest and largest desired velocity that was trained, m/s, m/s, rad/s.
    #[getter]
    fn command_range(&self) -> ([f32; 3], [f32; 3]) {
        let trained = &self.policy.identity().curriculum;
        (trained.lower, trained.upper)
    }

    /// Control rate, Hz.
    #[getter]
    fn control_hz(&self) -> f32 {
        self.spec().control_hz
    }

    /// Control period, ns.
    #[getter]
    fn period(&self) -> u64 {
        self.controller.period()
    }

    /// Name of the instruction set the network runs with.
    #[getter]
    fn instruction_set(&self) -> &'static str {
        self.controller.instruction_set()
    }

    /// Runs the golden vectors again.
    fn verify(&self) -> PyResult<()> {
        self.policy.verify().map_err(refuse)
    }

    /// The golden vectors: readings and what must come out. `actions` is a list of (observation, action), `steps` of dictionaries
    /// with the arguments of `step` and its `observation` and `targets`, from a reset at `clock_phase` on.
    fn golden<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let golden = self.policy.golden();
        let row = |values: &[f32]| arrays::new(py, values.iter().copied());
        let action = |it: &rust::GoldenAction| (row(&it.observation), row(&it.action));
        let step = |it: &rust::GoldenStep| {
            let step = PyDict::new(py);
            step.set_item("position", row(&it.position))?;
            step.set_item("velocity", row(&it.velocity))?;
            step.set_item("attitude", row(&it.attitude))?;
            step.set_item("gyro", row(&it.gyro))?;
            step.set_item("desired", row(&it.desired))?;
            step.set_item("base_velocity", it.base_velocity.map(|velocity| row(&velocity)))?;
            step.set_item("observation", row(&it.observation))?;
            step.set_item("targets", row(&it.targets))?;
            Ok(step)
        };
        let found = PyDict::new(py);
        found.set_item("clock_phase", golden.clock_phase)?;
        found.set_item("actions", golden.actions.iter().map(action).collect::<Vec<_>>())?;
        found.set_item("steps", golden.steps.iter().map(step).collect::<PyResult<Vec<_>>>()?)?;
        Ok(found)
    }

    /// Checks that `names`, the order in which you give readings and take targets, is the policy's.
    fn check_joints(&self, names: &Bound<'_, PyAny>) -> PyResult<()> {
        let names: Vec<String> = taken(names, "names", NAMES)?;
        self.spec().check_order(&names).map_err(refuse)
    }

    /// Index among `names`, your robot's joints, of each of the policy's joints.
    fn joint_map<'py>(&self, py: Python<'py>, names: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let names: Vec<String> = taken(names, "names", NAMES)?;
        let map = self.spec().joint_map(&names).map_err(refuse)?;
        Ok(arrays::new(py, map.into_iter().map(|index| index as i64)))
    }

    /// Checks that the policy was trained for `robot`: joints, limits, gains, nominal pose, kinematics.
    fn check_robot(&self, robot: &Robot) -> PyResult<()> {
        let settings = layers(&self.policy).and_then(|layers| layers.build::<Settings>());
        let (settings, _) = settings.map_err(raise)?;
        let found = spec(&robot.robot, &settings.env);
        self.spec().check_robot(&found).map_err(refuse)
    }

    /// Starts an episode with the clock at `phase`, in cycles, or where the policy begins; a fall is forgotten. The robot should
    /// stand in the nominal pose.
    #[pyo3(signature = (phase=None))]
    fn reset(&mut self, phase: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let phase = match phase {
            Some(given) => finite(given, "phase")?,
            None => self.controller.reset_phase(),
        };
        self.controller.reset(phase);
        Ok(())
    }

    /// Starts with a robot in whatever pose: ramps to the nominal pose, rests, then walks.
    ///
    /// Raises Error if a position is not finite or well beyond its joint's limits. Then send no targets to servos that are on:
    /// steps hold what was told last, with the fault, until one of them has good readings, from which the takeover begins.
    fn take_over(&mut self, position: &Bound<'_, PyAny>) -> PyResult<()> {
        let position = readings(position, &self.policy.spec().joints, "position")?;
        let taken = self.controller.take_over(&position);
        taken.map_err(|fault| refuse(fault.sentence(self.policy.spec())))
    }

    /// One step, to be made once a control period: the targets (rad or m, finite, within limits) and a status.
    ///
    /// `now` and `measured` are the times of the step and of its readings, ns on one clock that does not jump. `position` and
    /// `velocity` are arrays in the policy's order, or dictionaries by joint name, which may hold other joints too; then
    /// the targets are a dictionary. `out` is the array to write the targets to.
    #[pyo3(signature = (now, measured, position, velocity, attitude, gyro, desired, base_velocity=None, *, out=None))]
    #[expect(clippy::too_many_arguments, reason = "they are named in Python")]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        now: &Bound<'py, PyAny>,
        measured: &Bound<'py, PyAny>,
        position: &Bound<'py, PyAny>,
        velocity: &Bound<'py, PyAny>,
        attitude: &Bound<'py, PyAny>,
        gyro: &Bound<'py, PyAny>,
        desired: &Bound<'py, PyAny>,
        base_velocity: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, Status)> {
        let joints = &self.policy.spec().joints;
        let (now, measured) = (
            taken(now, "now", NANOSECONDS)?,
            taken(measured, "measured", NANOSECONDS)?,
        );
        let positions = readings(position, joints, "position")?;
        let velocities = readings(velocity, joints, "velocity")?;
        let sensors = Sensors {
            position: &positions,
            velocity: &velocities,
            attitude: arrays::fixed(attitude, "attitude")?,
            gyro: arrays::fixed(gyro, "gyro")?,
            base_velocity: base_velocity
                .map(|given| arrays::fixed(given, "base_velocity"))
                .transpose()?,
        };
        let desired = arrays::fixed(desired, "desired")?;
        let out = out.map(|given| arrays::out(given, &[joints.len()])).transpose()?;
        let Self {
            controller, targets, ..
        } = self;
        let status = py.detach(|| controller.step(now, measured, &sensors, desired, targets));
        let targets = match out {
            _ if position.is_instance_of::<PyDict>() => {
                let names = joints.iter().map(|joint| joint.name.as_str());
                let found = PyDict::new(py);
                for (name, target) in names.zip(&self.targets) {
                    found.set_item(name, target)?;
                }
                found.into_any()
            }
            Some(mut out) => {
                out.as_slice_mut().map_err(refuse)?.copy_from_slice(&self.targets);
                out.as_any().clone()
            }
            None => arrays::new(py, self.targets.iter().copied()).into_any(),
        };
        Ok((targets, Status::new(&status, self.policy.spec())))
    }

    /// Actions in [0, 1] for observations, a row each or a single one, without advancing the loop.
    #[pyo3(signature = (observations, *, out=None))]
    fn act<'py>(
        &mut self,
        py: Python<'py>,
        observations: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let (width, joints) = (self.spec().observation_len(), self.spec().action_len());
        let refusal = || {
            wrong(
                "observations",
                format_args!("{width} numbers, or rows of {width} numbers"),
                observations,
            )
        };
        let numbers: Numbers<'py> = observations.extract().map_err(|_| refusal())?;
        let mut shape = numbers.shape().to_vec();
        match shape.last_mut() {
            Some(last) if *last == width => *last = joints,
            _ => return Err(refusal()),
        }
        let given = arrays::in_order(&numbers);
        let mut out = match out {
            Some(given) => arrays::out(given, &shape)?,
            None => PyArrayDyn::zeros(py, shape, false).readwrite(),
        };
        let found = out.as_slice_mut().map_err(refuse)?;
        let controller = &mut self.controller;
        py.detach(|| {
            for (observation, action) in given.chunks_exact(width).zip(found.chunks_exact_mut(joints)) {
                controller.act(observation, action);
            }
        });
        Ok((**out).clone())
    }

    /// The observation of the last step of the policy, before bounds, as the policy sees it: mirrored in the second half of a
    /// symmetric policy's cycle.
    #[getter]
    fn observation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        arrays::new(py, self.controller.observation().iter().copied())
    }

    /// The action of the last step of the policy, in [0, 1]; not a number while the targets were held.
    #[getter]
    fn action<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        arrays::new(py, self.controller.action().iter().copied())
    }

    fn __repr__(&self) -> String {
        let identity = self.policy.identity();
        format!(
            "Controller({} joints at {} Hz, {} steps of training, by {})",
            self.spec().action_len(),
            self.spec().control_hz,
            identity.steps,
            identity.program
        )
    }
}
