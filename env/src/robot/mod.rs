//! The robot as every other module sees it: a tree of rigid links after fixed joints are merged, with
//! actuators, soles and a left-right mirror map.
//!
//! A robot is a folder (or a single URDF): the URDF gives links, joints, limits and mimic couplings, the TOML
//! everything a URDF cannot say. Units are SI and radians throughout; frames are the URDF's own.

mod controller;
mod describe;
mod effects;
mod feet;
mod joints;
mod kinematics;
mod limb;
mod load;
mod mass;
mod mirror;
mod ranges;
mod settings;
mod source;
mod tree;
mod urdf;
mod urdf_text;

pub use describe::describe;
pub use kinematics::Kinematics;
pub use limb::Limb;
pub use load::{files, load, load_with, massless_joints};
pub use ranges::{EffectRange, can_vary};
pub(crate) use settings::matches;
pub use source::{ContentError, RobotError, Source};

use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};

use crate::effect::Effect;

/// Height of the stand that robots are bolted to, m: feet hang free.
pub const STAND: f64 = 2.0;

/// How the base link is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// Six degrees of freedom: a humanoid standing on the ground.
    Floating,
    /// Bolted to the world at [`Robot::base_pose`]: an arm, a servo rig, a humanoid on a stand.
    Fixed,
}

/// A robot after loading and validation; nothing in it changes afterwards.
#[derive(Clone, Debug)]
pub struct Robot {
    /// The robot's name, from the URDF.
    pub name: String,
    /// Whether the base floats or is fixed to the world.
    pub base: Base,
    /// World pose of the base link's frame in the nominal pose: for a floating base the height at which the
    /// lowest contact point touches the plane z = 0.
    pub base_pose: Isometry3<f64>,
    /// Links after merging fixed joints. `links[0]` is the base and every parent precedes its children.
    pub links: Vec<Link>,
    /// Moving joints, mimic joints included. `joints[i]` carries `links[i + 1]`.
    pub joints: Vec<Joint>,
    /// The degrees of freedom beside the base's: indices into `joints` of those that are not mimic joints.
    /// "Degree of freedom d" everywhere means `joints[dofs[d]]`.
    pub dofs: Vec<usize>,
    /// The joints the policy moves, in the policy's order: indices into `dofs`. Actuated joints that are not
    /// among them hold their nominal position.
    pub policy: Vec<usize>,
    /// Feet, left first for a biped; empty for a robot that has none.
    pub feet: Vec<Foot>,
    /// Left-right mirror map of the policy's joints, if the robot has one.
    pub mirror: Option<Vec<MirroredJoint>>,
    /// Pairs of links whose geometric overlap ends an episode as `leg_overlap` (soles, shanks): indices into `links`.
    pub overlap_pairs: Vec<(usize, usize)>,
    /// Text of the URDF.
    pub urdf: String,
    /// What it does beyond the nominal model. Effects on bodies are in `links` already.
    pub effects: Vec<Effect>,
    /// What is known of its effects' values only to lie within bounds: environments draw it.
    pub ranges: Vec<EffectRange>,
    /// What loading had to assume: missing meshes, links without collision shape, defaults that were used.
    pub notes: Vec<String>,
}

/// A rigid link.
#[derive(Clone, Debug)]
pub struct Link {
    /// The URDF's name (the name of the outermost link where fixed joints were merged).
    pub name: String,
    /// Index of the parent link; `None` for the base.
    pub parent: Option<usize>,
    /// Mass, centre of mass and inertia.
    pub inertial: Inertial,
    /// Primitive collision shapes, posed in the link frame. Engines collide them with the ground only.
    pub shapes: Vec<Shape>,
    /// Primitives that show the link, posed in the link frame: for pictures only.
    pub visuals: Vec<Shape>,
    /// Points that collide with the ground in engines that use points (sole corners, and what the TOML names),
    /// in the link frame, m.
    pub contact_points: Vec<Point3<f64>>,
}

/// Mass properties of a link in the link's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertial {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the link frame, m.
    pub com: Vector3<f64>,
    /// Inertia about the centre of mass, axes parallel to the link frame, kg m^2.
    pub inertia: Matrix3<f64>,
}

/// A primitive collision shape in its link's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// The primitive.
    pub geometry: Geometry,
    /// Pose of the primitive's centre in the link frame.
    pub pose: Isometry3<f64>,
}

/// Primitive geometries, sizes in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Geometry {
    /// Half extents along x, y, z.
    Box(Vector3<f64>),
    /// Radius.
    Sphere(f64),
    /// Radius, and half the length along z without caps.
    Cylinder(f64, f64),
    /// Radius, and half the length along z without caps.
    Capsule(f64, f64),
}

/// Whether a joint turns (rad) or slides (m).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about its axis; positions in rad, efforts in N m.
    Revolute,
    /// Slides along its axis; positions in m, efforts in N.
    Prismatic,
}

/// A moving joint.
#[derive(Clone, Debug)]
pub struct Joint {
    /// The URDF's name.
    pub name: String,
    /// Turning or sliding.
    pub kind: JointKind,
    /// Link that carries the joint.
    pub parent: usize,
    /// Pose of the joint frame in the parent link's frame at position zero; the child link's frame at zero.
    pub origin: Isometry3<f64>,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Lower and upper position limit, rad or m; infinite for a joint without limits that the policy does not move.
    pub limits: (f64, f64),
    /// The coupling, for a joint that has no freedom of its own.
    pub mimic: Option<Mimic>,
    /// Position in the nominal pose, rad or m.
    pub nominal: f64,
    /// What does not depend on the command.
    pub passive: Passive,
    /// The motor; `None` for a passive joint.
    pub actuator: Option<Actuator>,
}

