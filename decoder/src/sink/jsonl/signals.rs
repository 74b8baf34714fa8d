//! Signals of one layout, put together from parts prepared per field.
//!
//! ```text
//! {"id":"0x6300:01","name":"actual pressure","raw":4711,"value":157.5,"unit":"bar","origin":"profile"}
//! └──────────────── before ──────────────────────┘    └between ┘     └──────────── behind ───────────┘
//! ```
//!
//! The parts are cut from a text the general writer wrote. A value with a name, bits or a remark is written by it
//! too and kept until the field has another one: such values change rarely. Property tests compare with it.

use std::sync::Arc;

use super::object::Object;
use crate::ascii::{push_decimal, push_fixed, push_integer};
use crate::profile::{Cut, Field, Layout, Meaning, integer};
use crate::query::record::{UNROUNDED, digits, signal};

/// Digits behind the point that are written here.
const MOST_DIGITS: u8 = 8;

/// Values that are tried until one is not special.
const TRIED: usize = 64;

/// What is prepared of a layout whose fields are always there.
pub(super) struct Signals {
    layout: Arc<Layout>,
    /// Bytes all its fields need.
    length: usize,
    parts: Vec<Part>,
}

/// What is prepared of a field.
struct Part {
    number: Option<Number>,
    /// Bits of the value that was last written in the general way, and what was written.
    last: Option<u64>,
    text: Vec<u8>,
}

/// How a number without name, bits or remark is written.
struct Number {
    cut: Cut,
    scale: Option<Scale>,
    /// Between these no value is remarkable, special ones apart.
    inside: [i64; 2],
    before: Vec<u8>,
    between: Vec<u8>,
    behind: Vec<u8>,
}

struct Scale {
    factor: f64,
    offset: f64,
    digits: u8,
    /// 10 to the power of `digits`.
    unit: f64,
}

impl Signals {
    /// `None` where which fields there are depends on values, and where a payload has more than eight bytes.
    pub(super) fn of(layout: &Arc<Layout>) -> Option<Self> {
        let is_plain = layout.bits <= 64 && layout.fields.iter().all(|field| field.present.is_none());
        is_plain.then(|| Self {
            layout: Arc::clone(layout),
            length: usize::from(layout.bits.div_ceil(8)),
            parts: layout.fields.iter().map(|field| Part::of(layout, field)).collect(),
        })
    }

    /// Whether they are prepared of a layout.
    pub(super) fn is_of(&self, layout: &Arc<Layout>) -> bool {
        Arc::ptr_eq(&self.layout, layout)
    }

    /// Whether these are the signals of a layout in a payload of some length.
    #[inline]
    pub(super) fn are_of(&self, layout: &Arc<Layout>, length: usize) -> bool {
        self.is_of(layout) && (self.length..=8).contains(&length)
    }

    /// Appends `,"signals":[…]`.
    #[inline]
    pub(super) fn write(&mut self, payload: [u8; 8], line: &mut Vec<u8>) {
        line.extend_from_slice(b",\"signals\":[");
        let begin = line.len();
        let word = u64::from_le_bytes(payload);
        for (part, field) in self.parts.iter_mut().zip(&self.layout.fields) {
            if line.len() != begin {
                line.push(b',');
            }
            part.write(&self.layout, field, word, line);
        }
        line.push(b']');
    }
}

impl Part {
    fn of(layout: &Layout, field: &Field) -> Self {
        Self { number: Number::of(layout, field), last: None, text: Vec::new() }
    }

    #[inline]
    fn write(&mut self, layout: &Layout, field: &Field, word: u64, line: &mut Vec<u8>) {
        if let Some(number) = &self.number
            && number.write(field, word, line)
        {
            return;
        }
        let raw = field.extract(&word.to_le_bytes());
        if self.last != raw || raw.is_none() {
            self.last = raw;
            self.text.clear();
            general(layout, field, raw.unwrap_or(0), &mut self.text);
        }
        line.extend_from_slice(&self.text);
    }
}

