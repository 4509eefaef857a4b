//! What an environment draws at random: episodes, their starts, and desired velocities on the way.

use super::environment::{Environment, Scratch};
use super::shared::Shared;
use crate::ground::Ground;

impl Environment {
    /// Draws what stays for the episode but its physics and its latency.
    pub(super) fn draw_episode(&mut self, shared: &Shared) {
        let config = &shared.config;
        let full = config.episode_steps();
        let stream = &mut self.stream;
        let share = stream.unit();
        self.length = if config.task.random_first_length && self.episode == 0 {
            1 + (share * f64::from(full)) as u32
        } else {
            full
        };
        self.desired = self.range.draw(stream);
        self.until_draw = self.draw_interval(shared);
        let epsilon = config.randomise.pd_noise;
        for response in &mut self.response {
            *response = self.stream.uniform(1.0 - epsilon, 1.0 + epsilon);
        }
        self.step = 0;
        self.push_steps = 0;
    }

    /// Draws the physical parameters of the episode and where it starts.
    pub(super) fn draw_start(&mut self, shared: &Shared, scratch: &mut Scratch) {
        shared.draw_world(&mut self.stream, &mut scratch.world);
        let robot = &shared.robot;
        let deviation = shared.config.randomise.start_position;
        for d in 0..robot.dofs.len() {
            let noise = if deviation > 0.0 {
                self.stream.normal(deviation)
            } else {
                0.0
            };
            let (lower, upper) = robot.limits(d);
            scratch.start.joints[d] = (robot.dof(d).nominal + noise).clamp(lower, upper);
        }
        // The lowest corner of the soles touches the ground.
        let level = shared.ground == Ground::Plane;
        if (deviation > 0.0 || !level) && !robot.feet.is_empty() {
            scratch
                .kinematics
                .set_pose(robot, &robot.base_pose, &scratch.start.joints);
            self.place_soles(shared, &scratch.kinematics);
            let lowest = self.soles.iter().map(|sole| sole.lowest).fold(f64::INFINITY, f64::min);
            scratch.start.position.z = robot.base_pose.translation.z - lowest;
        }
    }

    /// Steps until the next draw of the desired velocity, between half and one and a half times the mean.
    fn draw_interval(&mut self, shared: &Shared) -> u32 {
        let mean = shared.config.command.resample_seconds * f64::from(shared.config.engine.control_hz);
        let share = self.stream.uniform(0.5, 1.5);
        if mean > 0.0 {
            (share * mean).round().max(1.0) as u32
        } else {
            u32::MAX
        }
    }

    /// Counts a control step towards the next draw of the desired velocity, and draws it when it is due.
    pub(super) fn redraw(&mut self, shared: &Shared) {
        self.until_draw -= 1;
        if self.until_draw == 0 {
            self.desired = self.range.draw(&mut self.stream);
            self.until_draw = self.draw_interval(shared);
        }
    }
}
