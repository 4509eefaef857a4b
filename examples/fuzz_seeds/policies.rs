//! Small policies that differ in everything a file can differ in.

use omniwalk_controller::*;

fn joint(name: &str) -> JointSpec {
    JointSpec {
        name: name.into(),
        nominal: 0.1,
        lower: -1.0,
        upper: 1.0,
        kp: 100.0,
        kd: 2.0,
        torque_limit: 20.0,
        action_scale: 0.3,
    }
}

fn leg(name: &str, joint: Option<u16>) -> Leg {
    let upright = [0.0, 0.0, 0.0, 1.0];
    let segment = |prismatic: bool, z: f32| Segment {
        translation: [0.0, 0.1, z],
        rotation: upright,
        axis: [0.0, 1.0, 0.0],
        prismatic,
        joint,
        multiplier: -1.0,
        offset: 0.2,
    };
    Leg {
        name: name.into(),
        segments: vec![segment(false, 0.0), segment(true, -0.3)],
        corners: [
            [0.1, 0.05, 0.0],
            [0.1, -0.05, 0.0],
            [-0.1, 0.05, 0.0],
            [-0.1, -0.05, 0.0],
        ],
        sole_rotation: upright,
    }
}

/// Two joints, two legs, a clock, a mirror, and every block of the observation.
fn everything() -> Spec {
    let joints = vec![joint("left"), joint("right")];
    let mirrored = |joint: u16| MirroredJoint { joint, sign: 1.0 };
    Spec {
        control_hz: 40.0,
        joints,
        observation: Block::ALL.to_vec(),
        action: ActionSpec {
            law: ActionLaw::OffsetFromNominal,
            filter: Some(FilterSpec::Exponential { gain: 0.3 }),
            torque_clamp: true,
        },
        clock: Some(ClockSpec {
            period: 0.6,
            reset_phase: 0.5,
        }),
        symmetry: Some(vec![mirrored(1), mirrored(0)]),
        command: CommandSpec {
            rate: [0.5, 0.5, 1.0],
            lower: [-0.5; 3],
            upper: [0.5; 3],
        },
        legs: vec![leg("left", Some(0)), leg("right", None)],
        inertial_frame_period: 0.5,
        upright: [0.7; 2],
    }
}

/// One joint and as little as possible.
fn little() -> Spec {
    Spec {
        joints: vec![joint("only")],
        observation: vec![Block::JointPosition, Block::Attitude],
        clock: None,
        symmetry: None,
        legs: Vec::new(),
        ..everything()
    }
}

fn policy(spec: Spec, hidden: &[usize], activation: Activation, head: Head) -> Policy {
    let width = spec.observation_len();
    let outputs = 2 * spec.action_len();
    let mut inputs = width;
    let mut layers = Vec::new();
    for &outputs in hidden.iter().chain([&outputs]) {
        layers.push(Dense {
            inputs,
            weights: Weights::F32((0..inputs * outputs).map(|i| 0.3 * (i as f32).sin()).collect()),
            bias: vec![0.01; outputs],
        });
        inputs = outputs;
    }
    let actor = Actor {
        mean: vec![0.0; width],
        deviation: vec![1.0; width],
        clip: 10.0,
        layers,
        activation,
        head,
    };
    let bounds = Bounds {
        lower: vec![-5.0; width],
        upper: vec![f32::INFINITY; width],
    };
    let identity = Identity {
        config_hash: [7; 32],
        seed: 1,
        steps: 2,
        program: "seeds".into(),
        latency: [0.0, 0.05],
        curriculum: Curriculum {
            lower: [-0.4; 3],
            upper: [0.4; 3],
            velocity_factor: 1.0,
            foot_factor: 1.0,
        },
    };
    Policy::new(spec, actor, bounds, identity).expect("the parts fit")
}

/// Names and bytes of the files.
pub fn files() -> Vec<(String, Vec<u8>)> {
    let mut butterworth = little();
    butterworth.action.filter = Some(FilterSpec::Butterworth { cutoff_hz: 10.0 });
    butterworth.action.law = ActionLaw::IncrementOnMeasured;
    let mut bare = little();
    bare.action.filter = None;
    bare.action.law = ActionLaw::IncrementOnTarget;
    bare.inertial_frame_period = f32::INFINITY;
    let full = policy(everything(), &[8], Activation::Tanh, Head::Beta);
    let seeds = [
        ("int8", full.with_precision(Precision::Int8).expect("finite")),
        ("f16", full.with_precision(Precision::F16).expect("finite")),
        (
            "butterworth",
            policy(butterworth, &[4, 3], Activation::Elu, Head::Gaussian),
        ),
        ("bare", policy(bare, &[], Activation::Relu, Head::Beta)),
        ("everything", full),
    ];
    let file = |(name, policy): (&str, Policy)| (format!("{name}.omni"), policy.to_bytes());
    seeds.into_iter().map(file).collect()
}
