//! Robots side by side in SIMD lanes: many worlds of one robot on one core.
//!
//! A vector register holds the same number of 16 (`f32`, AVX-512), 8 or 4 robots, and two registers work side by side.
//! The robots of such a group share the topology, so control flow is uniform, and differ in state, parameters, drives
//! and contacts. Every lane computes the same operations, but for those that would change no bit of any lane,
//! whatever the others hold, so a world's bits depend neither on its lane nor on its neighbours, and a world that has
//! gone non-finite stays alone.
//!
//! A step is: poses and bias forces (recursive Newton-Euler), mass matrix (composite rigid bodies), implicit drives
//! on the diagonal, sparse factorisation, Gauss-Seidel sweeps over contacts, drive clamps, dry friction and limits in
//! coordinates where all inertias are one, semi-implicit Euler.
//!
//! **`f32` or `f64`.** The longer a row of joints, the more the acceleration is the small difference of large numbers. Relative
//! to it, in random states rounding in `f32` makes an error of 1e-6 for a humanoid, 6e-5 for a branched tree of sixty joints, and
//! for light rods in one row 2e-4 with ten, 5e-3 with twenty and 0.08 with sixty; in `f64` it is 2e-10 at most (`tests/long.rs`).
//! `auto` takes `f32`. For an arm, a snake or a tail of many more than ten joints in a row set `engine.simd` to `f64x8`, or to
//! `f64x4` on a processor without AVX-512.
//!
//! The modules explain their part: `model` (tree, couplings, sparsity), `dynamics`, `factor`, `joint`, `contact`, `friction`,
//! `tilt` (ground that is no level plane), `one_joint` (a rig's servo).

mod contact;
mod count;
mod dynamics;
mod engine;
mod factor;
mod friction;
mod group;
mod joint;
mod kinematics;
mod lane;
mod model;
mod one_joint;
mod pair;
mod reset;
mod series;
mod spatial;
mod step;
#[cfg(test)]
mod tests;
mod tilt;
mod vector;
mod work;
#[cfg(target_arch = "x86_64")]
mod x86;

use nalgebra::{IsometryMatrix3, Vector3};

pub use contact::{DAMPING as CONTACT_DAMPING, STIFFNESS as CONTACT_STIFFNESS};

use super::{BaseState, Drive, Engine, EngineError, JointState, Phase, Start, World};
use crate::ground::Ground;
use crate::robot::Robot;
use engine::Batch;

/// The lane type: how many robots share a register, in which scalar; two registers are a group. Results depend on it, so
/// a run records it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Simd {
    /// Sixteen robots in `f32`; AVX-512.
    F32x16,
    /// Eight robots in `f32`; AVX2 and FMA.
    F32x8,
    /// Eight robots in `f64`; AVX-512.
    F64x8,
    /// Four robots in `f64`; AVX2 and FMA.
    F64x4,
    /// One robot at a time in `f64`; any processor.
    Scalar,
}

impl Simd {
    /// Every level, the fastest first.
    pub const ALL: [Self; 5] = [Self::F32x16, Self::F32x8, Self::F64x8, Self::F64x4, Self::Scalar];

    /// The fastest level this processor has.
    pub fn detect() -> Self {
        Self::ALL
            .into_iter()
            .find(|level| level.is_available())
            .unwrap_or(Self::Scalar)
    }

    /// Whether this processor has the instructions.
    pub fn is_available(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            let avx512 = avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512bw");
            match self {
                Self::F32x16 | Self::F64x8 => avx512,
                Self::F32x8 | Self::F64x4 => avx2,
                Self::Scalar => true,
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            self == Self::Scalar
        }
    }

    /// Robots in a group: two registers full. Batches of a multiple of it leave no lane idle.
    pub fn width(self) -> usize {
        match self {
            Self::F32x16 => 32,
            Self::F32x8 | Self::F64x8 => 16,
            Self::F64x4 => 8,
            Self::Scalar => 1,
        }
    }

    /// The name in configurations and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F32x16 => "f32x16",
            Self::F32x8 => "f32x8",
            Self::F64x8 => "f64x8",
            Self::F64x4 => "f64x4",
            Self::Scalar => "scalar",
        }
    }
}

/// A batch of worlds for one thread. For several threads make several batches: results do not depend on the split.
///
/// Until its first reset a world holds the robot at rest, without gravity.
pub struct Lanes {
    level: Simd,
    batch: Level,
}

/// One variant a lane type.
enum Level {
    #[cfg(target_arch = "x86_64")]
    F32x16(Box<Batch<x86::F32x16>>),
    #[cfg(target_arch = "x86_64")]
    F32x8(Box<Batch<x86::F32x8>>),
    #[cfg(target_arch = "x86_64")]
    F64x8(Box<Batch<x86::F64x8>>),
    #[cfg(target_arch = "x86_64")]
    F64x4(Box<Batch<x86::F64x4>>),
    Scalar(Box<Batch<lane::Single>>),
}

/// Calls the batch behind the level.
macro_rules! on {
    ($level:expr, $batch:ident => $call:expr) => {
        match $level {
            #[cfg(target_arch = "x86_64")]
            Level::F32x16($batch) => $call,
            #[cfg(target_arch = "x86_64")]
            Level::F32x8($batch) => $call,
            #[cfg(target_arch = "x86_64")]
            Level::F64x8($batch) => $call,
            #[cfg(target_arch = "x86_64")]
            Level::F64x4($batch) => $call,
            Level::Scalar($batch) => $call,
        }
    };
}