/// `position = multiplier * position(joint) + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mimic {
    /// Index into [`Robot::joints`] of the joint that is followed; never itself a mimic joint.
    pub joint: usize,
    /// Ratio.
    pub multiplier: f64,
    /// Offset, rad or m.
    pub offset: f64,
}

/// Passive joint dynamics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Passive {
    /// Reflected rotor inertia, kg m^2 (kg for a sliding joint).
    pub armature: f64,
    /// Viscous friction, N m s/rad (N s/m).
    pub damping: f64,
    /// Dry (Coulomb) friction, N m (N).
    pub friction: f64,
}

/// A position servo: `torque = kp_scale kp (target - q) - kd dq`, clamped by the torque-speed line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actuator {
    /// Position gain, N m/rad (N/m).
    pub kp: f64,
    /// Stiffness the joint really has over `kp`, the one that is set.
    pub kp_scale: f64,
    /// Velocity gain, N m s/rad (N s/m).
    pub kd: f64,
    /// Largest torque at standstill, N m (N).
    pub torque_limit: f64,
    /// Speed at which no torque is left in the direction of motion, rad/s (m/s).
    pub speed_limit: f64,
}

impl Actuator {
    /// Torque per position error, N m/rad (N/m).
    pub fn stiffness(&self) -> f64 {
        self.kp_scale * self.kp
    }
}

/// A foot and its flat sole.
#[derive(Clone, Debug)]
pub struct Foot {
    /// Name used in tables: `left`, `right`, or the link's name.
    pub name: String,
    /// Index of the foot's link.
    pub link: usize,
    /// Pose of the sole's centre in the link frame, z up out of the ground.
    pub sole: Isometry3<f64>,
    /// Half length (x) and half width (y) of the sole, m.
    pub half_extents: [f64; 2],
}

/// Where a policy joint's value comes from in the mirrored robot: `mirrored[i] = sign * original[joint]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirroredJoint {
    /// Index into the policy's joints.
    pub joint: usize,
    /// +1 or -1.
    pub sign: f64,
}

impl Foot {
    /// The sole's four corners in the link frame, m.
    pub fn corners(&self) -> [Point3<f64>; 4] {
        let [x, y] = self.half_extents;
        [(x, y), (x, -y), (-x, y), (-x, -y)].map(|(x, y)| self.sole * Point3::new(x, y, 0.0))
    }

    /// The sole as a collision shape for a link that has none: a box of a centimetre above it, in the link frame.
    fn slab(&self) -> Shape {
        let half = Vector3::new(self.half_extents[0], self.half_extents[1], 0.005);
        Shape {
            geometry: Geometry::Box(half),
            pose: self.sole * Isometry3::translation(0.0, 0.0, half.z),
        }
    }
}

impl Robot {
    /// The mirror map as the controller takes it.
    pub fn mirror_map(&self) -> Option<Vec<omniwalk_controller::MirroredJoint>> {
        let single = |twin: &MirroredJoint| omniwalk_controller::MirroredJoint {
            joint: twin.joint as u16,
            sign: twin.sign as f32,
        };
        self.mirror.as_ref().map(|map| map.iter().map(single).collect())
    }

    /// The robot with its base bolted to a stand, upright, [`STAND`] above the ground.
    pub fn on_a_stand(&self) -> Self {
        Self {
            base: Base::Fixed,
            base_pose: Vector3::new(0.0, 0.0, STAND).into(),
            ..self.clone()
        }
    }

    /// The robot without the effects that its actuators run: what an engine itself moves.
    pub fn rigid(&self) -> Self {
        let mut robot = self.clone();
        robot.effects.retain(|effect| !effect.kind.runs());
        robot
    }

    /// The joint behind degree of freedom `d`.
    pub fn dof(&self, d: usize) -> &Joint {
        &self.joints[self.dofs[d]]
    }

    /// Position limits of degree of freedom `d`, rad or m: its joint's, tightened by those of the joints that follow it.
    pub fn limits(&self, d: usize) -> (f64, f64) {
        let leader = self.dofs[d];
        let mut limits = self.joints[leader].limits;
        for joint in &self.joints {
            let Some(mimic) = joint.mimic.filter(|m| m.joint == leader && m.multiplier != 0.0) else {
                continue;
            };
            let at = |limit: f64| (limit - mimic.offset) / mimic.multiplier;
            let (a, b) = (at(joint.limits.0), at(joint.limits.1));
            limits = (limits.0.max(a.min(b)), limits.1.min(a.max(b)));
        }
        limits
    }

    /// The joint behind the policy's joint `i`.
    pub fn policy_joint(&self, i: usize) -> &Joint {
        self.dof(self.policy[i])
    }

    /// Total mass, kg.
    pub fn mass(&self) -> f64 {
        self.links.iter().map(|link| link.inertial.mass).sum()
    }

    /// Degree of freedom, multiplier and offset behind each joint: `position = multiplier * q[dof] + offset`.
    pub fn drivers(&self) -> Vec<(usize, f64, f64)> {
        let dof = |joint| self.dofs.iter().position(|&other| other == joint).unwrap_or_default();
        let driver = |(index, joint): (usize, &Joint)| match joint.mimic {
            Some(mimic) => (dof(mimic.joint), mimic.multiplier, mimic.offset),
            None => (dof(index), 1.0, 0.0),
        };
        self.joints.iter().enumerate().map(driver).collect()
    }

    /// Nominal positions of the degrees of freedom, rad or m.
    pub fn nominal(&self) -> Vec<f64> {
        (0..self.dofs.len()).map(|d| self.dof(d).nominal).collect()
    }
}
