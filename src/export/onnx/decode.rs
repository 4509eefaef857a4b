//! What is about the network: the mirror of a symmetric policy, and from the action to the targets, operation by operation as
//! [`omniwalk_controller::Pipeline`] does it.

use omniwalk_controller::{ActionLaw, FilterSpec, MirroredJoint, Spec};

use super::proto::{Attribute, Tensor};
use super::{Builder, needs_measured};

impl Builder {
    /// From `observation` to `seen`.
    pub(super) fn mirrored_observation(&mut self, spec: &Spec) {
        match &spec.symmetry {
            Some(joints) => {
                self.node("GreaterOrEqual", &["clock_phase", "half"], "mirrored");
                let map = spec.mirror_observation(joints);
                self.mirror("observation", &map, "seen");
            }
            None => {
                self.node("Identity", &["observation"], "seen");
            }
        }
    }

    /// `output` is `input`, or in the second half of the cycle its mirror image.
    fn mirror(&mut self, input: &str, map: &[(u32, f32)], output: &str) {
        let [index, sign, moved, image] =
            ["mirror_index", "mirror_sign", "moved", "image"].map(|part| format!("{output}_{part}"));
        let (indices, signs): (Vec<i64>, Vec<f32>) = map.iter().map(|&(from, sign)| (i64::from(from), sign)).unzip();
        self.tensors.push(Tensor::indices(&index, &indices));
        self.constant(&sign, &[signs.len()], &signs);
        let gather = self.node("Gather", &[input, &index], &moved);
        gather.attribute.push(Attribute::int("axis", 1));
        self.node("Mul", &[&moved, &sign], &image);
        self.node("Where", &["mirrored", &image, input], output);
    }

    /// From `action` to `target` and the next step's state.
    pub(super) fn targets(&mut self, spec: &Spec) {
        self.node("Clip", &["action", "zero", "one"], "share");
        self.node("Mul", &["share", "two"], "doubled");
        self.node("Sub", &["doubled", "one"], "chosen");
        let command = self.mirrored_action(spec.symmetry.as_deref(), spec);
        self.hold(spec);
        let command = match spec.action.filter {
            Some(filter) => self.filter(filter, spec, command),
            None => command,
        };
        self.node("Clip", &[command, "minus_one", "one"], "command");
        self.law(spec);
        self.clock(spec);
    }

    fn mirrored_action(&mut self, symmetry: Option<&[MirroredJoint]>, spec: &Spec) -> &'static str {
        match symmetry {
            Some(joints) => {
                self.mirror("chosen", &spec.mirror_action(joints), "turned");
                "turned"
            }
            None => "chosen",
        }
    }

    /// `hold` where anything is not finite: zero times it is not zero.
    fn hold(&mut self, spec: &Spec) {
        let mut inputs = vec!["observation", "action"];
        if needs_measured(spec) {
            inputs.push("measured_position");
        }
        let all = self.node("Concat", &inputs, "all");
        all.attribute.push(Attribute::int("axis", 1));
        self.tensors.push(Tensor::indices("along_row", &[1]));
        self.node("Mul", &["all", "zero"], "nothing");
        self.node("ReduceSum", &["nothing", "along_row"], "no_sum");
        self.node("IsNaN", &["no_sum"], "hold");
    }

    /// The low-pass in transposed direct form II, which starts as if its first input had been there forever.
    fn filter(&mut self, filter: FilterSpec, spec: &Spec, input: &str) -> &'static str {
        let ([b0, b1, b2], [a1, a2]) = filter.coefficients(spec.control_hz);
        for (name, value) in [
            ("b0", b0),
            ("b1", b1),
            ("b2", b2),
            ("a1", a1),
            ("a2", a2),
            ("rest_1", 1.0 - b0),
            ("rest_2", b2 - a2),
        ] {
            self.scalar(name, value);
        }
        let split = self.node("Split", &["filter_state"], "given_1");
        split.output.push("given_2".into());
        split.attribute.push(Attribute::int("axis", 1));
        self.node("Greater", &["filter_started", "half"], "started");
        for (given, rest, delay) in [("given_1", "rest_1", "delay_1"), ("given_2", "rest_2", "delay_2")] {
            let first = format!("first_{delay}");
            self.node("Mul", &[input, rest], &first);
            self.node("Where", &["started", given, &first], delay);
        }
        self.node("Mul", &[input, "b0"], "b0_x");
        self.node("Add", &["b0_x", "delay_1"], "filtered");
        self.node("Mul", &[input, "b1"], "b1_x");
        self.node("Mul", &["filtered", "a1"], "a1_y");
        self.node("Sub", &["b1_x", "a1_y"], "difference");
        self.node("Add", &["difference", "delay_2"], "new_1");
        self.node("Mul", &[input, "b2"], "b2_x");
        self.node("Mul", &["filtered", "a2"], "a2_y");
        self.node("Sub", &["b2_x", "a2_y"], "new_2");
        let state = self.node("Concat", &["new_1", "new_2"], "new_state");
        state.attribute.push(Attribute::int("axis", 1));
        self.node("Where", &["hold", "filter_state", "new_state"], "next_filter_state");
        self.node("Where", &["hold", "filter_started", "one"], "next_filter_started");
        "filtered"
    }

    fn law(&mut self, spec: &Spec) {
        let joints = spec.joints.len();
        let of =
            |number: fn(&omniwalk_controller::JointSpec) -> f32| spec.joints.iter().map(number).collect::<Vec<_>>();
        self.constant("scale", &[joints], &of(|joint| joint.action_scale));
        self.constant("lower_limit", &[joints], &of(|joint| joint.lower));
        self.constant("upper_limit", &[joints], &of(|joint| joint.upper));
        let base = match spec.action.law {
            ActionLaw::IncrementOnMeasured => "measured_position",
            ActionLaw::IncrementOnTarget => "previous_target",
            ActionLaw::OffsetFromNominal => {
                self.constant("nominal", &[joints], &of(|joint| joint.nominal));
                "nominal"
            }
        };
        self.node("Mul", &["command", "scale"], "displacement");
        self.node("Add", &[base, "displacement"], "wanted");
        let mut target = "wanted";
        if spec.action.torque_clamp {
            self.constant("reach", &[joints], &of(|joint| joint.torque_limit / joint.kp));
            self.node("Sub", &["measured_position", "reach"], "least");
            self.node("Add", &["measured_position", "reach"], "most");
            self.node("Max", &[target, "least"], "not_below");
            self.node("Min", &["not_below", "most"], "reachable");
            target = "reachable";
        }
        self.node("Max", &[target, "lower_limit"], "not_too_low");
        self.node("Min", &["not_too_low", "upper_limit"], "within_limits");
        self.node("Where", &["hold", "previous_target", "within_limits"], "target");
    }

    fn clock(&mut self, spec: &Spec) {
        if let Some(clock) = spec.clock {
            self.scalar("clock_step", 1.0 / (spec.control_hz * clock.period));
            self.node("Add", &["clock_phase", "clock_step"], "advanced");
            self.node("Floor", &["advanced"], "cycles");
            self.node("Sub", &["advanced", "cycles"], "fraction");
            self.node("Less", &["fraction", "one"], "is_fraction");
            self.node("Where", &["is_fraction", "fraction", "zero"], "next_clock_phase");
        }
    }
}
