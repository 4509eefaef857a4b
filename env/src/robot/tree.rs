//! The tree of moving links: fixed joints merged into their parents, parents before children.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use urdf_rs::{JointType, Pose};

use super::mass::Flaw;
use super::source::RobotError;
use super::urdf::Urdf;
use super::{Geometry, Inertial, JointKind, Link, Shape};

/// The moving links and joints of a URDF.
pub(super) struct Tree {
    /// `links[0]` is the base.
    pub links: Vec<Link>,
    /// `joints[i]` carries `links[i + 1]`.
    pub joints: Vec<TreeJoint>,
    /// The link each URDF link was merged into and its pose there; `None` for the world.
    pub frames: Vec<Option<(usize, Isometry3<f64>)>>,
    /// What was assumed.
    pub notes: Vec<String>,
}

/// A moving joint before its settings are applied.
pub(super) struct TreeJoint {
    /// Index of the joint in the URDF.
    pub urdf: usize,
    pub kind: JointKind,
    pub parent: usize,
    pub origin: Isometry3<f64>,
    pub axis: Unit<Vector3<f64>>,
}

impl Tree {
    /// Builds the tree from the URDF link `base` outward. `held` gives the position of each joint that does not move.
    pub fn new(urdf: &Urdf, base: usize, held: &[Option<f64>]) -> Result<Self, RobotError> {
        let frames = vec![None; urdf.robot.links.len()];
        let mut tree = Self {
            links: Vec::new(),
            joints: Vec::new(),
            frames,
            notes: Vec::new(),
        };
        let mut carried = vec![Vec::new(); urdf.robot.links.len()];
        for (joint, &(parent, _)) in urdf.ends.iter().enumerate().rev() {
            carried[parent].push(joint);
        }
        tree.push_link(urdf, base, None)?;
        let mut open = carried[base].clone();
        while let Some(joint) = open.pop() {
            let (parent, child) = urdf.ends[joint];
            let Some((link, pose)) = tree.frames[parent] else {
                continue;
            };
            let origin = pose * isometry(&urdf.robot.joints[joint].origin);
            match held[joint] {
                Some(position) => {
                    let (kind, axis) = (kind(urdf, joint), axis(urdf, joint));
                    tree.absorb(urdf, child, link, origin * motion(kind, &axis, position))?;
                }
                None => {
                    let (kind, axis) = (kind(urdf, joint), axis(urdf, joint));
                    tree.joints.push(TreeJoint {
                        urdf: joint,
                        kind,
                        parent: link,
                        origin,
                        axis,
                    });
                    tree.push_link(urdf, child, Some(link))?;
                }
            }
            open.extend(&carried[child]);
        }
        Ok(tree)
    }

    fn push_link(&mut self, urdf: &Urdf, link: usize, parent: Option<usize>) -> Result<(), RobotError> {
        let name = urdf.robot.links[link].name.clone();
        self.links.push(Link {
            name,
            parent,
            inertial: Inertial::MASSLESS,
            shapes: Vec::new(),
            visuals: Vec::new(),
            contact_points: Vec::new(),
        });
        self.absorb(urdf, link, self.links.len() - 1, Isometry3::identity())
    }

    /// Adds mass and shapes of the URDF link to the link `into`, in whose frame it has the pose `pose`.
    fn absorb(&mut self, urdf: &Urdf, link: usize, into: usize, pose: Isometry3<f64>) -> Result<(), RobotError> {
        self.frames[link] = Some((into, pose));
        let source = &urdf.robot.links[link];
        let inertial = inertial(&source.inertial);
        match inertial.flaw() {
            Some(Flaw::Impossible(what)) => {
                let help = "take mass and inertia from the CAD model, or from a solid of the same size and mass";
                return Err(urdf.link_error(link, format!("link `{}` has {what}", source.name), help));
            }
            Some(Flaw::Slight(what)) => self
                .notes
                .push(format!("link `{}` has {what}; used as it is", source.name)),
            None => {}
        }
        let inertial = inertial
            .transformed(&isometry(&source.inertial.origin))
            .transformed(&pose);
        let target = &mut self.links[into];
        target.inertial = target.inertial.combined(&inertial);
        let shown = |visual: &urdf_rs::Visual| {
            let geometry = geometry(&visual.geometry).filter(is_solid)?;
            let pose = pose * isometry(&visual.origin);
            Some(Shape { geometry, pose })
        };
        target.visuals.extend(source.visual.iter().filter_map(shown));
        for collision in &source.collision {
            let Some(geometry) = geometry(&collision.geometry) else {
                continue;
            };
            if !is_solid(&geometry) {
                let message = format!("link `{}` has a collision shape without size", source.name);
                return Err(urdf.link_error(link, message, "sizes, radii and lengths are above zero, m"));
            }
            target.shapes.push(Shape {
                geometry,
                pose: pose * isometry(&collision.origin),
            });
        }
        Ok(())
    }

