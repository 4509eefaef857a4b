//! Small robots made in code, and what it takes to run them.

use nalgebra::{Isometry3, Matrix3, Unit, UnitQuaternion, Vector3};
pub use omniwalk_env::engine::GRAVITY as G;
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, Friction, Start, World};
use omniwalk_env::robot::{Base, Foot, Geometry, Inertial, Joint, JointKind, Link, Mimic, Passive, Robot, Shape};

pub fn link(name: &str, parent: Option<usize>, mass: f64, com: Vector3<f64>, inertia: Vector3<f64>) -> Link {
    Link {
        name: name.into(),
        parent,
        inertial: Inertial {
            mass,
            com,
            inertia: Matrix3::from_diagonal(&inertia),
        },
        shapes: Vec::new(),
        visuals: Vec::new(),
        contact_points: Vec::new(),
    }
}

pub fn joint(name: &str, parent: usize, origin: Vector3<f64>, axis: Vector3<f64>) -> Joint {
    Joint {
        name: name.into(),
        kind: JointKind::Revolute,
        parent,
        origin: Isometry3::translation(origin.x, origin.y, origin.z),
        axis: Unit::new_normalize(axis),
        limits: (f64::NEG_INFINITY, f64::INFINITY),
        mimic: None,
        nominal: 0.0,
        passive: Passive::default(),
        actuator: None,
    }
}

pub fn robot(base: Base, links: Vec<Link>, joints: Vec<Joint>) -> Robot {
    let dofs = (0..joints.len())
        .filter(|&j| joints[j].mimic.is_none())
        .collect::<Vec<_>>();
    Robot {
        name: "test".into(),
        base,
        base_pose: Isometry3::identity(),
        policy: (0..dofs.len()).collect(),
        dofs,
        links,
        joints,
        feet: Vec::new(),
        mirror: None,
        overlap_pairs: Vec::new(),
        urdf: String::new(),
        effects: Vec::new(),
        ranges: Vec::new(),
        notes: Vec::new(),
    }
}

/// A rod on a fixed base, turning about y; its centre of mass hangs 0.3 m below the joint.
pub fn pendulum() -> Robot {
    let base = link("base", None, 1.0, Vector3::zeros(), Vector3::repeat(0.01));
    let rod = link(
        "rod",
        Some(0),
        2.0,
        Vector3::new(0.0, 0.0, -0.3),
        Vector3::new(0.02, 0.02, 0.001),
    );
    let mut robot = robot(
        Base::Fixed,
        vec![base, rod],
        vec![joint("hinge", 0, Vector3::zeros(), Vector3::y())],
    );
    robot.base_pose = Isometry3::translation(0.0, 0.0, 2.0);
    robot
}

/// Inertia of the pendulum about its hinge, kg m^2.
pub const PENDULUM_INERTIA: f64 = 0.02 + 2.0 * 0.3 * 0.3;

/// Two arms on a fixed base, side by side about y; the second follows the first.
pub fn coupled(multiplier: f64, offset: f64) -> Robot {
    let base = link("base", None, 1.0, Vector3::zeros(), Vector3::repeat(0.01));
    let arm = |name| {
        link(
            name,
            Some(0),
            1.0,
            Vector3::new(0.0, 0.0, -0.2),
            Vector3::new(0.01, 0.01, 0.001),
        )
    };
    let leader = joint("leader", 0, Vector3::zeros(), Vector3::y());
    let mut follower = joint("follower", 0, Vector3::new(0.0, 0.5, 0.0), Vector3::y());
    follower.mimic = Some(Mimic {
        joint: 0,
        multiplier,
        offset,
    });
    let mut robot = robot(Base::Fixed, vec![base, arm("a"), arm("b")], vec![leader, follower]);
    robot.base_pose = Isometry3::translation(0.0, 0.0, 2.0);
    robot
}

/// A solid box of 0.4 x 0.4 x 0.1 m and 10 kg with a small wheel inside: the smallest robot that can slide.
pub fn sled() -> Robot {
    let mass = 10.0;
    let inertia = Vector3::new(0.4f64.powi(2) + 0.01, 0.4f64.powi(2) + 0.01, 2.0 * 0.16) * (mass / 12.0);
    let mut body = link("body", None, mass, Vector3::zeros(), inertia);
    body.shapes.push(Shape {
        geometry: Geometry::Box(Vector3::new(0.2, 0.2, 0.05)),
        pose: Isometry3::identity(),
    });
    let wheel = link("wheel", Some(0), 1e-3, Vector3::zeros(), Vector3::repeat(1e-6));
    let mut robot = robot(
        Base::Floating,
        vec![body, wheel],
        vec![joint("axle", 0, Vector3::zeros(), Vector3::z())],
    );
    robot.base_pose = Isometry3::translation(0.0, 0.0, 0.05);
    robot.feet.push(Foot {
        name: "body".into(),
        link: 0,
        sole: Isometry3::translation(0.0, 0.0, -0.05),
        half_extents: [0.2, 0.2],
    });
    robot
}

/// A solid ball of 0.1 m and 1 kg with a small wheel inside.
pub fn ball() -> Robot {
    let mut robot = sled();
    robot.links[0] = link("body", None, 1.0, Vector3::zeros(), Vector3::repeat(0.4 * 0.01));
    robot.links[0].shapes.push(Shape {
        geometry: Geometry::Sphere(0.1),
        pose: Isometry3::identity(),
    });
    robot.base_pose = Isometry3::translation(0.0, 0.0, 0.1);
    robot
}

