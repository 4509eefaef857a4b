//! Scratch memory of a step, shared by the groups of a batch, and the clock that splits a step into phases.

use super::count;
use super::lane::Lane;
use super::model::Model;
use super::spatial::{Force, Inertia, Motion};
use super::tilt::Tilt;
use super::vector::{Mat3, Sym3, Vec3};
use crate::clock::Clock;
use crate::ground::Ground;

/// A link's pose (position relative to the base link's origin) and motion.
#[derive(Clone, Copy)]
pub struct LinkWork<L> {
    pub rotation: Mat3<L>,
    pub position: Vec3<L>,
    pub velocity: Motion<L>,
    /// Acceleration with the joints' and the base's set to zero, less gravity.
    pub acceleration: Motion<L>,
    /// Force that this acceleration takes, of the link and all below it.
    pub force: Force<L>,
    /// Inertia of the link and, after the inward pass, of all below it.
    pub inertia: Inertia<L>,
}

/// What a degree of freedom's drive, dry friction and limits need during the sweeps, see [`super::joint`].
#[derive(Clone, Copy)]
pub struct JointRow<L> {
    /// Velocity per unit of impulse at the joint, and its inverse.
    pub response: L,
    pub inverse_response: L,
    /// The drive's impulse before the clamp and what it loses per unit of velocity change; this and the next two pairs are
    /// multiplied by the extra impulse per difference between both once the response is known.
    pub wanted: L,
    pub wanted_slope: L,
    /// What the drive gives without `drive_extra`, likewise.
    pub held: L,
    pub held_slope: L,
    /// The clamp as impulses.
    pub drive_min: L,
    pub drive_max: L,
    /// What undoes that.
    pub inverse_gain: L,
    /// The drive's impulse beyond the held one.
    pub drive_extra: L,
    /// The velocity that dry friction can take; until the response is known its bound as impulse.
    pub friction_speed: L,
    /// Velocities that the limits allow.
    pub velocity_min: L,
    pub velocity_max: L,
}

/// A contact body during the sweeps.
pub struct BodyWork<L: Lane> {
    /// Whether any point of any lane may touch; a body that is not costs nothing.
    pub active: bool,
    /// Half-solved unit wrenches at the reference point, one row a degree of freedom of the path.
    pub columns: Vec<[L; 6]>,
    /// Twist at the reference point per unit of wrench there.
    pub response: [[L; 6]; 6],
    /// Turning velocity per unit of moment in scaled coordinates.
    pub turning: Sym3<L>,
    /// Twist at the reference point before the step.
    pub velocity: [L; 6],
    pub points: Vec<PointWork<L>>,
    /// The points' axes; empty on the level plane.
    pub tilts: Vec<Tilt<L>>,
}

/// A contact point during the sweeps.
#[derive(Clone, Copy)]
pub struct PointWork<L> {
    /// From the body's reference point, m.
    pub arm: Vec3<L>,
    /// Largest normal impulse: zero where the point is out of reach.
    pub normal_max: L,
    /// Velocity at which the normal impulse would vanish, negated.
    pub bias: L,
    /// Inverse of the normal row's response.
    pub normal_step: L,
    /// Slip in scaled coordinates per unit of normal impulse.
    pub coupling: [L; 5],
    /// Slip per unit of frictional impulse in scaled coordinates: sliding by sliding (xx, xy, yy), sliding along x and y by
    /// turning.
    pub sliding: [L; 3],
    pub mixed: [Vec3<L>; 2],
}

/// Scratch memory of a step.
pub struct Work<L: Lane> {
    pub links: Vec<LinkWork<L>>,
    pub subspaces: Vec<Motion<L>>,
    /// The packed mass matrix, then its factor.
    pub mass_matrix: Vec<L>,
    pub inverse_diagonal: Vec<L>,
    /// Generalised bias force.
    pub bias: Vec<L>,
    /// Inverse of the factor, packed like the mass matrix: its rows are the half-solved unit impulses of the degrees of freedom.
    pub inverse: Vec<L>,
    /// Generalised impulse, then half-solved, then the change of velocity.
    pub change: Vec<L>,
    pub rows: Vec<JointRow<L>>,
    pub bodies: Vec<BodyWork<L>>,
}

impl<L: Lane> Work<L> {
    pub fn new(model: &Model<L>) -> Self {
        let o = L::zero();
        let link = LinkWork {
            rotation: Mat3::identity(),
            position: Vec3::zero(),
            velocity: Motion::zero(),
            acceleration: Motion::zero(),
            force: Force::zero(),
            inertia: Inertia::zero(),
        };
        let row = JointRow {
            response: o,
            inverse_response: o,
            wanted: o,
            wanted_slope: o,
            held: o,
            held_slope: o,
            drive_min: o,
            drive_max: o,
            inverse_gain: o,
            drive_extra: o,
            friction_speed: o,
            velocity_min: o,
            velocity_max: o,
        };
        let point = PointWork {
            arm: Vec3::zero(),
            normal_max: o,
            bias: o,
            normal_step: o,
            coupling: [o; 5],
            sliding: [o; 3],
            mixed: [Vec3::zero(); 2],
        };
        let level = model.ground == Ground::Plane;
        let body = |body: &super::model::ContactBody<L>| BodyWork {
            active: false,
            columns: vec![[o; 6]; body.path.len()],
            response: [[o; 6]; 6],
            turning: Sym3::zero(),
            velocity: [o; 6],
            points: vec![point; body.points.len()],
            tilts: vec![Tilt::level(); if level { 0 } else { body.points.len() }],
        };
        Self {
            links: vec![link; model.links()],
            subspaces: vec![Motion::zero(); model.joints.len() + model.sums.len()],
            mass_matrix: vec![o; model.entries],
            inverse_diagonal: vec![o; model.dofs()],
            bias: vec![o; model.dofs()],
            inverse: vec![o; model.entries],
            change: vec![o; model.dofs()],
            rows: vec![row; model.limits.len()],
            bodies: model.bodies.iter().map(body).collect(),
        }
    }
}

/// Phases of a step in order: `links outward` are poses, velocities, inertias and forces of the links, `links inward` bias force,
/// mass matrix and drives.
pub const PHASES: [&str; 8] = [
    "links outward",
    "links inward",
    "factorisation",
    "contact setup",
    "joint setup",
    "contact sweeps",
    "joint sweeps",
    "finish",
];
pub const OUTWARD: usize = 0;
pub const INWARD: usize = 1;
pub const FACTORISATION: usize = 2;
pub const CONTACT_SETUP: usize = 3;
pub const JOINT_SETUP: usize = 4;
pub const CONTACT_SWEEPS: usize = 5;
pub const JOINT_SWEEPS: usize = 6;
pub const FINISH: usize = 7;

/// Wall time by phase, kept only when asked for, and operations by phase of lanes that count.
pub struct Timer {
    pub clock: Clock<{ PHASES.len() }>,
    pub operations: [u64; PHASES.len()],
    counted: u64,
}

impl Timer {
    pub fn new() -> Self {
        Self {
            clock: Clock::new(),
            operations: [0; PHASES.len()],
            counted: 0,
        }
    }

    #[inline(always)]
    pub fn begin<L: Lane>(&mut self) {
        self.clock.begin();
        if L::COUNTS {
            self.counted = count::done();
        }
    }

    /// Books what has happened since the last call on `phase`.
    #[inline(always)]
    pub fn lap<L: Lane>(&mut self, phase: usize) {
        self.clock.lap(phase);
        if L::COUNTS {
            let done = count::done();
            self.operations[phase] += done - self.counted;
            self.counted = done;
        }
    }
}
