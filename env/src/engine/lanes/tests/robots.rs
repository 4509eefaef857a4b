//! Robots made in code.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::robot::{Actuator, Base, Foot, Inertial, Joint, JointKind, Link, Mimic, Passive, Robot};

pub fn link(parent: Option<usize>, mass: f64, com: [f64; 3], size: [f64; 3]) -> Link {
    let [x, y, z] = size.map(|s| s * s);
    let inertia = Matrix3::from_diagonal(&Vector3::new(y + z, x + z, x + y)) * (mass / 12.0);
    Link {
        name: String::new(),
        parent,
        inertial: Inertial {
            mass,
            com: com.into(),
            inertia,
        },
        shapes: vec![],
        visuals: vec![],
        contact_points: vec![],
    }
}

pub fn joint(parent: usize, at: [f64; 3], axis: [f64; 3], kind: JointKind) -> Joint {
    Joint {
        name: String::new(),
        kind,
        parent,
        origin: Isometry3::translation(at[0], at[1], at[2]),
        axis: Unit::new_normalize(axis.into()),
        limits: (f64::NEG_INFINITY, f64::INFINITY),
        mimic: None,
        nominal: 0.0,
        passive: Passive::default(),
        actuator: None,
    }
}

pub fn robot(base: Base, links: Vec<Link>, joints: Vec<Joint>) -> Robot {
    let dofs = (0..joints.len()).filter(|&j| joints[j].mimic.is_none()).collect();
    Robot {
        name: "test".into(),
        base,
        base_pose: Isometry3::identity(),
        links,
        joints,
        dofs,
        policy: vec![],
        feet: vec![],
        mirror: None,
        overlap_pairs: vec![],
        urdf: String::new(),
        effects: Vec::new(),
        ranges: Vec::new(),
        notes: vec![],
    }
}

/// A rod of 1 kg and 1 m that turns about y at its end, on a fixed base.
pub fn pendulum() -> Robot {
    let rod = link(Some(0), 1.0, [0.0, 0.0, -0.5], [0.02, 0.02, 1.0]);
    robot(
        Base::Fixed,
        vec![link(None, 1.0, [0.0; 3], [0.1; 3]), rod],
        vec![joint(0, [0.0; 3], [0.0, 1.0, 0.0], JointKind::Revolute)],
    )
}

/// Two rods in a row.
pub fn double_pendulum() -> Robot {
    let mut robot = pendulum();
    robot
        .links
        .push(link(Some(1), 0.7, [0.0, 0.0, -0.3], [0.02, 0.02, 0.6]));
    robot
        .joints
        .push(joint(1, [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], JointKind::Revolute));
    robot.dofs.push(1);
    robot
}

/// A carriage of 2 kg on a vertical rail.
pub fn slider() -> Robot {
    robot(
        Base::Fixed,
        vec![
            link(None, 1.0, [0.0; 3], [0.1; 3]),
            link(Some(0), 2.0, [0.0; 3], [0.1; 3]),
        ],
        vec![joint(0, [0.0; 3], [0.0, 0.0, 1.0], JointKind::Prismatic)],
    )
}

/// A free box whose bottom face is a sole. The origin is its centre.
pub fn block(mass: f64, size: [f64; 3]) -> Robot {
    let mut robot = robot(Base::Floating, vec![link(None, mass, [0.0; 3], size)], vec![]);
    let sole = Isometry3::translation(0.0, 0.0, -0.5 * size[2]);
    add_foot(&mut robot, 0, sole, [0.5 * size[0], 0.5 * size[1]]);
    robot.base_pose = Isometry3::translation(0.0, 0.0, 0.5 * size[2]);
    robot
}

fn add_foot(robot: &mut Robot, link: usize, sole: Isometry3<f64>, half_extents: [f64; 2]) {
    let foot = Foot {
        name: format!("foot {link}"),
        link,
        sole,
        half_extents,
    };
    robot.links[link].contact_points.extend(foot.corners());
    robot.feet.push(foot);
}

