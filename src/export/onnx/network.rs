//! Observation to action: bounds, normaliser, layers, mode of the distribution.

use omniwalk_controller::{Activation, Actor, Head, Policy};

use super::Builder;
use super::proto::Attribute;

impl Builder {
    /// From `seen` to `action`.
    pub(super) fn network(&mut self, policy: &Policy) {
        let (actor, bounds) = (policy.actor(), policy.bounds());
        let inputs = actor.observation_len();
        self.constant("lower", &[inputs], &bounds.lower);
        self.constant("upper", &[inputs], &bounds.upper);
        self.node("Max", &["seen", "lower"], "above");
        self.node("Min", &["above", "upper"], "bounded");
        self.normaliser(actor);
        let outputs = self.layers(actor);
        self.head(actor.head, &outputs);
    }

    fn normaliser(&mut self, actor: &Actor) {
        let n = actor.observation_len();
        let inverse: Vec<f32> = actor.deviation.iter().map(|x| 1.0 / x).collect();
        self.constant("mean", &[n], &actor.mean);
        self.constant("inverse_deviation", &[n], &inverse);
        self.scalar("clip_lower", -actor.clip);
        self.scalar("clip_upper", actor.clip);
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
