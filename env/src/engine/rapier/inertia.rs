//! The inertia each degree of freedom feels, with everything else free.

use nalgebra::{DMatrix, DVector, Dyn, Matrix3, OMatrix, U6};
use rapier3d_f64::prelude::*;

use super::scene::{Freedom, Scene, State};

/// Effective inertia of every degree of freedom in the present pose, kg m^2 or kg: `1 / (M^-1)_dd`, where M is
/// the mass matrix, armature included, over the base's velocities and the degrees of freedom with their mimic
/// joints tied to them.
pub(super) fn effective(scene: &Scene, state: &State) -> Vec<f64> {
    let multibody = &state.multibodies.get_multibody(scene.multibody).expect("multibody");
    let base = if scene.floating() { 6 } else { 0 };
    let ties = ties(&scene.freedoms, base, multibody.ndofs());
    let mut mass = ties.transpose() * DMatrix::from_diagonal(multibody.armature()) * &ties;
    for (link, &body) in scene.bodies.iter().enumerate().skip(usize::from(!scene.floating())) {
        let jacobian: OMatrix<f64, U6, Dyn> = multibody.body_jacobian(link) * &ties;
        let (linear, angular) = (jacobian.fixed_rows::<3>(0), jacobian.fixed_rows::<3>(3));
        let properties = state.bodies[body].mass_properties();
        mass += linear.transpose() * linear * properties.local_mprops.mass();
        let inertia = inertia_matrix(&properties.effective_angular_inertia());
        mass += angular.transpose() * inertia * angular;
    }
    let Some(factor) = mass.cholesky() else {
        return vec![0.0; scene.freedoms.len()];
    };
    let inverse_diagonal = |d: usize| {
        let mut unit = DVector::zeros(base + scene.freedoms.len());
        unit[base + d] = 1.0;
        factor.solve(&unit)[base + d]
    };
    (0..scene.freedoms.len()).map(|d| inverse_diagonal(d).recip()).collect()
}

/// Generalized velocities of the multibody from those of the base and the degrees of freedom.
fn ties(freedoms: &[Freedom], base: usize, velocities: usize) -> DMatrix<f64> {
    let mut ties = DMatrix::zeros(velocities, base + freedoms.len());
    (0..base).for_each(|i| ties[(i, i)] = 1.0);
    for (d, freedom) in freedoms.iter().enumerate() {
        for coordinate in &freedom.coordinates {
            ties[(coordinate.velocity, base + d)] = coordinate.multiplier;
        }
    }
    ties
}

fn inertia_matrix(i: &AngularInertia) -> Matrix3<f64> {
    Matrix3::new(i.m11, i.m12, i.m13, i.m12, i.m22, i.m23, i.m13, i.m23, i.m33)
}
