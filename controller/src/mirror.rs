//! The observation and action of the robot seen in a mirror: left and right change places.
//!
//! Under the reflection y -> -y positions and linear velocities (polar vectors) lose the sign of their y, angular
//! velocities (axial vectors) the signs of x and z; the gait is half a cycle further.

use alloc::vec::Vec;

use crate::{
    spec::{Block, MirroredJoint, Spec},
    validate::SpecError,
};

/// What the mirror does to the entries of a vector: `mirrored[i] = sign * original[index]` for entry i = `(index, sign)`.
type Signed = Vec<(u32, f32)>;

/// What the mirror does to the entries of a block; `None` for blocks with an entry for each joint.
fn signs(block: Block) -> Option<&'static [f32]> {
    match block {
        Block::JointPosition | Block::JointVelocity | Block::PreviousTarget => None,
        Block::Attitude => Some(&[-1.0, 1.0]),
        Block::Gyro => Some(&[-1.0, 1.0, -1.0]),
        Block::VelocityInertial | Block::VelocityBase => Some(&[1.0, -1.0, 1.0]),
        Block::DesiredVelocity | Block::CommandedVelocity | Block::TrackingError => Some(&[1.0, -1.0, -1.0]),
        Block::Clock => Some(&[-1.0, -1.0]),
    }
}

/// Mirrors a value of each joint in place; `joints` is its own inverse, so that pairs change places.
pub(crate) fn mirror_joints(joints: &[MirroredJoint], values: &mut [f32]) {
    for (i, twin) in joints.iter().enumerate() {
        let j = usize::from(twin.joint);
        if i <= j {
            (values[i], values[j]) = (twin.sign * values[j], twin.sign * values[i]);
        }
    }
}

/// Mirrors an observation in place.
pub(crate) fn mirror_observation(spec: &Spec, joints: &[MirroredJoint], observation: &mut [f32]) {
    let mut rest = observation;
    for &block in &spec.observation {
        let (entries, tail) = rest.split_at_mut(spec.block_len(block));
        rest = tail;
        match signs(block) {
            Some(signs) => entries.iter_mut().zip(signs).for_each(|(entry, sign)| *entry *= sign),
            None => mirror_joints(joints, entries),
        }
    }
}

impl Spec {
    /// The mirror of the observation: `mirrored[i] = sign * original[index]` for entry i = `(index, sign)`. `joints` is
    /// the robot's mirror map, one entry for each policy joint in the same sense.
    ///
    /// Normalised observations mirror the same way only if the normaliser is symmetric; mirror before it.
    ///
    /// # Panics
    /// When `joints` is shorter than the policy's joints.
    pub fn mirror_observation(&self, joints: &[MirroredJoint]) -> Signed {
        let mut map = Signed::with_capacity(self.observation_len());
        for &block in &self.observation {
            let start = map.len() as u32;
            match signs(block) {
                Some(signs) => map.extend((start..).zip(signs.iter().copied())),
                None => map.extend(
                    joints[..self.joints.len()]
                        .iter()
                        .map(|twin| (start + u32::from(twin.joint), twin.sign)),
                ),
            }
        }
        map
    }

    /// The mirror of `u = 2 a - 1` for actions a in [0, 1], as in [`Spec::mirror_observation`]: with sign +1
    /// `mirrored[i] = a[index]`, with sign -1 `mirrored[i] = 1 - a[index]`.
    pub fn mirror_action(&self, joints: &[MirroredJoint]) -> Signed {
        joints[..self.joints.len()]
            .iter()
            .map(|twin| (u32::from(twin.joint), twin.sign))
            .collect()
    }

