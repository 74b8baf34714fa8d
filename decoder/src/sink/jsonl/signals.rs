//! Signals of one layout, assembled from cached parts of each field.
//!
//! ```text
//! {"id":"0x6300:01","name":"actual pressure","raw":4711,"value":157.5,"unit":"bar","origin":"profile"}
//! └──────────────── before ──────────────────────┘    └between ┘     └──────────── after ───────────┘
//! ```
//!
//! The parts are cut from a text of the general writer. The general writer also writes every value with a
//! name, bits or a remark; that text is cached until the value changes, which is rare. Property tests compare
//! both.

use std::sync::Arc;

use super::object::JsonObjectWriter;
use crate::ascii::{push_decimal, push_fixed, push_integer};
use crate::profile::{IntegerPosition, ObjectMeaning, PayloadLayout, SignalField, as_integer};
use crate::query::record::{UNROUNDED, decimal_digits, visit_signal};

/// Maximum number of decimal places that is written here.
const MOST_DIGITS: u8 = 8;

/// Number of values tried to find a plain one.
const TRIED: usize = 64;

/// Cached parts of a layout without optional fields.
pub(super) struct SignalTemplates {
    layout: Arc<PayloadLayout>,
    /// Payload length that contains all fields, in bytes.
    length: usize,
    parts: Vec<SignalPart>,
}

/// Cached parts of one field.
struct SignalPart {
    number: Option<NumberTemplate>,
    /// Raw bits of the value in `text`.
    last: Option<u64>,
    text: Vec<u8>,
}

/// Parts of a plain number: without name, bits or remark.
struct NumberTemplate {
    cut: IntegerPosition,
    scale: Option<ScaleTemplate>,
    /// Range of plain values; special values inside it are checked separately.
    inside: [i64; 2],
    before: Vec<u8>,
    between: Vec<u8>,
    after: Vec<u8>,
}

struct ScaleTemplate {
    factor: f64,
    offset: f64,
    digits: u8,
    /// 10 to the power of `digits`.
    unit: f64,
}

impl SignalTemplates {
    /// `None` for a layout with optional fields, texts or more than eight bytes.
    pub(super) fn templates_of(layout: &Arc<PayloadLayout>) -> Option<Self> {
        let is_plain = layout.bits <= 64
            && layout.fields.iter().all(|field| field.present.is_none() && !field.is_text());
        is_plain.then(|| Self {
            layout: Arc::clone(layout),
            length: usize::from(layout.bits.div_ceil(8)),
            parts: layout.fields.iter().map(|field| SignalPart::part_of(layout, field)).collect(),
        })
    }

    /// Whether the parts belong to `layout`.
    pub(super) fn is_of(&self, layout: &Arc<PayloadLayout>) -> bool {
        Arc::ptr_eq(&self.layout, layout)
    }

    /// Whether the parts belong to `layout` and a payload of `length` bytes contains all fields.
    #[inline]
    pub(super) fn are_of(&self, layout: &Arc<PayloadLayout>, length: usize) -> bool {
        self.is_of(layout) && (self.length..=8).contains(&length)
    }

    /// Appends `,"signals":[…]`.
    #[inline]
    pub(super) fn write_signals(&mut self, payload: [u8; 8], line: &mut Vec<u8>) {
        line.extend_from_slice(b",\"signals\":[");
        let begin = line.len();
        let word = u64::from_le_bytes(payload);
        for (part, field) in self.parts.iter_mut().zip(&self.layout.fields) {
            if line.len() != begin {
                line.push(b',');
            }
            part.write_part(&self.layout, field, word, line);
        }
        line.push(b']');
    }
}

impl SignalPart {
    fn part_of(layout: &PayloadLayout, field: &SignalField) -> Self {
        Self { number: NumberTemplate::number_of(layout, field), last: None, text: Vec::new() }
    }

    #[inline]
    fn write_part(&mut self, layout: &PayloadLayout, field: &SignalField, word: u64, line: &mut Vec<u8>) {
        if let Some(number) = &self.number
            && number.write_number(field, word, line)
        {
            return;
        }
        let raw = field.extract_bits(&word.to_le_bytes());
        if self.last != raw || raw.is_none() {
            self.last = raw;
            self.text.clear();
            write_general(layout, field, raw.unwrap_or(0), &mut self.text);
        }
        line.extend_from_slice(&self.text);
    }
}