impl Number {
    /// `None` of a field whose values are no numbers, or hardly ever are without a name.
    fn of(layout: &Layout, field: &Field) -> Option<Self> {
        let cut = Cut::of(field)?;
        let (scale, inside) = match field.meaning.as_deref() {
            Some(Meaning { values: Some(_), .. } | Meaning { bits: Some(_), .. }) => return None,
            Some(meaning) if meaning.scale.is_some() && digits(meaning) > MOST_DIGITS => return None,
            Some(meaning) => (Scale::of(meaning), meaning.inside()?),
            None => (None, [i64::MIN, i64::MAX]),
        };
        // Any value that nothing more is said of shows the parts.
        let [least, most] = inside;
        let raw = (0.clamp(least, most)..=most).take(TRIED).find_map(|number| {
            let raw = number.cast_unsigned() & field.mask();
            (is_plain(field, inside, number) && integer(&field.value(raw)) == Some(number)).then_some(raw)
        })?;
        let mut text = Vec::new();
        general(layout, field, raw, &mut text);
        let (before, rest) = split(&text, b"\"raw\":")?;
        let (between, behind) = split(rest, b"\"value\":")?;
        Some(Self {
            cut,
            scale,
            inside,
            before: before.to_vec(),
            between: between.get(number_length(between)..)?.to_vec(),
            behind: behind.get(number_length(behind)..)?.to_vec(),
        })
    }

    /// Appends the signal; `false` leaves it to the general writer.
    #[inline]
    fn write(&self, field: &Field, word: u64, line: &mut Vec<u8>) -> bool {
        let number = self.cut.number(word, 8).filter(|number| is_plain(field, self.inside, *number));
        let Some(number) = number else { return false };
        let rounded = match &self.scale {
            Some(scale) => match scale.rounded(number) {
                Some(rounded) => rounded,
                None => return false,
            },
            None => 0,
        };
        line.extend_from_slice(&self.before);
        push_decimal(line, self.cut.raw(word));
        line.extend_from_slice(&self.between);
        match &self.scale {
            Some(scale) => push_fixed(line, rounded, scale.digits),
            None => push_integer(line, number),
        }
        line.extend_from_slice(&self.behind);
        true
    }
}

impl Scale {
    /// The scale of a meaning, if it has one.
    fn of(meaning: &Meaning) -> Option<Self> {
        let digits = digits(meaning);
        let unit = 10_f64.powi(i32::from(digits));
        meaning.scale.map(|scale| Self { factor: scale.factor, offset: scale.offset, digits, unit })
    }

    /// The quantity in units of its last digit.
    #[inline]
    #[expect(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "below 10^15")]
    fn rounded(&self, number: i64) -> Option<i64> {
        let shifted = (number as f64 * self.factor + self.offset) * self.unit;
        (shifted.abs() < UNROUNDED).then(|| shifted.round() as i64)
    }
}

/// Whether nothing but its value is said of a number.
#[inline]
fn is_plain(field: &Field, [least, most]: [i64; 2], number: i64) -> bool {
    let is_special = |meaning: &Meaning| {
        (meaning.special.is_some() || meaning.indicators.is_some())
            && meaning.label(&field.value(number.cast_unsigned())).is_some()
    };
    (least..=most).contains(&number) && !field.meaning.as_deref().is_some_and(is_special)
}

/// Writes one signal as any sink gets it.
fn general(layout: &Layout, field: &Field, raw: u64, text: &mut Vec<u8>) {
    signal(layout, (field, raw, &field.value(raw)), &mut Object::in_list(text));
}

/// What stands before the end of `by`, with it, and what behind.
fn split<'a>(text: &'a [u8], by: &[u8]) -> Option<(&'a [u8], &'a [u8])> {
    text.split_at_checked(memchr::memmem::find(text, by)? + by.len())
}

/// Bytes of the number at the beginning.
fn number_length(text: &[u8]) -> usize {
    text.iter().take_while(|byte| matches!(byte, b'0'..=b'9' | b'-' | b'.')).count()
}

#[cfg(test)]
mod tests {
    use proptest::option;
    use proptest::prelude::*;

    use super::*;
    use crate::profile::{BitName, BitNames, DataType, Factor, Indicators, Names};
    use crate::query::record::signals;
    use crate::wire::canopen::ObjectAddress;

