//! Describes a configuration: what it changes.

use std::path::Path;

use crate::config::{ConfigError, Layers};
use crate::files;
use crate::run::MAX_CONFIG_BYTES;
use crate::settings::Settings;

pub(super) fn describe(path: &Path, defaults: &Layers) -> Result<String, ConfigError> {
    let layers = defaults.clone().file(path)?;
    layers.build::<Settings>()?;
    let changes = layers.changes();
    let mut text = match changes.len() {
        0 if is_empty(path) => "configuration: empty, all defaults; a run's has every value\n".to_owned(),
        0 => "configuration: all defaults\n".to_owned(),
        n => format!("configuration: {n} values differ from the defaults\n"),
    };
    for change in changes {
        let default = change
            .default
            .map(|default| format!("  (default {default})"))
            .unwrap_or_default();
        text += &format!("  {} = {}{default}\n", change.key, change.value);
    }
    Ok(text)
}

fn is_empty(path: &Path) -> bool {
    let text = files::read(path, MAX_CONFIG_BYTES).unwrap_or_default();
    toml::from_slice(&text).is_ok_and(|table: toml::Table| table.is_empty())
}