/// A biped of boxes: trunk, thighs, shanks, feet; hips roll and pitch, knees and ankles pitch. The pitch of the
/// feet follows through plates as in a parallelogram leg. The trunk's centre of mass is off its origin.
pub fn biped() -> Robot {
    let mut trunk = link(
        "trunk",
        None,
        8.0,
        Vector3::new(0.01, 0.0, 0.15),
        Vector3::new(0.1, 0.1, 0.05),
    );
    trunk.shapes.push(Shape {
        geometry: Geometry::Box(Vector3::new(0.1, 0.12, 0.2)),
        pose: Isometry3::translation(0.0, 0.0, 0.2),
    });
    let (mut links, mut joints) = (vec![trunk], Vec::new());
    for side in [1.0, -1.0] {
        add_leg(&mut links, &mut joints, side);
    }
    let mut robot = robot(Base::Floating, links, joints);
    robot.base_pose = Isometry3::translation(0.0, 0.0, 0.7);
    for (name, link) in [("left", 6), ("right", 12)] {
        robot.feet.push(Foot {
            name: name.into(),
            link,
            sole: Isometry3::translation(0.03, 0.0, -0.05),
            half_extents: [0.12, 0.06],
        });
    }
    robot
}

fn add_leg(links: &mut Vec<Link>, joints: &mut Vec<Joint>, side: f64) {
    let first = links.len();
    let j = joints.len();
    let thin = Vector3::repeat(1e-3);
    let down = Vector3::new(0.0, 0.0, -0.15);
    let limb = Vector3::new(0.01, 0.01, 0.002);
    let next = Vector3::new(0.0, 0.0, -0.3);
    links.push(link("hip", Some(0), 0.5, Vector3::zeros(), thin));
    links.push(link("thigh", Some(first), 1.0, down, limb));
    links.push(link("plate", Some(first + 1), 0.0, Vector3::zeros(), Vector3::zeros()));
    links.push(link("shank", Some(first + 2), 1.0, down, limb));
    links.push(link("carrier", Some(first + 3), 0.5, Vector3::zeros(), thin));
    let mut foot = link(
        "foot",
        Some(first + 4),
        0.5,
        Vector3::new(0.03, 0.0, -0.03),
        Vector3::new(1e-3, 3e-3, 3e-3),
    );
    foot.shapes.push(Shape {
        geometry: Geometry::Box(Vector3::new(0.12, 0.06, 0.01)),
        pose: Isometry3::translation(0.03, 0.0, -0.04),
    });
    links.push(foot);
    joints.push(joint("hip_roll", 0, Vector3::new(0.0, 0.1 * side, -0.05), Vector3::x()));
    joints.push(joint("hip_pitch", first, Vector3::zeros(), Vector3::y()));
    joints.push(joint("plate", first + 1, next, Vector3::y()));
    joints.push(joint("knee", first + 2, Vector3::zeros(), Vector3::y()));
    joints.push(joint("ankle_pitch", first + 3, next, Vector3::y()));
    joints.push(joint("ankle_roll", first + 4, Vector3::zeros(), Vector3::x()));
    for (follower, leader) in [(j + 2, j + 1), (j + 4, j + 3)] {
        joints[follower].mimic = Some(Mimic {
            joint: leader,
            multiplier: -1.0,
            offset: 0.0,
        });
    }
    for joint in &mut joints[j..] {
        joint.passive.armature = if joint.mimic.is_some() { 0.0 } else { 0.04 };
    }
}

/// The robot's own masses and passive joints under standard gravity.
pub fn nominal(robot: &Robot) -> World {
    let friction = Friction {
        tangential: 0.8,
        torsional: 0.0,
        rolling: 0.0,
    };
    World::nominal(robot, friction)
}

/// One world at `start`.
pub fn single(robot: &Robot, dt: f64, start: &Start, model: &World) -> Rapier {
    let mut engine = Rapier::new(robot, dt, 1).expect("engine");
    engine.reset(0, start, model);
    engine
}

/// The same servo on every degree of freedom, without a limit.
pub fn servo(robot: &Robot, worlds: usize, stiffness: f64, damping: f64) -> Drive {
    let dofs = robot.dofs.len();
    let mut drive = Drive::idle(dofs, worlds);
    for d in 0..dofs {
        for w in 0..worlds {
            drive.target[d * worlds + w] = robot.dof(d).nominal;
        }
    }
    drive.stiffness.fill(stiffness);
    drive.damping.fill(damping);
    drive.torque_min.fill(f64::NEG_INFINITY);
    drive.torque_max.fill(f64::INFINITY);
    drive
}

/// Everything that can be seen of a world, for comparison of bits.
pub fn bits(engine: &Rapier, world: usize) -> Vec<u64> {
    let (worlds, joints, base) = (engine.worlds(), engine.joints(), engine.base(world));
    let lanes = [&joints.position, &joints.velocity, &joints.torque]
        .into_iter()
        .flat_map(|values| values.iter().skip(world).step_by(worlds));
    let rotation: UnitQuaternion<f64> = base.orientation;
    lanes
        .chain(base.position.iter())
        .chain(rotation.coords.iter())
        .chain(base.linear_velocity.iter())
        .chain(base.angular_velocity.iter())
        .map(|x| x.to_bits())
        .collect()
}
