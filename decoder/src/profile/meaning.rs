//! What a number of an object means on one node at one time: unit, scale, names, everything resolved.

use std::fmt::Write as _;
use std::sync::Arc;

use super::data_type::{DataType, Value};
use super::names::{BitNames, Names};
use super::object::{Format, Role};
use crate::wire::canopen::ObjectAddress;

/// Raw number to quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factor {
    /// value = raw × factor + offset.
    pub factor: f64,
    /// Added after scaling.
    pub offset: f64,
    /// Object that holds the full-scale value, and that value.
    pub full_scale: Option<(ObjectAddress, f64)>,
}

/// Codes of a parameter that carry no value (SAE J1939-71 §5.1.4, tables 1 and 2).
///
/// ```text
/// bits           error          not available
/// 2..=7          all but bit 0  all
/// 8              FE             FF
/// 16, 24, 32, …  FExx…          FFxx…
/// others         -              all
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Indicators {
    /// Width of the parameter in bits.
    pub bits: u16,
    /// Largest raw value; codes up to it are values.
    pub largest: u64,
}

impl Indicators {
    /// What a code says; `None` for values and codes that are reserved.
    pub fn label(self, raw: u64) -> Option<&'static str> {
        let all = u64::MAX.checked_shr(64_u32.checked_sub(u32::from(self.bits))?)?;
        if raw <= self.largest || raw > all {
            return None;
        }
        let top = if self.bits.is_multiple_of(8) { raw >> (self.bits - 8) } else { 0 };
        match (self.bits, top) {
            (8.., 0xFF) => Some("not available"),
            (8.., 0xFE) => Some("error"),
            (2.., _) if raw == all => Some("not available"),
            (2..=7, _) if raw == all - 1 => Some("error"),
            _ => None,
        }
    }
}

/// How one object is read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Meaning {
    /// The object.
    pub object: ObjectAddress,
    /// Full name.
    pub name: String,
    /// The word for it in lines.
    pub short: Option<String>,
    /// Type, if known.
    pub data_type: Option<DataType>,
    /// How people read it.
    pub format: Format,
    /// Unit of the scaled value; empty for plain numbers.
    pub unit: String,
    /// Scale; `None` for plain numbers.
    pub scale: Option<Factor>,
    /// Digits after the point.
    pub decimals: u8,
    /// Digits after the point no value has more of; 0 if that is not known.
    pub digits: u8,
    /// Permitted raw values.
    pub range: Option<[i64; 2]>,
    /// Permitted values in `unit`.
    pub limits: Option<[f64; 2]>,
    /// Enumeration.
    pub values: Option<Arc<Names>>,
    /// Raw values that are no quantity.
    pub special: Option<Arc<Names>>,
    /// Raw values above the largest one that say why there is none (SAE J1939-71).
    pub indicators: Option<Indicators>,
    /// Named bits.
    pub bits: Option<Arc<BitNames>>,
    /// What it is for the device.
    pub role: Option<Role>,
    /// Of an actual value the set point it follows.
    pub of: Option<ObjectAddress>,
    /// Output of the device.
    pub channel: Option<u8>,
    /// Rests on a default, or on a value that may have changed unseen.
    pub assumed: bool,
}

impl Meaning {
    /// The value of bytes; bytes where the type is unknown.
    pub fn decode(&self, data: &[u8]) -> Value {
        match self.data_type {
            _ if self.format == Format::Ascii => DataType::VisibleString.decode(data),
            Some(data_type) => data_type.decode(data),
            None => Value::Bytes(data.to_vec()),
        }
    }

    /// A number as a value of its type.
    pub fn number(&self, raw: i64) -> Value {
        self.data_type.map_or(Value::Integer(raw), |data_type| data_type.number(raw.cast_unsigned()))
    }

