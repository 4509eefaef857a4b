//! CDR, the wire form of ROS 2 messages, and how messages describe themselves.
//!
//! A message is four bytes of encapsulation (00 01 00 00: plain CDR, little-endian), then its fields in order. A
//! number is aligned to its size, counted from the end of the encapsulation. Strings and sequences start with their
//! length (u32); a string ends with a zero byte that counts.

use std::fmt::Write;

const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Writes fields in CDR.
#[derive(Debug, Default)]
pub struct Encoder {
    bytes: Vec<u8>,
}

impl Encoder {
    fn number<const N: usize>(&mut self, number: [u8; N]) {
        let body = self.bytes.len() - ENCAPSULATION.len();
        self.bytes.resize(ENCAPSULATION.len() + body.next_multiple_of(N), 0);
        self.bytes.extend_from_slice(&number);
    }
}

/// Reads fields in CDR.
#[derive(Debug)]
pub struct Decoder<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Decoder<'a> {
    fn take(&mut self, len: usize) -> Result<&'a [u8], String> {
        let bytes = self.at.checked_add(len).and_then(|end| self.body.get(self.at..end));
        let bytes = bytes.ok_or_else(|| format!("the message ends at byte {}", self.body.len()))?;
        self.at += len;
        Ok(bytes)
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.at = self.at.next_multiple_of(N);
        let bytes = self.take(N)?;
        bytes.try_into().map_err(|_| "the message is cut off".to_owned())
    }
}

/// A type that a field of a message can have.
pub trait Field: Sized {
    /// The type's name in a ROS message definition.
    fn type_name() -> String;
    /// Appends the definition of this type, if it is a message, and of those it needs, each once.
    fn define(definitions: &mut Vec<(String, String)>);
    /// Appends the value.
    fn encode(&self, encoder: &mut Encoder);
    /// Reads a value.
    ///
    /// # Errors
    /// What is wrong with the bytes.
    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, String>;
}

macro_rules! number_field {
    ($($type:ty => $name:literal),*) => {$(
        impl Field for $type {
            fn type_name() -> String {
                $name.to_owned()
            }
            fn define(_: &mut Vec<(String, String)>) {}
            fn encode(&self, encoder: &mut Encoder) {
                encoder.number(self.to_le_bytes());
            }
            fn decode(decoder: &mut Decoder<'_>) -> Result<Self, String> {
                decoder.number().map(<$type>::from_le_bytes)
            }
        }
    )*};
}
number_field!(u8 => "uint8", i32 => "int32", u32 => "uint32", f32 => "float32", f64 => "float64");

impl Field for bool {
    fn type_name() -> String {
        "bool".to_owned()
    }
    fn define(_: &mut Vec<(String, String)>) {}
    fn encode(&self, encoder: &mut Encoder) {
        u8::from(*self).encode(encoder);
    }
    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, String> {
        u8::decode(decoder).map(|byte| byte != 0)
    }
}

impl Field for String {
    fn type_name() -> String {
        "string".to_owned()
    }
    fn define(_: &mut Vec<(String, String)>) {}
    fn encode(&self, encoder: &mut Encoder) {
        (self.len() as u32 + 1).encode(encoder);
        encoder.bytes.extend_from_slice(self.as_bytes());
        encoder.bytes.push(0);
    }
    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, String> {
        let len = u32::decode(decoder)? as usize;
        let bytes = decoder.take(len)?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        String::from_utf8(text.to_vec()).map_err(|_| "a string is not UTF-8".to_owned())
    }
}

impl<T: Field> Field for Vec<T> {
    fn type_name() -> String {
        format!("{}[]", T::type_name())
    }
    fn define(definitions: &mut Vec<(String, String)>) {
        T::define(definitions);
    }
    fn encode(&self, encoder: &mut Encoder) {
        (self.len() as u32).encode(encoder);
        self.iter().for_each(|value| value.encode(encoder));
    }
    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, String> {
        // The length is only believed as far as there are bytes: nothing is reserved for it.
        let len = u32::decode(decoder)?;
        (0..len).map(|_| T::decode(decoder)).collect()
    }
}

impl<T: Field + Copy + Default, const N: usize> Field for [T; N] {
    fn type_name() -> String {
        format!("{}[{N}]", T::type_name())
    }
    fn define(definitions: &mut Vec<(String, String)>) {
        T::define(definitions);
    }
    fn encode(&self, encoder: &mut Encoder) {
        self.iter().for_each(|value| value.encode(encoder));
    }
    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, String> {
        let mut values = [T::default(); N];
        for value in &mut values {
            *value = T::decode(decoder)?;
        }
        Ok(values)
    }
}

/// A field that is a type of its own: its definition from the names and types of its fields.
pub(super) fn define_message(name: &str, fields: &[(&str, String)], definitions: &mut Vec<(String, String)>) {
    let mut text = String::new();
    for (field, type_name) in fields {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{type_name} {field}");
    }
    if definitions.iter().all(|(defined, _)| defined != name) {
        definitions.push((name.to_owned(), text));
    }
}

/// The bytes of a message.
pub(super) fn encode(message: &impl Field) -> Vec<u8> {
    let mut encoder = Encoder {
        bytes: ENCAPSULATION.to_vec(),
    };
    message.encode(&mut encoder);
    encoder.bytes
}

/// The message in `bytes`.
pub(super) fn decode<T: Field>(bytes: &[u8]) -> Result<T, String> {
    match bytes.split_first_chunk::<4>() {
        Some(([0, 1, ..], body)) => T::decode(&mut Decoder { body, at: 0 }),
        Some(([a, b, ..], _)) => Err(format!(
            "it is not little-endian plain CDR (encapsulation {a:02x}{b:02x})"
        )),
        None => Err("it is too short for CDR".to_owned()),
    }
}

/// The text of a `ros2msg` schema: the message, then every message it needs.
pub(super) fn schema<T: Field>() -> String {
    let mut definitions = Vec::new();
    T::define(&mut definitions);
    let name = T::type_name();
    let own = definitions
        .iter()
        .filter(|(defined, _)| *defined == name)
        .map(|(_, text)| text.clone());
    let others = definitions.iter().filter(|(defined, _)| *defined != name);
    own.chain(others.map(|(name, text)| format!("{}\nMSG: {name}\n{text}", "=".repeat(80))))
        .collect()
}
