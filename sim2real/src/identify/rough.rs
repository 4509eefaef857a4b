//! Less data where fits are dear: to begin with, not to end with.

use std::sync::Arc;

use super::fit::Data;

/// Stretches of a robot that walks freely that suffice to get near a fit: more than ten seconds of them.
const STRETCHES: usize = 48;

impl Data {
    /// Less to compute: at a physics step of a millisecond; of a robot that walks freely no more than [`STRETCHES`] of its stretches,
    /// evenly spread. Fits that begin far off get near by it, and end with all.
    pub fn rough(&self) -> Self {
        let mut rough = Self {
            finer: 1,
            ..self.clone()
        };
        if self.is_free() {
            let every = self.trials.len().div_ceil(STRETCHES);
            rough.trials = Arc::new(self.trials.iter().step_by(every).cloned().collect());
            rough.robots = Arc::new(self.robots.iter().step_by(every).cloned().collect());
            rough.first_block = self.first_block.iter().step_by(every).copied().collect();
        }
        rough
    }

    /// Whether a fit takes so long that it is begun with [`Self::rough`] data.
    pub fn is_dear(&self) -> bool {
        self.finer > 1 || self.is_free()
    }

    /// Whether the base is not held.
    pub fn is_free(&self) -> bool {
        self.trials.iter().any(|trial| trial.base.is_some())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use omniwalk_env::robot::load;

    use super::super::base::MeasuredBase;
    use super::super::cut::{self, Lengths};
    use super::super::trial::Trial;
    use super::*;
    use crate::recording::{JointRecord, Recording, Series};

    const URDF: &str = r#"<robot name="arm"><link name="base"/>
<link name="arm"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="8"/></joint></robot>"#;

    #[test]
    fn rough_data_of_a_robot_that_walks_are_stretches_spread_over_all_its_logs() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("arm.urdf"), URDF).expect("written");
        std::fs::write(folder.path().join("robot.toml"), "base = \"fixed\"\n").expect("written");
        let robot = load(folder.path()).expect("a robot");
        let time: Vec<f64> = (0..1600).map(|k| f64::from(k) * 5e-3).collect();
        let value = time.iter().map(|t| (3.0 * t).sin()).collect();
        let series = Series { time, value };
        let hinge = JointRecord {
            name: "hinge".into(),
            command: series.clone(),
            position: series,
            ..JointRecord::default()
        };
        let log = Recording {
            name: "log".into(),
            joints: vec![hinge],
            ..Recording::default()
        };
        let lengths = Lengths { block: 0.1, piece: 0.1 };
        let cut = |index| cut::cut(&robot, &log, index, (0.0, f64::INFINITY), lengths).expect("trials");
        let trials: Vec<Trial> = (0..2).flat_map(cut).collect();
        let held = Data::new(&robot, trials).expect("data");
        assert_eq!(held.rough().trials.len(), held.trials.len());
        let mut free = held;
        for trial in Arc::make_mut(&mut free.trials) {
            trial.base = Some(MeasuredBase {
                orientation: UnitQuaternion::identity(),
                angular_velocity: Vector3::zeros(),
            });
        }
        let rough = free.rough();
        let kept = rough.trials.len();
        assert!(
            (STRETCHES / 2..=STRETCHES).contains(&kept),
            "{kept} of {}",
            free.trials.len()
        );
        assert_eq!((rough.robots.len(), rough.first_block.len()), (kept, kept));
        let of_log = |log| rough.trials.iter().filter(|trial| trial.log == log).count();
        assert!(of_log(0).abs_diff(of_log(1)) <= 1);
        let every = free.trials.len().div_ceil(STRETCHES);
        for (k, (trial, first)) in rough.trials.iter().zip(&rough.first_block).enumerate() {
            let (same, own) = (&free.trials[k * every], free.first_block[k * every]);
            assert_eq!(
                (trial.log, trial.start.to_bits(), *first),
                (same.log, same.start.to_bits(), own)
            );
        }
    }
}