    /// The scaled quantity; `None` without scale, and for special values and texts.
    pub fn scaled(&self, value: &Value) -> Option<f64> {
        let scale = self.scale?;
        if self.label(value).is_some() {
            return None;
        }
        let raw = match value {
            #[expect(clippy::cast_precision_loss, reason = "scaled values are for reading; raw is the truth")]
            Value::Unsigned(raw) => *raw as f64,
            #[expect(clippy::cast_precision_loss, reason = "scaled values are for reading; raw is the truth")]
            Value::Integer(raw) => *raw as f64,
            Value::Real(raw) => *raw,
            Value::Text(_) | Value::Bytes(_) => return None,
        };
        Some(raw * scale.factor + scale.offset)
    }

    /// Name of a value: of an enumeration, or a special one.
    pub fn label(&self, value: &Value) -> Option<&str> {
        let name = |number| {
            let special = self.special.as_deref().and_then(|names| names.get(number));
            special.or_else(|| self.values.as_deref().and_then(|names| names.get(number)))
        };
        integer(value).and_then(name).or_else(|| self.indicated(value))
    }

    /// What a code beyond the values says.
    fn indicated(&self, value: &Value) -> Option<&'static str> {
        match value {
            Value::Unsigned(raw) => self.indicators?.label(*raw),
            _ => None,
        }
    }

    /// Whether a value lies outside what the manual permits.
    pub fn is_outside(&self, value: &Value) -> bool {
        let Some(number) = integer(value) else { return false };
        let is_special = self.special.as_deref().is_some_and(|names| names.get(number).is_some());
        if is_special || self.indicated(value).is_some() {
            return false;
        }
        let outside_range = self.range.is_some_and(|[least, most]| number < least || number > most);
        #[expect(clippy::cast_precision_loss, reason = "compared with limits of few digits")]
        let quantity = self.scaled(value).or_else(|| self.scale.is_none().then_some(number as f64));
        let outside_limits = match (self.limits, quantity) {
            // Half a step of the raw number: limits are printed rounded.
            (Some([least, most]), Some(quantity)) => {
                let slack = self.scale.map_or(0.0, |scale| scale.factor.abs()) / 2.0 + f64::EPSILON;
                quantity < least - slack || quantity > most + slack
            }
            _ => false,
        };
        outside_range || outside_limits
    }

    /// Between which raw numbers no value lies outside; `None` where that is not told by their ends.
    pub fn inside(&self) -> Option<[i64; 2]> {
        let [mut least, mut most] = self.range.unwrap_or([i64::MIN, i64::MAX]);
        if let Some([low, high]) = self.limits {
            let (factor, offset) = self.scale.map_or((1.0, 0.0), |scale| (scale.factor, scale.offset));
            let ends = [low, high].map(|limit| (limit - offset) / factor);
            if !ends.iter().all(|end| end.is_finite()) {
                return None;
            }
            #[expect(clippy::cast_possible_truncation, reason = "saturates")]
            let [low, high] = [ends[0].min(ends[1]).ceil() as i64, ends[0].max(ends[1]).floor() as i64];
            (least, most) = (least.max(low), most.min(high));
        }
        // A quantity rises or falls with its number: what holds at both ends holds between them.
        let is_right = |number| !self.is_outside(&Value::Integer(number));
        (least <= most && is_right(least) && is_right(most)).then_some([least, most])
    }

    /// The value as people write it: `157.5 bar`, `CAN bus`, `80000185h`, `pressure control`.
    pub fn show(&self, value: &Value) -> String {
        if let Some(label) = self.label(value) {
            return match self.values {
                Some(_) => format!("{label} ({})", self.plain(value)),
                None => label.to_owned(),
            };
        }
        if let (Some(bits), Some(word)) = (self.bits.as_deref(), word(value)) {
            return show_bits(bits, word, self.data_type);
        }
        match self.scaled(value) {
            Some(quantity) => self.with_unit(&format!("{quantity:.*}", usize::from(self.decimals))),
            None => self.with_unit(&self.plain(value)),
        }
    }

    /// The same with its sign where it can have either, and a remark where the manual does not permit it.
    pub fn signed(&self, value: &Value) -> String {
        let text = self.show(value);
        let shows = 0.5 / 10_f64.powi(i32::from(self.decimals));
        let is_positive = self.scaled(value).is_some_and(|quantity| quantity >= shows);
        let both_ways = self.range.is_some_and(|[least, _]| least < 0)
            || self.limits.is_some_and(|[least, _]| least < 0.0);
        let sign = if is_positive && both_ways { "+" } else { "" };
        let outside = if self.is_outside(value) { " (outside)" } else { "" };
        format!("{sign}{text}{outside}")
    }

    fn with_unit(&self, number: &str) -> String {
        // "-0.0" reads as a sign that is not there.
        let number = match number.strip_prefix('-') {
            Some(digits) if digits.bytes().all(|digit| matches!(digit, b'0' | b'.')) => digits,
            _ => number,
        };
        if self.unit.is_empty() { number.to_owned() } else { format!("{number} {}", self.unit) }
    }

    fn plain(&self, value: &Value) -> String {
        match (value, self.format) {
            (Value::Unsigned(number), Format::Hex) => {
                let digits = usize::from(self.data_type.and_then(DataType::bits).unwrap_or(32).div_ceil(4));
                format!("{number:0digits$X}h")
            }
            // Bits 31..16 index, 15..8 sub-index, 7..0 width (CiA 301 figure 70).
            (Value::Unsigned(number), Format::Mapping) if *number != 0 => {
                format!("{:04X}:{:02X}/{} bit", number >> 16, number >> 8 & 0xFF, number & 0xFF)
            }
            _ => value.to_string(),
        }
    }
}

