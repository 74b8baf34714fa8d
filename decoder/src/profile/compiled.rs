//! Binary form of TOML written by the build script, so that the program parses no text at start.
//!
//! ```text
//! value    tag (1), start and length of its position in the text, length of its content, content
//! content  s text · i number (8, two's complement) · f IEEE 754 (8) · b 0 or 1 · a values ·
//!          t keys (length, text), each with its value
//! ```
//! Numbers of eight bytes are little-endian. Positions and lengths have seven bits per byte, the lowest
//! first; the top bit is set if more bytes follow.

use std::ops::Range;

use serde::de::value::{BorrowedStrDeserializer, MapAccessDeserializer};
use serde::de::{
    DeserializeSeed, EnumAccess, Error as _, IntoDeserializer, MapAccess, SeqAccess, VariantAccess, Visitor,
};
use serde::{Deserialize, Deserializer, forward_to_deserialize_any};
use serde_spanned::de::{SpannedDeserializer, is_spanned};
use toml::de::Error;

/// Deserializes a compiled file.
///
/// # Errors
/// Keys and values unknown to `T`, unexpected end of the data.
pub(super) fn read<'de, T: Deserialize<'de>>(compiled: &'de [u8]) -> Result<T, Error> {
    T::deserialize(Bytes(compiled).value()?)
}

/// As [`read`], without the value of the key `omitted` in the outermost table.
pub(super) fn read_without<'de, T: Deserialize<'de>>(
    compiled: &'de [u8],
    omitted: &'static str,
) -> Result<T, Error> {
    let value = Bytes(compiled).value()?;
    T::deserialize(MapAccessDeserializer::new(Items { bytes: Bytes(value.content), omitted: Some(omitted) }))
}

/// Elements of the list that is the value of `key` in the outermost table; empty if the key is missing.
pub(super) fn elements<'de>(compiled: &'de [u8], key: &str) -> Result<Vec<CompiledValue<'de>>, Error> {
    let mut table = Bytes(Bytes(compiled).value()?.content);
    while !table.0.is_empty() {
        let (found, value) = (table.text()?, table.value()?);
        if found == key {
            let mut list = Bytes(value.content);
            let mut elements = Vec::new();
            while !list.0.is_empty() {
                elements.push(CompiledValue(list.value()?));
            }
            return Ok(elements);
        }
    }
    Ok(Vec::new())
}

/// A value that is read later.
#[derive(Debug)]
pub(super) struct CompiledValue<'de>(Value<'de>);

impl<'de> CompiledValue<'de> {
    /// Deserializes the value.
    ///
    /// # Errors
    /// As [`read`].
    pub(super) fn read<T: Deserialize<'de>>(&self) -> Result<T, Error> {
        T::deserialize(self.0.clone())
    }

    /// Whether the content contains a text: a key, or a part of one or of a string.
    pub(super) fn contains(&self, text: &str) -> bool {
        memchr::memmem::find(self.0.content, text.as_bytes()).is_some()
    }
}

/// Sequence of compiled values.
#[derive(Debug, Clone, Copy)]
struct Bytes<'de>(&'de [u8]);

/// A compiled value.
#[derive(Debug, Clone)]
struct Value<'de> {
    tag: u8,
    span: Range<usize>,
    content: &'de [u8],
}

impl<'de> Bytes<'de> {
    fn take(&mut self, length: usize) -> Result<&'de [u8], Error> {
        let (taken, rest) =
            self.0.split_at_checked(length).ok_or_else(|| Error::custom("compiled file: unexpected end"))?;
        self.0 = rest;
        Ok(taken)
    }

    fn number(&mut self) -> Result<usize, Error> {
        let mut number = 0;
        for shift in (0..usize::BITS).step_by(7) {
            let [byte] = self.take(1)? else { break };
            number |= usize::from(byte & 0x7F) << shift;
            if *byte < 0x80 {
                return Ok(number);
            }
        }
        Err(Error::custom("compiled file: unterminated length"))
    }

    fn text(&mut self) -> Result<&'de str, Error> {
        let length = self.number()?;
        std::str::from_utf8(self.take(length)?).map_err(Error::custom)
    }

    fn value(&mut self) -> Result<Value<'de>, Error> {
        let tag = self.take(1)?.first().copied().unwrap_or_default();
        let start = self.number()?;
        let span = start..start.saturating_add(self.number()?);
        let length = self.number()?;
        Ok(Value { tag, span, content: self.take(length)? })
    }
}

impl Value<'_> {
    fn eight(&self) -> Result<[u8; 8], Error> {
        self.content
            .first_chunk()
            .copied()
            .ok_or_else(|| Error::custom("compiled file: number shorter than eight bytes"))
    }
}

impl<'de> Deserializer<'de> for Value<'de> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.tag {
            b's' => visitor.visit_borrowed_str(std::str::from_utf8(self.content).map_err(Error::custom)?),
            b'i' => visitor.visit_i64(i64::from_le_bytes(self.eight()?)),
            b'f' => visitor.visit_f64(f64::from_le_bytes(self.eight()?)),
            b'b' => visitor.visit_bool(self.content == [1]),
            b'a' => visitor.visit_seq(Items::of(self.content)),
            b't' => visitor.visit_map(Items::of(self.content)),
            tag => Err(Error::custom(format!("compiled file: unknown tag {tag}"))),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        if is_spanned(name) {
            let span = self.span.clone();
            return visitor.visit_map(SpannedDeserializer::new(self, span));
        }
        self.deserialize_any(visitor)
    }

    /// A name, or a table with the name as its only key.
    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        if self.tag != b't' {
            let name = std::str::from_utf8(self.content).map_err(Error::custom)?;
            return visitor.visit_enum(name.into_deserializer());
        }
        let mut content = Bytes(self.content);
        let (name, value) = (content.text()?, content.value()?);
        visitor.visit_enum(Variant { name, value })
    }

    /// Skips the value.
    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_unit()
    }

    forward_to_deserialize_any! {
        bool u8 u16 u32 u64 i8 i16 i32 i64 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map identifier
    }
}

