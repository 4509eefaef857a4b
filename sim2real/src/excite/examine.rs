//! What planned motions show of every effect of the library, by simulating them.

use omniwalk_env::robot::{Limb, Robot};
use rayon::prelude::*;

use super::{Motion, Plan, held};
use crate::identify::{TrialError, shown};

impl Plan {
    /// Simulates the motions of single joints with every effect that the joint may have, to see what they show and what they do not show apart.
    ///
    /// # Errors
    /// [`TrialError`] when the robot has nothing to command.
    pub fn examine(&mut self, robot: &Robot) -> Result<(), TrialError> {
        let held = held(robot);
        let limbs = held.limbs();
        let joints = (0..robot.policy.len()).into_par_iter();
        let of_joint = |joint: usize| {
            let dof = robot.policy[joint];
            let Some(limb) = limbs.iter().find(|limb| limb.dofs.contains(&dof)) else {
                return Ok(None);
            };
            let motions = self
                .motions
                .iter()
                .enumerate()
                .filter(|(_, motion)| motion.is_of(&robot.dof(dof).name));
            let (places, motions): (Vec<usize>, Vec<Motion>) = motions
                .map(|(place, motion)| (place, motion.of_limb(robot, limb)))
                .unzip();
            if motions.is_empty() {
                return Ok(None);
            }
            let own = limb.dofs.iter().position(|&own| own == dof).unwrap_or(0);
            Ok(Some((places, shown(&limb.robot, own, &motions)?)))
        };
        let found: Vec<_> = joints.map(of_joint).collect::<Result<_, TrialError>>()?;
        for (places, shown) in found.into_iter().flatten() {
            for (place, shows) in places.into_iter().zip(shown.motions) {
                self.motions[place].information[0].shows = shows;
            }
            self.confused.extend(shown.confused);
        }
        Ok(())
    }
}

impl Motion {
    /// Whether it moves this joint and no other.
    fn is_of(&self, joint: &str) -> bool {
        matches!(self.information.as_slice(), [own] if own.joint == joint)
    }

    /// What it is of a limb of `robot`.
    fn of_limb(&self, robot: &Robot, limb: &Limb) -> Self {
        let place = |&own: &usize| robot.policy.iter().position(|&dof| dof == limb.dofs[own]);
        let places: Vec<usize> = limb.robot.policy.iter().filter_map(place).collect();
        let of = |targets: &Vec<f64>| places.iter().map(|&place| targets[place]).collect();
        Self {
            targets: self.targets.iter().map(of).collect(),
            ..self.clone()
        }
    }
}