impl NumberTemplate {
    /// `None` for a field whose values are not plain numbers, or almost always have a name.
    fn number_of(layout: &PayloadLayout, field: &SignalField) -> Option<Self> {
        let cut = IntegerPosition::position_of(field)?;
        let (scale, inside) = match field.meaning.as_deref() {
            Some(meaning) if meaning.values.is_some() || meaning.is_composed() => return None,
            Some(meaning) if meaning.scale.is_some_and(|scale| scale.is_reciprocal) => return None,
            Some(meaning) if meaning.scale.is_some() && decimal_digits(meaning) > MOST_DIGITS => return None,
            Some(meaning) => (ScaleTemplate::scale_of(meaning), meaning.permitted_range()?),
            None => (None, [i64::MIN, i64::MAX]),
        };
        // The text of any plain value yields the parts.
        let [least, most] = inside;
        let raw = (0.clamp(least, most)..=most).take(TRIED).find_map(|number| {
            let raw = number.cast_unsigned() & field.mask();
            (is_plain(field, inside, number) && as_integer(&field.convert_raw(raw)) == Some(number))
                .then_some(raw)
        })?;
        let mut text = Vec::new();
        write_general(layout, field, raw, &mut text);
        let (before, rest) = split_after(&text, b"\"raw\":")?;
        let (between, after) = split_after(rest, b"\"value\":")?;
        Some(Self {
            cut,
            scale,
            inside,
            before: before.to_vec(),
            between: between.get(number_length(between)..)?.to_vec(),
            after: after.get(number_length(after)..)?.to_vec(),
        })
    }

    /// Appends the signal; returns `false` if the general writer must write it.
    #[inline]
    fn write_number(&self, field: &SignalField, word: u64, line: &mut Vec<u8>) -> bool {
        let number = self.cut.number(word, 8).filter(|number| is_plain(field, self.inside, *number));
        let Some(number) = number else { return false };
        let rounded = match &self.scale {
            Some(scale) => match scale.round_scaled(number) {
                Some(rounded) => rounded,
                None => return false,
            },
            None => 0,
        };
        line.extend_from_slice(&self.before);
        push_decimal(line, self.cut.raw_bits(word));
        line.extend_from_slice(&self.between);
        match &self.scale {
            Some(scale) => push_fixed(line, rounded, scale.digits),
            None => push_integer(line, number),
        }
        line.extend_from_slice(&self.after);
        true
    }
}

impl ScaleTemplate {
    /// Scale of a meaning; `None` without one.
    fn scale_of(meaning: &ObjectMeaning) -> Option<Self> {
        let digits = decimal_digits(meaning);
        let unit = 10_f64.powi(i32::from(digits));
        meaning.scale.map(|scale| Self { factor: scale.factor, offset: scale.offset, digits, unit })
    }

    /// Scaled value in units of its last digit; `None` if too large.
    #[inline]
    #[expect(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "below 10^15")]
    fn round_scaled(&self, number: i64) -> Option<i64> {
        let shifted = (number as f64 * self.factor + self.offset) * self.unit;
        (shifted.abs() < UNROUNDED).then(|| shifted.round() as i64)
    }
}

/// Whether a number has no label and is inside the range.
#[inline]
fn is_plain(field: &SignalField, [least, most]: [i64; 2], number: i64) -> bool {
    let is_special = |meaning: &ObjectMeaning| {
        (meaning.special.is_some() || meaning.indicators.is_some())
            && meaning.value_label(&field.convert_raw(number.cast_unsigned())).is_some()
    };
    (least..=most).contains(&number) && !field.meaning.as_deref().is_some_and(is_special)
}

/// Writes one signal with the general writer.
fn write_general(layout: &PayloadLayout, field: &SignalField, raw: u64, text: &mut Vec<u8>) {
    visit_signal(layout, (field, raw, &field.convert_raw(raw)), &mut JsonObjectWriter::in_list(text));
}

/// Splits `text` after the first occurrence of `by`.
fn split_after<'a>(text: &'a [u8], by: &[u8]) -> Option<(&'a [u8], &'a [u8])> {
    text.split_at_checked(memchr::memmem::find(text, by)? + by.len())
}

/// Length of the number at the start of `text`, in bytes.
fn number_length(text: &[u8]) -> usize {
    text.iter().take_while(|byte| matches!(byte, b'0'..=b'9' | b'-' | b'.')).count()
}

#[cfg(test)]
mod tests {
    use proptest::option;
    use proptest::prelude::*;

    use super::*;
    use crate::profile::{
        BitName, BitNames, DataType, IndicatorCoding, LayoutOrigin, ParameterIndicators, RawConversion,
        ValueNames,
    };
    use crate::query::record::visit_signals;
    use crate::wire::canopen::ObjectAddress;

    fn names() -> impl Strategy<Value = Option<Arc<ValueNames>>> {
        let names = prop::collection::btree_map(-3_i64..4, "[a-z\"]{0,3}".prop_map(String::from), 0..3);
        option::weighted(0.2, names.prop_map(|names| Arc::new(ValueNames(names))))
    }

    fn factor() -> impl Strategy<Value = Option<RawConversion>> {
        let numbers = prop_oneof![Just(0.1), Just(100.0 / 16383.0), Just(-0.25), -1e3_f64..1e3, Just(1e12)];
        let offsets = prop_oneof![3 => Just(0.0), 1 => -300.0_f64..300.0];
        let factor = (numbers, offsets).prop_map(|(factor, offset)| RawConversion {
            factor,
            offset,
            full_scale: None,
            is_reciprocal: false,
        });
        option::weighted(0.7, factor)
    }

