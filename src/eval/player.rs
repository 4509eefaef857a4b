//! Who plays: the learner of a run, or the controller of a policy file.

use omniwalk_controller::Controller;
use omniwalk_ppo::{Agent, Inference};

/// What turns observations into actions.
pub enum Player {
    /// A run's networks.
    Learner(Box<Agent>, Inference),
    /// A policy file's, with the bounds it has for observations.
    Controller(Box<Controller>),
}

impl Player {
    /// The most likely action for each observation, row-major.
    pub fn mode(&mut self, observations: &[f32], actions: &mut [f32]) {
        match self {
            Self::Learner(agent, buffers) => agent.mode(buffers, observations, actions),
            Self::Controller(controller) => {
                let (width, joints) = (controller.spec().observation_len(), controller.spec().action_len());
                let rows = observations.chunks_exact(width).zip(actions.chunks_exact_mut(joints));
                rows.for_each(|(observation, action)| controller.act(observation, action));
            }
        }
    }
}