    /// Notes which links have no primitive collision shape.
    pub fn note_shapeless(&mut self, urdf: &Urdf) {
        let mut names: Vec<&str> = Vec::new();
        for (link, frame) in urdf.robot.links.iter().zip(&self.frames) {
            let massive = link.inertial.mass.value > 0.0;
            if massive && frame.is_some() && !link.collision.iter().any(|c| geometry(&c.geometry).is_some()) {
                names.push(&link.name);
            }
        }
        if !names.is_empty() {
            let few = names.len().min(SHOWN);
            let more = match names.len() - few {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            let note = format!(
                "no collision shape (meshes are not read): {}{more}",
                names[..few].join(", ")
            );
            self.notes.push(note);
        }
    }
}

/// Links that a note names.
const SHOWN: usize = 4;

/// Pose of the child's frame after a joint at `position` (rad or m).
fn motion(kind: JointKind, axis: &Unit<Vector3<f64>>, position: f64) -> Isometry3<f64> {
    match kind {
        JointKind::Revolute => Isometry3::from_parts(
            Translation3::identity(),
            UnitQuaternion::from_axis_angle(axis, position),
        ),
        JointKind::Prismatic => Translation3::from(axis.into_inner() * position).into(),
    }
}

fn kind(urdf: &Urdf, joint: usize) -> JointKind {
    match urdf.robot.joints[joint].joint_type {
        JointType::Prismatic => JointKind::Prismatic,
        _ => JointKind::Revolute,
    }
}

/// Axis of a joint. Fixed joints may have any, even none, as they never move.
fn axis(urdf: &Urdf, joint: usize) -> Unit<Vector3<f64>> {
    let axis = Vector3::from(*urdf.robot.joints[joint].axis.xyz);
    Unit::try_new(axis, 1e-6).unwrap_or(Vector3::x_axis())
}

/// Pose from a URDF origin: fixed-axis roll, pitch, yaw.
pub(super) fn isometry(pose: &Pose) -> Isometry3<f64> {
    let [roll, pitch, yaw] = *pose.rpy;
    Isometry3::from_parts(
        Vector3::from(*pose.xyz).into(),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    )
}

/// Mass and inertia in the frame of the inertial's own origin.
fn inertial(inertial: &urdf_rs::Inertial) -> Inertial {
    let i = &inertial.inertia;
    let inertia = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    Inertial {
        mass: inertial.mass.value,
        com: Vector3::zeros(),
        inertia,
    }
}

fn geometry(geometry: &urdf_rs::Geometry) -> Option<Geometry> {
    Some(match geometry {
        urdf_rs::Geometry::Box { size } => Geometry::Box(Vector3::from(**size) / 2.0),
        urdf_rs::Geometry::Sphere { radius } => Geometry::Sphere(*radius),
        urdf_rs::Geometry::Cylinder { radius, length } => Geometry::Cylinder(*radius, length / 2.0),
        urdf_rs::Geometry::Capsule { radius, length } => Geometry::Capsule(*radius, length / 2.0),
        urdf_rs::Geometry::Mesh { .. } => return None,
    })
}

fn is_solid(geometry: &Geometry) -> bool {
    match geometry {
        Geometry::Box(half) => half.min() > 0.0,
        Geometry::Sphere(radius) => *radius > 0.0,
        Geometry::Cylinder(radius, half) | Geometry::Capsule(radius, half) => *radius > 0.0 && *half > 0.0,
    }
}

impl Shape {
    /// Points of the shape, in the link frame, among which is the lowest one whatever flat orientation the link
    /// has: corners, and for round ends the lowest point along the link's own z.
    pub(super) fn low_points(&self, down: &Vector3<f64>) -> Vec<Point3<f64>> {
        let signs = [-1.0, 1.0];
        let ends = |half: f64| signs.map(|s| self.pose * Point3::new(0.0, 0.0, s * half));
        match self.geometry {
            Geometry::Box(half) => {
                let corner = |x, y, z| self.pose * Point3::from(half.component_mul(&Vector3::new(x, y, z)));
                signs
                    .iter()
                    .flat_map(|&x| signs.iter().flat_map(move |&y| signs.map(|z| corner(x, y, z))))
                    .collect()
            }
            Geometry::Sphere(radius) => vec![self.pose * Point3::origin() + down * radius],
            Geometry::Capsule(radius, half) => ends(half).map(|end| end + down * radius).to_vec(),
            Geometry::Cylinder(radius, half) => {
                let axis = self.pose.rotation * Vector3::z();
                let radial = (down - axis * axis.dot(down)).try_normalize(1e-9).unwrap_or_default();
                ends(half).map(|end| end + radial * radius).to_vec()
            }
        }
    }
}
