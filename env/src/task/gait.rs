//! How a robot walks, from foot forces and sole positions: touchdowns, alternation, air time, clearance, slip.
//!
//! Return and episode length look excellent on gaits that vibrate or shuffle; these measures tell them apart. A foot
//! is in contact from the moment it carries 5 % of the weight until it has carried less than 1 % for 20 ms. Slip is
//! measured over control steps in which the foot carries its share of the weight from beginning to end: in those around touchdown
//! and lift-off the foot swings for a part of the time.

use serde::{Deserialize, Serialize};

const CONTACT_SHARE: f64 = 0.05;
const RELEASE_SHARE: f64 = 0.01;
const RELEASE_TIME: f64 = 0.02;

/// Sums over an episode, one entry a foot where feet differ.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GaitMeter {
    weight: f64,
    feet: Vec<FootMeter>,
    last_touchdown: Option<usize>,
    counted: u32,
    alternating: u32,
    /// Touchdowns that do not alternate: of the control step that is over, and so far.
    taps: [u32; 2],
    time: f64,
    double_support: f64,
    flight: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct FootMeter {
    contact: bool,
    /// In contact and under load in every physics step since the last control step.
    loaded: bool,
    /// Time without load, s.
    unloaded: f64,
    /// Highest lowest point of the sole in the present swing, m.
    height: f64,
    touchdowns: u32,
    air_time: f64,
    clearance: f64,
    slip: f64,
    loaded_time: f64,
    position: [f64; 2],
    /// Horizontal speed of the sole's centre over the last control step, m/s.
    speed: f64,
}

/// The gait of an episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Gait {
    /// Share of touchdowns whose foot is not the one before's.
    pub alternation: f64,
    /// Touchdowns of all feet per second.
    pub touchdowns_per_second: f64,
    /// Mean over swings of the highest position of the sole's lowest corner, m.
    pub clearance_m: f64,
    /// Mean duration of a swing, s.
    pub air_time_s: f64,
    /// Mean horizontal speed of loaded soles, m/s.
    pub slip_mps: f64,
    /// Share of the time with two feet or more in contact.
    pub double_support: f64,
    /// Share of the time with no foot in contact.
    pub flight: f64,
}

/// A sole at the end of a control step, world frame but for heights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sole {
    /// Centre, m; its z is the height above the ground under it.
    pub centre: [f64; 3],
    /// Height of the lowest corner above the ground under it, m.
    pub lowest: f64,
    /// Rotation about the horizontal forward axis of the sole, rad.
    pub roll: f64,
}

impl FootMeter {
    /// On the ground at `position`.
    fn new(position: [f64; 2]) -> Self {
        Self {
            contact: true,
            loaded: true,
            unloaded: 0.0,
            height: 0.0,
            touchdowns: 0,
            air_time: 0.0,
            clearance: 0.0,
            slip: 0.0,
            loaded_time: 0.0,
            position,
            speed: 0.0,
        }
    }
}

impl GaitMeter {
    /// A meter for `feet` feet of a robot that weighs `weight` N.
    pub fn new(feet: usize, weight: f64) -> Self {
        Self {
            weight,
            feet: vec![FootMeter::new([0.0; 2]); feet],
            last_touchdown: None,
            counted: 0,
            alternating: 0,
            taps: [0; 2],
            time: 0.0,
            double_support: 0.0,
            flight: 0.0,
        }
    }

    /// Whether it is of as many feet as `own`.
    pub(super) fn has_shape_of(&self, own: &Self) -> bool {
        self.feet.len() == own.feet.len()
    }

    /// Starts an episode with the soles at `soles`.
    pub fn reset(&mut self, soles: &[Sole]) {
        let feet = std::mem::take(&mut self.feet);
        *self = Self {
            feet,
            ..Self::new(0, self.weight)
        };
        for (foot, sole) in self.feet.iter_mut().zip(soles) {
            *foot = FootMeter::new([sole.centre[0], sole.centre[1]]);
        }
    }

    /// Takes in the vertical force on foot `i` over a physics step of `dt` s.
    pub fn force(&mut self, i: usize, vertical: f64, dt: f64) {
        let foot = &mut self.feet[i];
        foot.loaded &= vertical > CONTACT_SHARE * self.weight;
        if vertical > CONTACT_SHARE * self.weight {
            if !foot.contact {
                foot.contact = true;
                foot.touchdowns += 1;
                foot.air_time += foot.unloaded;
                foot.clearance += foot.height;
                if let Some(last) = self.last_touchdown {
                    self.counted += 1;
                    self.alternating += u32::from(last != i);
                }
                self.last_touchdown = Some(i);
            }
            foot.unloaded = 0.0;
        } else if vertical < RELEASE_SHARE * self.weight || !foot.contact {
            foot.unloaded += dt;
            if foot.contact && foot.unloaded >= RELEASE_TIME {
                foot.contact = false;
                foot.height = 0.0;
            }
        } else {
            foot.unloaded = 0.0;
        }
    }

