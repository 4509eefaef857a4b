//! Configuration in layers: the embedded defaults, a file laid over them, single changes laid over that.
//!
//! The defaults hold every key and are the one place of defaults. A file gives the keys it changes, `--set
//! key=value` one key. Every value remembers where it was written, so that an unknown key, a wrong type or an
//! impossible value is shown at the line that wrote it, whichever layer that was.

mod change;
mod de;
mod error;
mod explain;
mod table;
mod tree;

use std::io::Read;
use std::ops::Range;
use std::path::Path;

pub use de::Fault;
pub use error::ConfigError;
pub use table::Table;

use crate::files;
use change::parse_change;
use tree::{Item, Node, Origin, SyntaxError};

/// Largest configuration file, bytes.
pub const MAX_FILE_BYTES: u64 = 1 << 20;

/// A value that is of the right type and still impossible.
#[derive(Clone, Debug, PartialEq)]
pub struct Invalid {
    /// The dotted path of the key, such as `ppo.discount`; entries of arrays by their index.
    pub key: String,
    /// What would be right, such as `must be above 0 and at most 1`.
    pub message: String,
}

impl Invalid {
    /// An impossible value at `key`.
    pub fn new(key: impl Into<String>, message: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            message: message.into(),
        }
    }
}

/// A configuration that can be read from a table and knows which of its values are impossible.
pub trait Configuration: Sized {
    /// Reads it from a table; keys that it does not take are refused.
    ///
    /// # Errors
    /// [`Fault`] when a key is missing or a value is of the wrong type.
    fn read(table: &mut Table<'_>) -> Result<Self, Fault>;

    /// Checks every value and how values fit together.
    ///
    /// # Errors
    /// Everything that is wrong, not only the first.
    fn validate(&self) -> Result<(), Vec<Invalid>>;
}

/// A value that differs from the default.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The dotted path of the key.
    pub key: String,
    /// The default, as TOML; `None` for a key without one.
    pub default: Option<String>,
    /// The effective value, as TOML.
    pub value: String,
}

/// The layers laid over each other so far.
#[derive(Clone, Debug)]
pub struct Layers {
    defaults: Node,
    merged: Node,
    sources: Vec<Source>,
}

/// A text that gave values, for messages.
#[derive(Clone, Debug)]
struct Source {
    name: String,
    text: String,
}

impl Source {
    fn error(&self, message: impl Into<String>, span: Range<usize>, label: &str) -> ConfigError {
        ConfigError::new(message).at(&self.name, &self.text, span, label)
    }

    fn syntax_error(&self, error: SyntaxError) -> ConfigError {
        self.error(format!("{} is not valid TOML", self.name), error.span, &error.message)
    }
}

impl Layers {
    /// Starts from the defaults.
    ///
    /// # Errors
    /// When `defaults` is not TOML.
    pub fn new(defaults: &str) -> Result<Self, ConfigError> {
        let source = Source {
            name: "default.toml (built in)".to_owned(),
            text: defaults.to_owned(),
        };
        let node = Node::parse(defaults, 0).map_err(|error| source.syntax_error(error))?;
        Ok(Self {
            defaults: node.clone(),
            merged: node,
            sources: vec![source],
        })
    }

    /// Lays the file at `path` over what is there.
    ///
    /// # Errors
    /// When it cannot be read, is larger than [`MAX_FILE_BYTES`], or is not TOML.
    pub fn file(self, path: &Path) -> Result<Self, ConfigError> {
        let text = read_bounded(path)?;
        self.text(&path.display().to_string(), &text)
    }

    /// Lays `text`, known to the user as `name`, over what is there.
    ///
    /// # Errors
    /// When it is not TOML.
    pub fn text(mut self, name: &str, text: &str) -> Result<Self, ConfigError> {
        let source = Source {
            name: name.to_owned(),
            text: text.to_owned(),
        };
        let node = Node::parse(text, self.sources.len()).map_err(|error| source.syntax_error(error))?;
        self.sources.push(source);
        self.merged.overlay(node);
        Ok(self)
    }

