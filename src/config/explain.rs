//! What is said of a wrong configuration: where it was written, and what would be right.

use super::de::{Fault, Problem};
use super::tree::{Item, Node};
use super::{ConfigError, Invalid, Layers};

impl Layers {
    /// The message for a value in the place of a table.
    pub(super) fn no_table(&self, path: &str, node: &Node) -> ConfigError {
        let tables =
            matches!(&node.item, Item::Array(nodes) if nodes.iter().any(|node| matches!(node.item, Item::Table(_))));
        self.source(&node.origin)
            .error(
                format!("`{path}` has the wrong type"),
                node.place(),
                &format!("this is {}", node.item.kind()),
            )
            .with_help(match tables {
                true => format!("write `[{path}]` once, not `[[{path}]]`"),
                false => format!("it takes a table, `[{path}]`"),
            })
    }

    /// Where to show that the value at `key` is impossible: where it was written, or, if it is a default, where the
    /// first of the keys was written that `message` names.
    fn culprit(&self, key: &str, message: &str) -> &Node {
        let node = self.merged.nearest(key);
        if node.origin.layer > 0 {
            return node;
        }
        let section = key.split('.').next().unwrap_or_default();
        let words = message.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_' || c == '.'));
        let named = |word: &str| {
            let word = word.trim_matches('.');
            let node = self
                .merged
                .get(word)
                .or_else(|| self.merged.get(&format!("{section}.{word}")))?;
            let value = !matches!(node.item, Item::Table(_));
            (value && node.origin.layer > 0).then_some(node)
        };
        words.filter(|word| !word.is_empty()).find_map(named).unwrap_or(node)
    }

    /// The message for a value that [`Configuration::validate`] refused.
    pub(super) fn refuse(&self, invalid: &Invalid) -> ConfigError {
        let node = self.culprit(&invalid.key, &invalid.message);
        let message = format!("`{}` {}", invalid.key, invalid.message);
        self.source(&node.origin)
            .error(message, node.place(), "this is not possible")
    }

    /// The message for a value that the type refused.
    pub(super) fn explain(&self, fault: Fault) -> ConfigError {
        let origin = fault.origin.unwrap_or_else(|| self.merged.origin.clone());
        let source = self.source(&origin);
        let path = fault.path.iter().rev().cloned().collect::<Vec<_>>().join(".");
        let below = |key: &str| {
            if path.is_empty() {
                key.to_owned()
            } else {
                format!("{path}.{key}")
            }
        };
        match fault.problem {
            Problem::UnknownKey { key, known } => source
                .error(
                    format!("unknown key `{}`", below(&key)),
                    origin.key,
                    "there is no such setting",
                )
                .with_help(self.suggest(&key, &known, &below)),
            Problem::UnknownChoice { choice, known } => source
                .error(
                    format!("`{path}` cannot be `{choice}`"),
                    origin.value,
                    "there is no such choice",
                )
                .with_help(match closest(&choice, known) {
                    Some(name) => format!("did you mean `{name}`? The choices are {}", known.join(", ")),
                    None => format!("the choices are {}", known.join(", ")),
                }),
            Problem::Missing(key) => source
                .error(format!("`{}` is missing", below(key)), origin.key, "it is needed here")
                .with_help(format!("add `{key} = ...`")),
            Problem::WrongType { expected, found } => source
                .error(
                    format!("`{path}` has the wrong type"),
                    origin.value,
                    &format!("this is {found}"),
                )
                .with_help(format!("it takes {expected}")),
            Problem::Other(message) => source.error(format!("`{path}`: {message}"), origin.value, "here"),
        }
    }

    /// The `type` that the table of the key at the dotted path `own` has in the defaults, where that key is in them.
    fn variant_with(&self, own: &str) -> Option<String> {
        let (table, key) = own.rsplit_once('.')?;
        let node = self.defaults.get(table)?;
        node.child(key)?;
        match &node.child("type")?.item {
            Item::String(variant) => Some(format!("`{table}.type = \"{variant}\"`")),
            _ => None,
        }
    }

    fn suggest(&self, key: &str, known: &[&str], below: &dyn Fn(&str) -> String) -> String {
        let own = below(key);
        if let Some(variant) = self.variant_with(&own) {
            return format!("there is `{own}` only with {variant}");
        }
        if let Some(name) = closest(key, known) {
            return format!("did you mean `{}`?", below(name));
        }
        match self.defaults.paths_to(key).first() {
            Some(path) => format!("there is `{path}`"),
            None => format!("the keys here are {}", known.join(", ")),
        }
    }
}

/// The known name that `word` is most likely a slip of.
fn closest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let distance = |name: &str| strsim::damerau_levenshtein(&word.to_lowercase(), name);
    let name = known.iter().copied().min_by_key(|name| distance(name))?;
    (distance(name) <= 1 + word.chars().count() / 4).then_some(name)
}