    /// Takes in the soles at the end of a control step of `dt` s.
    pub fn soles(&mut self, soles: &[Sole], dt: f64) {
        let mut contacts = 0;
        for (foot, sole) in self.feet.iter_mut().zip(soles) {
            let [x, y] = foot.position;
            let (dx, dy) = (sole.centre[0] - x, sole.centre[1] - y);
            let moved = (dx * dx + dy * dy).sqrt();
            foot.position = [sole.centre[0], sole.centre[1]];
            foot.speed = moved / dt;
            if foot.contact {
                contacts += 1;
            } else {
                foot.height = foot.height.max(sole.lowest);
            }
            if foot.loaded {
                foot.slip += moved;
                foot.loaded_time += dt;
            }
            foot.loaded = true;
        }
        let taps = self.counted - self.alternating;
        self.taps = [taps - self.taps[1], taps];
        self.time += dt;
        self.double_support += if contacts >= 2 { dt } else { 0.0 };
        self.flight += if contacts == 0 { dt } else { 0.0 };
    }

    /// Sum over the feet in contact of the squared horizontal speed of the sole in the last control step, (m/s)^2: slip,
    /// and whatever speed a foot touches down and leaves the ground with.
    pub fn slip_squared(&self) -> f64 {
        self.feet
            .iter()
            .filter(|foot| foot.contact)
            .map(|foot| foot.speed * foot.speed)
            .sum()
    }

    /// Touchdowns in the last control step of feet that had been the last to touch down, too.
    pub fn taps(&self) -> u32 {
        self.taps[0]
    }

    /// Whether foot `i` is in contact.
    pub fn contact(&self, i: usize) -> bool {
        self.feet[i].contact
    }

    /// The episode so far.
    pub fn gait(&self) -> Gait {
        let sum = |f: fn(&FootMeter) -> f64| self.feet.iter().map(f).sum::<f64>();
        let touchdowns = sum(|foot| f64::from(foot.touchdowns));
        let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
        Gait {
            alternation: ratio(f64::from(self.alternating), f64::from(self.counted)),
            touchdowns_per_second: ratio(touchdowns, self.time),
            clearance_m: ratio(sum(|foot| foot.clearance), touchdowns),
            air_time_s: ratio(sum(|foot| foot.air_time), touchdowns),
            slip_mps: ratio(sum(|foot| foot.slip), sum(|foot| foot.loaded_time)),
            double_support: ratio(self.double_support, self.time),
            flight: ratio(self.flight, self.time),
        }
    }

    /// Touchdowns per second of the first two feet; not a number where there is none.
    pub fn touchdowns_per_second(&self) -> [f64; 2] {
        [0, 1].map(|i| {
            let touchdowns = self.feet.get(i).map(|foot| f64::from(foot.touchdowns));
            touchdowns.map_or(f64::NAN, |touchdowns| touchdowns / self.time.max(1e-9))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A trot: each foot 0.4 s on the ground, 0.4 s in the air, the feet in opposite phase, 10 cm a swing.
    fn synthetic(slip: f64) -> Gait {
        let mut meter = GaitMeter::new(2, 100.0);
        meter.reset(&[Sole::default(); 2]);
        let mut x = [0.0; 2];
        for step in 0..3200 {
            // The feet change in the middle of a control step.
            let t = f64::from(step) * 0.005 + 0.0125;
            let swings = [(t / 0.4) as i64 % 2 == 0, (t / 0.4) as i64 % 2 == 1];
            for i in 0..2 {
                meter.force(i, if swings[i] { 0.0 } else { 100.0 }, 0.005);
                x[i] += if swings[i] { 0.25 * 0.005 } else { slip * 0.005 };
            }
            if step % 5 == 4 {
                let sole = |i: usize| Sole {
                    centre: [x[i], 0.0, 0.0],
                    lowest: if swings[i] {
                        0.05 * (std::f64::consts::PI * (t % 0.4) / 0.4).sin()
                    } else {
                        0.0
                    },
                    roll: 0.0,
                };
                meter.soles(&[sole(0), sole(1)], 0.025);
            }
        }
        meter.gait()
    }

    #[test]
    fn a_synthetic_walk_is_measured_as_it_was_made() {
        let gait = synthetic(0.05);
        assert_eq!(gait.alternation, 1.0);
        assert!((gait.touchdowns_per_second - 2.5).abs() < 0.1, "{gait:?}");
        assert!((gait.air_time_s - 0.4).abs() < 0.011, "{gait:?}");
        assert!((gait.clearance_m - 0.05).abs() < 0.001, "{gait:?}");
        assert!((gait.slip_mps - 0.05).abs() < 1e-9, "{gait:?}");
    }

    #[test]
    fn a_foot_that_touches_down_twice_in_a_row_taps_once_in_the_control_step_of_the_second() {
        let mut meter = GaitMeter::new(2, 100.0);
        meter.reset(&[Sole::default(); 2]);
        // The left foot is on the ground where the bit is set, one control step of 25 ms each; the right one never.
        let taps: Vec<u32> = [1, 0, 1, 1, 0, 1, 1]
            .into_iter()
            .map(|on| {
                (0..5).for_each(|_| meter.force(0, 100.0 * f64::from(on), 0.005));
                meter.force(1, 0.0, 0.025);
                meter.soles(&[Sole::default(); 2], 0.025);
                meter.taps()
            })
            .collect();
        // Feet begin on the ground: the touchdown in the third step is the first.
        assert_eq!(taps, [0, 0, 0, 0, 0, 1, 0]);
    }

    #[test]
    fn chatter_shorter_than_the_release_time_is_no_step() {
        let mut meter = GaitMeter::new(1, 100.0);
        for step in 0..1000 {
            meter.force(0, if step % 4 == 0 { 100.0 } else { 0.0 }, 0.005);
        }
        assert_eq!(meter.gait().touchdowns_per_second, 0.0);
        assert_eq!(meter.feet[0].touchdowns, 0);
    }
}