    /// Lays the single change `key.sub=value` over what is there. The value is TOML; what is not TOML is a string,
    /// so that words need no quotes on the command line. The last part of a key is enough where only one key ends in it.
    ///
    /// # Errors
    /// When `argument` has no `=`, its key is not a dotted key, or its value is broken TOML.
    pub fn set(mut self, argument: &str) -> Result<Self, ConfigError> {
        let source = Source {
            name: "--set".to_owned(),
            text: argument.to_owned(),
        };
        let node = parse_change(argument, self.sources.len()).map_err(|error| match argument.split_once('=') {
            Some((key, _)) if error.span.start > key.len() => {
                let message = format!("the value of `{}` cannot be used", key.trim());
                source.error(message, error.span, &error.message)
            }
            _ => source
                .error("`--set` takes key=value", error.span, &error.message)
                .with_help("for example `--set ppo.epochs=5` or `--set train.name=first`"),
        })?;
        self.sources.push(source);
        let node = self.in_its_table(node);
        self.merged.overlay(node);
        Ok(self)
    }

    /// A change of a key that stands in one table alone, as a change in that table.
    fn in_its_table(&self, change: Node) -> Node {
        let Item::Table(entries) = &change.item else {
            return change;
        };
        let [(key, _)] = &entries[..] else { return change };
        let paths = self.defaults.paths_to(key);
        let [path] = &paths[..] else { return change };
        let wrap = |node: Node, table: &str| Node {
            origin: node.origin.clone(),
            item: Item::Table(vec![(table.to_owned(), node)]),
        };
        path.split('.').rev().skip(1).fold(change, wrap)
    }

    /// The configuration as `T`, and the whole of it as TOML: loading that text again gives the same value.
    ///
    /// # Errors
    /// A key that `T` does not know, a value of the wrong type, or what [`Configuration::validate`] refuses.
    pub fn build<T: Configuration>(&self) -> Result<(T, String), ConfigError> {
        if let Some((path, node)) = misplaced(&self.defaults, &self.merged, "") {
            return Err(self.no_table(&path, node));
        }
        let mut table = Table::new(&self.merged);
        let value = T::read(&mut table).and_then(|value| table.end().map(|()| value));
        let value = value.map_err(|fault| self.explain(fault))?;
        if let Err(invalid) = value.validate()
            && let Some(error) = ConfigError::join(invalid.iter().map(|invalid| self.refuse(invalid)).collect())
        {
            return Err(error);
        }
        Ok((value, self.effective()))
    }

    /// Every value that differs from the defaults.
    pub fn changes(&self) -> Vec<Change> {
        let mut changes = Vec::new();
        compare(Some(&self.defaults), &self.merged, "", &mut changes);
        changes
    }

    fn effective(&self) -> String {
        // A table of plain TOML values always has a TOML text.
        toml::to_string(&self.merged.to_toml()).unwrap_or_default()
    }

    fn source(&self, origin: &Origin) -> &Source {
        &self.sources[origin.layer]
    }
}

/// The first value that stands where the defaults have a table, with its dotted path.
fn misplaced<'a>(defaults: &Node, merged: &'a Node, path: &str) -> Option<(String, &'a Node)> {
    let Item::Table(entries) = &defaults.item else {
        return None;
    };
    if !matches!(merged.item, Item::Table(_)) {
        return Some((path.to_owned(), merged));
    }
    entries.iter().find_map(|(key, default)| {
        let below = if path.is_empty() {
            key.clone()
        } else {
            format!("{path}.{key}")
        };
        misplaced(default, merged.child(key)?, &below)
    })
}

fn read_bounded(path: &Path) -> Result<String, ConfigError> {
    let cannot = |why: String| ConfigError::new(format!("cannot read {}: {why}", path.display()));
    let file = files::open(path).map_err(|error| cannot(error.to_string()))?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| cannot(error.to_string()))?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(cannot("it is larger than 1 MiB".to_owned()).with_help("a configuration is a short TOML file"));
    }
    String::from_utf8(bytes).map_err(|error| {
        cannot(format!(
            "it is not text (byte {} is not UTF-8)",
            error.utf8_error().valid_up_to()
        ))
        .with_help("a configuration is a TOML file in UTF-8")
    })
}

fn compare(default: Option<&Node>, value: &Node, path: &str, changes: &mut Vec<Change>) {
    if let Item::Table(entries) = &value.item {
        for (key, child) in entries {
            let path = if path.is_empty() {
                key.clone()
            } else {
                format!("{path}.{key}")
            };
            compare(default.and_then(|table| table.child(key)), child, &path, changes);
        }
        return;
    }
    let (default, value) = (
        default.map(|node| node.to_toml().to_string()),
        value.to_toml().to_string(),
    );
    if default.as_ref() != Some(&value) {
        changes.push(Change {
            key: path.to_owned(),
            default,
            value,
        });
    }
}

#[cfg(test)]
mod tests;
