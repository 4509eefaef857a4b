//! TOML values that remember where they were written.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Where a value was written: which layer, and the bytes of its key and of the value itself.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Origin {
    /// Index of the layer.
    pub layer: usize,
    /// Bytes of the key; of the value for an entry of an array.
    pub key: Range<usize>,
    /// Bytes of the value.
    pub value: Range<usize>,
}

/// A value and where it came from.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub item: Item,
    pub origin: Origin,
}

/// A TOML value; tables keep the order in which they were written.
#[derive(Clone, Debug)]
pub(crate) enum Item {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    String(String),
    Array(Vec<Node>),
    Table(Vec<(String, Node)>),
}

/// What is wrong with a text, and where.
#[derive(Debug)]
pub(crate) struct SyntaxError {
    pub message: String,
    pub span: Range<usize>,
}

impl Node {
    /// Parses a document as layer number `layer`.
    pub fn parse(text: &str, layer: usize) -> Result<Self, SyntaxError> {
        let table = DeTable::parse(text).map_err(|error| SyntaxError {
            message: error.message().to_owned(),
            span: error.span().unwrap_or(0..0),
        })?;
        let origin = Origin {
            layer,
            key: 0..0,
            value: 0..0,
        };
        Ok(Self {
            item: Item::from_table(table.into_inner(), layer)?,
            origin,
        })
    }

    /// Lays `over` over this value: tables merge key by key, everything else is replaced.
    ///
    /// A table whose `type` differs is replaced as a whole: the keys of one variant mean nothing to another. A word in the place of a
    /// table that has a `kind` is that kind: `engine = "lanes"`. What else somebody wrote in the place of a table stays, so that it is
    /// refused there.
    pub fn overlay(&mut self, over: Node) {
        match (&mut self.item, over.item) {
            (Item::Table(entries), Item::Table(changes)) if same_variant(entries, &changes) => {
                for (key, change) in changes {
                    match entries.iter_mut().find(|(name, _)| *name == key) {
                        Some((_, entry)) => entry.overlay(change),
                        None => entries.push((key, change)),
                    }
                }
                self.origin = over.origin;
            }
            (Item::Table(entries), Item::String(word)) if entries.iter().any(is_kind) => {
                if let Some((_, entry)) = entries.iter_mut().find(|entry| is_kind(entry)) {
                    (entry.item, entry.origin) = (Item::String(word), over.origin);
                }
            }
            (item, Item::Table(_)) if self.origin.layer > 0 && !matches!(item, Item::Table(_)) => {}
            (item, change) => {
                *item = change;
                self.origin = over.origin;
            }
        }
    }

    /// The value under `key` of a table or at index `key` of an array.
    pub fn child(&self, key: &str) -> Option<&Node> {
        match &self.item {
            Item::Table(entries) => entries.iter().find(|(name, _)| name == key).map(|(_, node)| node),
            Item::Array(nodes) => nodes.get(key.parse::<usize>().ok()?),
            _ => None,
        }
    }

    /// Bytes to show for this value: its own, or those of its key where it has none.
    pub fn place(&self) -> Range<usize> {
        if self.origin.value.is_empty() {
            self.origin.key.clone()
        } else {
            self.origin.value.clone()
        }
    }

    /// The value at a dotted path.
    pub fn get(&self, path: &str) -> Option<&Node> {
        path.split('.').try_fold(self, |node, key| node.child(key))
    }

    /// The value at a dotted path, or its nearest ancestor that exists.
    pub fn nearest(&self, path: &str) -> &Node {
        let mut node = self;
        for key in path.split('.') {
            match node.child(key) {
                Some(child) => node = child,
                None => break,
            }
        }
        node
    }

