//! A robot: a folder with a URDF and a robot.toml, or a URDF.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::PyArray1;
use omniwalk::command::load;
use omniwalk_env::robot::{Actuator, Base, Joint, describe};
use pyo3::prelude::*;

use crate::arrays;
use crate::error::raise;
use crate::given::taken;

/// A robot, loaded and checked.
#[pyclass(module = "omniwalk", frozen)]
pub struct Robot {
    pub robot: Arc<omniwalk_env::robot::Robot>,
}

impl Robot {
    fn policy_joints(&self) -> impl Iterator<Item = &Joint> {
        (0..self.robot.policy.len()).map(|i| self.robot.policy_joint(i))
    }

    fn numbers<'py>(&self, py: Python<'py>, number: impl Fn(&Joint) -> f64) -> Bound<'py, PyArray1<f64>> {
        arrays::new(py, self.policy_joints().map(number))
    }

    fn motors<'py>(&self, py: Python<'py>, number: impl Fn(&Actuator) -> f64) -> Bound<'py, PyArray1<f64>> {
        self.numbers(py, |joint| joint.actuator.as_ref().map_or(f64::NAN, &number))
    }
}

#[pymethods]
impl Robot {
    /// The robot in the folder or URDF at `path`.
    #[new]
    fn new(path: &Bound<'_, PyAny>) -> PyResult<Self> {
        let path: PathBuf = taken(path, "path", "the path of a folder or a URDF")?;
        let robot = load::robot(&path).map_err(raise)?;
        Ok(Self { robot })
    }

    /// The robot's name.
    #[getter]
    fn name(&self) -> &str {
        &self.robot.name
    }

    /// Whether its base floats; otherwise it is bolted to the world.
    #[getter]
    fn floating(&self) -> bool {
        self.robot.base == Base::Floating
    }

    /// Mass, kg.
    #[getter]
    fn mass(&self) -> f64 {
        self.robot.mass()
    }

    /// Names of the joints the policy moves, in the order of every array.
    #[getter]
    fn joints(&self) -> Vec<&str> {
        self.policy_joints().map(|joint| joint.name.as_str()).collect()
    }

    /// Names of all moving joints.
    #[getter]
    fn all_joints(&self) -> Vec<&str> {
        self.robot.joints.iter().map(|joint| joint.name.as_str()).collect()
    }

    /// Names of the links.
    #[getter]
    fn links(&self) -> Vec<&str> {
        self.robot.links.iter().map(|link| link.name.as_str()).collect()
    }

    /// Names of the feet.
    #[getter]
    fn feet(&self) -> Vec<&str> {
        self.robot.feet.iter().map(|foot| foot.name.as_str()).collect()
    }

    /// What loading had to assume.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.robot.notes.clone()
    }

    /// Nominal pose, rad or m.
    #[getter]
    fn nominal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.numbers(py, |joint| joint.nominal)
    }

    /// Lower position limits, rad or m.
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.numbers(py, |joint| joint.limits.0)
    }

    /// Upper position limits, rad or m.
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.numbers(py, |joint| joint.limits.1)
    }

    /// Position gains, N m/rad or N/m.
    #[getter]
    fn kp<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.motors(py, |motor| motor.kp)
    }

    /// Velocity gains, N m s/rad or N s/m.
    #[getter]
    fn kd<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.motors(py, |motor| motor.kd)
    }

    /// Largest torques at standstill, N m or N.
    #[getter]
    fn torque_limit<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.motors(py, |motor| motor.torque_limit)
    }

    /// Everything that decides how it moves, in tables for people.
    fn describe(&self) -> String {
        describe(&self.robot)
    }

    fn __repr__(&self) -> String {
        format!(
            "Robot({}, {:.3} kg, {} joints moved by the policy)",
            self.robot.name,
            self.robot.mass(),
            self.robot.policy.len()
        )
    }
}
