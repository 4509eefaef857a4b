//! One world of a batch: its episode's parameters, one step, and what it shows.

use nalgebra::{Isometry3, Translation3, Vector3};
use rapier3d_f64::prelude::*;

use super::contact::{self, GroundForce, Stick, Touch};
use super::convert;
use super::drive::{Applied, Command, Memory};
use super::inertia::{self, Turning};
use super::scene::{self, Scene, State};
use crate::engine::{BaseState, Friction, MAX_SPEED, Start, World};

/// Gauss-Seidel sweeps per step. With 4 a walking robot's loaded soles slip a tenth more than with 20 and bounce a
/// little at touchdown; only 4 and 20 were compared, and 10 lies between. Dry friction's rows start cold and need no more.
const SWEEPS: usize = 10;

/// Contacts are made this early (m): what a sole corner may move in a step of 5 ms at 2 m/s.
const PREDICTION: f64 = 0.01;
/// Penetration that is left alone, m: contacts that hold are neither lost nor pushed out.
const SLOP: f64 = 5e-4;

/// A world of one robot.
pub(super) struct Lane {
    pub state: State,
    pub gravity: Vector3<f64>,
    pub friction: Friction,
    pub push: Vector3<f64>,
    /// Pose of the base link's frame in the root body's.
    pub base_offset: Isometry3<f64>,
    /// One per degree of freedom.
    pub memory: Vec<Memory>,
    /// Velocities and torques of the degrees of freedom after the last step.
    pub joints: Vec<JointNow>,
    /// One per toucher of the scene.
    pub forces: Vec<GroundForce>,
    /// Torsional and rolling friction of each toucher.
    pub sticks: Vec<Stick>,
    /// Inertia each toucher's link feels about the vertical, in the pose of the reset, kg m^2.
    pub inertias: Vec<Turning>,
    /// False once the world has left the physically possible; it then stands still until it is reset.
    pub alive: bool,
    applied: Vec<Applied>,
    pipeline: PhysicsPipeline,
    ccd: CCDSolver,
}

/// A degree of freedom after the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct JointNow {
    pub position: f64,
    pub velocity: f64,
    pub torque: f64,
}

/// rapier's settings for a step of `dt`.
pub(super) fn parameters(dt: f64) -> IntegrationParameters {
    IntegrationParameters {
        dt,
        num_solver_iterations: 1,
        num_internal_pgs_iterations: SWEEPS,
        max_ccd_substeps: 0,
        contact_recycling: false,
        contact_clustering: false,
        normalized_prediction_distance: PREDICTION,
        normalized_allowed_linear_error: SLOP,
        friction_model: FrictionModel::Coulomb,
        ..Default::default()
    }
}

impl Lane {
    /// A world that waits for its first reset.
    pub(super) fn new(scene: &Scene) -> Self {
        Self {
            state: scene.template.clone(),
            gravity: Vector3::zeros(),
            friction: Friction {
                tangential: 0.0,
                torsional: 0.0,
                rolling: 0.0,
            },
            push: Vector3::zeros(),
            base_offset: Isometry3::identity(),
            memory: vec![Memory::default(); scene.freedoms.len()],
            joints: vec![JointNow::default(); scene.freedoms.len()],
            forces: vec![GroundForce::default(); scene.touchers.len()],
            sticks: vec![Stick::default(); scene.touchers.len()],
            inertias: vec![Turning::default(); scene.touchers.len()],
            alive: false,
            applied: vec![Applied::default(); scene.freedoms.len()],
            pipeline: PhysicsPipeline::new(),
            ccd: CCDSolver::new(),
        }
    }