    fn names() -> impl Strategy<Value = Option<Arc<Names>>> {
        let names = prop::collection::btree_map(-3_i64..4, "[a-z\"]{0,3}".prop_map(String::from), 0..3);
        option::weighted(0.2, names.prop_map(|names| Arc::new(Names(names))))
    }

    fn factor() -> impl Strategy<Value = Option<Factor>> {
        let numbers = prop_oneof![Just(0.1), Just(100.0 / 16383.0), Just(-0.25), -1e3_f64..1e3, Just(1e12)];
        let offsets = prop_oneof![3 => Just(0.0), 1 => -300.0_f64..300.0];
        let factor =
            (numbers, offsets).prop_map(|(factor, offset)| Factor { factor, offset, full_scale: None });
        option::weighted(0.7, factor)
    }

    fn meaning() -> impl Strategy<Value = Meaning> {
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
                Meaning {
                    name,
                    unit,
                    scale,
                    digits,
                    range: range.map(|least| [least, least + 50]),
                    limits: limits.map(|least| [least, least + 50.0]),
                    values,
                    special,
                    indicators: largest.map(|largest| Indicators { bits: 8, largest }),
                    bits: list.map(|bit| Arc::new(BitNames { list: vec![bit] })),
                    assumed,
                    ..Meaning::default()
                }
            },
        )
    }

    fn field() -> impl Strategy<Value = (Option<Meaning>, u16, DataType)> {
        let types = prop_oneof![
            Just(DataType::Integer8),
            Just(DataType::Integer16),
            Just(DataType::Unsigned16),
            Just(DataType::Unsigned32),
            Just(DataType::Real32),
            Just(DataType::Boolean),
            Just(DataType::VisibleString),
        ];
        (option::weighted(0.8, meaning()), prop_oneof![1_u16..20, Just(8), Just(16), Just(32)], types)
    }

    /// Fields one behind the other.
    fn layout() -> impl Strategy<Value = Layout> {
        prop::collection::vec(field(), 0..5).prop_map(|made| {
            let mut bits = 0;
            let mut fields = Vec::new();
            for (meaning, width, data_type) in made {
                let object = ObjectAddress::new(0x6000, 1);
                let field = Field::of_object(object, bits, width, data_type);
                fields.push(Field { meaning: meaning.map(Arc::new), ..field });
                bits += width;
            }
            Layout { fields, bits, origin: "profile", assumed: false, depends: Vec::new() }
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
            let Some(mut prepared) = Signals::of(&layout) else {
                prop_assert!(layout.bits > 64);
                return Ok(());
            };
            prop_assert!(prepared.are_of(&layout, 8));
            prop_assert!(!prepared.are_of(&layout, usize::from(layout.bits.div_ceil(8)).wrapping_sub(1)));
            // Twice, so that texts that are kept come too.
            for payload in payloads.iter().flat_map(|payload| [payload, payload]) {
                let (mut line, mut expected) = (b"{\"a\":1".to_vec(), b"{\"a\":1".to_vec());
                prepared.write(payload.to_le_bytes(), &mut line);
                signals(&layout, &payload.to_le_bytes(), &mut Object::resume(&mut expected));
                prop_assert_eq!(String::from_utf8(line).unwrap(), String::from_utf8(expected).unwrap());
            }
        }
    }

    #[test]
    fn plain_numbers_are_prepared() {
        let with = |meaning| {
            let field = Field::of_object(ObjectAddress::new(0x6000, 1), 3, 12, DataType::Integer16);
            let field = Field { meaning: Some(Arc::new(meaning)), ..field };
            Layout { fields: vec![field.clone()], bits: 15, ..Layout::default() }
        };
        let is_prepared = |meaning| {
            let layout = with(meaning);
            Number::of(&layout, &layout.fields[0]).is_some()
        };
        let scale = Some(Factor { factor: 0.1, offset: -40.0, full_scale: None });
        assert!(is_prepared(Meaning { scale, range: Some([-1000, -5]), ..Meaning::default() }));
        assert!(is_prepared(Meaning {
            indicators: Some(Indicators { bits: 12, largest: 5 }),
            ..Meaning::default()
        }));
        assert!(!is_prepared(Meaning { digits: 9, scale, ..Meaning::default() }));
        assert!(!is_prepared(Meaning { values: Some(Arc::default()), ..Meaning::default() }));
    }
}
