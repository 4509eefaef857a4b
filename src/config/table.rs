//! A configuration's table, shared out between several structs.

use serde::de::{Deserialize, Deserializer, Visitor};

use super::de::{Fault, Problem, TableAccess};
use super::tree::{Item, Node};

/// A table that is shared out: every part takes what it knows.
pub struct Table<'de> {
    node: &'de Node,
    known: Vec<&'static str>,
}

impl<'de> Table<'de> {
    pub(super) fn new(node: &'de Node) -> Self {
        Self {
            node,
            known: Vec::new(),
        }
    }

    /// The struct `T` from the keys that are its fields.
    ///
    /// # Errors
    /// [`Fault`] when one of them is missing or `T` refuses its value.
    pub fn part<T: Deserialize<'de>>(&mut self) -> Result<T, Fault> {
        T::deserialize(Part(self))
    }

    /// The value of `key`.
    ///
    /// # Errors
    /// [`Fault`] when it is missing or `T` refuses it.
    pub fn entry<T: Deserialize<'de>>(&mut self, key: &'static str) -> Result<T, Fault> {
        self.known.push(key);
        let missing = || Fault::new(Problem::Missing(key)).within(self.node);
        let value = self.node.child(key).ok_or_else(missing)?;
        T::deserialize(value).map_err(|fault| fault.within(value).below(key))
    }

    /// Refuses a key that no part has taken.
    pub(super) fn end(self) -> Result<(), Fault> {
        let Item::Table(entries) = &self.node.item else {
            return Ok(());
        };
        match entries.iter().find(|(key, _)| !self.known.contains(&key.as_str())) {
            None => Ok(()),
            Some((key, value)) => Err(Fault::new(Problem::UnknownKey {
                key: key.clone(),
                known: self.known.into(),
            })
            .within(value)),
        }
    }
}

/// Deserialises a struct from the keys of a table that are its fields.
struct Part<'a, 'de>(&'a mut Table<'de>);

impl<'de> Deserializer<'de> for Part<'_, 'de> {
    type Error = Fault;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        self.0.node.deserialize_any(visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        self.0.known.extend(fields);
        match &self.0.node.item {
            Item::Table(entries) => visitor.visit_map(TableAccess::new(entries, Some(fields))),
            _ => return self.deserialize_any(visitor),
        }
        .map_err(|fault| fault.within(self.0.node))
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf
        option unit unit_struct newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}
