//! `policy_actions POLICY.omni OBSERVATIONS ACTIONS`: what the controller does with each observation. Both files are rows
//! of little-endian `f32`. For programs that check other ways of running a policy against it.

use std::fs;
use std::path::Path;

use omniwalk_controller::{Controller, Policy};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [policy, observations, actions] = arguments.as_slice() else {
        panic!("usage: policy_actions POLICY.omni OBSERVATIONS ACTIONS");
    };
    let policy = Policy::from_bytes(&fs::read(policy).expect("a policy file")).expect("a policy");
    let mut controller = Controller::new(&policy).expect("valid");
    let (width, joints) = (policy.spec().observation_len(), policy.spec().action_len());
    let bytes = fs::read(Path::new(observations)).expect("observations");
    let numbers: Vec<f32> = bytes
        .as_chunks()
        .0
        .iter()
        .map(|word| f32::from_le_bytes(*word))
        .collect();
    let mut action = vec![0.0; joints];
    let mut out = Vec::new();
    for observation in numbers.chunks_exact(width) {
        controller.act(observation, &mut action);
        action.iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
    }
    fs::write(actions, out).expect("writes");
}