    pub(super) fn reset(&mut self, scene: &Scene, start: &Start, model: &World) {
        self.state.clone_from(&scene.template);
        self.pipeline = PhysicsPipeline::new();
        self.gravity = model.gravity;
        self.friction = model.friction;
        self.push = Vector3::zeros();
        self.forces.fill(GroundForce::default());
        self.sticks.fill(Stick::default());
        let offset = scene::root_offset(scene.base, 0, &model.links[0]);
        self.base_offset = Isometry3::from(offset.inverse());
        self.set_masses(scene, model);
        self.set_friction(scene);
        self.set_passive(scene, model);
        self.place(scene, start, &offset);
        let inertias = inertia::effective(scene, &self.state);
        for (d, freedom) in scene.freedoms.iter().enumerate() {
            let own = freedom.coordinates.iter();
            let viscous = own.map(|c| c.multiplier * c.multiplier * model.joints[c.joint].damping);
            self.memory[d] = Memory {
                inertia: inertias.freedoms[d],
                viscous: viscous.sum(),
                load: 0.0,
            };
            self.joints[d].torque = 0.0;
        }
        self.inertias = inertias.touchers;
        self.alive = self.look(scene);
    }

    fn set_masses(&mut self, scene: &Scene, model: &World) {
        for (link, (&body, inertial)) in scene.bodies.iter().zip(&model.links).enumerate() {
            if *inertial == scene.links[link] {
                continue;
            }
            let com = if link == 0 { Vector3::zeros() } else { inertial.com };
            let body = &mut self.state.bodies[body];
            body.set_additional_mass_properties(scene::mass_properties(inertial, &com), false);
            body.recompute_mass_properties_from_colliders(&self.state.colliders);
        }
        if scene.floating() && model.links[0].com != scene.links[0].com {
            self.move_root_origin(scene);
        }
    }

    /// Re-poses everything fixed in the root body for another centre of mass.
    fn move_root_origin(&mut self, scene: &Scene) {
        let multibody = self
            .state
            .multibodies
            .get_multibody_mut(scene.multibody)
            .expect("multibody");
        for (j, joint) in scene.joints.iter().enumerate().filter(|(_, joint)| joint.parent == 0) {
            let link = multibody.link_mut(j + 1).expect("link of joint");
            link.joint.data.local_frame1 = convert::pose(&(self.base_offset * scene::joint_frame(joint)));
        }
        for toucher in scene.touchers.iter().filter(|toucher| toucher.link == 0) {
            for (&collider, pose) in toucher.colliders.iter().zip(&toucher.poses) {
                let pose = convert::pose(&(self.base_offset * pose));
                self.state.colliders[collider].set_position_wrt_parent(pose);
            }
        }
    }

    fn set_friction(&mut self, scene: &Scene) {
        let touching = scene.touchers.iter().flat_map(|toucher| &toucher.colliders);
        for &collider in touching.chain([&scene.ground]) {
            self.state.colliders[collider].set_friction(self.friction.tangential);
        }
    }

    /// Armature of every coordinate. What a degree of freedom has is
    /// shared among the coordinates that move with it: the sum is the same as long as they do move together,
    /// while each of them alone is stiffer and heavier, which the solver's sweeps need.
    fn set_passive(&mut self, scene: &Scene, model: &World) {
        let multibody = self
            .state
            .multibodies
            .get_multibody_mut(scene.multibody)
            .expect("multibody");
        for freedom in &scene.freedoms {
            let own = model.joints[freedom.coordinates[0].joint].armature;
            for (i, coordinate) in freedom.coordinates.iter().enumerate() {
                let extra = if i == 0 {
                    0.0
                } else {
                    model.joints[coordinate.joint].armature
                };
                multibody.armature_mut()[coordinate.velocity] = extra + coordinate.gain(own);
            }
        }
    }

