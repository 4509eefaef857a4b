//! A small policy for the tests.

use omniwalk_controller::{
    ActionLaw, ActionSpec, Activation, Actor, Block, Bounds, ClockSpec, CommandSpec, Curriculum, Dense, FilterSpec,
    Head, Identity, JointSpec, Leg, MirroredJoint, Policy, Segment, Spec, Weights,
};

const LEVEL: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// One hip joint on each side, a clock, a filter, and a policy that is symmetric.
fn spec() -> Spec {
    let joint = |name: &str| JointSpec {
        name: name.into(),
        nominal: 0.0,
        lower: -1.0,
        upper: 1.0,
        kp: 100.0,
        kd: 2.0,
        torque_limit: 20.0,
        action_scale: 0.3,
    };
    let leg = |name: &str, joint: u16, side: f32| Leg {
        name: name.into(),
        segments: vec![Segment {
            translation: [0.0, 0.1 * side, 0.0],
            rotation: LEVEL,
            axis: [0.0, 1.0, 0.0],
            prismatic: false,
            joint: Some(joint),
            multiplier: 1.0,
            offset: 0.0,
        }],
        corners: [
            [0.1, 0.05, -0.6],
            [0.1, -0.05, -0.6],
            [-0.1, 0.05, -0.6],
            [-0.1, -0.05, -0.6],
        ],
        sole_rotation: LEVEL,
    };
    Spec {
        control_hz: 40.0,
        joints: vec![joint("left"), joint("right")],
        observation: vec![
            Block::JointPosition,
            Block::VelocityBase,
            Block::VelocityInertial,
            Block::Clock,
        ],
        action: ActionSpec {
            law: ActionLaw::IncrementOnMeasured,
            filter: Some(FilterSpec::Exponential { gain: 0.3 }),
            torque_clamp: true,
        },
        clock: Some(ClockSpec {
            period: 0.8,
            reset_phase: 0.0,
        }),
        symmetry: Some(vec![
            MirroredJoint { joint: 1, sign: 1.0 },
            MirroredJoint { joint: 0, sign: 1.0 },
        ]),
        command: CommandSpec {
            rate: [1.0; 3],
            lower: [-0.5; 3],
            upper: [0.5; 3],
        },
        legs: vec![leg("left", 0, 1.0), leg("right", 1, -1.0)],
        inertial_frame_period: 2.0,
        upright: [0.7; 2],
    }
}

/// A policy with made-up weights and `hidden` units in two layers.
pub fn policy(hidden: usize) -> Policy {
    let spec = spec();
    let width = spec.observation_len();
    let layer = |inputs: usize, outputs: usize| Dense {
        inputs,
        weights: Weights::F32((0..inputs * outputs).map(|i| 0.1 * (i as f32).sin()).collect()),
        bias: vec![0.0; outputs],
    };
    let actor = Actor {
        mean: vec![0.0; width],
        deviation: vec![1.0; width],
        clip: 10.0,
        layers: vec![layer(width, hidden), layer(hidden, hidden), layer(hidden, 4)],
        activation: Activation::Elu,
        head: Head::Beta,
    };
    let bounds = Bounds {
        lower: vec![-5.0; width],
        upper: vec![5.0; width],
    };
    let identity = Identity {
        config_hash: [0; 32],
        seed: 0,
        steps: 0,
        program: "test".into(),
        latency: [0.0; 2],
        curriculum: Curriculum {
            lower: [-0.5; 3],
            upper: [0.5; 3],
            velocity_factor: 1.0,
            foot_factor: 1.0,
        },
    };
    Policy::new(spec, actor, bounds, identity).expect("the parts fit")
}
