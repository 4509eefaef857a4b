//! The worlds of one SIMD vector: what determines their future.

use super::lane::{Lane, MAX_WIDTH};
use super::model::Model;
use super::one_joint::OneJoint;
use super::spatial::Motion;
use super::vector::{Quaternion, Sym3, Vec3};

/// Coordinates, velocities and the impulses that warm-start the next step.
pub struct State<L: Lane> {
    /// Position of the base link, m. In `f64` so that slow motion far from the origin is not rounded away.
    pub position: [[f64; MAX_WIDTH]; 3],
    pub orientation: Quaternion<L>,
    /// Velocity of the base link's origin and angular velocity, world frame.
    pub velocity: Motion<L>,
    pub joint_position: Vec<L>,
    pub joint_velocity: Vec<L>,
    /// Impulse of dry friction and limits per degree of freedom, N m s or N s.
    pub joint_impulse: Vec<L>,
    pub contacts: Vec<ContactImpulse<L>>,
    /// Drive torque of the last step, N m or N.
    pub torque: Vec<L>,
    /// Ground force on each contact body in the last step, N.
    pub ground_force: Vec<Vec3<L>>,
    /// 1 once a velocity has left all physical bounds, else 0.
    pub broken: L,
}

/// The impulse of a contact point.
#[derive(Clone, Copy)]
pub struct ContactImpulse<L> {
    /// Along the normal, N s.
    pub normal: L,
    /// The frictional components divided by their coefficients, N s: along x and y, rolling about x and y, torsion.
    pub friction: [L; 5],
}

/// Physical parameters of the worlds.
pub struct Parameters<L: Lane> {
    pub links: Vec<LinkInertia<L>>,
    /// Per degree of freedom, mimic joints included.
    pub armature: Vec<L>,
    pub damping: Vec<L>,
    /// Tangential, torsional and rolling friction.
    pub friction: [L; 3],
    pub gravity: Vec3<L>,
    /// Force on the base link's origin, N.
    pub push: Vec3<L>,
}

/// Mass properties in the link frame.
#[derive(Clone, Copy)]
pub struct LinkInertia<L> {
    pub mass: L,
    pub com: Vec3<L>,
    pub about_com: Sym3<L>,
}

/// A degree of freedom's [`crate::engine::Drive`] during one step.
#[derive(Clone, Copy)]
pub struct JointDrive<L> {
    pub target: L,
    pub stiffness: L,
    pub damping: L,
    pub feed_forward: L,
    pub torque_min: L,
    pub torque_max: L,
    pub friction: L,
}

/// The worlds of one vector.
pub struct Group<L: Lane> {
    pub state: State<L>,
    pub parameters: Parameters<L>,
    pub drive: Vec<JointDrive<L>>,
    /// Of a robot of one joint; none until the first step with these parameters.
    pub one_joint: Option<OneJoint<L>>,
}

/// All lanes of a group's state and parameters in a fixed order, by `iter` or `iter_mut`.
macro_rules! lanes {
    ($group:expr, $iter:ident $(, $mutable:tt)?) => {{
        let Group { state, parameters, .. } = $group;
        let scalars = [
            &$($mutable)? state.orientation.w,
            &$($mutable)? state.orientation.x,
            &$($mutable)? state.orientation.y,
            &$($mutable)? state.orientation.z,
            &$($mutable)? state.broken,
        ];
        let vectors = [
            &$($mutable)? state.velocity.linear,
            &$($mutable)? state.velocity.angular,
            &$($mutable)? parameters.gravity,
            &$($mutable)? parameters.push,
        ];
        scalars
            .into_iter()
            .chain(state.joint_position.$iter())
            .chain(state.joint_velocity.$iter())
            .chain(state.joint_impulse.$iter())
            .chain(state.torque.$iter())
            .chain(state.contacts.$iter().flat_map(|c| [&$($mutable)? c.normal].into_iter().chain(c.friction.$iter())))
            .chain(parameters.armature.$iter())
            .chain(parameters.damping.$iter())
            .chain(parameters.friction.$iter())
            .chain(
                vectors
                    .into_iter()
                    .chain(state.ground_force.$iter())
                    .flat_map(|v| [&$($mutable)? v.x, &$($mutable)? v.y, &$($mutable)? v.z]),
            )
            .chain(parameters.links.$iter().flat_map(|LinkInertia { mass, com, about_com }| {
                let Sym3 { xx, xy, xz, yy, yz, zz } = about_com;
                [mass, &$($mutable)? com.x, &$($mutable)? com.y, &$($mutable)? com.z, xx, xy, xz, yy, yz, zz]
            }))
    }};
}

impl<L: Lane> Group<L> {
    /// Worlds without mass, motion or impulse; every lane is to be reset before the first step.
    pub fn new(model: &Model<L>) -> Self {
        let dofs = model.limits.len();
        let zeros = || vec![L::zero(); dofs];
        let o = L::zero();
        let idle = JointDrive {
            target: o,
            stiffness: o,
            damping: o,
            feed_forward: o,
            torque_min: o,
            torque_max: o,
            friction: o,
        };
        Self {
            state: State {
                position: [[0.0; MAX_WIDTH]; 3],
                orientation: Quaternion::identity(),
                velocity: Motion::zero(),
                joint_position: zeros(),
                joint_velocity: zeros(),
                joint_impulse: zeros(),
                contacts: vec![
                    ContactImpulse {
                        normal: o,
                        friction: [o; 5]
                    };
                    model.points
                ],
                torque: zeros(),
                ground_force: vec![Vec3::zero(); model.bodies.len()],
                broken: o,
            },
            parameters: Parameters {
                links: vec![
                    LinkInertia {
                        mass: o,
                        com: Vec3::zero(),
                        about_com: Sym3::zero(),
                    };
                    model.links()
                ],
                armature: zeros(),
                damping: zeros(),
                friction: [o; 3],
                gravity: Vec3::zero(),
                push: Vec3::zero(),
            },
            drive: vec![idle; dofs],
            one_joint: None,
        }
    }

    /// All numbers of a lane but the base position, in a fixed order.
    pub fn lanes(&self) -> impl Iterator<Item = &L> {
        lanes!(self, iter)
    }

    /// See [`Group::lanes`]; parameters may change.
    pub fn lanes_mut(&mut self) -> impl Iterator<Item = &mut L> {
        self.one_joint = None;
        lanes!(self, iter_mut, mut)
    }
}
