//! From a robot to a rapier scene: bodies, multibody joints and couplings; `shapes` has the colliders.
//!
//! The scene is built once per batch and settled by a step of no length. Worlds start from clones of it, so that
//! nothing of an episode reaches the next and equal starts replay bit for bit.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

use super::convert;
use super::shapes::{self, Toucher};
use crate::engine::EngineError;
use crate::ground::Ground;
use crate::robot::{Base, Inertial, Joint, JointKind, Robot};

/// Mass (kg) and inertia (kg m^2) given to a link whose mass properties are zero: rapier stores inverses, so zero
/// would mean immovable. A millionth of the lightest link of a small humanoid: nothing moves measurably otherwise.
const TINY_MASS: f64 = 1e-6;
const TINY_INERTIA: f64 = 1e-8;

/// Height (m) at which the scene is settled: far from the ground, so that no contact is in it.
const LIMBO: f64 = 1e3;

/// The part of a rapier world that its future depends on.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct State {
    pub islands: IslandManager,
    pub broad_phase: BroadPhaseBvh,
    pub narrow_phase: NarrowPhase,
    pub bodies: RigidBodySet,
    pub colliders: ColliderSet,
    pub impulse_joints: ImpulseJointSet,
    pub multibodies: MultibodyJointSet,
}

/// A coordinate of the multibody that moves with a degree of freedom: its own joint, or a mimic joint.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coordinate {
    /// Index into `Robot::joints`; the joint's link is `joint + 1` in the robot and in the multibody.
    pub joint: usize,
    /// The coordinate's axis in rapier's six (x, y, z, about x, y, z).
    pub axis: usize,
    /// Index of its velocity in the multibody's generalized velocities.
    pub velocity: usize,
    /// `position = multiplier * position(degree of freedom) + offset`.
    pub multiplier: f64,
    pub offset: f64,
    /// Part of whatever acts on the degree of freedom that acts here; the parts of one degree of freedom sum to 1.
    pub share: f64,
}

impl Coordinate {
    /// This coordinate's part of a gain on the degree of freedom: a stiffness, damping or inertia.
    pub(super) fn gain(&self, gain: f64) -> f64 {
        if self.share == 0.0 {
            return 0.0;
        }
        gain * self.share / (self.multiplier * self.multiplier)
    }
}

/// A degree of freedom: the coordinates it moves, its own first.
#[derive(Clone, Debug)]
pub(super) struct Freedom {
    pub coordinates: Vec<Coordinate>,
    pub limits: (f64, f64),
}

/// What all worlds of a batch share.
pub(super) struct Scene {
    pub template: State,
    pub multibody: MultibodyIndex,
    /// Bodies of the links.
    pub bodies: Vec<RigidBodyHandle>,
    pub ground: ColliderHandle,
    pub surface: Ground,
    pub freedoms: Vec<Freedom>,
    pub touchers: Vec<Toucher>,
    /// For every foot its index in `touchers`; `None` for a foot without a collision shape.
    pub feet: Vec<Option<usize>>,
    pub base: Base,
    /// World pose of a fixed base.
    pub base_pose: Isometry3<f64>,
    pub joints: Vec<Joint>,
    /// Mass properties in the template.
    pub links: Vec<Inertial>,
    pub name: String,
}

impl Scene {
    pub(super) fn new(surface: &Ground, robot: &Robot) -> Result<Self, EngineError> {
        if robot.joints.is_empty() {
            return Err(EngineError::NoJoints {
                robot: robot.name.clone(),
            });
        }
        let floating = robot.base == Base::Floating;
        let mut state = State::empty();
        let ground = state.colliders.insert(shapes::ground(surface));
        let bodies: Vec<_> = (0..robot.links.len())
            .map(|link| state.add_body(robot, link, floating))
            .collect();
        for (j, joint) in robot.joints.iter().enumerate() {
            let mut data = joint_data(joint, &root_offset(robot.base, joint.parent, &robot.links[0].inertial));
            if let Some(d) = robot.dofs.iter().position(|&dof| dof == j) {
                let limits = &mut data.limits[axis(joint)];
                (limits.min, limits.max) = robot.limits(d);
            }
            state
                .multibodies
                .insert(bodies[joint.parent], bodies[j + 1], data, true);
        }
        let multibody = state
            .multibodies
            .rigid_body_link(bodies[0])
            .map(|link| link.multibody)
            .expect("a robot with joints is a multibody");
        let freedoms = freedoms(robot, if floating { 6 } else { 0 });
        let touchers = shapes::touchers(robot, &mut state, &bodies);
        let feet = robot
            .feet
            .iter()
            .map(|foot| touchers.iter().position(|toucher| toucher.link == foot.link))
            .collect();
        let mut scene = Self {
            template: state,
            multibody,
            bodies,
            ground,
            surface: surface.clone(),
            freedoms,
            touchers,
            feet,
            base: robot.base,
            base_pose: robot.base_pose,
            joints: robot.joints.clone(),
            links: robot.links.iter().map(|link| link.inertial).collect(),
            name: robot.name.clone(),
        };
        scene.settle();
        Ok(scene)
    }

