//! Configurations: what is accepted is written whole and read again as the same.

use omniwalk::config::Layers;
use omniwalk::settings::{DEFAULT, Settings};

/// Lays `data` over the defaults.
pub fn check(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    let layers = Layers::new(DEFAULT).expect("the defaults");
    // The same text as `--set` takes it.
    let _ = layers.clone().set(text).and_then(|layers| layers.build::<Settings>());
    let Ok((settings, whole)) = layers.text("input", text).and_then(|layers| layers.build::<Settings>()) else {
        return;
    };
    let again = Layers::new(&whole).and_then(|layers| layers.build::<Settings>());
    let (again, text) = again.unwrap_or_else(|error| panic!("{error:?}\n{whole}"));
    assert_eq!(settings, again);
    assert_eq!(whole, text);
}
