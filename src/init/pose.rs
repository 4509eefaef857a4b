//! A standing pose: knees a little bent, soles flat, level and straight ahead, the centre of mass over their middle.
//!
//! Damped least squares (Levenberg 1944) over the degrees of freedom of the legs, with finite differences.

use nalgebra::{DMatrix, DVector, Isometry3, Vector3};
use omniwalk_env::robot::{Kinematics, Robot};

use super::legs::Leg;

/// How much lower than with straight legs it stands, over the length of the leg.
const SHORTER: f64 = 0.02;
/// Where the search starts: hip, knee and ankle bent as in a human squat, rad.
const SQUAT: [f64; 3] = [-0.2, 0.4, -0.2];
/// Distance to the joints' limits, rad.
const MARGIN: f64 = 0.02;
/// Weight of a radian away from zero against a metre or radian of misplaced sole: decides only what nothing else does.
const LAZINESS: f64 = 1e-3;
const ITERATIONS: usize = 100;
/// Largest change of a joint in an iteration, rad.
const STEP: f64 = 0.2;
const DIFFERENCE: f64 = 1e-6;

/// Joint names and nominal positions of the legs of `robot`, which has feet and limits already; rounded to thousandths, the
/// right leg the mirror image of the left where the robot has a mirror map.
pub(super) fn standing(robot: &Robot, legs: &[Leg]) -> Vec<(String, f64)> {
    let dofs: Vec<usize> = (0..robot.dofs.len())
        .filter(|&dof| legs.iter().any(|leg| leg.joints.contains(&robot.dofs[dof])))
        .collect();
    let mut search = Search::new(robot, legs, dofs);
    search.run();
    let mut positions = search.positions.map(|position| (1000.0 * position).round() / 1000.0);
    mirror(robot, &search.dofs, &mut positions);
    let named = search
        .dofs
        .iter()
        .zip(&positions)
        .map(|(&dof, &position)| (robot.dof(dof).name.clone(), position));
    named.filter(|(_, position)| *position != 0.0).collect()
}

/// Makes the second of two mirrored joints the mirror image of the first.
fn mirror(robot: &Robot, dofs: &[usize], positions: &mut DVector<f64>) {
    let Some(map) = &robot.mirror else { return };
    let place = |policy: usize| dofs.iter().position(|&dof| dof == robot.policy[policy]);
    for (own, twin) in map.iter().enumerate().filter(|(own, twin)| *own < twin.joint) {
        if let (Some(own), Some(other)) = (place(own), place(twin.joint)) {
            positions[other] = twin.sign * positions[own];
        }
    }
}

struct Search<'a> {
    robot: &'a Robot,
    dofs: Vec<usize>,
    positions: DVector<f64>,
    kinematics: Kinematics,
    /// Sideways position of each sole and its height below the base, m.
    wanted: Vec<(f64, f64)>,
}

impl<'a> Search<'a> {
    fn new(robot: &'a Robot, legs: &[Leg], dofs: Vec<usize>) -> Self {
        let mut kinematics = Kinematics::new(robot);
        kinematics.set_pose(robot, &Isometry3::identity(), &vec![0.0; robot.dofs.len()]);
        let wanted = (0..legs.len())
            .map(|foot| {
                let sole = kinematics.sole(robot, foot).translation;
                (sole.y, sole.z + SHORTER * legs[foot].length)
            })
            .collect();
        let mut start = vec![0.0; robot.dofs.len()];
        for (&(dof, axis), bent) in legs.iter().flat_map(|leg| leg.pitch.iter().zip(SQUAT)) {
            start[dof] = axis * bent;
        }
        let positions = DVector::from_iterator(dofs.len(), dofs.iter().map(|&dof| start[dof]));
        let mut search = Self {
            robot,
            dofs,
            positions,
            kinematics,
            wanted,
        };
        search.clamp();
        search
    }

    fn run(&mut self) {
        let n = self.dofs.len();
        for _ in 0..ITERATIONS {
            let residual = self.residual();
            let mut jacobian = DMatrix::zeros(residual.len(), n);
            for column in 0..n {
                let kept = self.positions[column];
                self.positions[column] = kept + DIFFERENCE;
                jacobian.set_column(column, &((self.residual() - &residual) / DIFFERENCE));
                self.positions[column] = kept;
            }
            let damped = jacobian.tr_mul(&jacobian) + DMatrix::identity(n, n) * 1e-6;
            let Some(factors) = damped.cholesky() else { return };
            let change = factors.solve(&jacobian.tr_mul(&residual));
            self.positions -= change.map(|value| value.clamp(-STEP, STEP));
            self.clamp();
        }
    }

    fn clamp(&mut self) {
        for (position, &dof) in self.positions.iter_mut().zip(&self.dofs) {
            let (lower, upper) = self.robot.dof(dof).limits;
            let margin = MARGIN.min((upper - lower) / 2.0);
            *position = position.max(lower + margin).min(upper - margin);
        }
    }

    /// Zero for a standing pose: for each sole tilt, heading, and place, which is below the centre of mass. A foot ahead and one
    /// behind would do as well, so each has its own.
    fn residual(&mut self) -> DVector<f64> {
        let mut positions = vec![0.0; self.robot.dofs.len()];
        for (&dof, &position) in self.dofs.iter().zip(&self.positions) {
            positions[dof] = position;
        }
        self.kinematics.set_pose(self.robot, &Isometry3::identity(), &positions);
        let centre = self
            .kinematics
            .center_of_mass(self.robot.links.iter().map(|link| &link.inertial));
        let mut residual = Vec::new();
        for (foot, &(y, z)) in self.wanted.iter().enumerate() {
            let sole = self.kinematics.sole(self.robot, foot);
            let (up, ahead) = (sole.rotation * Vector3::z(), sole.rotation * Vector3::x());
            residual.extend([up.x, up.y, ahead.y]);
            residual.extend([
                centre.x - sole.translation.x,
                sole.translation.y - y,
                sole.translation.z - z,
            ]);
        }
        residual.extend(self.positions.iter().map(|position| LAZINESS * position));
        DVector::from_vec(residual)
    }
}