impl<'de> IntoDeserializer<'de, Error> for Value<'de> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

/// Content of an array or a table.
struct Items<'de> {
    bytes: Bytes<'de>,
    /// Key that is skipped.
    omitted: Option<&'static str>,
}

impl<'de> Items<'de> {
    fn of(content: &'de [u8]) -> Self {
        Self { bytes: Bytes(content), omitted: None }
    }
}

impl<'de> SeqAccess<'de> for Items<'de> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Error> {
        if self.bytes.0.is_empty() {
            return Ok(None);
        }
        seed.deserialize(self.bytes.value()?).map(Some)
    }
}

impl<'de> MapAccess<'de> for Items<'de> {
    type Error = Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Error> {
        if self.bytes.0.is_empty() {
            return Ok(None);
        }
        let mut key = self.bytes.text()?;
        if self.omitted == Some(key) {
            self.bytes.value()?;
            if self.bytes.0.is_empty() {
                return Ok(None);
            }
            key = self.bytes.text()?;
        }
        let key: BorrowedStrDeserializer<'de, Error> = BorrowedStrDeserializer::new(key);
        seed.deserialize(key).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Error> {
        seed.deserialize(self.bytes.value()?)
    }
}

/// Name and value of an enum variant.
struct Variant<'de> {
    name: &'de str,
    value: Value<'de>,
}

impl<'de> EnumAccess<'de> for Variant<'de> {
    type Error = Error;
    type Variant = Value<'de>;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Value<'de>), Error> {
        let name: BorrowedStrDeserializer<'de, Error> = BorrowedStrDeserializer::new(self.name);
        Ok((seed.deserialize(name)?, self.value))
    }
}

impl<'de> VariantAccess<'de> for Value<'de> {
    type Error = Error;

    fn unit_variant(self) -> Result<(), Error> {
        Err(Error::custom("table for a variant without content; expected its name"))
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Error> {
        seed.deserialize(self)
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Error> {
        self.deserialize_any(visitor)
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.deserialize_any(visitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use toml::Spanned;

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    enum Shape {
        Round,
        Square(i64),
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct CompiledItem {
        name: Spanned<String>,
        shapes: Vec<Shape>,
        weight: Option<f64>,
        light: bool,
    }

    /// `name = "a"`, `shapes = ["round", { square = -2 }]`, `weight = 0.5`, `light = true`.
    const THING: &[u8] = b"t\x00\x05\x54\
        \x04names\x07\x03\x01a\
        \x06shapesa\x0b\x07\x20s\x0c\x07\x05roundt\x14\x04\x13\x06squarei\x1e\x02\x08\xfe\xff\xff\xff\xff\xff\xff\xff\
        \x06weightf\x00\x00\x08\x00\x00\x00\x00\x00\x00\xe0\x3f\
        \x05lightb\x80\x01\x04\x01\x01";

    #[test]
    fn values_of_every_kind() {
        let thing: CompiledItem = read(THING).unwrap();
        assert_eq!((thing.name.get_ref().as_str(), thing.name.span()), ("a", 7..10));
        assert_eq!(thing.shapes, [Shape::Round, Shape::Square(-2)]);
        assert_eq!((thing.weight, thing.light), (Some(0.5), true));
    }

    #[test]
    fn a_list_is_read_apart_from_its_table() {
        #[derive(Debug, PartialEq, Deserialize)]
        #[serde(deny_unknown_fields)]
        struct WithoutShapes {
            name: String,
            weight: f64,
            light: bool,
        }
        let rest: WithoutShapes = read_without(THING, "shapes").unwrap();
        assert_eq!(rest, WithoutShapes { name: "a".into(), weight: 0.5, light: true });
        let shapes: Vec<Shape> =
            elements(THING, "shapes").unwrap().iter().map(|shape| shape.read().unwrap()).collect();
        assert_eq!(shapes, [Shape::Round, Shape::Square(-2)]);
        assert!(elements(THING, "colours").unwrap().is_empty());
    }

    #[test]
    fn errors_are_reported() {
        let error = |bytes: &[u8]| read::<CompiledItem>(bytes).unwrap_err().to_string();
        assert!(error(&THING[..40]).contains("unexpected end"), "{}", error(&THING[..40]));
        assert!(error(b"t\x00\x00\x06\x01xb\x00\x00\x01\x01").contains("unknown field `x`"));
        assert!(error(b"?\x00\x00\x00").contains("tag 63"));
        assert!(error(b"t\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff").contains("unterminated length"));
    }

    proptest! {
        #[test]
        fn no_bytes_are_too_broken(place in 0..THING.len(), byte: u8, rest: Vec<u8>) {
            let mut bytes = THING.to_vec();
            bytes[place] = byte;
            let _ = read::<CompiledItem>(&bytes);
            let _ = read::<toml::Table>(&rest);
        }
    }
}
