//! Configuration in layers: the embedded defaults, a file laid over them, single changes laid over that.
//!
//! The defaults hold every key and are the one place of defaults. A file gives the keys it changes, `--set
//! key=value` one key. Every value remembers where it was written, so that an unknown key, a wrong type or an
//! impossible value is shown at the line that wrote it, whichever layer that was.

mod de;
mod error;
mod table;
mod tree;

use std::io::Read;
use std::ops::Range;
use std::path::Path;

pub use de::Fault;
pub use error::ConfigError;
pub use table::Table;

use crate::files;
use de::Problem;
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

    /// The message for a value in the place of a table.
    fn no_table(&self, path: &str, node: &Node) -> ConfigError {
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
    fn refuse(&self, invalid: &Invalid) -> ConfigError {
        let node = self.culprit(&invalid.key, &invalid.message);
        let message = format!("`{}` {}", invalid.key, invalid.message);
        self.source(&node.origin)
            .error(message, node.place(), "this is not possible")
    }

    /// The message for a value that the type refused.
    fn explain(&self, fault: Fault) -> ConfigError {
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

/// The known name that `word` is most likely a slip of.
fn closest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let distance = |name: &str| strsim::damerau_levenshtein(&word.to_lowercase(), name);
    let name = known.iter().copied().min_by_key(|name| distance(name))?;
    (distance(name) <= 1 + word.chars().count() / 4).then_some(name)
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

/// Parses `key.sub=value` into nested tables.
fn parse_change(argument: &str, layer: usize) -> Result<Node, SyntaxError> {
    let at = argument.find('=').ok_or_else(|| SyntaxError {
        message: "there is no `=` here".to_owned(),
        span: 0..argument.len(),
    })?;
    let (key, value) = (&argument[..at], argument[at + 1..].trim());
    let whole = Node::parse(argument, layer);
    if let (Ok(node), Ok(only)) = (&whole, Node::parse(&format!("{key}=0"), layer))
        && !sets_only(node, &only)
    {
        return Err(SyntaxError {
            message: "one change at a time".to_owned(),
            span: 0..argument.len(),
        });
    }
    let end = argument.trim_end().len();
    let span = end - value.len()..end;
    // Not a number, however it is spelt, is no word either.
    if value.parse::<f64>().is_ok_and(f64::is_nan) {
        return Err(SyntaxError {
            message: "this is not a number".to_owned(),
            span,
        });
    }
    let is_word = !value.is_empty() && !value.contains(['"', '\'', '[', ']', '{', '}', '\n', '#']);
    match whole {
        Err(_) if is_word => {
            let mut node = Node::parse(&format!("{key}=0"), layer)?;
            replace_leaf(&mut node, value, span);
            Ok(node)
        }
        other => other,
    }
}

/// Whether `node` has no keys beside those of the chain of tables `only`, whatever is at its end.
fn sets_only(node: &Node, only: &Node) -> bool {
    match (&node.item, &only.item) {
        (Item::Table(entries), Item::Table(chain)) => {
            entries.len() == chain.len()
                && chain
                    .iter()
                    .all(|(key, below)| node.child(key).is_some_and(|child| sets_only(child, below)))
        }
        (_, end) => !matches!(end, Item::Table(_)),
    }
}

/// Puts the word at the end of a chain of tables with one entry each.
fn replace_leaf(node: &mut Node, word: &str, span: Range<usize>) {
    match &mut node.item {
        Item::Table(entries) => entries
            .iter_mut()
            .for_each(|(_, child)| replace_leaf(child, word, span.clone())),
        item => {
            *item = Item::String(word.to_owned());
            node.origin.value = span;
        }
    }
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