    pub(super) fn floating(&self) -> bool {
        self.base == Base::Floating
    }

    /// Makes the template ready to be cloned: mass properties, coordinates of the joints, islands and events
    /// are in the state in which a step leaves them.
    fn settle(&mut self) {
        let Self { template, .. } = self;
        template
            .bodies
            .iter_mut()
            .for_each(|(_, body)| body.recompute_mass_properties_from_colliders(&template.colliders));
        let multibody = template
            .multibodies
            .get_multibody_mut(self.multibody)
            .expect("the scene's multibody");
        multibody.set_self_contacts_enabled(false);
        multibody.forward_kinematics(&template.bodies, true);
        multibody.damping_mut().fill(0.0);
        for freedom in &self.freedoms {
            let leader = freedom.coordinates[0];
            for follower in &freedom.coordinates[1..] {
                multibody.add_dof_coupling(MultibodyDofCoupling {
                    link1: leader.joint + 1,
                    dof1: 0,
                    axis1: leader.axis,
                    link2: follower.joint + 1,
                    dof2: 0,
                    axis2: follower.axis,
                    coeff: follower.multiplier,
                    offset: follower.offset,
                });
            }
        }
        multibody.update_rigid_bodies(&mut template.bodies, true);
        let parameters = IntegrationParameters {
            dt: 0.0,
            ..Default::default()
        };
        template.step(
            &mut PhysicsPipeline::new(),
            &mut CCDSolver::new(),
            &parameters,
            Vector::ZERO,
        );
    }
}

impl State {
    fn empty() -> Self {
        Self {
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::new(),
            narrow_phase: NarrowPhase::new(),
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            impulse_joints: ImpulseJointSet::new(),
            multibodies: MultibodyJointSet::new(),
        }
    }

    /// One step of rapier's pipeline.
    pub(super) fn step(
        &mut self,
        pipeline: &mut PhysicsPipeline,
        ccd: &mut CCDSolver,
        parameters: &IntegrationParameters,
        gravity: Vector,
    ) {
        pipeline.step(
            gravity,
            parameters,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibodies,
            &mut SoftBodySet::new(),
            ccd,
            &(),
            &(),
        );
    }

    fn add_body(&mut self, robot: &Robot, link: usize, floating: bool) -> RigidBodyHandle {
        let inertial = &robot.links[link].inertial;
        let builder = if link == 0 && !floating {
            RigidBodyBuilder::fixed()
        } else {
            RigidBodyBuilder::dynamic()
        };
        let com = if link == 0 { Vector3::zeros() } else { inertial.com };
        self.bodies.insert(
            builder
                .translation(Vector::new(0.0, 0.0, LIMBO))
                .can_sleep(false)
                .additional_mass_properties(mass_properties(inertial, &com)),
        )
    }
}

/// Offset of a link's body from the link's frame. rapier integrates a free root's translation as if the body's
/// origin were its centre of mass, so it has to be; all other bodies are where their links are.
pub(super) fn root_offset(base: Base, link: usize, inertial: &Inertial) -> Translation3<f64> {
    match base {
        Base::Floating if link == 0 => Translation3::from(inertial.com),
        _ => Translation3::identity(),
    }
}

/// Mass properties for rapier with the centre of mass at `com` in the body's frame.
///
/// The principal axes are found here. rapier's own search for them takes axes as arbitrary where moments differ by less than 1e-5
/// kg m^2, which turns the inertia of the links of a small robot; and its closed form is good to some 1e-8 of the moments only.
pub(super) fn mass_properties(inertial: &Inertial, com: &Vector3<f64>) -> MassProperties {
    let Inertial { mass, inertia, .. } = weighed(inertial);
    let eigen = inertia.symmetric_eigen();
    let mut axes = eigen.eigenvectors;
    if axes.determinant() < 0.0 {
        axes.column_mut(2).neg_mut();
    }
    let axes = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    // What rounding makes of a moment that is zero is none.
    let moments = eigen.eigenvalues.map(|moment| moment.max(0.0));
    MassProperties::with_principal_inertia_frame(
        convert::vector(com),
        mass,
        convert::vector(&moments),
        convert::rotation(&axes),
    )
}

