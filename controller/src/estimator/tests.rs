//! The estimator on a made-up walk whose true velocity is known: the base sways, rolls, nods and turns along a curve, the
//! feet rest at footholds (on their front edge, as the nodding base carries the soles) and swing between them.

use alloc::vec::Vec;
use core::f32::consts::{PI, TAU};

use super::*;
use crate::{
    attitude::{fused_yaw, up_from_orientation},
    kinematics::sole,
    math::{Quat, axis_angle, compose, rotate, rotate_z},
    spec::Spec,
    testing::biped,
};

const CYCLE: f32 = 0.8;
const STANCE: f32 = 0.6;
const CLEARANCE: f32 = 0.03;
const NOISE: f32 = 1e-3;

/// Position and orientation of the base at time `t`, s.
fn base(t: f32) -> (Vec3, Quat) {
    let phase = TAU * t / CYCLE;
    let heading = 0.3 * t;
    let radius = 0.4 / 0.3;
    let path = [
        radius * heading.sin(),
        radius * (1.0 - heading.cos()),
        0.64 + 0.005 * (2.0 * phase).cos(),
    ];
    let sway = rotate_z(heading, [0.0, 0.03 * phase.sin(), 0.0]);
    let pitch = axis_angle([0.0, 1.0, 0.0], 0.05 + 0.02 * (2.0 * phase).sin());
    let roll = axis_angle([1.0, 0.0, 0.0], 0.04 * phase.sin());
    (
        add(path, sway),
        compose(axis_angle([0.0, 0.0, 1.0], heading), compose(pitch, roll)),
    )
}

/// Front edge of foot `side` (1 left, -1 right) at time `t`: position of its middle and yaw.
fn foothold(side: f32, t: f32) -> (Vec3, f32) {
    let cycles = t / CYCLE + 0.25 * side;
    let (step, phase) = (cycles.floor(), cycles - cycles.floor());
    // Place and yaw of a stance: under the path in the middle of it.
    let place = |step: f32| {
        let middle = (step + 0.5 * STANCE - 0.25 * side) * CYCLE;
        let heading = 0.3 * middle;
        let radius = 0.4 / 0.3;
        let path = [radius * heading.sin(), radius * (1.0 - heading.cos()), 0.0];
        (add(path, rotate_z(heading, [0.15, 0.09 * side, 0.0])), heading)
    };
    let ((from, yaw), (to, next_yaw)) = (place(step), place(step + 1.0));
    let swing = ((phase - STANCE) / (1.0 - STANCE)).max(0.0);
    let share = swing - (TAU * swing).sin() / TAU;
    let height = CLEARANCE * (PI * swing).sin().powi(2);
    let way = scale(add(to, scale(from, -1.0)), share);
    (add(add(from, way), [0.0, 0.0, height]), yaw + (next_yaw - yaw) * share)
}

/// How far the foot of `leg` is off its foothold: position, yaw, and the height difference of its sides.
fn miss(spec: &Spec, leg: usize, q: &[f32; 10], t: f32) -> [f32; 5] {
    let (origin, orientation) = base(t);
    let sole = sole::<f32>(&spec.legs[leg], |j| q[j], |_| 0.0);
    let edge = scale(add(sole.corners[0], sole.corners[1]), 0.5);
    let (place, yaw) = foothold(1.0 - 2.0 * leg as f32, t);
    let [x, y, z] = add(add(origin, rotate(orientation, edge)), scale(place, -1.0));
    let world = compose(orientation, sole.rotation);
    [x, y, z, fused_yaw(world) - yaw, rotate(world, [0.0, 1.0, 0.0])[2]]
}

/// Joint positions that put both feet where they belong at `t`: Newton's method on five joints a leg.
fn posture(spec: &Spec, t: f32, guess: [f32; 10]) -> [f32; 10] {
    let mut q = guess;
    for leg in 0..2 {
        for _ in 0..12 {
            let now = miss(spec, leg, &q, t);
            let mut system = [[0.0f32; 6]; 5];
            for joint in 0..5 {
                let mut moved = q;
                moved[5 * leg + joint] += 1e-3;
                let then = miss(spec, leg, &moved, t);
                (0..5).for_each(|row| system[row][joint] = (then[row] - now[row]) / 1e-3);
            }
            (0..5).for_each(|row| system[row][5] = -now[row]);
            let change = solve(system);
            (0..5).for_each(|joint| q[5 * leg + joint] += change[joint].clamp(-0.3, 0.3));
        }
        let left = miss(spec, leg, &q, t);
        assert!(left.iter().all(|x| x.abs() < 1e-5), "no posture at {t}: {left:?}");
    }
    q
}