impl Lanes {
    /// `worlds` copies of `robot` on a level plane at a physics step of `dt` seconds.
    ///
    /// # Errors
    /// When `dt` is not a positive number or the processor lacks the instructions of `level`.
    pub fn new(robot: &Robot, dt: f64, worlds: usize, level: Simd) -> Result<Self, EngineError> {
        Self::on(&Ground::Plane, robot, dt, worlds, level)
    }

    /// The same on any ground.
    ///
    /// # Errors
    /// As [`Lanes::new`].
    pub fn on(ground: &Ground, robot: &Robot, dt: f64, worlds: usize, level: Simd) -> Result<Self, EngineError> {
        if !(dt.is_finite() && dt > 0.0) {
            return Err(EngineError::TimeStep { dt });
        }
        if !level.is_available() {
            return Err(EngineError::Simd { level });
        }
        let batch = match level {
            #[cfg(target_arch = "x86_64")]
            Simd::F32x16 => Level::F32x16(Box::new(Batch::new(ground, robot, dt, worlds))),
            #[cfg(target_arch = "x86_64")]
            Simd::F32x8 => Level::F32x8(Box::new(Batch::new(ground, robot, dt, worlds))),
            #[cfg(target_arch = "x86_64")]
            Simd::F64x8 => Level::F64x8(Box::new(Batch::new(ground, robot, dt, worlds))),
            #[cfg(target_arch = "x86_64")]
            Simd::F64x4 => Level::F64x4(Box::new(Batch::new(ground, robot, dt, worlds))),
            _ => Level::Scalar(Box::new(Batch::new(ground, robot, dt, worlds))),
        };
        Ok(Self { level, batch })
    }

    /// Makes the contacts as hard as a step that is `hardness` times shorter would allow: that many times [`CONTACT_DAMPING`], and its
    /// square times [`CONTACT_STIFFNESS`].
    pub fn harden(&mut self, hardness: f64) {
        on!(&mut self.batch, batch => batch.harden(hardness));
    }

    /// Velocities of all links of `world` after the last step or reset, in the order of `Robot::links`, world frame: of the link frame's
    /// origin, m/s, and turning, rad/s. They are the ones that the next step begins with.
    pub fn link_velocities(&mut self, world: usize) -> Vec<[Vector3<f64>; 2]> {
        on!(&mut self.batch, batch => batch.link_velocities(world))
    }

    /// The lane type.
    pub fn level(&self) -> Simd {
        self.level
    }
}

/// Floating-point operations that a step of all worlds of `engine`, lanes in `f32`, takes under `drive`, in the order of
/// [`Engine::phases`]: counted while the step is done with lanes that count (module `count`). The engine stays as it is.
///
/// # Errors
/// When `engine` is another one, or of lanes in `f64`.
pub fn operations(
    ground: &Ground,
    robot: &Robot,
    dt: f64,
    engine: &dyn Engine,
    drive: &Drive,
) -> Result<Vec<u64>, String> {
    let mut counting = Batch::<count::Counted>::new(ground, robot, dt, engine.worlds());
    let mut bytes = vec![];
    for world in 0..engine.worlds() {
        bytes.clear();
        engine.save(world, &mut bytes);
        counting.load(world, &bytes)?;
    }
    Ok(counting.operations(drive).to_vec())
}

impl Engine for Lanes {
    fn worlds(&self) -> usize {
        on!(&self.batch, batch => batch.worlds())
    }
    fn reset(&mut self, world: usize, start: &Start, model: &World) {
        on!(&mut self.batch, batch => batch.reset(world, start, model));
    }
    fn step(&mut self, drive: &Drive) {
        on!(&mut self.batch, batch => batch.step(drive));
    }
    fn joints(&self) -> &JointState {
        on!(&self.batch, batch => batch.joints())
    }
    fn base(&self, world: usize) -> BaseState {
        on!(&self.batch, batch => batch.base(world))
    }
    fn foot_force(&self, world: usize, foot: usize) -> Vector3<f64> {
        on!(&self.batch, batch => batch.foot_force(world, foot))
    }
    fn foot_loads(&self) -> &[f64] {
        on!(&self.batch, batch => batch.foot_loads())
    }
    fn link_poses(&mut self, links: &[usize], poses: &mut [IsometryMatrix3<f64>]) {
        on!(&mut self.batch, batch => batch.link_poses(links, poses));
    }
    fn time_phases(&mut self, running: bool) {
        on!(&mut self.batch, batch => batch.time_phases(running));
    }
    fn phases(&self) -> Vec<Phase> {
        on!(&self.batch, batch => batch.phases())
    }
    fn push(&mut self, world: usize, force: Vector3<f64>) {
        on!(&mut self.batch, batch => batch.push(world, force));
    }
    fn is_finite(&self, world: usize) -> bool {
        on!(&self.batch, batch => batch.is_finite(world))
    }
    fn save(&self, world: usize, bytes: &mut Vec<u8>) {
        on!(&self.batch, batch => batch.save(world, bytes));
    }
    fn load(&mut self, world: usize, bytes: &[u8]) -> Result<(), String> {
        on!(&mut self.batch, batch => batch.load(world, bytes))
    }
}
