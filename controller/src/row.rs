//! Observations of many robots of one kind: their legs and velocity estimates side by side, [`ROW`] at a time.

use alloc::{vec, vec::Vec};

use crate::{
    estimator::{finite, mean_velocity},
    kinematics::{Sole, sole},
    math::Vec3,
    number::{Number, Row},
    pipeline::{Pipeline, Sensors},
    spec::Spec,
};

pub use crate::number::ROW;

/// What [`Pipeline::observe`] takes of one robot.
pub struct Turn<'a> {
    /// The robot's loop.
    pub pipeline: &'a mut Pipeline,
    /// Its readings.
    pub sensors: Sensors<'a>,
    /// Its desired velocity, m/s, m/s, rad/s.
    pub desired: [f32; 3],
    /// Where its observation goes.
    pub out: &'a mut [f32],
}

/// Scratch memory for rows of robots of one spec.
pub struct RowObserver {
    position: Vec<Row>,
    velocity: Vec<Row>,
    soles: Vec<Sole<Row>>,
}

impl RowObserver {
    /// Scratch memory for `spec`.
    pub fn new(spec: &Spec) -> Self {
        let zeros = vec![Row::of(0.0); spec.joints.len()];
        let soles = spec
            .legs
            .iter()
            .map(|leg| sole(leg, |j| zeros[j], |j| zeros[j]))
            .collect();
        Self {
            velocity: zeros.clone(),
            position: zeros,
            soles,
        }
    }

    /// [`Pipeline::observe`] for every turn of a row, with the same bits. Places without a turn are left alone.
    ///
    /// # Panics
    /// When the readings or the output of a turn do not have the spec's lengths.
    pub fn observe(&mut self, spec: &Spec, turns: &mut [Option<Turn>; ROW]) {
        let zero = [Row::of(0.0); 3];
        let (mut gyro, mut up, mut previous) = (zero, zero, zero);
        for (i, turn) in turns.iter_mut().enumerate() {
            let Some(Turn { pipeline, sensors, .. }) = turn else {
                continue;
            };
            put(&mut up, i, pipeline.take_in(spec, sensors));
            put(&mut gyro, i, sensors.gyro.map(f64::from));
            put(&mut previous, i, pipeline.base_velocity());
            put(&mut self.position, i, sensors.position.iter().copied().map(f64::from));
            put(&mut self.velocity, i, sensors.velocity.iter().copied().map(f64::from));
        }
        for (state, leg) in self.soles.iter_mut().zip(&spec.legs) {
            *state = sole(leg, |j| self.position[j], |j| self.velocity[j]);
        }
        let mean = mean_velocity(&self.soles, gyro, up, previous);
        for (i, turn) in turns.iter_mut().enumerate() {
            let Some(turn) = turn else { continue };
            for (to, from) in turn.pipeline.soles_mut().iter_mut().zip(&self.soles) {
                *to = from.map(|row| row.0[i]);
            }
            let of = |row: Vec3<Row>| row.map(|row| row.0[i]);
            let Turn {
                sensors, desired, out, ..
            } = turn;
            turn.pipeline
                .give_out(spec, sensors, of(up), finite(of(mean)), *desired, out);
        }
    }
}

/// Sets place `i` of each row.
fn put(rows: &mut [Row], i: usize, values: impl IntoIterator<Item = f64>) {
    for (row, value) in rows.iter_mut().zip(values) {
        row.0[i] = value;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::biped;

    proptest! {
        #[test]
        fn robots_in_a_row_observe_the_same_bits_as_one_alone(
            q in prop::collection::vec(-0.7f32..0.7, 10 * ROW), dq in prop::collection::vec(-3.0f32..3.0, 10 * ROW),
            tilt in prop::array::uniform2(-0.5f32..0.5), gyro in prop::array::uniform3(-2.0f32..2.0), used in 1..=ROW,
        ) {
            let spec = biped();
            let mut alone = vec![Pipeline::new(&spec).unwrap(); used];
            let mut together = alone.clone();
            let mut observer = RowObserver::new(&spec);
            let length = spec.observation_len();
            for step in 0..3 {
                let (mut one, mut all) = (vec![0.0; used * length], vec![0.0; used * length]);
                let sensors = |i: usize| {
                    let at = 10 * ((i + step) % ROW);
                    Sensors {
                        position: &q[at..at + 10],
                        velocity: &dq[at..at + 10],
                        attitude: tilt,
                        gyro: gyro.map(|x| x * i as f32),
                        base_velocity: None,
                    }
                };
                for (i, out) in one.chunks_mut(length).enumerate() {
                    alone[i].observe(&spec, &sensors(i), [0.3, 0.0, 0.1], out);
                }
                let mut rows = together.iter_mut().zip(all.chunks_mut(length)).enumerate();
                let mut turns = core::array::from_fn(|_| {
                    rows.next().map(|(i, (pipeline, out))| Turn {
                        pipeline,
                        sensors: sensors(i),
                        desired: [0.3, 0.0, 0.1],
                        out,
                    })
                });
                observer.observe(&spec, &mut turns);
                let bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                prop_assert_eq!(bits(&one), bits(&all));
                prop_assert_eq!(&alone, &together);
            }
        }
    }
}
