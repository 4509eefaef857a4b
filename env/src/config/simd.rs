//! The key `engine.simd`.

use std::fmt;

use serde::de::{self, Deserialize, Deserializer, Visitor};
use serde::{Serialize, Serializer};

use crate::engine::lanes::Simd;

/// The SIMD level of the engine `lanes`: a given one, or `auto`, the fastest this processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SimdChoice(pub Option<Simd>);

const AUTO: &str = "auto";

/// Every choice by its name.
const CHOICES: [&str; 1 + Simd::ALL.len()] = {
    let mut names = [AUTO; 1 + Simd::ALL.len()];
    let mut i = 0;
    while i < Simd::ALL.len() {
        names[1 + i] = Simd::ALL[i].name();
        i += 1;
    }
    names
};

impl SimdChoice {
    /// The level to use on this processor.
    pub fn level(self) -> Simd {
        self.0.unwrap_or_else(Simd::detect)
    }
}

impl Serialize for SimdChoice {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.0.map_or(AUTO, Simd::name))
    }
}

impl<'de> Deserialize<'de> for SimdChoice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_str(Name)
    }
}

/// Reads the name of a choice.
struct Name;

impl Visitor<'_> for Name {
    type Value = SimdChoice;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the name of a choice")
    }

    fn visit_str<E: de::Error>(self, name: &str) -> Result<SimdChoice, E> {
        if name == AUTO {
            return Ok(SimdChoice(None));
        }
        let level = Simd::ALL.into_iter().find(|level| level.name() == name);
        let level = level.ok_or_else(|| E::unknown_variant(name, &CHOICES))?;
        Ok(SimdChoice(Some(level)))
    }
}
