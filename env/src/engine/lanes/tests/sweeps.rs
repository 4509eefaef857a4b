//! Gauss-Seidel sweeps against the converged step.

use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::engine::lanes::engine::Batch;
use crate::engine::lanes::lane::{Lane, Single};
use crate::engine::lanes::model::{ROOT, SWEEPS};
use crate::ground::Ground;

/// Sweeps after which a step is as good as solved.
const CONVERGED: usize = 2000;

/// Errors of the velocity change of a step, relative, along a motion with steps, slips and clamped drives; sorted.
struct Errors {
    /// For every number of sweeps, against the step solved.
    sweeps: Vec<Vec<f64>>,
    /// Of the step solved, against two of half of it.
    halving: Vec<f64>,
}

fn errors(dt: f64, sweeps: &[usize]) -> Errors {
    let robot = nimbro();
    let begin = Start::nominal(&robot);
    let own = World::nominal(&robot, friction(0.6, 0.02, 0.02));
    let batch = |dt| Batch::<Single>::new(&Ground::Plane, &robot, dt, 1);
    let (mut engine, mut whole, mut half) = (batch(dt), batch(dt), batch(0.5 * dt));
    engine.reset(0, &begin, &own);
    let mut errors = Errors {
        sweeps: vec![vec![]; sweeps.len()],
        halving: vec![],
    };
    let mut bytes = vec![];
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut drive = hold(&robot);
    drive.friction.fill(0.5);
    for step in 0..1000 {
        if step % 5 == 0 {
            for d in 0..robot.dofs.len() {
                drive.target[d] = robot.dof(d).nominal + rng.random_range(-0.15..0.15);
            }
        }
        bytes.clear();
        engine.save(0, &mut bytes);
        let change = |other: &mut Batch<Single>, sweeps: usize, steps: usize| {
            other.model.sweeps = sweeps;
            other.load(0, &bytes).expect("same robot");
            let mut total = DVector::zeros(robot.dofs.len() + ROOT);
            for _ in 0..steps {
                other.step(&drive);
                let change = other.work.change.iter().map(|v| v.get(0));
                total += DVector::from_iterator(total.len(), change);
            }
            total
        };
        let exact = change(&mut whole, CONVERGED, 1);
        let error = |other: DVector<f64>| (other - &exact).norm() / exact.norm();
        errors.halving.push(error(change(&mut half, CONVERGED / 10, 2)));
        for (errors, &count) in errors.sweeps.iter_mut().zip(sweeps) {
            errors.push(error(change(&mut whole, count, 1)));
        }
        engine.step(&drive);
        if engine.base(0).position.z < 0.7 * begin.position.z {
            engine.reset(0, &begin, &own);
        }
    }
    for errors in errors.sweeps.iter_mut().chain([&mut errors.halving]) {
        errors.sort_by(f64::total_cmp);
    }
    errors
}

/// The table in docs/performance.md, by `-- --nocapture`.
#[test]
fn sweeps_approach_the_converged_step() {
    let counts = [2, 4, SWEEPS, 8, 12, 24];
    let errors = errors(0.005, &counts);
    let at = |errors: &[f64]| [0.5, 0.95, 0.99].map(|share| errors[(share * errors.len() as f64) as usize]);
    for (count, errors) in counts.iter().zip(&errors.sweeps) {
        let [median, most, all] = at(errors);
        println!("{count:2} sweeps: median {median:.0e}, 95 % {most:.0e}, 99 % {all:.0e}");
    }
    let halving = at(&errors.halving);
    for pair in errors.sweeps.windows(2) {
        let [few, many] = [&pair[0], &pair[1]].map(|errors| at(errors));
        assert!(
            many.iter().zip(few).all(|(many, few)| *many < few),
            "{few:?} to {many:?}"
        );
    }
    // An error that falls as slowly as one over the sweeps would be half as large after twice as many: that of most steps falls
    // geometrically.
    for (few, many) in [(0, 1), (1, 3), (4, 5)] {
        let [few, many] = [few, many].map(|i: usize| at(&errors.sweeps[i])[0]);
        assert!(many < 0.5 * few, "{few} to {many}");
    }
    // What the sweeps leave is less than what the step leaves.
    let left = at(&errors.sweeps[2]);
    assert!(
        left.iter().zip(halving).all(|(left, halving)| *left < halving),
        "{left:?}, {halving:?} by the step"
    );
}
