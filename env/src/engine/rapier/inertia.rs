//! The inertia each degree of freedom and each touching link feels, with everything else free.

use nalgebra::{DMatrix, DVector, Dyn, Matrix3, OMatrix, U6};
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

use super::scene::{Freedom, Scene, State};

/// Effective inertias in one pose: `1 / (J M^-1 J')` for the row J of a velocity, where M is the mass matrix, armature
/// included, over the base's velocities and the degrees of freedom with their mimic joints tied to them.
pub(super) struct Effective {
    /// Of every degree of freedom, kg m^2 or kg.
    pub freedoms: Vec<f64>,
    /// Of turning each toucher's link.
    pub touchers: Vec<Turning>,
}

/// Inertias a link feels when it turns, kg m^2.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Turning {
    /// About the vertical.
    pub vertical: f64,
    /// About the horizontal axis that turns most easily.
    pub horizontal: f64,
}

/// Effective inertias in the present pose; zero where the mass matrix is singular.
pub(super) fn effective(scene: &Scene, state: &State) -> Effective {
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
        return Effective {
            freedoms: vec![0.0; scene.freedoms.len()],
            touchers: vec![Turning::default(); scene.touchers.len()],
        };
    };
    // A fixed link has no mobility and needs no friction.
    let felt = |mobility: f64| if mobility > 0.0 { mobility.recip() } else { 0.0 };
    let unit = |d: usize| {
        DVector::from_fn(
            base + scene.freedoms.len(),
            |i, _| if i == base + d { 1.0 } else { 0.0 },
        )
    };
    let turn = |link: usize| {
        let jacobian: OMatrix<f64, U6, Dyn> = multibody.body_jacobian(link) * &ties;
        let rows = jacobian.fixed_rows::<3>(3).transpose();
        let mobility: Matrix3<f64> = rows.transpose() * factor.solve(&rows);
        let horizontal = mobility.fixed_view::<2, 2>(0, 0).into_owned();
        Turning {
            vertical: felt(mobility[(2, 2)]),
            horizontal: felt(horizontal.symmetric_eigenvalues().max()),
        }
    };
    Effective {
        freedoms: (0..scene.freedoms.len())
            .map(|d| {
                let row = unit(d);
                felt(row.dot(&factor.solve(&row)))
            })
            .collect(),
        touchers: scene.touchers.iter().map(|toucher| turn(toucher.link)).collect(),
    }
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