/// Gauss-Jordan elimination with pivoting of five equations, the right side in the last column.
fn solve(mut rows: [[f32; 6]; 5]) -> [f32; 5] {
    for column in 0..5 {
        let pivot = (column..5).max_by(|&a, &b| rows[a][column].abs().total_cmp(&rows[b][column].abs()));
        rows.swap(column, pivot.expect("five rows"));
        let row = rows[column].map(|x| x / rows[column][column]);
        rows[column] = row;
        for other in (0..5).filter(|&other| other != column) {
            let factor = rows[other][column];
            (0..6).for_each(|k| rows[other][k] -= factor * row[k]);
        }
    }
    rows.map(|row| row[5])
}

/// What the robot measures at an instant, and the true velocity of its base in the base frame.
struct Instant {
    position: [f32; 10],
    velocity: [f32; 10],
    orientation: Quat,
    gyro: Vec3,
    truth: Vec3,
}

fn instant(spec: &Spec, t: f32, guess: [f32; 10]) -> Instant {
    let step = 4e-3;
    let position = posture(spec, t, guess);
    let (ahead, behind) = (posture(spec, t + step, position), posture(spec, t - step, position));
    let velocity = core::array::from_fn(|i| (ahead[i] - behind[i]) / (2.0 * step));
    let ((_, orientation), (later, turned), (sooner, before)) = (base(t), base(t + step), base(t - step));
    let inverse = |[x, y, z, w]: Quat| [-x, -y, -z, w];
    let [x, y, z, _] = compose(inverse(before), turned);
    let displacement = add(later, scale(sooner, -1.0));
    Instant {
        position,
        velocity,
        orientation,
        gyro: scale([x, y, z], 2.0 / (2.0 * step)),
        truth: rotate(inverse(orientation), scale(displacement, 1.0 / (2.0 * step))),
    }
}

/// Five seconds of the walk at the control rate.
fn walk(spec: &Spec) -> Vec<Instant> {
    let mut guess = [0.0, 0.05, -0.35, 0.7, 0.0, 0.0, -0.05, -0.35, 0.7, 0.0];
    (0..200)
        .map(|step| {
            let instant = instant(spec, step as f32 / spec.control_hz + 7e-3, guess);
            guess = instant.position;
            instant
        })
        .collect()
}

/// Normally distributed numbers from a fixed seed (xorshift, sum of twelve).
struct Noise(u32);

impl Noise {
    fn next(&mut self, sigma: f32) -> f32 {
        let sum: f32 = (0..12)
            .map(|_| {
                self.0 ^= self.0 << 13;
                self.0 ^= self.0 >> 17;
                self.0 ^= self.0 << 5;
                self.0 as f32 / u32::MAX as f32
            })
            .sum();
        sigma * (sum - 6.0)
    }
}

type Rule = fn(&[Sole; 2], Vec3, Vec3, Vec3) -> Vec3;

/// Root mean square of the velocity error over the walk and several draws of noise and constant offsets (standard
/// deviations in rad and rad/s; joints and attitude), m/s, and the largest error.
fn error(spec: &Spec, walk: &[Instant], noise: f32, offset: f32, rule: Rule) -> (f32, f32) {
    let (mut sum, mut largest) = (0.0f32, 0.0f32);
    let draws = 8;
    for draw in 1..=draws {
        let mut random = Noise(0x9E37_79B9_u32.wrapping_mul(draw));
        let joint_offset: [f32; 10] = core::array::from_fn(|_| random.next(offset));
        let tilt = [random.next(offset), random.next(offset), 0.0];
        let mut estimate = [0.0; 3];
        for (step, instant) in walk.iter().enumerate() {
            let position = core::array::from_fn(|i| instant.position[i] + joint_offset[i] + random.next(noise));
            let velocity = instant.velocity.map(|dq| dq + random.next(noise));
            let up = add(tilt, up_from_orientation(instant.orientation)).map(|x| x + random.next(0.1 * noise));
            let gyro = instant.gyro.map(|w| w + random.next(0.1 * noise));
            let soles = soles(spec, &position, &velocity);
            estimate = rule(&soles, gyro, up, estimate);
            // The first quarter second is for finding the velocity: the walk starts at full speed.
            if step >= 10 {
                let wrong = add(estimate, scale(instant.truth, -1.0));
                sum += dot(wrong, wrong);
                largest = largest.max(dot(wrong, wrong).sqrt());
            }
        }
    }
    ((sum / (draws as usize * (walk.len() - 10)) as f32).sqrt(), largest)
}