/// A box trunk on two legs like the NimbRo-OP2X's: yaw, roll, thigh, knee plate (follows the thigh), shank, ankle
/// (follows the shank), foot roll; and an arm on either side.
pub fn biped() -> Robot {
    let (roll, pitch, yaw) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let mut robot = robot(
        Base::Floating,
        vec![link(None, 7.0, [0.0, 0.0, 0.15], [0.2, 0.3, 0.4])],
        vec![],
    );
    for side in [1.0, -1.0] {
        let mut add = |parent: usize, at: [f64; 3], axis, mass: f64, length: f64, gain: f64| {
            let mut joint = joint(parent, at, axis, JointKind::Revolute);
            joint.passive = Passive {
                armature: 0.02,
                damping: 0.5,
                friction: 0.0,
            };
            joint.actuator = Some(Actuator {
                kp: gain,
                kp_scale: 1.0,
                kd: 2.0,
                torque_limit: 60.0,
                speed_limit: 8.0,
            });
            joint.limits = (-1.5, 1.5);
            robot.joints.push(joint);
            robot.links.push(link(
                Some(parent),
                mass,
                [0.0, 0.0, -0.5 * length],
                [0.08, 0.06, length + 0.05],
            ));
            robot.links.len() - 1
        };
        let yaw = add(0, [0.0, 0.09 * side, 0.0], yaw, 0.3, 0.05, 400.0);
        let hip = add(yaw, [0.0, 0.0, -0.06], roll, 0.5, 0.05, 300.0);
        let thigh = add(hip, [0.0, 0.0, -0.03], pitch, 0.6, 0.3, 400.0);
        let plate = add(thigh, [0.0, 0.0, -0.3], pitch, 0.1, 0.02, 0.0);
        let shank = add(plate, [0.0; 3], pitch, 1.5, 0.3, 400.0);
        let ankle = add(shank, [0.0, 0.0, -0.3], pitch, 0.4, 0.02, 0.0);
        let foot = add(ankle, [0.0, 0.0, -0.03], roll, 0.5, 0.05, 250.0);
        let shoulder = add(0, [0.0, 0.2 * side, 0.3], pitch, 0.6, 0.2, 20.0);
        add(shoulder, [0.0, 0.0, -0.2], pitch, 0.5, 0.25, 20.0);
        for (follower, leader) in [(plate, thigh), (ankle, shank)] {
            let joint = &mut robot.joints[follower - 1];
            joint.mimic = Some(Mimic {
                joint: leader - 1,
                multiplier: -1.0,
                offset: 0.0,
            });
            joint.actuator = None;
            joint.limits = (f64::NEG_INFINITY, f64::INFINITY);
        }
        add_foot(&mut robot, foot, Isometry3::translation(0.03, 0.0, -0.05), [0.1, 0.05]);
    }
    robot.dofs = (0..robot.joints.len())
        .filter(|&j| robot.joints[j].mimic.is_none())
        .collect();
    robot.base_pose = Isometry3::translation(0.0, 0.0, 0.77);
    robot
}

/// A random tree: any axes and frames, turning and sliding, couplings within and across branches.
pub fn random(seed: u64, base: Base, joints: usize) -> Robot {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut robot = robot(base, vec![random_link(&mut rng, None)], vec![]);
    for j in 0..joints {
        let parent = rng.random_range(j.saturating_sub(4)..=j);
        let kind = if rng.random_bool(0.25) {
            JointKind::Prismatic
        } else {
            JointKind::Revolute
        };
        let mut joint = joint(parent, [0.0; 3], vector(&mut rng, 1.0).into(), kind);
        let turn = UnitQuaternion::from_scaled_axis(vector(&mut rng, 2.0));
        joint.origin = Isometry3::from_parts(Translation3::from(vector(&mut rng, 0.3)), turn);
        if j > 0 && rng.random_bool(0.2) {
            let leader = rng.random_range(0..j);
            if robot.joints[leader].mimic.is_none() {
                let multiplier = rng.random_range(-2.0..2.0);
                joint.mimic = Some(Mimic {
                    joint: leader,
                    multiplier,
                    offset: rng.random_range(-0.5..0.5),
                });
            }
        }
        robot.joints.push(joint);
        let own = random_link(&mut rng, Some(parent));
        robot.links.push(own);
    }
    robot.dofs = (0..joints).filter(|&j| robot.joints[j].mimic.is_none()).collect();
    let leaf = robot.links.len() - 1;
    robot.links[leaf].contact_points = vec![Point3::from(vector(&mut rng, 0.2))];
    robot
}

fn random_link(rng: &mut ChaCha8Rng, parent: Option<usize>) -> Link {
    let com = vector(rng, 0.1);
    let mut link = link(parent, rng.random_range(0.3..3.0), com.into(), [0.1, 0.2, 0.3]);
    let turn = UnitQuaternion::from_scaled_axis(vector(rng, 2.0)).to_rotation_matrix();
    link.inertial.inertia = turn.matrix() * link.inertial.inertia * turn.matrix().transpose();
    link
}

pub fn vector(rng: &mut ChaCha8Rng, scale: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-scale..scale))
}
