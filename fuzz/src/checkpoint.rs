//! Checkpoints: what is read is written as the same, and training goes on from it or is refused.

use std::sync::{Arc, LazyLock};

use omniwalk::config::Layers;
use omniwalk::run::checkpoint::Checkpoint;
use omniwalk::settings::{DEFAULT, Settings};
use omniwalk::train::checkpoint::{progress, restore};
use omniwalk_env::robot::{Robot, load_with};
use serde_json::Value;

use super::scratch::with_file;

static ROBOT: LazyLock<Arc<Robot>> = LazyLock::new(|| {
    let urdf = include_bytes!("../corpus/urdf/two_legs.urdf");
    Arc::new(with_file("urdf", urdf, |path| load_with(path, "")).expect("a robot of the corpus"))
});

/// As small as training gets.
const CHANGES: [&str; 7] = [
    "engine.kind=lanes",
    "train.environments=1",
    "train.steps_per_update=2",
    "train.mirror=false",
    "ppo.hidden=[2]",
    "ppo.minibatch=2",
    "ppo.epochs=1",
];

/// The configuration that the corpus was trained with.
pub static SETTINGS: LazyLock<Settings> = LazyLock::new(|| {
    let layers = Layers::new(DEFAULT).expect("the defaults");
    let layers = CHANGES.iter().try_fold(layers, |layers, change| layers.set(change));
    layers
        .and_then(|layers| layers.build())
        .expect("a small configuration")
        .0
});

/// The robot that the corpus was trained with.
pub fn robot() -> Arc<Robot> {
    ROBOT.clone()
}

/// Reads `data` as it is, and once more with its checksum made right: nobody hostile would leave it wrong.
pub fn check(data: &[u8]) {
    go_on(data);
    if let Some(sealed) = seal(data) {
        go_on(&sealed);
    }
}

fn go_on(data: &[u8]) {
    let Ok(checkpoint) = with_file("safetensors", data, Checkpoint::read) else {
        return;
    };
    let again = with_file("safetensors", &[], |path| {
        checkpoint.write(path).expect("room for what was read");
        Checkpoint::read(path)
    });
    assert_eq!(again.expect("what is written can be read").step, checkpoint.step);
    if progress(&checkpoint).is_ok()
        && let Ok(mut trainer) = restore(&checkpoint, &SETTINGS, ROBOT.clone())
    {
        trainer.update();
    }
}

/// The file with the checksum that its content has; `None` for what is no such file.
pub fn seal(data: &[u8]) -> Option<Vec<u8>> {
    let (len, rest) = data.split_first_chunk::<8>()?;
    let (header, body) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*len)).ok()?)?;
    let mut header: Value = serde_json::from_slice(header).ok()?;
    let mut own: Value = serde_json::from_str(header["__metadata__"]["omniwalk"].as_str()?).ok()?;
    let mut crc = crc32c::crc32c(&own["step"].as_u64()?.to_le_bytes());
    // Names are in order: serde_json's objects are sorted.
    for (name, value) in own["metadata"].as_object()? {
        crc = crc32c::crc32c_append(crc, format!("{name}={value}\n").as_bytes());
    }
    for (name, tensor) in header.as_object()?.iter().filter(|(name, _)| *name != "__metadata__") {
        let kind = tensor["dtype"].as_str()?.to_ascii_lowercase();
        let shape: Vec<u64> = tensor["shape"]
            .as_array()?
            .iter()
            .map(Value::as_u64)
            .collect::<Option<_>>()?;
        let at = |i: usize| usize::try_from(tensor["data_offsets"][i].as_u64()?).ok();
        crc = crc32c::crc32c_append(crc, format!("{name}:{kind}{shape:?}\n").as_bytes());
        crc = crc32c::crc32c_append(crc, body.get(at(0)?..at(1)?)?);
    }
    own["crc32c"] = crc.into();
    header["__metadata__"]["omniwalk"] = own.to_string().into();
    let header = header.to_string().into_bytes();
    Some([&(header.len() as u64).to_le_bytes(), &header[..], body].concat())
}