fn soles(spec: &Spec, position: &[f32; 10], velocity: &[f32; 10]) -> [Sole; 2] {
    [0, 1].map(|leg| sole(&spec.legs[leg], |j| f64::from(position[j]), |j| f64::from(velocity[j])))
}

fn ours(soles: &[Sole; 2], gyro: Vec3, up: Vec3, previous: Vec3) -> Vec3 {
    let [gyro, up, previous] = [gyro, up, previous].map(|v| v.map(f64::from));
    base_velocity(soles, gyro, up, previous)
        .expect("finite")
        .map(|x| x as f32)
}

/// The lowest corner alone.
fn lowest_corner(soles: &[Sole; 2], gyro: Vec3, up: Vec3, _: Vec3) -> Vec3 {
    let up = up.map(f64::from);
    let corners = soles.iter().flat_map(|sole| sole.corners.map(|corner| (sole, corner)));
    let lowest = corners
        .min_by(|a, b| dot(up, a.1).total_cmp(&dot(up, b.1)))
        .expect("eight corners");
    resting(lowest.0, lowest.1, gyro.map(f64::from)).map(|x| x as f32)
}

/// The centre of the lower sole: the usual "stance foot".
fn lower_sole(soles: &[Sole; 2], gyro: Vec3, up: Vec3, _: Vec3) -> Vec3 {
    let up = up.map(f64::from);
    let lower = soles
        .iter()
        .min_by(|a, b| dot(up, a.position).total_cmp(&dot(up, b.position)))
        .expect("two soles");
    resting(lower, lower.position, gyro.map(f64::from)).map(|x| x as f32)
}

#[test]
fn perfect_readings_give_the_true_velocity() {
    let spec = biped();
    let (rms, largest) = error(&spec, &walk(&spec), 0.0, 0.0, ours);
    assert!(rms < 0.005 && largest < 0.02, "{rms} {largest}");
}

#[test]
fn sensor_noise_of_the_thesis_costs_millimetres_a_second() {
    let spec = biped();
    let (rms, largest) = error(&spec, &walk(&spec), NOISE, 0.0, ours);
    assert!(rms < 0.005 && largest < 0.02, "{rms} {largest}");
}

/// With joint and attitude offsets of 0.01 rad the wrong foot is often the lower one around touchdown; what a
/// foot's velocity says about the base then tells them apart.
#[test]
fn offsets_mislead_the_lowest_point_but_not_the_estimator() {
    let spec = biped();
    let walk = walk(&spec);
    let (rms, largest) = error(&spec, &walk, NOISE, 0.01, ours);
    assert!(rms < 0.015 && largest < 0.1, "{rms} {largest}");
    for other in [lowest_corner, lower_sole] {
        let (other_rms, other_largest) = error(&spec, &walk, NOISE, 0.01, other);
        assert!(
            2.0 * rms < other_rms && 2.0 * largest < other_largest,
            "{rms} {other_rms}, {largest} {other_largest}"
        );
    }
}

#[test]
fn a_wrong_memory_is_forgotten_in_one_stance() {
    let spec = biped();
    let mut estimate = [-1.0, 1.0, 0.5];
    for (step, instant) in walk(&spec).iter().enumerate() {
        let soles = soles(&spec, &instant.position, &instant.velocity);
        estimate = ours(&soles, instant.gyro, up_from_orientation(instant.orientation), estimate);
        let wrong = add(estimate, scale(instant.truth, -1.0));
        assert!(step < 16 || dot(wrong, wrong).sqrt() < 0.02, "step {step}: {wrong:?}");
    }
}

#[test]
fn without_legs_or_with_broken_readings_there_is_no_estimate() {
    let up = [0.0, 0.0, 1.0];
    let spec = biped();
    assert_eq!(base_velocity(&[], [0.0; 3], up, [0.0; 3]), None);
    let mut position = [0.0; 10];
    position[3] = f32::NAN;
    let soles = soles(&spec, &position, &[0.0; 10]);
    assert_eq!(base_velocity(&soles, [0.0; 3], up, [0.0; 3]), None);
}
