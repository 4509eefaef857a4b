//! What tests of whole environments share: the project's humanoid and the default configuration.

use std::path::Path;
use std::sync::Arc;

use omniwalk_env::EnvConfig;
use omniwalk_env::config::EngineKind;
use omniwalk_env::robot::{self, Robot};

/// A robot of the project.
pub fn robot(name: &str) -> Arc<Robot> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots").join(name);
    Arc::new(robot::load(&folder).unwrap_or_else(|error| panic!("{error}")))
}

/// The default configuration in the given engine.
pub fn config(engine: EngineKind) -> EnvConfig {
    let mut config: EnvConfig = toml::from_str(include_str!("../../../configs/default.toml")).expect("the defaults");
    config.engine.kind = engine;
    config
}
