//! A small symmetric biped for the tests of this crate.

use alloc::{format, string::String, vec, vec::Vec};

use crate::{
    actor::{Activation, Actor, Dense, Head},
    policy::{Bounds, Curriculum, Identity, Policy},
    spec::*,
    weights::Weights,
};

/// No velocity of ten joints.
pub(crate) const STILL: [f32; 10] = [0.0; 10];

fn segment(translation: [f32; 3], axis: [f32; 3], joint: u16, multiplier: f32) -> Segment {
    Segment {
        translation,
        rotation: [0.0, 0.0, 0.0, 1.0],
        axis,
        prismatic: false,
        joint: Some(joint),
        multiplier,
        offset: 0.0,
    }
}

/// Hip yaw, hip roll, hip pitch, knee, ankle roll from `first` on; two followers keep the sole parallel to the base in pitch.
fn leg(name: &str, side: f32, first: u16) -> Leg {
    let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let here = [0.0; 3];
    let segments = vec![
        segment([0.0, 0.08 * side, 0.0], z, first, 1.0),
        segment(here, x, first + 1, 1.0),
        segment(here, y, first + 2, 1.0),
        segment([0.0, 0.0, -0.3], y, first + 3, 1.0),
        segment([0.0, 0.0, -0.3], y, first + 2, -1.0),
        segment(here, y, first + 3, -1.0),
        segment([0.0, 0.0, -0.04], x, first + 4, 1.0),
    ];
    let corner = |dx: f32, dy: f32| [0.03 + dx, 0.01 * side + dy, -0.06];
    let corners = [
        corner(0.12, 0.06),
        corner(0.12, -0.06),
        corner(-0.12, 0.06),
        corner(-0.12, -0.06),
    ];
    Leg {
        name: name.into(),
        segments,
        corners,
        sole_rotation: [0.0, 0.0, 0.0, 1.0],
    }
}

/// Ten joints, every observation block, increments on the previous target, clock and filter.
pub(crate) fn biped() -> Spec {
    let names = ["hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_roll"];
    let joint = |i: usize| {
        let name: String = format!("{}_{}", if i < 5 { "left" } else { "right" }, names[i % 5]);
        let (lower, upper) = match i {
            1 => (-0.4, 0.8),
            6 => (-0.8, 0.4),
            3 | 8 => (-0.1, 2.0),
            _ => (-1.2, 1.2),
        };
        let nominal = [0.0, if i < 5 { 0.05 } else { -0.05 }, -0.25, 0.5, 0.0][i % 5];
        JointSpec {
            name,
            nominal,
            lower,
            upper,
            kp: 120.0,
            kd: 3.0,
            torque_limit: 40.0,
            action_scale: 0.3,
        }
    };
    Spec {
        control_hz: 40.0,
        joints: (0..10).map(joint).collect(),
        observation: vec![
            Block::JointPosition,
            Block::JointVelocity,
            Block::Attitude,
            Block::Gyro,
            Block::VelocityInertial,
            Block::VelocityBase,
            Block::DesiredVelocity,
            Block::CommandedVelocity,
            Block::Clock,
            Block::PreviousTarget,
            Block::TrackingError,
        ],
        action: ActionSpec {
            law: ActionLaw::IncrementOnTarget,
            filter: Some(FilterSpec::Butterworth { cutoff_hz: 10.0 }),
            torque_clamp: true,
        },
        clock: Some(ClockSpec {
            period: 0.8,
            reset_phase: 0.0,
        }),
        symmetry: None,
        command: CommandSpec {
            rate: [0.5, 0.5, 1.0],
            lower: [-0.6; 3],
            upper: [0.6; 3],
        },
        legs: vec![leg("left", 1.0, 0), leg("right", -1.0, 5)],
        inertial_frame_period: 1.0,
        upright: [0.7; 2],
    }
}

/// The mirror map of [`biped`].
pub(crate) fn biped_mirror() -> Vec<MirroredJoint> {
    (0..10)
        .map(|i| MirroredJoint {
            joint: (i + 5) % 10,
            sign: [-1.0, -1.0, 1.0, 1.0, -1.0][usize::from(i % 5)],
        })
        .collect()
}

/// A leg with a turned mount, a sliding joint and a locked one.
pub(crate) fn sliding_leg() -> Leg {
    let mut leg = leg("left", 1.0, 0);
    leg.segments[2].rotation = [0.0, 0.6, 0.0, 0.8];
    leg.segments[3].prismatic = true;
    leg.segments[3].multiplier = 0.5;
    leg.segments[5].joint = None;
    leg.segments[5].offset = 0.3;
    leg.sole_rotation = [0.0, 0.0, 1.0, 0.0];
    leg
}

/// A network with made-up weights for `observation` entries and `actions` joints.
pub(crate) fn actor(observation: usize, hidden: &[usize], actions: usize) -> Actor {
    let mut state = 1u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    let mut inputs = observation;
    let widths: Vec<usize> = hidden.iter().copied().chain([2 * actions]).collect();
    let layer = |&outputs: &usize| {
        let scale = libm::sqrtf(3.0 / inputs as f32);
        let weights = (0..inputs * outputs).map(|_| scale * next()).collect();
        let layer = Dense {
            inputs,
            weights: Weights::F32(weights),
            bias: (0..outputs).map(|_| 0.1 * next()).collect(),
        };
        inputs = outputs;
        layer
    };
    Actor {
        mean: vec![0.1; observation],
        deviation: vec![0.7; observation],
        clip: 10.0,
        layers: widths.iter().map(layer).collect(),
        activation: Activation::Tanh,
        head: Head::Beta,
    }
}

/// Where the policies of tests come from.
pub(crate) fn identity() -> Identity {
    Identity {
        config_hash: [7; 32],
        seed: 3,
        steps: 1_000_000,
        program: "omniwalk 0.1.0".into(),
        latency: [0.0, 0.05],
        curriculum: Curriculum {
            lower: [-0.3, -0.2, -0.6],
            upper: [0.5, 0.2, 0.6],
            velocity_factor: 0.9,
            foot_factor: 1.0,
        },
    }
}

/// A policy of a small network for `spec`, with wide observation bounds that `change` may narrow.
pub(crate) fn policy_with(spec: Spec, change: impl FnOnce(&mut [f32], &mut [f32])) -> Policy {
    let (width, joints) = (spec.observation_len(), spec.action_len());
    let mut bounds = Bounds {
        lower: vec![-20.0; width],
        upper: vec![f32::INFINITY; width],
    };
    change(&mut bounds.lower, &mut bounds.upper);
    Policy::new(spec, actor(width, &[24, 16], joints), bounds, identity()).expect("the parts fit")
}

/// A policy of [`biped`].
pub(crate) fn policy() -> Policy {
    policy_with(biped(), |_, _| {})
}
