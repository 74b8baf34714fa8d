//! Form of TOML written by the build script, so that the program parses no text at start.
//!
//! ```text
//! value    tag (1), start (3) and length (3) of its position in the text, length of its content, content
//! content  s text · i number, bit 0 is the sign · f IEEE 754 in reversed byte order · b 0 or 1 ·
//!          a number of values, values · t keys (length, text), each with its value
//! ```
//! Characters of numbers have six bits, the lowest first. Bit 6 is set if more characters follow; positions
//! always have three. The whole form is text, so that its strings need no check.

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
pub(crate) fn read_compiled<'de, T: Deserialize<'de>>(compiled: &'de str) -> Result<T, Error> {
    T::deserialize(CompiledText(compiled).take_value()?)
}

/// As [`read`], without the value of the key `omitted` in the outermost table.
pub(super) fn read_without<'de, T: Deserialize<'de>>(
    compiled: &'de str,
    omitted: &'static str,
) -> Result<T, Error> {
    let value = CompiledText(compiled).take_value()?;
    T::deserialize(MapAccessDeserializer::new(TableKeys {
        rest: CompiledText(value.content),
        omitted: Some(omitted),
    }))
}

/// Elements of the list that is the value of `key` in the outermost table; empty if the key is missing.
pub(super) fn list_elements<'de>(compiled: &'de str, key: &str) -> Result<Vec<CompiledValue<'de>>, Error> {
    let mut table = CompiledText(CompiledText(compiled).take_value()?.content);
    while !table.0.is_empty() {
        let (found, value) = (table.take_string()?, table.take_value()?);
        if found == key {
            let ArrayElements { mut rest, count } = ArrayElements::elements_of(value.content)?;
            let mut elements = Vec::with_capacity(count.min(rest.0.len()));
            while !rest.0.is_empty() {
                elements.push(CompiledValue(rest.take_value()?));
            }
            return Ok(elements);
        }
    }
    Ok(Vec::new())
}

/// A value that is read later.
#[derive(Debug)]
pub(super) struct CompiledValue<'de>(BinaryValue<'de>);

impl<'de> CompiledValue<'de> {
    /// Deserializes the value.
    ///
    /// # Errors
    /// As [`read`].
    pub(super) fn read_value<T: Deserialize<'de>>(&self) -> Result<T, Error> {
        T::deserialize(self.0.clone())
    }

    /// Whether the content contains a text: a key, or a part of one or of a string.
    pub(super) fn contains(&self, text: &str) -> bool {
        memchr::memmem::find(self.0.content.as_bytes(), text.as_bytes()).is_some()
    }
}

/// Sequence of compiled values.
#[derive(Debug, Clone, Copy)]
struct CompiledText<'de>(&'de str);

/// A compiled value.
#[derive(Debug, Clone)]
struct BinaryValue<'de> {
    tag: u8,
    /// Position in the text, in the compiled form.
    position: [u8; 6],
    content: &'de str,
}

impl<'de> CompiledText<'de> {
    #[inline]
    fn take_text(&mut self, length: usize) -> Result<&'de str, Error> {
        let (taken, rest) = self.0.split_at_checked(length).ok_or_else(unexpected_end)?;
        self.0 = rest;
        Ok(taken)
    }

    #[inline]
    fn take_number(&mut self) -> Result<u64, Error> {
        match self.0.as_bytes() {
            [byte @ ..0x40, ..] => {
                self.take_text(1)?;
                Ok(u64::from(*byte))
            }
            _ => self.long_number(),
        }
    }

    fn long_number(&mut self) -> Result<u64, Error> {
        let mut number = 0;
        for shift in (0..u64::BITS).step_by(6) {
            let byte = self.take_text(1)?.as_bytes().first().copied().unwrap_or_default();
            number |= u64::from(byte & 0x3F) << shift;
            if byte < 0x40 {
                return Ok(number);
            }
        }
        Err(Error::custom("compiled file: unterminated number"))
    }

    #[inline]
    fn take_string(&mut self) -> Result<&'de str, Error> {
        let length = self.take_number()?;
        self.take_text(usize::try_from(length).unwrap_or(usize::MAX))
    }

    #[inline]
    fn take_value(&mut self) -> Result<BinaryValue<'de>, Error> {
        let Some([tag, position @ ..]) = self.take_text(7)?.as_bytes().first_chunk::<7>() else {
            return Err(unexpected_end());
        };
        Ok(BinaryValue { tag: *tag, position: *position, content: self.take_string()? })
    }
}

#[cold]
fn unexpected_end() -> Error {
    Error::custom("compiled file: unexpected end")
}

impl BinaryValue<'_> {
    fn to_number(&self) -> Result<u64, Error> {
        CompiledText(self.content).take_number()
    }

    /// Position in the text.
    fn span(&self) -> Range<usize> {
        let [start, length] = self.position.as_chunks::<3>().0 else { return 0..0 };
        let [start, length] = [start, length].map(|digits| {
            digits.iter().rev().fold(0, |number, digit| number << 6 | usize::from(digit & 0x3F))
        });
        start..start.saturating_add(length)
    }
}

