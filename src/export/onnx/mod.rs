//! A policy as an ONNX model: from a step's observation to the joint targets. What the loop remembers between two steps goes
//! in and comes out.
//!
//! ```text
//! observation, clock_phase -> mirror -> bounds -> normaliser -> network -> mode -> action
//! action, filter_state, measured_position, previous_target -> mirror -> filter -> law -> clamp, limits -> target
//! ```
//!
//! docs/policy-file.md says what each input and output is, and what is left to who uses it: the observation itself.

mod decode;
mod network;
mod proto;

use omniwalk_controller::{ActionLaw, Policy, Spec};
use prost::Message;
use serde_json::json;

use proto::{Entry, Graph, Model, Node, Opset, Tensor, Value};

/// Version of the standard's operators; of 2021, so that every runtime has them.
const OPSET: i64 = 15;
/// Version of the file format that came with them.
const FORMAT: i64 = 8;

/// How every model begins that is written here: the file format, then the program's name.
pub const START: &[u8] = b"\x08\x08\x12\x08omniwalk";

/// The model of `policy` as the bytes of a `.onnx` file.
pub fn model(policy: &Policy) -> Vec<u8> {
    let spec = policy.spec();
    let mut build = Builder::default();
    build.constants();
    build.mirrored_observation(spec);
    build.network(policy);
    build.targets(spec);
    let (input, output) = ends(spec);
    let graph = Graph {
        node: build.nodes,
        name: "policy".into(),
        initializer: build.tensors,
        input,
        output,
    };
    let model = Model {
        ir_version: FORMAT,
        producer_name: "omniwalk".into(),
        producer_version: env!("CARGO_PKG_VERSION").into(),
        doc_string: "One step: `target` are the joint targets, rad or m; they are the `previous_target` of the next step, and every \
                     `next_x` is its `x`. After a reset: the nominal pose, zeros, and the phase to begin with."
            .into(),
        graph: Some(graph),
        opset_import: vec![Opset {
            domain: String::new(),
            version: OPSET,
        }],
        metadata_props: metadata(policy),
    };
    model.encode_to_vec()
}

/// Inputs and outputs: those that the policy has a use for.
fn ends(spec: &Spec) -> (Vec<Value>, Vec<Value>) {
    let joints = spec.action_len();
    let mut input = vec![
        Value::batch("observation", spec.observation_len()),
        Value::batch("previous_target", joints),
    ];
    let mut output = vec![Value::batch("target", joints), Value::batch("action", joints)];
    if needs_measured(spec) {
        input.push(Value::batch("measured_position", joints));
    }
    let mut state = |name: &str, len: usize| {
        input.push(Value::batch(name, len));
        output.push(Value::batch(&format!("next_{name}"), len));
    };
    if spec.action.filter.is_some() {
        state("filter_state", 2 * joints);
        state("filter_started", 1);
    }
    if spec.clock.is_some() {
        state("clock_phase", 1);
    }
    (input, output)
}

/// Whether targets depend on where the joints are.
fn needs_measured(spec: &Spec) -> bool {
    spec.action.torque_clamp || spec.action.law == ActionLaw::IncrementOnMeasured
}

/// What the policy file says beside the network.
fn metadata(policy: &Policy) -> Vec<Entry> {
    let (spec, identity) = (policy.spec(), policy.identity());
    let hash: String = identity.config_hash.iter().map(|byte| format!("{byte:02x}")).collect();
    let blocks = spec.layout().into_iter();
    let layout: Vec<_> = blocks
        .map(|block| json!({ "name": block.name, "len": block.len, "unit": block.unit, "frame": block.frame }))
        .collect();
    let curriculum = &identity.curriculum;
    let about = json!({
        "config_hash": hash,
        "seed": identity.seed,
        "steps": identity.steps,
        "program": identity.program,
        "latency": identity.latency,
        "curriculum": {
            "lower": curriculum.lower,
            "upper": curriculum.upper,
            "velocity_factor": curriculum.velocity_factor,
            "foot_factor": curriculum.foot_factor,
        },
    });
    let entry = |key: &str, value: serde_json::Value| Entry {
        key: key.to_owned(),
        value: value.to_string(),
    };
    vec![
        entry("spec", json!(spec)),
        entry("layout", layout.into()),
        entry("identity", about),
    ]
}

#[derive(Default)]
struct Builder {
    nodes: Vec<Node>,
    tensors: Vec<Tensor>,
}

impl Builder {
    /// A node with one output, which is named like it.
    fn node(&mut self, operation: &str, inputs: &[&str], output: &str) -> &mut Node {
        self.nodes.push(Node {
            input: inputs.iter().map(|&name| name.to_owned()).collect(),
            output: vec![output.to_owned()],
            name: output.to_owned(),
            op_type: operation.to_owned(),
            attribute: Vec::new(),
        });
        let last = self.nodes.len() - 1;
        &mut self.nodes[last]
    }

    fn constant(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        self.tensors.push(Tensor::new(name, shape, values));
    }

    fn scalar(&mut self, name: &str, value: f32) {
        self.constant(name, &[], &[value]);
    }

    /// Numbers that more than one part needs.
    fn constants(&mut self) {
        for (name, value) in [
            ("zero", 0.0),
            ("half", 0.5),
            ("one", 1.0),
            ("two", 2.0),
            ("minus_one", -1.0),
        ] {
            self.scalar(name, value);
        }
    }
}
