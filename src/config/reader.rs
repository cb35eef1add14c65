//! serde over [`Node`]: typed values out of the tree, with errors that know the path.
//!
//! serde stops at the first thing that is wrong; [`super::gather`] repairs and asks again, which is
//! why the errors here are structured. A key that nobody asked for is always an error, also where a
//! type forgot to deny it.

use super::tree::{Node, Path, Step, Value};
use serde::de::{self, DeserializeSeed, Expected, Unexpected, Visitor};
use std::fmt;

/// What is wrong at a path.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadError {
    /// From the root; steps are in reverse while the error travels outward.
    reversed: Vec<Step>,
    /// What.
    pub fault: Fault,
}

/// The kinds of mismatch between a tree and a type.
#[derive(Debug, Clone, PartialEq)]
pub enum Fault {
    /// The table has a key that the type does not know.
    Unknown {
        /// The key.
        key: String,
        /// The keys that it knows.
        known: Vec<String>,
    },
    /// The table lacks a key.
    Missing {
        /// The key.
        key: String,
    },
    /// A word that is none of the allowed ones.
    Variant {
        /// The allowed ones.
        known: Vec<String>,
    },
    /// A value of the wrong type or out of the type's range.
    Type {
        /// What the type wants, in serde's words.
        wanted: String,
        /// Whether what was found is a table (the fault is then not in a leaf of it).
        found_table: bool,
    },
    /// Whatever a type's own code says.
    Other(String),
}

impl ReadError {
    fn new(fault: Fault) -> Self {
        Self { reversed: Vec::new(), fault }
    }

    fn inside(mut self, step: Step) -> Self {
        self.reversed.push(step);
        self
    }

    /// The table or value at fault.
    pub fn path(&self) -> Path {
        Path(self.reversed.iter().rev().cloned().collect())
    }
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {:?}", self.path(), self.fault)
    }
}

impl std::error::Error for ReadError {}

impl de::Error for ReadError {
    fn custom<T: fmt::Display>(msg: T) -> Self {
        Self::new(Fault::Other(msg.to_string()))
    }

    fn invalid_type(found: Unexpected<'_>, wanted: &dyn Expected) -> Self {
        let found_table = matches!(found, Unexpected::Map);
        Self::new(Fault::Type { wanted: wanted.to_string(), found_table })
    }

    fn invalid_value(found: Unexpected<'_>, wanted: &dyn Expected) -> Self {
        Self::invalid_type(found, wanted)
    }

    fn invalid_length(_: usize, wanted: &dyn Expected) -> Self {
        Self::new(Fault::Type { wanted: wanted.to_string(), found_table: false })
    }

    fn unknown_variant(_: &str, known: &'static [&'static str]) -> Self {
        Self::new(Fault::Variant { known: owned(known) })
    }

    fn unknown_field(key: &str, known: &'static [&'static str]) -> Self {
        Self::new(Fault::Unknown { key: key.to_owned(), known: owned(known) })
    }

    fn missing_field(key: &'static str) -> Self {
        Self::new(Fault::Missing { key: key.to_owned() })
    }
}

fn owned(words: &[&str]) -> Vec<String> {
    words.iter().map(|w| (*w).to_owned()).collect()
}

/// Reads a value as any serde type does.
pub struct Reader<'a>(pub &'a Node);

impl<'de> de::Deserializer<'de> for Reader<'de> {
    type Error = ReadError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.0.value {
            Value::Nothing => Err(de::Error::invalid_type(Unexpected::Unit, &visitor)),
            Value::String(s) => visitor.visit_borrowed_str(s),
            Value::Integer(i) => visitor.visit_i64(*i),
            Value::Float(x) => visitor.visit_f64(*x),
            Value::Boolean(b) => visitor.visit_bool(*b),
            Value::Datetime(_) => Err(de::Error::invalid_type(Unexpected::Other("a date"), &visitor)),
            Value::Array(items) => {
                let mut list = List { items, next: 0 };
                let value = visitor.visit_seq(&mut list)?;
                if list.next < items.len() {
                    // A fixed-size type took fewer than there are.
                    let wanted = format!("a list of {}", list.next);
                    return Err(ReadError::new(Fault::Type { wanted, found_table: false }));
                }
                Ok(value)
            }
            Value::Table(entries) => visitor.visit_map(Entries { entries, next: 0 }),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        match &self.0.value {
            Value::String(word) => {
                visitor.visit_enum(de::value::BorrowedStrDeserializer::<ReadError>::new(word))
            }
            Value::Table(entries) if entries.len() == 1 => visitor.visit_enum(Tagged(&entries[0])),
            _ => Err(ReadError::new(Fault::Variant { known: owned(variants) })),
        }
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, ReadError> {
        // Reached for a key that a type skips: the caller adds the key and reports it as unknown.
        Err(ReadError::new(Fault::Other(SKIPPED.to_owned())))
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit
        unit_struct seq tuple tuple_struct map struct identifier
    }
}

/// Marks the value of a key that nobody asked for, on its way to the table around it.
const SKIPPED: &str = "\u{0}skipped";

struct List<'a> {
    items: &'a [Node],
    next: usize,
}

impl<'de> de::SeqAccess<'de> for &mut List<'de> {
    type Error = ReadError;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, ReadError> {
        let Some(item) = self.items.get(self.next) else { return Ok(None) };
        self.next += 1;
        let index = self.next - 1;
        seed.deserialize(Reader(item)).map(Some).map_err(|e| e.inside(Step::Index(index)))
    }
}

struct Entries<'a> {
    entries: &'a [(String, Node)],
    next: usize,
}

impl<'de> de::MapAccess<'de> for Entries<'de> {
    type Error = ReadError;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, ReadError> {
        let Some((key, _)) = self.entries.get(self.next) else { return Ok(None) };
        seed.deserialize(de::value::BorrowedStrDeserializer::<ReadError>::new(key)).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, ReadError> {
        let (key, node) = &self.entries[self.next];
        self.next += 1;
        seed.deserialize(Reader(node)).map_err(|error| match &error.fault {
            Fault::Other(text) if text == SKIPPED => {
                ReadError::new(Fault::Unknown { key: key.clone(), known: vec![] })
            }
            _ => error.inside(Step::Key(key.clone())),
        })
    }
}

/// An enum written as a table with one key.
struct Tagged<'a>(&'a (String, Node));

impl<'de> de::EnumAccess<'de> for Tagged<'de> {
    type Error = ReadError;
    type Variant = Self;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), ReadError> {
        let tag = de::value::BorrowedStrDeserializer::<ReadError>::new(&self.0.0);
        Ok((seed.deserialize(tag)?, self))
    }
}

impl<'de> de::VariantAccess<'de> for Tagged<'de> {
    type Error = ReadError;

    fn unit_variant(self) -> Result<(), ReadError> {
        Err(ReadError::new(Fault::Other(format!("write \"{}\" alone", self.0.0))))
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, ReadError> {
        let step = Step::Key(self.0.0.clone());
        seed.deserialize(Reader(&self.0.1)).map_err(|e| e.inside(step))
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, ReadError> {
        let step = Step::Key(self.0.0.clone());
        de::Deserializer::deserialize_any(Reader(&self.0.1), visitor).map_err(|e| e.inside(step))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        self.tuple_variant(0, visitor)
    }
}
