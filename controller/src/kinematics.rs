//! Forward kinematics of a leg: pose and velocity of its sole relative to the base.

use serde::{Deserialize, Serialize};

use crate::{
    math::{IDENTITY, Quat, Vec3, add, axis_angle, compose, cross, rotate, scale},
    number::Number,
    spec::Leg,
};

/// A sole relative to the base, in the base frame: what an observer on the base sees, whatever the base itself does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sole<N = f64> {
    /// Centre of the four corners, m.
    pub position: [N; 3],
    /// Orientation of the sole frame, unit quaternion x, y, z, w.
    pub rotation: [N; 4],
    /// Velocity of the centre, m/s.
    pub velocity: [N; 3],
    /// Angular velocity, rad/s.
    pub angular_velocity: [N; 3],
    /// Corners in the order of [`Leg::corners`], m.
    pub corners: [[N; 3]; 4],
}

impl<N: Number> Sole<N> {
    /// Velocity of a point that moves with the sole, m/s; the point and the result in the base frame.
    #[inline(always)]
    pub fn velocity_at(&self, point: [N; 3]) -> [N; 3] {
        let arm = add(point, scale(self.position, N::of(-1.0)));
        add(self.velocity, cross(self.angular_velocity, arm))
    }

    /// The same numbers by `f`, in another type.
    #[inline(always)]
    pub(crate) fn map<M>(&self, f: impl Fn(N) -> M) -> Sole<M> {
        Sole {
            position: self.position.map(&f),
            rotation: self.rotation.map(&f),
            velocity: self.velocity.map(&f),
            angular_velocity: self.angular_velocity.map(&f),
            corners: self.corners.map(|corner| corner.map(&f)),
        }
    }
}

/// The sole of `leg` at joint positions `position` (rad or m) and velocities `velocity` (rad/s or m/s) of the policy's
/// joints, by index.
pub fn sole<N: Number>(leg: &Leg, position: impl Fn(usize) -> N, velocity: impl Fn(usize) -> N) -> Sole<N> {
    let zero = N::of(0.0);
    let mut frame = Frame {
        origin: [zero; 3],
        rotation: of(IDENTITY),
        velocity: [zero; 3],
        angular_velocity: [zero; 3],
    };
    for segment in &leg.segments {
        let (value, rate) = match segment.joint {
            Some(joint) => {
                let (joint, multiplier) = (usize::from(joint), N::of(f64::from(segment.multiplier)));
                (
                    multiplier * position(joint) + N::of(f64::from(segment.offset)),
                    multiplier * velocity(joint),
                )
            }
            None => (N::of(f64::from(segment.offset)), zero),
        };
        if segment.translation != [0.0; 3] {
            frame.translate(of(segment.translation));
        }
        if segment.rotation != IDENTITY {
            frame.rotation = compose(frame.rotation, of(segment.rotation));
        }
        let own = of(segment.axis);
        let axis = rotate(frame.rotation, own);
        if segment.prismatic {
            frame.shift(scale(axis, value));
            frame.velocity = add(frame.velocity, scale(axis, rate));
        } else {
            frame.angular_velocity = add(frame.angular_velocity, scale(axis, rate));
            frame.rotation = compose(frame.rotation, axis_angle(own, value));
        }
    }
    let ankle = frame;
    frame.translate(scale(
        leg.corners.iter().map(|&corner| of(corner)).fold([zero; 3], add),
        N::of(0.25),
    ));
    Sole {
        position: frame.origin,
        rotation: compose(ankle.rotation, of(leg.sole_rotation)),
        velocity: frame.velocity,
        angular_velocity: frame.angular_velocity,
        corners: leg
            .corners
            .map(|corner| add(ankle.origin, rotate(ankle.rotation, of(corner)))),
    }
}

/// Numbers of the spec as those of a robot or row.
fn of<N: Number, const K: usize>(numbers: [f32; K]) -> [N; K] {
    numbers.map(|x| N::of(f64::from(x)))
}

/// A frame on its way along the chain, seen from the base.
#[derive(Clone, Copy)]
struct Frame<N> {
    origin: Vec3<N>,
    rotation: Quat<N>,
    velocity: Vec3<N>,
    angular_velocity: Vec3<N>,
}

impl<N: Number> Frame<N> {
    /// Moves the origin by `offset`, given in this frame, to another point of the same body.
    #[inline(always)]
    fn translate(&mut self, offset: Vec3<N>) {
        self.shift(rotate(self.rotation, offset));
    }

    /// Moves the origin by `arm`, given in the base frame, to another point of the same body.
    #[inline(always)]
    fn shift(&mut self, arm: Vec3<N>) {
        self.origin = add(self.origin, arm);
        self.velocity = add(self.velocity, cross(self.angular_velocity, arm));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::{biped, sliding_leg};

    #[test]
    fn a_straight_leg_hangs_below_its_hip() {
        let spec = biped();
        let left = sole(&spec.legs[0], |_| 0.0f64, |_| 0.0);
        let expected = [0.03, 0.09, -0.70];
        for (found, expected) in left.position.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{:?}", left.position);
        }
        assert_eq!(left.velocity, [0.0; 3]);
    }

    #[test]
    fn a_follower_keeps_the_sole_parallel_to_the_base() {
        let spec = biped();
        // hip yaw, roll, pitch, knee, ankle roll; the ankle pitch of the test robot follows -(hip pitch + knee) by two segments.
        let mut q = [0.0; 10];
        q[2] = -0.4;
        q[3] = 0.9;
        let rotation = sole(&spec.legs[0], |j| q[j], |_| 0.0f64).rotation;
        assert!(rotation[3].abs() > 1.0 - 1e-6, "{rotation:?}");
    }

    proptest! {
        #[test]
        fn velocities_are_the_derivatives_of_positions(
            q in prop::array::uniform10(-0.7f64..0.7), dq in prop::array::uniform10(-3.0f64..3.0), slide in any::<bool>(),
        ) {
            let leg = if slide { sliding_leg() } else { biped().legs[0].clone() };
            let step = 2e-3;
            let at = |time: f64| sole(&leg, |j| q[j] + time * dq[j], |j| dq[j]);
            let (ahead, behind, now) = (at(step), at(-step), at(0.0));
            for corner in 0..4 {
                let velocity = now.velocity_at(now.corners[corner]);
                for (axis, velocity) in velocity.iter().enumerate() {
                    let difference = (ahead.corners[corner][axis] - behind.corners[corner][axis]) / (2.0 * step);
                    prop_assert!((difference - velocity).abs() < 5e-3, "{difference} {velocity}");
                }
            }
        }

        #[test]
        fn the_centre_is_the_mean_of_the_corners(q in prop::array::uniform10(-0.7f64..0.7)) {
            let sole = sole(&biped().legs[1], |j| q[j], |_| 0.0);
            for axis in 0..3 {
                let mean = sole.corners.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0;
                prop_assert!((mean - sole.position[axis]).abs() < 1e-6);
            }
        }
    }
}
