//! Describes a configuration: what it changes.

use std::path::Path;

use crate::config::{ConfigError, Layers};
use crate::settings::Settings;

pub(super) fn describe(path: &Path, defaults: &Layers) -> Result<String, ConfigError> {
    let layers = defaults.clone().file(path)?;
    layers.build::<Settings>()?;
    let changes = layers.changes();
    let mut text = match changes.len() {
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