    fn meaning() -> impl Strategy<Value = ObjectMeaning> {
        let bounds =
            (option::weighted(0.3, -40_i64..300), option::weighted(0.3, -40.0_f64..300.0), any::<bool>());
        let texts = ("[a-z\"\\\\\u{1}é]{0,6}", "(bar|°C|%)?");
        let shape = (0_u8..12, option::weighted(0.2, 0_u64..300), option::weighted(0.1, 0_u8..16));
        (texts, factor(), bounds, names(), names(), shape).prop_map(
            |((name, unit), scale, (range, limits, assumed), values, special, (digits, largest, bit))| {
                let name_of_bit = name.clone();
                let list = bit.map(|bit| BitName {
                    bit,
                    width: 1,
                    name: name_of_bit,
                    text: None,
                    off: None,
                    values: None,
                    reserved: false,
                });
                ObjectMeaning {
                    name,
                    unit,
                    scale,
                    digits,
                    range: range.map(|least| [least, least + 50]),
                    limits: limits.map(|least| [least, least + 50.0]),
                    values,
                    special,
                    indicators: largest.map(|largest| ParameterIndicators {
                        bits: 8,
                        largest,
                        coding: IndicatorCoding::J1939,
                    }),
                    bits: list.map(|bit| Arc::new(BitNames { list: vec![bit] })),
                    assumed,
                    ..ObjectMeaning::default()
                }
            },
        )
    }

    fn field() -> impl Strategy<Value = (Option<ObjectMeaning>, u16, DataType)> {
        let types = prop_oneof![
            Just(DataType::Integer8),
            Just(DataType::Integer16),
            Just(DataType::Unsigned16),
            Just(DataType::Unsigned32),
            Just(DataType::Real32),
            Just(DataType::Boolean),
        ];
        (option::weighted(0.8, meaning()), prop_oneof![1_u16..20, Just(8), Just(16), Just(32)], types)
    }

    /// Contiguous fields.
    fn layout() -> impl Strategy<Value = PayloadLayout> {
        prop::collection::vec(field(), 0..5).prop_map(|made| {
            let mut bits = 0;
            let mut fields = Vec::new();
            for (meaning, width, data_type) in made {
                let object = ObjectAddress::new(0x6000, 1);
                let field = SignalField::of_object(object, bits, width, data_type);
                fields.push(SignalField { meaning: meaning.map(Arc::new), ..field });
                bits += width;
            }
            PayloadLayout {
                fields,
                bits,
                origin: LayoutOrigin::Profile,
                assumed: false,
                ..PayloadLayout::default()
            }
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, cases: 2_000, ..ProptestConfig::default() })]

        #[test]
        fn prepared_signals_equal_those_of_the_general_writer(
            layout in layout(),
            payloads in prop::collection::vec(
                prop_oneof![any::<u64>(), 0_u64..300, any::<u8>().prop_map(|byte| u64::from_le_bytes([byte; 8]))],
                1..20,
            ),
        ) {
            let layout = Arc::new(layout);
            let Some(mut prepared) = SignalTemplates::templates_of(&layout) else {
                prop_assert!(layout.bits > 64);
                return Ok(());
            };
            prop_assert!(prepared.are_of(&layout, 8));
            prop_assert!(!prepared.are_of(&layout, usize::from(layout.bits.div_ceil(8)).wrapping_sub(1)));
            // Twice, so that cached texts are also used.
            for payload in payloads.iter().flat_map(|payload| [payload, payload]) {
                let (mut line, mut expected) = (b"{\"a\":1".to_vec(), b"{\"a\":1".to_vec());
                prepared.write_signals(payload.to_le_bytes(), &mut line);
                visit_signals(&layout, &payload.to_le_bytes(), &mut JsonObjectWriter::resume_object(&mut expected));
                prop_assert_eq!(String::from_utf8(line).unwrap(), String::from_utf8(expected).unwrap());
            }
        }
    }

    #[test]
    fn plain_numbers_are_prepared() {
        let with = |meaning| {
            let field = SignalField::of_object(ObjectAddress::new(0x6000, 1), 3, 12, DataType::Integer16);
            let field = SignalField { meaning: Some(Arc::new(meaning)), ..field };
            PayloadLayout { fields: vec![field.clone()], bits: 15, ..PayloadLayout::default() }
        };
        let is_prepared = |meaning| {
            let layout = with(meaning);
            NumberTemplate::number_of(&layout, &layout.fields[0]).is_some()
        };
        let scale =
            Some(RawConversion { factor: 0.1, offset: -40.0, full_scale: None, is_reciprocal: false });
        assert!(is_prepared(ObjectMeaning { scale, range: Some([-1000, -5]), ..ObjectMeaning::default() }));
        assert!(is_prepared(ObjectMeaning {
            indicators: Some(ParameterIndicators { bits: 12, largest: 5, coding: IndicatorCoding::J1939 }),
            ..ObjectMeaning::default()
        }));
        assert!(!is_prepared(ObjectMeaning { digits: 9, scale, ..ObjectMeaning::default() }));
        assert!(!is_prepared(ObjectMeaning { values: Some(Arc::default()), ..ObjectMeaning::default() }));
    }
}