impl<'de> Deserializer<'de> for BinaryValue<'de> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.tag {
            b's' => visitor.visit_borrowed_str(self.content),
            b'i' => visitor.visit_i64(self.to_number()?.rotate_right(1).cast_signed()),
            b'f' => visitor.visit_f64(f64::from_bits(self.to_number()?.swap_bytes())),
            b'b' => visitor.visit_bool(self.to_number()? == 1),
            b'a' => visitor.visit_seq(ArrayElements::elements_of(self.content)?),
            b't' => visitor.visit_map(TableKeys { rest: CompiledText(self.content), omitted: None }),
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
            let span = self.span();
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
            return visitor.visit_enum(self.content.into_deserializer());
        }
        let mut content = CompiledText(self.content);
        let (name, value) = (content.take_string()?, content.take_value()?);
        visitor.visit_enum(EnumVariant { name, value })
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

impl<'de> IntoDeserializer<'de, Error> for BinaryValue<'de> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

/// Content of an array.
struct ArrayElements<'de> {
    rest: CompiledText<'de>,
    /// Number of elements in `rest`.
    count: usize,
}

impl<'de> ArrayElements<'de> {
    fn elements_of(content: &'de str) -> Result<Self, Error> {
        let mut rest = CompiledText(content);
        let count = usize::try_from(rest.take_number()?).unwrap_or(usize::MAX);
        Ok(Self { rest, count })
    }
}

impl<'de> SeqAccess<'de> for ArrayElements<'de> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Error> {
        if self.rest.0.is_empty() {
            return Ok(None);
        }
        self.count = self.count.saturating_sub(1);
        seed.deserialize(self.rest.take_value()?).map(Some)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.count)
    }
}

/// Content of a table.
struct TableKeys<'de> {
    rest: CompiledText<'de>,
    /// Key that is skipped.
    omitted: Option<&'static str>,
}

impl<'de> MapAccess<'de> for TableKeys<'de> {
    type Error = Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Error> {
        if self.rest.0.is_empty() {
            return Ok(None);
        }
        let mut key = self.rest.take_string()?;
        if self.omitted == Some(key) {
            self.rest.take_value()?;
            if self.rest.0.is_empty() {
                return Ok(None);
            }
            key = self.rest.take_string()?;
        }
        let key: BorrowedStrDeserializer<'de, Error> = BorrowedStrDeserializer::new(key);
        seed.deserialize(key).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Error> {
        seed.deserialize(self.rest.take_value()?)
    }
}

/// Name and value of an enum variant.
struct EnumVariant<'de> {
    name: &'de str,
    value: BinaryValue<'de>,
}

impl<'de> EnumAccess<'de> for EnumVariant<'de> {
    type Error = Error;
    type Variant = BinaryValue<'de>;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, BinaryValue<'de>), Error> {
        let name: BorrowedStrDeserializer<'de, Error> = BorrowedStrDeserializer::new(self.name);
        Ok((seed.deserialize(name)?, self.value))
    }
}

impl<'de> VariantAccess<'de> for BinaryValue<'de> {
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
    const THING: &str = "t\0\0\0\x05\0\0n\x01\
        \x04names\x07\0\0\x03\0\0\x01a\
        \x06shapesa\x0b\0\0\x07\0\0\x30\x02s\x0c\0\0\x07\0\0\x05roundt\x14\0\0\x04\0\0\x1a\
        \x06squarei\x1e\0\0\x02\0\0\x0b\x7d\x7f\x7f\x7f\x7f\x7f\x7f\x7f\x7f\x7f\x0f\
        \x06weightf\0\0\0\0\0\0\x03\x7f\x40\x0e\
        \x05lightb\0\x02\0\x04\0\0\x01\x01";

    #[test]
    fn values_of_every_kind() {
        let thing: CompiledItem = read_compiled(THING).unwrap();
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
            list_elements(THING, "shapes").unwrap().iter().map(|shape| shape.read_value().unwrap()).collect();
        assert_eq!(shapes, [Shape::Round, Shape::Square(-2)]);
        assert!(list_elements(THING, "colours").unwrap().is_empty());
    }

    #[test]
    fn errors_are_reported() {
        let error = |text: &str| read_compiled::<CompiledItem>(text).unwrap_err().to_string();
        assert!(error(&THING[..40]).contains("unexpected end"), "{}", error(&THING[..40]));
        assert!(error("t\0\0\0\0\0\0\x0b\x01xb\0\0\0\0\0\0\x01\x01").contains("unknown field `x`"));
        assert!(error("?\0\0\0\0\0\0\0").contains("tag 63"));
        let endless = format!("t\0\0\0\0\0\0{}", "\x7f".repeat(12));
        assert!(error(&endless).contains("unterminated number"));
    }

    proptest! {
        #[test]
        fn no_bytes_are_too_broken(place in 0..THING.len(), byte: u8, rest: Vec<u8>) {
            let mut bytes = THING.as_bytes().to_vec();
            bytes[place] = byte;
            let _ = read_compiled::<CompiledItem>(&String::from_utf8_lossy(&bytes));
            let _ = read_compiled::<toml::Table>(&String::from_utf8_lossy(&rest));
        }
    }
}
