//! The checkpoint of the smallest training there is.

use std::fs;

use super::checks::checkpoint::{SETTINGS, robot};
use omniwalk::run::checkpoint::Checkpoint;
use omniwalk::train::checkpoint::save;
use omniwalk::train::shape::Shape;
use omniwalk::train::trainer::Trainer;

/// Names and bytes of the files.
pub fn files() -> Vec<(String, Vec<u8>)> {
    let mut trainer = Trainer::new(&SETTINGS, robot()).expect("a small training");
    for _ in 0..2 {
        trainer.update();
    }
    let no_files = std::env::temp_dir().join(format!("omniwalk-seed-{}", std::process::id()));
    fs::create_dir_all(&no_files).expect("a writable folder");
    let shape = Shape::new(&SETTINGS, &no_files).expect("a shape");
    fs::remove_dir(&no_files).expect("an empty folder");
    let trained = save(&trainer, &shape).expect("a checkpoint");
    let mut little = Checkpoint::new(7);
    little.insert("a", &[2], &[1.0_f32, f32::NAN]);
    little.insert("b", &[], &[3_u64]);
    little.metadata.insert("seed".into(), 1.into());
    vec![
        ("trained.safetensors".into(), bytes(&trained)),
        ("little.safetensors".into(), bytes(&little)),
    ]
}

fn bytes(checkpoint: &Checkpoint) -> Vec<u8> {
    let path = std::env::temp_dir().join(format!("omniwalk-seed-{}.safetensors", std::process::id()));
    checkpoint.write(&path).expect("a writable folder");
    let bytes = fs::read(&path).expect("what was written");
    fs::remove_file(path).expect("what was written");
    bytes
}
