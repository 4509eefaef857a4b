//! Which windows of long logs are looked at: as many as there is time for, spread over all the motion of every joint.

use std::collections::BTreeMap;

use omniwalk_env::robot::{Base, Robot};

use super::trial::{DT, Trial};

/// Length of a window, s: the half second in which what its start does not know dies away is a tenth of it.
pub const LENGTH: f64 = 5.0;
/// Most seconds a search follows, times the joints of the limb: engine steps, effects and re-tuned parameters are in proportion to the
/// joints each, and what one joint shows in ten minutes is no more than what it shows in a good part of them. An effect in a leg of five
/// joints then takes some minutes to find (`cargo bench -p omniwalk-sim2real --bench stand`).
const SECONDS: f64 = 300.0;
/// A joint moves in a window when its range there is this share of its range in all of them.
const MOVES: f64 = 0.2;

/// Most seconds that are followed of any limb of `robot`.
pub fn most(robot: &Robot) -> f64 {
    if robot.base == Base::Floating {
        return f64::INFINITY;
    }
    let joints = robot.limbs().iter().map(|limb| limb.dofs.len()).max();
    SECONDS / joints.unwrap_or(1).max(1) as f64
}

/// Those of `trials`, of the limb that `robot` is, that are looked at: all of them where that is not too long. Otherwise every joint in
/// turn has a window in which it moves, spread over the time in which it does.
pub fn chosen(robot: &Robot, trials: Vec<Trial>) -> Vec<Trial> {
    let (most, joints) = (most(robot), robot.dofs.len());
    let seconds = |trial: &Trial| trial.steps as f64 * DT;
    if trials.iter().map(seconds).sum::<f64>() <= most {
        return trials;
    }
    let mut queues: Vec<_> = (0..joints).map(|d| spread(&moving(&trials, d)).into_iter()).collect();
    let mut taken = vec![false; trials.len()];
    let mut left = most;
    'full: loop {
        let mut any = false;
        for queue in &mut queues {
            let Some(next) = queue.find(|&window| !taken[window]) else {
                continue;
            };
            left -= seconds(&trials[next]);
            if left < 0.0 && taken.contains(&true) {
                break 'full;
            }
            (taken[next], any) = (true, true);
        }
        if !any {
            break;
        }
    }
    let mut kept = taken.iter();
    let mut chosen: Vec<Trial> = trials.into_iter().filter(|_| *kept.next().unwrap_or(&false)).collect();
    close_up(&mut chosen);
    chosen
}

/// The windows in which degree of freedom `d` moves.
fn moving(trials: &[Trial], d: usize) -> Vec<usize> {
    let range = |trial: &Trial| {
        let own = trial.readings.iter().filter(|r| r.dof == d).map(|r| r.position);
        own.fold((f64::MAX, f64::MIN), |(low, high), q| (low.min(q), high.max(q)))
    };
    let ranges: Vec<(f64, f64)> = trials.iter().map(range).collect();
    let all = ranges
        .iter()
        .fold((f64::MAX, f64::MIN), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let moves = |&window: &usize| ranges[window].1 - ranges[window].0 >= MOVES * (all.1 - all.0);
    (0..trials.len()).filter(moves).collect()
}

/// `windows` in an order any beginning of which is spread over all of them: by the bits of their places, reversed (van der Corput 1935).
fn spread(windows: &[usize]) -> Vec<usize> {
    let mut places: Vec<usize> = (0..windows.len()).collect();
    places.sort_by_key(|place| place.reverse_bits());
    places.into_iter().map(|place| windows[place]).collect()
}

/// Numbers logs and blocks anew, without those that are left out.
fn close_up(trials: &mut [Trial]) {
    let mut logs: BTreeMap<usize, BTreeMap<usize, usize>> = BTreeMap::new();
    for trial in &*trials {
        let blocks = logs.entry(trial.log).or_default();
        blocks.extend(trial.readings.iter().map(|reading| (reading.block, 0)));
    }
    for blocks in logs.values_mut() {
        blocks.values_mut().enumerate().for_each(|(place, new)| *new = place);
    }
    let numbers: BTreeMap<usize, usize> = logs.keys().enumerate().map(|(number, &log)| (log, number)).collect();
    for trial in trials {
        let blocks = &logs[&trial.log];
        trial
            .readings
            .iter_mut()
            .for_each(|reading| reading.block = blocks[&reading.block]);
        trial.log = numbers[&trial.log];
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::Reading;
    use super::*;

    /// A minute and more of windows in which joint `d` moves in the tenth that begins with window `at[d]`.
    fn trials(windows: usize, at: &[usize]) -> Vec<Trial> {
        let window = |number: usize| {
            let moves = |d: usize| (at[d]..at[d] + windows / 10).contains(&number);
            let reading = |d: usize, k: u32| Reading {
                at: f64::from(k) * 50.0,
                dof: d,
                position: if moves(d) { f64::from(k % 2) } else { 0.0 },
                block: 2 * number + usize::from(k >= 50),
            };
            Trial {
                steps: 5_000,
                start: number as f64 * LENGTH,
                readings: (0..100)
                    .flat_map(|k| (0..at.len()).map(move |d| reading(d, k)))
                    .collect(),
                ..Trial::default()
            }
        };
        (0..windows).map(window).collect()
    }

    /// The chain of so many joints.
    fn chain(joints: usize) -> Robot {
        let mut urdf = "<robot name=\"chain\"><link name=\"link0\"/>".to_owned();
        for d in 0..joints {
            let next = d + 1;
            urdf += &format!(
                "<link name=\"link{next}\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>
<joint name=\"joint{d}\" type=\"continuous\"><parent link=\"link{d}\"/><child link=\"link{next}\"/><axis xyz=\"0 1 0\"/></joint>"
            );
        }
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("chain.urdf"), urdf + "</robot>").expect("written");
        std::fs::write(folder.path().join("robot.toml"), "base = \"fixed\"\n").expect("written");
        omniwalk_env::robot::load(folder.path()).expect("a robot")
    }

    #[test]
    fn of_a_limb_with_ever_so_many_joints_one_window_is_looked_at() {
        let robot = chain(61);
        assert!(most(&robot) < LENGTH);
        assert_eq!(chosen(&robot, trials(10, &[0; 61])).len(), 1);
    }

    #[test]
    fn every_joint_has_its_share_of_the_windows_in_which_it_moves() {
        let robot = chain(2);
        assert_eq!(most(&robot), 150.0);
        let few = chosen(&robot, trials(20, &[0, 10]));
        assert_eq!(few.len(), 20, "what is short is looked at whole");
        // Each joint moves in a tenth.
        let long = chosen(&robot, trials(200, &[0, 100]));
        let numbers: Vec<usize> = long.iter().map(|trial| (trial.start / LENGTH) as usize).collect();
        let of = |from: usize| numbers.iter().filter(|&&n| (from..from + 20).contains(&n)).count();
        assert_eq!([of(0), of(100)], [15, 15], "{numbers:?}");
        let last: Vec<usize> = numbers.iter().copied().filter(|n| *n >= 15 && *n < 20).collect();
        assert!(last.len() >= 3, "spread over all of its time: {numbers:?}");
        let blocks: Vec<usize> = long.iter().flat_map(|t| t.readings.iter().map(|r| r.block)).collect();
        assert!(
            blocks
                .windows(2)
                .all(|pair| pair[1] == pair[0] || pair[1] == pair[0] + 1)
        );
        assert_eq!((blocks[0], blocks[blocks.len() - 1]), (0, 59));
    }
}