/// The mass properties that rapier steps for a link: its own, or the least there can be.
pub fn weighed(inertial: &Inertial) -> Inertial {
    Inertial {
        mass: inertial.mass.max(TINY_MASS),
        com: inertial.com,
        inertia: if inertial.inertia.trace() > TINY_INERTIA {
            inertial.inertia
        } else {
            Matrix3::from_diagonal_element(TINY_INERTIA)
        },
    }
}

/// The pose of a joint in its parent's frame, turned so that the joint's axis is x.
pub(super) fn joint_frame(joint: &Joint) -> Isometry3<f64> {
    joint.origin * axis_frame(joint)
}

fn axis_frame(joint: &Joint) -> Isometry3<f64> {
    let to_axis = UnitQuaternion::rotation_between(&Vector3::x(), &joint.axis)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
    Isometry3::from_parts(Translation3::identity(), to_axis)
}

fn joint_data(joint: &Joint, parent_offset: &Translation3<f64>) -> GenericJoint {
    let locked = match joint.kind {
        JointKind::Revolute => JointAxesMask::LOCKED_REVOLUTE_AXES,
        JointKind::Prismatic => JointAxesMask::LOCKED_PRISMATIC_AXES,
    };
    GenericJointBuilder::new(locked)
        .local_frame1(convert::pose(&(parent_offset.inverse() * joint_frame(joint))))
        .local_frame2(convert::pose(&axis_frame(joint)))
        .contacts_enabled(false)
        .build()
}

fn axis(joint: &Joint) -> usize {
    match joint.kind {
        JointKind::Revolute => 3,
        JointKind::Prismatic => 0,
    }
}

fn freedoms(robot: &Robot, root_velocities: usize) -> Vec<Freedom> {
    let coordinate = |joint: usize, multiplier, offset| Coordinate {
        joint,
        axis: axis(&robot.joints[joint]),
        velocity: root_velocities + joint,
        multiplier,
        offset,
        share: 0.0,
    };
    let followers = |leader| {
        robot.joints.iter().enumerate().filter_map(move |(joint, data)| {
            let mimic = data.mimic.filter(|mimic| mimic.joint == leader)?;
            Some(coordinate(joint, mimic.multiplier, mimic.offset))
        })
    };
    let freedom = |(d, &leader): (usize, &usize)| {
        let own = coordinate(leader, 1.0, 0.0);
        let mut coordinates: Vec<_> = std::iter::once(own).chain(followers(leader)).collect();
        share_equally(&mut coordinates);
        Freedom {
            coordinates,
            limits: robot.limits(d),
        }
    };
    robot.dofs.iter().enumerate().map(freedom).collect()
}

/// A follower whose multiplier is zero does not move with its leader and takes no part.
fn share_equally(coordinates: &mut [Coordinate]) {
    let moving = coordinates.iter().filter(|c| c.multiplier != 0.0).count();
    for coordinate in coordinates.iter_mut().filter(|c| c.multiplier != 0.0) {
        coordinate.share = 1.0 / moving as f64;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Diagonalising and multiplying back rounds some ten times: 1e-13 of the largest moment. What the quaternion of the axes
        /// loses counts twice.
        #[test]
        fn rapier_has_the_inertia_of_a_link_however_small_and_round_it_is(
            scale in -8.0_f64..1.0, spread in -9.0_f64..0.0, shares in prop::array::uniform3(0.5_f64..1.0),
            turn in prop::array::uniform3(-3.0_f64..3.0),
        ) {
            // A sum of two moments is larger than the third: half and more of the largest each.
            let moments = Vector3::from(shares).map(|share| 10.0_f64.powf(scale) * (1.0 - 10.0_f64.powf(spread) * (1.0 - share)));
            let axes = UnitQuaternion::from_scaled_axis(Vector3::from(turn)).to_rotation_matrix();
            let inertia = axes.matrix() * Matrix3::from_diagonal(&moments) * axes.matrix().transpose();
            let inertia = 0.5 * (inertia + inertia.transpose());
            let inertial = Inertial { mass: 0.1, com: Vector3::zeros(), inertia };
            let found = mass_properties(&inertial, &Vector3::zeros()).reconstruct_inertia_matrix();
            let found = Matrix3::from_column_slice(&found.to_cols_array());
            prop_assume!(inertia.trace() > TINY_INERTIA);
            prop_assert!((found - inertia).abs().max() < 1e-13 * inertia.abs().max());
        }
    }
}