    /// Checks that `joints` mirrors this policy: it is its own inverse, and the nominal pose, limits and action
    /// scales are symmetric under it (to 1e-4), without which the mirror of a previous target or action would be wrong.
    ///
    /// # Errors
    /// [`SpecError::Mirror`] with the first joint that is not.
    pub fn validate_mirror(&self, joints: &[MirroredJoint]) -> Result<(), SpecError> {
        let close = |a: f32, b: f32| (a - b).abs() <= 1e-4;
        for (i, joint) in self.joints.iter().enumerate() {
            let symmetric = joints.len() == self.joints.len()
                && self.joints.get(usize::from(joints[i].joint)).is_some_and(|twin| {
                    let MirroredJoint { joint: other, sign } = joints[i];
                    let (lower, upper) = if sign > 0.0 {
                        (twin.lower, twin.upper)
                    } else {
                        (-twin.upper, -twin.lower)
                    };
                    sign.abs() == 1.0
                        && joints[usize::from(other)] == (MirroredJoint { joint: i as u16, sign })
                        && close(joint.nominal, sign * twin.nominal)
                        && close(joint.lower, lower)
                        && close(joint.upper, upper)
                        && close(joint.action_scale, twin.action_scale)
                });
            if !symmetric {
                return Err(SpecError::Mirror {
                    joint: joint.name.clone(),
                });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        Pipeline, Sensors,
        testing::{biped, biped_mirror},
    };

    fn apply(map: &[(u32, f32)], values: &[f32]) -> Vec<f32> {
        map.iter().map(|&(index, sign)| sign * values[index as usize]).collect()
    }

    #[test]
    fn the_mirror_of_the_mirror_is_the_original() {
        let spec = biped();
        let map = spec.mirror_observation(&biped_mirror());
        let values: Vec<f32> = (0..spec.observation_len()).map(|i| i as f32 + 0.5).collect();
        assert_eq!(map.len(), values.len());
        assert_eq!(apply(&map, &apply(&map, &values)), values);
        assert_ne!(apply(&map, &values), values);
    }

    #[test]
    fn a_map_that_does_not_fit_the_robot_is_refused() {
        let spec = biped();
        assert_eq!(spec.validate_mirror(&biped_mirror()), Ok(()));
        assert!(spec.validate_mirror(&biped_mirror()[..9]).is_err());
        let mut wrong_sign = biped_mirror();
        wrong_sign[2].sign = -1.0;
        wrong_sign[7].sign = -1.0;
        assert_eq!(
            spec.validate_mirror(&wrong_sign),
            Err(SpecError::Mirror {
                joint: "left_hip_pitch".into()
            })
        );
    }

    /// Readings of one step: positions, velocities, attitude, gyro, desired velocity, action.
    type Step = ([f32; 10], [f32; 10], [f32; 2], [f32; 3], [f32; 3], [f32; 10]);

    fn step() -> impl Strategy<Value = Step> {
        use prop::array::{uniform2, uniform3, uniform10};
        (
            uniform10(-0.5f32..0.5),
            uniform10(-3.0f32..3.0),
            uniform2(-0.3f32..0.3),
            uniform3(-2.0f32..2.0),
            uniform3(-1.0f32..1.0),
            uniform10(0.0f32..1.0),
        )
    }

    fn mirrored((q, dq, [roll, pitch], [wx, wy, wz], [vx, vy, turn], action): Step) -> Step {
        let joints = |values: [f32; 10]| {
            let mut out = [0.0; 10];
            for (out, twin) in out.iter_mut().zip(biped_mirror()) {
                *out = twin.sign * values[usize::from(twin.joint)];
            }
            out
        };
        let action = joints(action.map(|a| 2.0 * a - 1.0)).map(|u| 0.5 + 0.5 * u);
        (
            joints(q),
            joints(dq),
            [-roll, pitch],
            [-wx, wy, -wz],
            [vx, -vy, -turn],
            action,
        )
    }

    /// Observations and targets along a sequence of readings.
    fn run(spec: &Spec, phase: f32, steps: &[Step]) -> Vec<(Vec<f32>, Vec<f32>)> {
        let mut pipeline = Pipeline::new(spec).expect("the test spec is valid");
        pipeline.reset(spec, phase);
        steps
            .iter()
            .map(|(position, velocity, attitude, gyro, desired, action)| {
                let sensors = Sensors {
                    position,
                    velocity,
                    attitude: *attitude,
                    gyro: *gyro,
                    base_velocity: None,
                };
                let mut observation = alloc::vec![0.0; spec.observation_len()];
                let mut targets = alloc::vec![0.0; spec.action_len()];
                pipeline.observe(spec, &sensors, *desired, &mut observation);
                pipeline.decode(spec, action, &mut targets);
                (observation, targets)
            })
            .collect()
    }

    proptest! {
        #[test]
        fn mirrored_sensors_give_the_mirrored_observations_and_targets(steps in prop::collection::vec(step(), 1..60)) {
            let spec = biped();
            let (observation, joints) = (spec.mirror_observation(&biped_mirror()), spec.mirror_action(&biped_mirror()));
            let mirrored: Vec<Step> = steps.iter().copied().map(mirrored).collect();
            for (original, reflected) in run(&spec, 0.1, &steps).iter().zip(&run(&spec, 0.6, &mirrored)) {
                let expected = apply(&observation, &original.0).into_iter().chain(apply(&joints, &original.1));
                for (expected, found) in expected.zip(reflected.0.iter().chain(&reflected.1)) {
                    prop_assert!((expected - found).abs() < 2e-4, "{expected} {found}");
                }
            }
        }

        #[test]
        fn a_symmetric_policy_sees_the_same_in_both_halves_of_the_cycle_and_moves_the_mirrored_joints(
            steps in prop::collection::vec(step(), 1..60),
        ) {
            let spec = Spec { symmetry: Some(biped_mirror()), ..biped() };
            let joints = spec.mirror_action(&biped_mirror());
            let same_action = |step: &Step| {
                let (q, dq, attitude, gyro, desired, _) = mirrored(*step);
                (q, dq, attitude, gyro, desired, step.5)
            };
            let reflected: Vec<Step> = steps.iter().map(same_action).collect();
            for (original, reflected) in run(&spec, 0.1, &steps).iter().zip(&run(&spec, 0.6, &reflected)) {
                let expected = original.0.iter().copied().chain(apply(&joints, &original.1));
                for (expected, found) in expected.zip(reflected.0.iter().chain(&reflected.1)) {
                    prop_assert!((expected - found).abs() < 2e-4, "{expected} {found}");
                }
            }
        }
    }
}
