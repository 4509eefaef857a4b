//! What every entry of an observation is called, how it is measured and in which frame: what a policy file says of it.

use alloc::{format, string::String, vec::Vec};

use crate::spec::{Block, Spec};

/// A block of an observation in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockLayout {
    /// The block's name, as in configurations.
    pub name: String,
    /// Its entries.
    pub len: u32,
    /// Their unit.
    pub unit: String,
    /// The frame they are measured in.
    pub frame: String,
}

impl Block {
    /// Every block.
    pub const ALL: [Self; 11] = [
        Self::JointPosition,
        Self::JointVelocity,
        Self::Attitude,
        Self::Gyro,
        Self::VelocityInertial,
        Self::VelocityBase,
        Self::DesiredVelocity,
        Self::CommandedVelocity,
        Self::Clock,
        Self::PreviousTarget,
        Self::TrackingError,
    ];

    /// The name, as in configurations.
    pub fn name(self) -> &'static str {
        match self {
            Self::JointPosition => "joint_position",
            Self::JointVelocity => "joint_velocity",
            Self::Attitude => "attitude",
            Self::Gyro => "gyro",
            Self::VelocityInertial => "velocity_inertial",
            Self::VelocityBase => "velocity_base",
            Self::DesiredVelocity => "desired_velocity",
            Self::CommandedVelocity => "commanded_velocity",
            Self::Clock => "clock",
            Self::PreviousTarget => "previous_target",
            Self::TrackingError => "tracking_error",
        }
    }

    /// Unit of the entries.
    pub fn unit(self) -> &'static str {
        match self {
            Self::JointPosition | Self::PreviousTarget => "rad or m",
            Self::JointVelocity => "rad/s or m/s",
            Self::Attitude => "rad",
            Self::Gyro => "rad/s",
            Self::VelocityInertial | Self::VelocityBase => "m/s",
            Self::DesiredVelocity | Self::CommandedVelocity | Self::TrackingError => "m/s, m/s, rad/s",
            Self::Clock => "1",
        }
    }

    /// Frame of the entries.
    pub fn frame(self) -> &'static str {
        match self {
            Self::JointPosition | Self::JointVelocity => "joint",
            Self::PreviousTarget => "joint, relative to the nominal pose",
            Self::Attitude => "fused roll and pitch of the base against gravity",
            Self::Gyro | Self::VelocityBase => "base",
            Self::VelocityInertial => "inertial: level, at a former heading of the base",
            Self::DesiredVelocity | Self::CommandedVelocity | Self::TrackingError => {
                "base, level: forward, left, turn about the vertical"
            }
            Self::Clock => "sine and cosine of the phase",
        }
    }

    /// Names of the entries of a block without one for each joint.
    fn entries(self) -> &'static [&'static str] {
        match self {
            Self::JointPosition | Self::JointVelocity | Self::PreviousTarget => &[],
            Self::Attitude => &["roll", "pitch"],
            Self::Gyro | Self::VelocityInertial | Self::VelocityBase => &["x", "y", "z"],
            Self::DesiredVelocity | Self::CommandedVelocity | Self::TrackingError => &["x", "y", "turn"],
            Self::Clock => &["sin", "cos"],
        }
    }
}

impl Spec {
    /// The observation in words, block by block.
    pub fn layout(&self) -> Vec<BlockLayout> {
        let block = |&block: &Block| BlockLayout {
            name: block.name().into(),
            len: self.block_len(block) as u32,
            unit: block.unit().into(),
            frame: block.frame().into(),
        };
        self.observation.iter().map(block).collect()
    }

    /// What entry `index` of the observation is called, such as `joint_position[left_knee]`; `None` beyond the last.
    pub fn entry_name(&self, index: usize) -> Option<String> {
        let mut first = 0;
        for &block in &self.observation {
            let len = self.block_len(block);
            if index < first + len {
                let within = index - first;
                let joint = || self.joints[within].name.as_str();
                let entry = block.entries().get(within).copied().unwrap_or_else(joint);
                return Some(format!("{}[{entry}]", block.name()));
            }
            first += len;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::biped;

    #[test]
    fn every_entry_has_a_name_of_its_own() {
        let spec = biped();
        let mut names: Vec<String> = (0..).map_while(|i| spec.entry_name(i)).collect();
        assert_eq!(names.len(), spec.observation_len());
        assert_eq!(names[3], "joint_position[left_knee]");
        assert_eq!(names[21], "attitude[pitch]");
        assert_eq!(names[33], "desired_velocity[turn]");
        names.sort();
        names.dedup();
        assert_eq!(names.len(), spec.observation_len());
    }

    #[test]
    fn names_are_those_of_configurations_and_lengths_those_of_the_observation() {
        let spec = biped();
        for (block, words) in Block::ALL.iter().zip(spec.layout()) {
            let serialised = postcard::to_stdvec(block).expect("serialises");
            assert_eq!(postcard::from_bytes(&serialised), Ok(*block));
            let snake: String = format!("{block:?}")
                .char_indices()
                .flat_map(|(i, c)| {
                    (i > 0 && c.is_uppercase())
                        .then_some('_')
                        .into_iter()
                        .chain(c.to_lowercase())
                })
                .collect();
            assert_eq!(block.name(), snake);
            assert_eq!(
                (words.name.as_str(), words.len as usize),
                (block.name(), spec.block_len(*block))
            );
        }
    }
}
