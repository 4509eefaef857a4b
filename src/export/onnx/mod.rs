//! A policy as an ONNX model.
//!
//! ```text
//! observation [n, entries] -> bounds -> normaliser -> network -> mode -> action [n, joints] in [0, 1]
//!                                                                  \--> displacement [n, joints] = scale (2 action - 1)
//! ```
//!
//! Displacements are in rad or m, before the action filter. What has a memory stays with the controller: the symmetric
//! policy's mirror, the filter, and what the displacement is added to. The metadata say which they are.

mod proto;

use omniwalk_controller::{Activation, Actor, Head, Policy};
use prost::Message;
use serde_json::json;

use proto::{Attribute, Entry, Graph, Model, Node, Opset, Tensor, Value};

/// Version of the standard's operators; of 2021, so that every runtime has them.
const OPSET: i64 = 15;
/// Version of the file format that came with them.
const FORMAT: i64 = 8;

/// How every model begins that is written here: the file format, then the program's name.
pub const START: &[u8] = b"\x08\x08\x12\x08omniwalk";

/// The model of `policy` as the bytes of a `.onnx` file.
pub fn model(policy: &Policy) -> Vec<u8> {
    let (inputs, joints) = (policy.spec().observation_len(), policy.spec().action_len());
    let mut build = Builder::default();
    build.policy(policy);
    let graph = Graph {
        node: build.nodes,
        name: "policy".into(),
        initializer: build.tensors,
        input: vec![Value::batch("observation", inputs)],
        output: vec![Value::batch("action", joints), Value::batch("displacement", joints)],
    };
    let model = Model {
        ir_version: FORMAT,
        producer_name: "omniwalk".into(),
        producer_version: env!("CARGO_PKG_VERSION").into(),
        doc_string: "Displacements are scale (2 action - 1), rad or m, before filter and law; see the metadata.".into(),
        graph: Some(graph),
        opset_import: vec![Opset {
            domain: String::new(),
            version: OPSET,
        }],
        metadata_props: metadata(policy),
    };
    model.encode_to_vec()
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

    fn policy(&mut self, policy: &Policy) {
        let (actor, bounds) = (policy.actor(), policy.bounds());
        let inputs = actor.observation_len();
        self.constant("lower", &[inputs], &bounds.lower);
        self.constant("upper", &[inputs], &bounds.upper);
        self.node("Max", &["observation", "lower"], "above");
        self.node("Min", &["above", "upper"], "bounded");
        self.normaliser(actor);
        let outputs = self.layers(actor);
        self.head(actor.head, &outputs);
        let scale: Vec<f32> = policy.spec().joints.iter().map(|joint| joint.action_scale).collect();
        let doubled: Vec<f32> = scale.iter().map(|scale| 2.0 * scale).collect();
        self.constant("scale", &[scale.len()], &scale);
        self.constant("doubled_scale", &[scale.len()], &doubled);
        self.node("Clip", &["action", "zero", "one"], "share");
        self.node("Mul", &["share", "doubled_scale"], "range");
        self.node("Sub", &["range", "scale"], "displacement");
    }

    fn normaliser(&mut self, actor: &Actor) {
        let n = actor.observation_len();
        let inverse: Vec<f32> = actor.deviation.iter().map(|x| 1.0 / x).collect();
        self.constant("mean", &[n], &actor.mean);
        self.constant("inverse_deviation", &[n], &inverse);
        for (name, value) in [
            ("clip_lower", -actor.clip),
            ("clip_upper", actor.clip),
            ("zero", 0.0),
            ("one", 1.0),
        ] {
            self.constant(name, &[], &[value]);
        }
        self.node("Sub", &["bounded", "mean"], "centred");
        self.node("Mul", &["centred", "inverse_deviation"], "scaled");
        self.node("Clip", &["scaled", "clip_lower", "clip_upper"], "normalised");
    }

    /// Returns the name of the last layer's output.
    fn layers(&mut self, actor: &Actor) -> String {
        let last = actor.layers.len() - 1;
        let mut input = "normalised".to_owned();
        for (i, layer) in actor.layers.iter().enumerate() {
            let [weight, bias, sum] = ["weight", "bias", "sum"].map(|part| format!("layer_{i}_{part}"));
            let outputs = layer.bias.len();
            self.constant(&weight, &[outputs, layer.inputs], &layer.weights.expand(layer.inputs));
            self.constant(&bias, &[outputs], &layer.bias);
            let gemm = self.node("Gemm", &[&input, &weight, &bias], &sum);
            gemm.attribute.push(Attribute::int("transB", 1));
            input = sum;
            if i < last {
                let operation = match actor.activation {
                    Activation::Tanh => "Tanh",
                    Activation::Elu => "Elu",
                    Activation::Relu => "Relu",
                };
                let output = format!("layer_{i}");
                self.node(operation, &[&input], &output);
                input = output;
            }
        }
        input
    }

    fn head(&mut self, head: Head, outputs: &str) {
        let split = self.node("Split", &[outputs], "first");
        split.output.push("second".into());
        split.attribute.push(Attribute::int("axis", 1));
        self.constant("half", &[], &[0.5]);
        match head {
            Head::Beta => {
                self.node("Softplus", &["first"], "alpha");
                self.node("Softplus", &["second"], "beta");
                self.node("Add", &["alpha", "beta"], "sum");
                self.node("Equal", &["sum", "zero"], "flat");
                self.node("Where", &["flat", "one", "sum"], "divisor");
                self.node("Div", &["alpha", "divisor"], "mode");
                self.node("Where", &["flat", "half", "mode"], "action");
            }
            Head::Gaussian => {
                self.node("Mul", &["first", "half"], "halved");
                self.node("Add", &["halved", "half"], "action");
            }
        }
    }
}
