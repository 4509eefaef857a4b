//! What went wrong in a run, from its `metrics.csv`: by the same rules as the progress line.

use std::path::Path;

use crate::run::metrics::{Metrics, MetricsError};
use crate::train::health::Symptom;

/// A symptom over a run.
struct Spell {
    first: Symptom,
    from: u64,
    to: u64,
    updates: usize,
}

/// A sentence for each thing that was wrong with the run whose metrics are at `path`, of a policy of `joints` joints; without
/// that number the entropy is not judged. Empty for a run that learned.
///
/// # Errors
/// [`MetricsError`].
pub fn warnings(path: &Path, joints: Option<usize>) -> Result<Vec<String>, MetricsError> {
    let mut spells: Vec<Spell> = Vec::new();
    let (mut lost, mut lost_from) = (0.0, None);
    // No entropy is below what so many joints may have.
    let joints = joints.unwrap_or(usize::MAX);
    let metrics = Metrics::scan(path, |metrics| {
        let Some((step, values)) = &metrics.last else { return };
        let figure = |name: &str| {
            let column = metrics.columns.iter().position(|column| column == name);
            column
                .and_then(|column| values.get(column))
                .copied()
                .unwrap_or(f64::NAN)
        };
        if figure("episode/lost") > 0.0 {
            lost += figure("episode/lost");
            lost_from.get_or_insert(*step);
        }
        if let Some(symptom) = Symptom::of(figure, joints) {
            note(&mut spells, symptom, *step);
        }
    })?;
    let of_all = |spell: &Spell| {
        format!(
            "{}; so in {} of {} recorded updates, first after {} steps, last after {}",
            spell.first, spell.updates, metrics.rows, spell.from, spell.to
        )
    };
    let mut said: Vec<String> = spells.iter().map(of_all).collect();
    if let Some(from) = lost_from {
        said.push(format!(
            "{lost} episodes lost to numbers that were not finite, the first after {from} steps"
        ));
    }
    Ok(said)
}

fn note(spells: &mut Vec<Spell>, symptom: Symptom, step: u64) {
    match spells.iter_mut().find(|spell| spell.first.is_like(&symptom)) {
        Some(spell) => {
            spell.to = step;
            spell.updates += 1;
        }
        None => spells.push(Spell {
            first: symptom,
            from: step,
            to: step,
            updates: 1,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::metrics::MetricsWriter;

    #[test]
    fn a_symptom_is_told_once_with_when_and_how_often() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let columns = ["update", "ppo/kl", "ppo/entropy", "episode/lost"];
        let mut writer = MetricsWriter::create(&path, &columns).unwrap();
        for update in 1..=10u64 {
            let kl = if (4..=6).contains(&update) {
                0.1 * update as f64
            } else {
                0.01
            };
            let entropy = if update == 9 { -90.0 } else { -14.0 };
            let lost = if update == 7 { 2.0 } else { 0.0 };
            writer
                .append(100 * update, &[update as f64, kl, entropy, lost])
                .unwrap();
        }
        let said = warnings(&path, Some(16)).unwrap();
        assert_eq!(said.len(), 3, "{said:?}");
        for part in [
            "KL of 0.40",
            "in 3 of 10 recorded updates, first after 400 steps, last after 600",
        ] {
            assert!(said[0].contains(part), "{said:?}");
        }
        assert!(said[1].contains("entropy collapsed to -5.6"), "{said:?}");
        assert!(
            said[2].contains("2 episodes lost") && said[2].contains("after 700"),
            "{said:?}"
        );
        assert_eq!(warnings(&path, None).unwrap().len(), 2);
    }
}