    fn place(&mut self, scene: &Scene, start: &Start, offset: &Translation3<f64>) {
        let State {
            bodies, multibodies, ..
        } = &mut self.state;
        let multibody = multibodies.get_multibody_mut(scene.multibody).expect("multibody");
        let base = if scene.floating() {
            Isometry3::from_parts(Translation3::from(start.position), start.orientation)
        } else {
            scene.base_pose
        };
        bodies[scene.bodies[0]].set_position(convert::pose(&(base * offset)), false);
        let mut displacements = vec![0.0; multibody.ndofs()];
        let mut velocities = vec![0.0; multibody.ndofs()];
        if scene.floating() {
            let arm = start.orientation * offset.vector;
            let linear = start.linear_velocity + start.angular_velocity.cross(&arm);
            velocities[..3].copy_from_slice(linear.as_slice());
            velocities[3..6].copy_from_slice(start.angular_velocity.as_slice());
        }
        for (d, freedom) in scene.freedoms.iter().enumerate() {
            for c in &freedom.coordinates {
                displacements[c.velocity] = c.multiplier * start.joints[d] + c.offset;
                velocities[c.velocity] = c.multiplier * start.joint_velocities[d];
            }
        }
        multibody.apply_displacements(&displacements);
        multibody.generalized_velocity_mut().copy_from_slice(&velocities);
        multibody.forward_kinematics(bodies, true);
        for (link, &body) in scene.bodies.iter().enumerate() {
            let pose = *multibody.link(link).expect("link").local_to_world();
            bodies[body].set_position(pose, false);
        }
        multibody.update_rigid_bodies(bodies, true);
    }

    /// One step under one command and one dry friction per degree of freedom.
    pub(super) fn step(&mut self, scene: &Scene, dt: f64, drive: impl Fn(usize) -> (Command, f64)) {
        if !self.alive {
            return;
        }
        for d in 0..scene.freedoms.len() {
            let (command, friction) = drive(d);
            let JointNow { position, velocity, .. } = self.joints[d];
            self.applied[d] = Applied::new(&command, &self.memory[d], position, velocity, dt);
            self.alive &= self.applied[d].is_finite() && friction.is_finite();
            self.apply(scene, d, friction);
        }
        self.alive &= self.push.iter().all(|f| f.is_finite());
        if !self.alive {
            return;
        }
        self.push_and_brake(scene, dt);
        let gravity = convert::vector(&self.gravity);
        self.state
            .step(&mut self.pipeline, &mut self.ccd, &parameters(dt), gravity);
        for (force, toucher) in self.forces.iter_mut().zip(&scene.touchers) {
            *force = contact::ground_force(&self.state, toucher, dt);
        }
        self.alive = self.pipeline.quarantine().is_empty() && self.observe(scene, dt);
    }

    fn apply(&mut self, scene: &Scene, d: usize, friction: f64) {
        let freedom = &scene.freedoms[d];
        let applied = self.applied[d];
        let multibody = self
            .state
            .multibodies
            .get_multibody_mut_internal(scene.multibody)
            .expect("multibody");
        for c in &freedom.coordinates {
            multibody.damping_mut()[c.velocity] = c.gain(applied.damping);
            let joint = &mut multibody.link_mut(c.joint + 1).expect("link of joint").joint;
            joint.set_spring(
                c.axis,
                c.gain(applied.stiffness),
                c.multiplier * applied.rest + c.offset,
            );
        }
        let own = freedom.coordinates[0];
        multibody.frictions_mut()[own.velocity] = friction;
        let joint = &mut multibody.link_mut(own.joint + 1).expect("link of joint").joint;
        let position = self.joints[d].position;
        // rapier's limit rows do nothing within the limits but cost a solve with the mass matrix each.
        let beyond = position < freedom.limits.0 || position > freedom.limits.1;
        joint.data.limit_axes = if beyond {
            JointAxesMask::from_bits_truncate(1 << own.axis)
        } else {
            JointAxesMask::empty()
        };
    }

