//! Rows that repeat a reading because nothing new had arrived.
//!
//! A joint that stands still gives equal readings too, and a slow one does so between two steps of its encoder.
//! Of a run of `n` equal rows, all but the first are repeats where the joint evidently moved on meanwhile: the jump
//! to the next reading makes a step per row that the encoder would have shown, in the direction of the motion before,
//! no faster than it by far, and larger than one row of the motion after.

/// Steps per row, in units of the resolution, that cannot hide in rounding: at one, a row changes or not by chance.
const SHOWN_STEPS: f64 = 1.5;
/// A joint that starts from rest has hardly moved before; one that goes on moving has: least speed before the run as
/// a share of that across it. Two would do for steady motion; four leaves room for acceleration.
const SPEED_BEFORE: f64 = 0.25;
/// A joint that was really stuck leaves with one row of motion, one that was not read jumps over at least two.
const JUMP: f64 = 1.5;

/// Equal rows, and the step per row from them to the next run.
struct Run {
    start: usize,
    rows: usize,
    speed: f64,
}

/// Which rows hold a reading of their own: `position` decides about motion, and what else was `measured` is the same in a row that
/// repeats one. All have one entry a row. Rows without a position are between readings, and none.
pub(super) fn fresh(position: &[f64], measured: &[&[f64]]) -> Vec<bool> {
    let read: Vec<usize> = (0..position.len()).filter(|&row| position[row].is_finite()).collect();
    let bits = |row: usize, values: &[f64]| values[row].to_bits();
    let equal = |a: usize, b: usize| measured.iter().all(|values| bits(a, values) == bits(b, values));
    let same: Vec<bool> = (0..read.len())
        .map(|i| i > 0 && bits(read[i], position) == bits(read[i - 1], position) && equal(read[i], read[i - 1]))
        .collect();
    let positions: Vec<f64> = read.iter().map(|&row| position[row]).collect();
    let mut fresh = vec![true; position.len()];
    for (&row, repeated) in read.iter().zip(repeats(&positions, &same)) {
        fresh[row] = !repeated;
    }
    fresh
}

/// Which rows repeat the one before: `position` decides about motion, `same[i]` says whether row `i` equals row
/// `i - 1` in everything that was measured. Both have one entry a row; positions are finite.
fn repeats(position: &[f64], same: &[bool]) -> Vec<bool> {
    let resolution = resolution(position);
    let runs = runs(position, same);
    let mut repeats = vec![false; position.len()];
    for around in runs.windows(3) {
        let [before, run, after] = around else { continue };
        let shown = run.speed.abs() > SHOWN_STEPS * resolution;
        let moving = before.speed * run.speed.signum() >= SPEED_BEFORE * run.speed.abs();
        let jumps = run.speed.abs() * run.rows as f64 > JUMP * after.speed.abs();
        if run.rows > 1 && shown && moving && jumps {
            repeats[run.start + 1..run.start + run.rows].fill(true);
        }
    }
    repeats
}

fn runs(position: &[f64], same: &[bool]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (row, same) in same.iter().enumerate() {
        match runs.last_mut() {
            Some(run) if *same => run.rows += 1,
            Some(run) => run.speed = (position[row] - position[run.start]) / run.rows as f64,
            None => {}
        }
        if !*same || runs.is_empty() {
            runs.push(Run {
                start: row,
                rows: 1,
                speed: 0.0,
            });
        }
    }
    runs
}

/// The smallest step between consecutive readings; infinite if there is none.
fn resolution(position: &[f64]) -> f64 {
    let steps = position.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    steps.filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(position: &[f64]) -> Vec<usize> {
        let same: Vec<bool> = (0..position.len())
            .map(|i| i > 0 && position[i] == position[i - 1])
            .collect();
        let repeats = repeats(position, &same);
        (0..position.len()).filter(|&i| repeats[i]).collect()
    }

    #[test]
    fn readings_repeated_in_motion_are_found() {
        let moving: Vec<f64> = (0..40).map(|i| (f64::from(i) * 0.1).sin()).collect();
        let mut logged = moving.clone();
        logged[8] = logged[7];
        logged[20] = logged[19];
        logged[21] = logged[19];
        assert_eq!(found(&moving), Vec::<usize>::new());
        assert_eq!(found(&logged), [8, 20, 21]);
    }

    #[test]
    fn rows_without_a_reading_hide_no_repeats() {
        let mut logged: Vec<f64> = (0..40).map(|i| (f64::from(i) * 0.1).sin()).collect();
        logged[8] = logged[7];
        let repeated = |position: &[f64]| fresh(position, &[position]).iter().filter(|fresh| !**fresh).count();
        assert_eq!(repeated(&logged), 1);
        // Commands in rows of their own, and one reading that was lost.
        let mut apart: Vec<f64> = logged.iter().flat_map(|&position| [position, f64::NAN]).collect();
        assert_eq!(repeated(&apart), 1);
        apart[60] = f64::NAN;
        assert_eq!(repeated(&apart), 1);
        assert!(!fresh(&apart, &[&apart])[16]);
    }

    #[test]
    fn standing_still_and_slow_motion_on_a_coarse_encoder_are_readings() {
        let mut stop_and_go: Vec<f64> = (0..30).map(|i| f64::from(i) * 0.01).collect();
        stop_and_go.extend([0.29; 50]);
        stop_and_go.extend((1..30).map(|i| 0.29 + f64::from(i) * 0.01));
        assert_eq!(found(&stop_and_go), Vec::<usize>::new());
        let slow: Vec<f64> = (0..200).map(|i| (f64::from(i) * 0.37).round() * 0.0015).collect();
        assert_eq!(found(&slow), Vec::<usize>::new());
        assert_eq!(found(&[0.5; 100]), Vec::<usize>::new());
        assert_eq!(found(&[]), Vec::<usize>::new());
    }
}
