//! Deserialises a [`Node`] into any type, keeping the origin and the path of the innermost value that failed.

use std::fmt::{self, Display};

use serde::de::value::{MapAccessDeserializer, StrDeserializer};
use serde::de::{self, DeserializeSeed, Expected, IntoDeserializer, Unexpected, Visitor};

use super::tree::{Item, Node, Origin};

/// Why a value was refused, and where.
#[derive(Debug)]
pub struct Fault {
    pub(super) problem: Problem,
    /// The innermost value that failed; `None` until a value on the way up puts itself here.
    pub(super) origin: Option<Origin>,
    /// Keys from the outermost table to the failing value, innermost first.
    pub(super) path: Vec<String>,
}

/// What is wrong.
#[derive(Debug)]
pub(super) enum Problem {
    /// A key that the type does not have.
    UnknownKey { key: String, known: Box<[&'static str]> },
    /// A choice that the type does not have.
    UnknownChoice {
        choice: String,
        known: &'static [&'static str],
    },
    /// A key that is needed.
    Missing(&'static str),
    /// A value of another type.
    WrongType { expected: String, found: String },
    /// Anything else the type says about itself.
    Other(String),
}

impl Fault {
    pub(super) fn new(problem: Problem) -> Self {
        Self {
            problem,
            origin: None,
            path: Vec::new(),
        }
    }

    /// Places the fault at `node` unless it already has a place further in.
    pub(super) fn within(mut self, node: &Node) -> Self {
        if self.origin.is_none() {
            let entry = match &self.problem {
                // Tagged enums report an unknown key only after the whole table has been read.
                Problem::UnknownKey { key, .. } => node.child(key),
                _ => None,
            };
            self.origin = Some(entry.unwrap_or(node).origin.clone());
        }
        self
    }

    pub(super) fn below(mut self, key: &str) -> Self {
        self.path.push(key.to_owned());
        self
    }
}

impl Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.problem)
    }
}

impl std::error::Error for Fault {}

impl de::Error for Fault {
    fn custom<T: Display>(message: T) -> Self {
        Self::new(Problem::Other(message.to_string()))
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::new(Problem::WrongType {
            expected: in_words(&expected.to_string()),
            found: found_in_words(found),
        })
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(found, expected)
    }

    fn unknown_field(key: &str, known: &'static [&'static str]) -> Self {
        Self::new(Problem::UnknownKey {
            key: key.to_owned(),
            known: known.into(),
        })
    }

    fn unknown_variant(choice: &str, known: &'static [&'static str]) -> Self {
        Self::new(Problem::UnknownChoice {
            choice: choice.to_owned(),
            known,
        })
    }

    fn missing_field(key: &'static str) -> Self {
        Self::new(Problem::Missing(key))
    }
}

/// Rust's type names mean nothing to who writes a configuration.
fn in_words(expected: &str) -> String {
    let words = match expected {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, not negative",
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number",
        "f32" | "f64" => "a number",
        "a boolean" => "true or false",
        "a sequence" => "an array",
        "a map" => "a table",
        _ if expected.starts_with("struct ") => "a table",
        _ if expected.contains("enum ") => "the name of a choice",
        other => other,
    };
    words.to_owned()
}

fn found_in_words(found: Unexpected<'_>) -> String {
    match found {
        Unexpected::Signed(value) => format!("the whole number {value}"),
        Unexpected::Unsigned(value) => format!("the whole number {value}"),
        Unexpected::Float(value) => format!("the number {value}"),
        Unexpected::Seq => "an array".to_owned(),
        Unexpected::Map => "a table".to_owned(),
        other => other.to_string(),
    }
}

impl<'de> de::Deserializer<'de> for &'de Node {
    type Error = Fault;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        match &self.item {
            Item::Boolean(value) => visitor.visit_bool(*value),
            Item::Integer(value) => visitor.visit_i64(*value),
            Item::Float(value) => visitor.visit_f64(*value),
            Item::String(value) => visitor.visit_borrowed_str(value),
            Item::Array(nodes) => {
                let mut access = ArrayAccess {
                    nodes: nodes.iter().enumerate(),
                };
                visitor
                    .visit_seq(&mut access)
                    .and_then(|value| match access.nodes.len() {
                        0 => Ok(value),
                        extra => Err(de::Error::custom(format!("{extra} too many values"))),
                    })
            }
            Item::Table(entries) => visitor.visit_map(TableAccess::new(entries, None)),
        }
        .map_err(|fault| fault.within(self))
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        match &self.item {
            Item::String(choice) => {
                let choice: StrDeserializer<'_, Fault> = choice.as_str().into_deserializer();
                visitor.visit_enum(choice)
            }
            Item::Table(entries) if entries.len() == 1 => {
                visitor.visit_enum(MapAccessDeserializer::new(TableAccess::new(entries, None)))
            }
            other => Err(Fault::new(Problem::WrongType {
                expected: "the name of a choice".to_owned(),
                found: other.kind().to_owned(),
            })),
        }
        .map_err(|fault| fault.within(self))
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf
        unit unit_struct seq tuple tuple_struct map struct identifier ignored_any
    }
}

struct ArrayAccess<'de> {
    nodes: std::iter::Enumerate<std::slice::Iter<'de, Node>>,
}

impl<'de> de::SeqAccess<'de> for &mut ArrayAccess<'de> {
    type Error = Fault;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Fault> {
        let Some((index, node)) = self.nodes.next() else {
            return Ok(None);
        };
        seed.deserialize(node)
            .map(Some)
            .map_err(|fault| fault.below(&index.to_string()))
    }
}

pub(super) struct TableAccess<'de> {
    entries: std::slice::Iter<'de, (String, Node)>,
    /// The only keys that are looked at, if not all are.
    only: Option<&'static [&'static str]>,
    next: Option<&'de (String, Node)>,
}

impl<'de> TableAccess<'de> {
    pub(super) fn new(entries: &'de [(String, Node)], only: Option<&'static [&'static str]>) -> Self {
        Self {
            entries: entries.iter(),
            only,
            next: None,
        }
    }
}

impl<'de> de::MapAccess<'de> for TableAccess<'de> {
    type Error = Fault;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Fault> {
        let only = self.only;
        let wanted = |entry: &&(String, Node)| only.is_none_or(|only| only.contains(&entry.0.as_str()));
        let Some(entry) = self.entries.find(wanted) else {
            return Ok(None);
        };
        self.next = Some(entry);
        let key: StrDeserializer<'_, Fault> = entry.0.as_str().into_deserializer();
        seed.deserialize(key).map(Some).map_err(|fault| fault.within(&entry.1))
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Fault> {
        let (key, node) = self
            .next
            .take()
            .ok_or_else(|| Fault::new(Problem::Other("a value without a key".into())))?;
        seed.deserialize(node).map_err(|fault| fault.within(node).below(key))
    }
}