    fn push_and_brake(&mut self, scene: &Scene, dt: f64) {
        let root = scene.bodies[0];
        let multibody = self
            .state
            .multibodies
            .get_multibody(scene.multibody)
            .expect("multibody");
        let body = &mut self.state.bodies[root];
        body.reset_forces(false);
        body.reset_torques(false);
        let origin = (body.position() * convert::pose(&self.base_offset)).translation;
        body.add_force_at_point(convert::vector(&self.push), origin, false);
        let sticking = self.sticks.iter_mut().zip(&self.inertias);
        for ((toucher, force), (stick, inertia)) in scene.touchers.iter().zip(&self.forces).zip(sticking) {
            let jacobian = multibody.body_jacobian(toucher.link);
            let angular_velocity = jacobian.fixed_rows::<3>(3) * multibody.generalized_velocity();
            let body = &mut self.state.bodies[scene.bodies[toucher.link]];
            if toucher.link != 0 {
                body.reset_torques(false);
            }
            let place = body.position().translation;
            let touch = Touch {
                friction: &self.friction,
                force,
                normal: scene.surface.at(place.x, place.y).normal(),
            };
            let torque = stick.torque(&angular_velocity, inertia, &touch, dt);
            body.add_torque(convert::vector(&torque), false);
        }
    }

    /// Takes over what the step did to the joints; false, and nothing is taken over, if it is impossible.
    fn observe(&mut self, scene: &Scene, dt: f64) -> bool {
        for d in 0..scene.freedoms.len() {
            let before = self.joints[d].velocity;
            let after = self.coordinate(scene, d).velocity;
            let torque = self.applied[d].torque(before, after);
            self.memory[d].observe(before, after, torque, dt);
            self.joints[d].torque = torque;
        }
        self.look(scene)
    }

    /// Reads the joints; false if anything in the world is beyond physical bounds.
    fn look(&mut self, scene: &Scene) -> bool {
        for d in 0..scene.freedoms.len() {
            let JointNow { position, velocity, .. } = self.coordinate(scene, d);
            self.joints[d].position = position;
            self.joints[d].velocity = velocity;
        }
        let base = self.base(scene);
        let joints = self
            .joints
            .iter()
            .all(|j| j.position.is_finite() && j.velocity.abs() < MAX_SPEED && j.torque.is_finite());
        joints
            && base.position.norm().is_finite()
            && base.linear_velocity.amax() < MAX_SPEED
            && base.angular_velocity.amax() < MAX_SPEED
    }

    fn coordinate(&self, scene: &Scene, d: usize) -> JointNow {
        let multibody = self
            .state
            .multibodies
            .get_multibody(scene.multibody)
            .expect("multibody");
        let own = scene.freedoms[d].coordinates[0];
        let joint = multibody.link(own.joint + 1).expect("link of joint").joint();
        JointNow {
            position: joint.coords()[own.axis],
            velocity: multibody.generalized_velocity()[own.velocity],
            torque: 0.0,
        }
    }

    pub(super) fn link_pose(&self, scene: &Scene, link: usize) -> Isometry3<f64> {
        let pose = convert::from_pose(self.state.bodies[scene.bodies[link]].position());
        if link == 0 { pose * self.base_offset } else { pose }
    }

    pub(super) fn base(&self, scene: &Scene) -> BaseState {
        let pose = self.link_pose(scene, 0);
        let mut base = BaseState {
            position: pose.translation.vector,
            orientation: pose.rotation,
            linear_velocity: Vector3::zeros(),
            angular_velocity: Vector3::zeros(),
        };
        if scene.floating() {
            let multibody = self
                .state
                .multibodies
                .get_multibody(scene.multibody)
                .expect("multibody");
            let velocity = multibody.generalized_velocity();
            let arm = pose.rotation * self.base_offset.translation.vector;
            base.angular_velocity = velocity.fixed_rows::<3>(3).into_owned();
            base.linear_velocity = velocity.fixed_rows::<3>(0) + base.angular_velocity.cross(&arm);
        }
        base
    }

    /// Goes on from `state`.
    pub(super) fn restore(&mut self, state: State) {
        self.state = state;
        self.pipeline = PhysicsPipeline::new();
        self.ccd = CCDSolver::new();
    }
}