    /// Every path below this table that ends in `key`.
    pub fn paths_to(&self, key: &str) -> Vec<String> {
        let Item::Table(entries) = &self.item else {
            return Vec::new();
        };
        let mut paths = Vec::new();
        for (name, node) in entries {
            if name == key {
                paths.push(name.clone());
            }
            paths.extend(node.paths_to(key).into_iter().map(|path| format!("{name}.{path}")));
        }
        paths
    }

    /// The plain TOML value.
    pub fn to_toml(&self) -> toml::Value {
        match &self.item {
            Item::Boolean(value) => toml::Value::Boolean(*value),
            Item::Integer(value) => toml::Value::Integer(*value),
            Item::Float(value) => toml::Value::Float(*value),
            Item::String(value) => toml::Value::String(value.clone()),
            Item::Array(nodes) => toml::Value::Array(nodes.iter().map(Node::to_toml).collect()),
            Item::Table(entries) => toml::Value::Table(
                entries
                    .iter()
                    .map(|(key, node)| (key.clone(), node.to_toml()))
                    .collect(),
            ),
        }
    }
}

/// Whether an entry of a table is the word that says of what kind the table is.
fn is_kind((key, node): &(String, Node)) -> bool {
    key == "kind" && matches!(node.item, Item::String(_))
}

fn same_variant(entries: &[(String, Node)], changes: &[(String, Node)]) -> bool {
    let variant = |table: &[(String, Node)]| {
        table.iter().find_map(|(key, node)| match &node.item {
            Item::String(value) if key == "type" => Some(value.clone()),
            _ => None,
        })
    };
    match variant(changes) {
        Some(changed) => variant(entries).is_none_or(|current| current == changed),
        None => true,
    }
}

impl Item {
    /// What the user would call this kind of value.
    pub fn kind(&self) -> &'static str {
        match self {
            Item::Boolean(_) => "true or false",
            Item::Integer(_) => "a whole number",
            Item::Float(_) => "a number",
            Item::String(_) => "a string",
            Item::Array(_) => "an array",
            Item::Table(_) => "a table",
        }
    }

    fn from_table(table: DeTable<'_>, layer: usize) -> Result<Self, SyntaxError> {
        let entry = |(key, value): (Spanned<std::borrow::Cow<'_, str>>, Spanned<DeValue<'_>>)| {
            let origin = Origin {
                layer,
                key: key.span(),
                value: value.span(),
            };
            let item = Item::from_value(value, layer)?;
            Ok((key.into_inner().into_owned(), Node { item, origin }))
        };
        Ok(Item::Table(table.into_iter().map(entry).collect::<Result<_, _>>()?))
    }

    fn from_value(value: Spanned<DeValue<'_>>, layer: usize) -> Result<Self, SyntaxError> {
        let span = value.span();
        let wrong = |message: &str| SyntaxError {
            message: message.to_owned(),
            span: span.clone(),
        };
        Ok(match value.into_inner() {
            DeValue::Boolean(value) => Item::Boolean(value),
            DeValue::String(value) => Item::String(value.into_owned()),
            DeValue::Integer(value) => Item::Integer(
                i64::from_str_radix(value.as_str(), value.radix())
                    .map_err(|_| wrong("this whole number does not fit in 64 bits"))?,
            ),
            DeValue::Float(value) => match value.as_str().parse::<f64>() {
                Ok(number) if !number.is_nan() => Item::Float(number),
                _ => return Err(wrong("this is not a number")),
            },
            DeValue::Datetime(_) => {
                return Err(wrong(
                    "no setting is a date or a time; put quotes around it if it is text",
                ));
            }
            DeValue::Array(values) => {
                let node = |value: Spanned<DeValue<'_>>| {
                    let origin = Origin {
                        layer,
                        key: value.span(),
                        value: value.span(),
                    };
                    Ok(Node {
                        item: Item::from_value(value, layer)?,
                        origin,
                    })
                };
                Item::Array(values.into_iter().map(node).collect::<Result<_, _>>()?)
            }
            DeValue::Table(table) => Item::from_table(table, layer)?,
        })
    }
}