/// A number as signed.
pub fn integer(value: &Value) -> Option<i64> {
    match value {
        Value::Unsigned(number) => i64::try_from(*number).ok(),
        Value::Integer(number) => Some(*number),
        _ => None,
    }
}

/// A number as bits.
pub fn word(value: &Value) -> Option<u64> {
    match value {
        Value::Unsigned(number) => Some(*number),
        Value::Integer(number) => Some(number.cast_unsigned()),
        _ => None,
    }
}

/// `08h pressure control, parameter-set 2`.
fn show_bits(bits: &BitNames, word: u64, data_type: Option<DataType>) -> String {
    let width = data_type.and_then(DataType::bits).unwrap_or(64).clamp(1, 64);
    let digits = usize::from(width.div_ceil(4));
    let word = word & (u64::MAX >> (64 - width));
    let mut text = format!("{word:0digits$X}h");
    let words = bit_words(bits, word);
    for (place, part) in words.iter().enumerate() {
        let separator = if place == 0 { " " } else { ", " };
        // Writing to a string cannot fail.
        let _ = write!(text, "{separator}{part}");
    }
    text
}

/// Words for the bits of a word: set ones by name, clear ones that have a word for it, numbers.
pub fn bit_words(bits: &BitNames, word: u64) -> Vec<String> {
    let named = bits.list.iter().filter(|bit| !bit.reserved);
    named.filter_map(|bit| bit.word(bit.of(word))).collect()
}

impl super::names::BitName {
    /// The word for a number of these bits; `None` where there is nothing to say.
    pub fn word(&self, number: u64) -> Option<String> {
        let title = self.text.as_deref().unwrap_or(&self.name);
        if self.width == 1 {
            return if number == 0 { self.off.clone() } else { Some(title.to_owned()) };
        }
        match &self.values {
            Some(values) => {
                let name = i64::try_from(number).ok().and_then(|number| values.get(number));
                Some(name.map_or_else(|| format!("{title} {number}"), |name| format!("{title} {name}")))
            }
            None if number == 0 => None,
            None => Some(format!("{title} {number}")),
        }
    }
}
