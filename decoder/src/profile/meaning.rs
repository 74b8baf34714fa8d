//! Resolved meaning of an object on one node at one time: unit, scale, names.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::sync::Arc;

use strum::IntoStaticStr;

use super::data_type::{DataType, DecodedValue};
use super::error_texts::ErrorTexts;
use super::lookup::pgn_name;
use super::names::{BitNames, ValueNames};
use super::object::{NumberFormat, ObjectRole};
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::Pgn;

/// Conversion of a raw number to a quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RawConversion {
    /// Factor in value = raw × factor + offset.
    pub factor: f64,
    /// Offset in value = raw × factor + offset.
    pub offset: f64,
    /// Object that contains the full-scale value, and that value.
    pub full_scale: Option<(ObjectAddress, f64)>,
    /// Whether value = factor / raw + offset; raw 0 has no value.
    pub is_reciprocal: bool,
}

/// Codes of a parameter without a value. J1939: SAE J1939-71 §5.1.4, tables 1 and 2. NMEA 2000: the largest
/// numbers of the type, as canboat reads them.
///
/// ```text
///            bits           error          not available
/// J1939      2..=7          all but bit 0  all
///            8              FE             FF
///            16, 24, 32, …  FExx…          FFxx…
///            others         -              all
/// NMEA 2000  2, 3           -              largest
///            4, 5, …        largest − 1    largest, signed 16 bits: 7FFF
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ParameterIndicators {
    /// Length of the parameter in bits.
    pub bits: u16,
    /// Largest raw value; codes above it have no value.
    pub largest: u64,
    /// Standard that defines the codes.
    pub coding: IndicatorCoding,
}

/// Standard that defines the codes of a parameter without a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum IndicatorCoding {
    /// SAE J1939-71, for unsigned parameters.
    #[default]
    J1939,
    /// NMEA 2000.
    Nmea2000 {
        /// Two's complement: the largest number has a 0 as its first bit.
        is_signed: bool,
    },
}

/// Code in place of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
pub enum IndicatorCode {
    /// The parameter is not available.
    #[strum(serialize = "not available")]
    NotAvailable,
    /// The sensor or the device reports an error.
    #[strum(serialize = "error")]
    Error,
}

impl IndicatorCode {
    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl ParameterIndicators {
    /// Meaning of a code; `None` for values and reserved codes.
    pub fn code(self, raw: u64) -> Option<IndicatorCode> {
        let all = self.greatest_number()?;
        if raw <= self.largest || raw > all {
            return None;
        }
        if self.coding != IndicatorCoding::J1939 {
            const LEAST_WITH_ERROR: u64 = 15;
            return match all - raw {
                0 if all > 1 => Some(IndicatorCode::NotAvailable),
                1 if all >= LEAST_WITH_ERROR => Some(IndicatorCode::Error),
                _ => None,
            };
        }
        let top = if self.bits.is_multiple_of(8) { raw >> (self.bits - 8) } else { 0 };
        match (self.bits, top) {
            (8.., 0xFF) => Some(IndicatorCode::NotAvailable),
            (8.., 0xFE) => Some(IndicatorCode::Error),
            (2.., _) if raw == all => Some(IndicatorCode::NotAvailable),
            (2..=7, _) if raw == all - 1 => Some(IndicatorCode::Error),
            _ => None,
        }
    }

    /// Largest number of the type.
    pub(crate) fn greatest_number(self) -> Option<u64> {
        let is_signed = self.coding == IndicatorCoding::Nmea2000 { is_signed: true };
        let bits = u32::from(self.bits).checked_sub(u32::from(is_signed))?;
        u64::MAX.checked_shr(64_u32.checked_sub(bits)?)
    }
}

/// Interpretation of one object.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObjectMeaning {
    /// Address of the object.
    pub object: ObjectAddress,
    /// Full name.
    pub name: String,
    /// Short name in event lines.
    pub short: Option<String>,
    /// Data type, if known.
    pub data_type: Option<DataType>,
    /// Number format in output.
    pub format: NumberFormat,
    /// Unit of the scaled value; empty for plain numbers.
    pub unit: String,
    /// Scale; `None` for plain numbers.
    pub scale: Option<RawConversion>,
    /// Decimals in output.
    pub decimals: u8,
    /// Max decimals of any value; 0 if unknown.
    pub digits: u8,
    /// Permitted raw values: minimum and maximum.
    pub range: Option<[i64; 2]>,
    /// Permitted values in `unit`: minimum and maximum.
    pub limits: Option<[f64; 2]>,
    /// Names of enumeration values.
    pub values: Option<Arc<ValueNames>>,
    /// Names of raw values other than quantities.
    pub special: Option<Arc<ValueNames>>,
    /// Codes above the largest value, which indicate an error or a missing value (SAE J1939-71).
    pub indicators: Option<ParameterIndicators>,
    /// Names of bits.
    pub bits: Option<Arc<BitNames>>,
    /// Texts of error codes, for an entry of the error history.
    pub errors: Option<ErrorTexts>,
    /// Function of the object in the device.
    pub role: Option<ObjectRole>,
    /// Set point that an actual value follows.
    pub of: Option<ObjectAddress>,
    /// Channel of the device.
    pub channel: Option<u8>,
    /// Whether it depends on a default, or on a value that may have changed without being seen.
    pub assumed: bool,
}

impl ObjectMeaning {
    /// Decodes data with the data type; bytes if the type is unknown.
    pub fn decode(&self, data: &[u8]) -> DecodedValue {
        match self.data_type {
            // CiA 301 §7.5.2.13 and §7.5.2.14: a write contains a signature, a read returns capability bits.
            Some(data_type) if self.format == NumberFormat::Ascii && !is_signature(data) => {
                data_type.decode(data)
            }
            _ if self.format == NumberFormat::Ascii => DataType::VisibleString.decode(data),
            Some(data_type) => data_type.decode(data),
            None => DecodedValue::Bytes(data.to_vec()),
        }
    }

    /// Converts a raw number to a value of the data type.
    pub fn convert_raw(&self, raw: i64) -> DecodedValue {
        self.data_type
            .map_or(DecodedValue::Integer(raw), |data_type| data_type.decode_raw(raw.cast_unsigned()))
    }

    /// Scaled quantity; `None` without a scale, for special values, for codes without a value and for texts. A
    /// value with a name keeps its quantity.
    pub fn scaled_value(&self, value: &DecodedValue) -> Option<f64> {
        let scale = self.scale?;
        if self.is_special(value) || self.has_no_value(value) {
            return None;
        }
        let raw = match value {
            #[expect(
                clippy::cast_precision_loss,
                reason = "scaled values are for display; raw numbers are exact"
            )]
            DecodedValue::Unsigned(raw) => *raw as f64,
            #[expect(
                clippy::cast_precision_loss,
                reason = "scaled values are for display; raw numbers are exact"
            )]
            DecodedValue::Integer(raw) => *raw as f64,
            DecodedValue::Real(raw) => *raw,
            DecodedValue::Text(_) | DecodedValue::Bytes(_) => return None,
        };
        if scale.is_reciprocal {
            return (raw != 0.0).then(|| scale.factor / raw + scale.offset);
        }
        Some(raw * scale.factor + scale.offset)
    }

    /// Name of an enumeration value or special value.
    pub fn value_label(&self, value: &DecodedValue) -> Option<&str> {
        let name = |number| {
            let special = self.special.as_deref().and_then(|names| names.get(number));
            special.or_else(|| self.values.as_deref().and_then(|names| names.get(number)))
        };
        as_integer(value).and_then(name).or_else(|| self.indicator_text(value))
    }

    /// Text that explains a number: its name, the names of its bits, or the parts that it is composed of.
    pub fn description(&self, value: &DecodedValue) -> Option<Cow<'_, str>> {
        if let Some(label) = self.value_label(value) {
            return Some(Cow::Borrowed(label));
        }
        let parts = self.part_texts(as_word(value)?);
        (!parts.is_empty()).then(|| Cow::Owned(parts.join(", ")))
    }

    /// Whether a write of the object contains a signature.
    pub fn is_signature(&self) -> bool {
        self.format == NumberFormat::Ascii
    }

    /// Interpretation of written data: the bits of a signature object describe reads only.
    #[must_use]
    pub fn for_write(self) -> Self {
        if self.is_signature() { Self { bits: None, data_type: None, ..self } } else { self }
    }

    /// Whether its numbers are composed of bits or parts.
    pub fn is_composed(&self) -> bool {
        let is_format = matches!(
            self.format,
            NumberFormat::Mapping
                | NumberFormat::Emcy
                | NumberFormat::HeartbeatConsumer
                | NumberFormat::Date
                | NumberFormat::TimeOfDay
                | NumberFormat::ParameterGroup
        );
        is_format || self.bits.is_some()
    }

    /// Texts of the parts of a composed number.
    fn part_texts(&self, word: u64) -> Vec<String> {
        let word = word & (u64::MAX >> (64 - self.width()));
        let mut parts = match self.format {
            NumberFormat::Date | NumberFormat::TimeOfDay | NumberFormat::ParameterGroup => {
                self.written_number(word).into_iter().collect()
            }
            NumberFormat::Mapping if word != 0 => vec![mapping_entry(word)],
            NumberFormat::HeartbeatConsumer => vec![consumer_heartbeat(word)],
            // CiA 301 §7.5.2.4: the upper 16 bits are manufacturer-specific.
            NumberFormat::Emcy => {
                let code = u16::try_from(word & 0xFFFF).unwrap_or_default();
                self.errors.iter().map(|errors| errors.get(code).to_owned()).collect()
            }
            _ => Vec::new(),
        };
        parts.extend(self.bits.iter().flat_map(|bits| bit_words(bits, word)));
        parts
    }

    /// A date, a time or a group as people write it.
    fn written_number(&self, word: u64) -> Option<String> {
        match self.format {
            NumberFormat::Date => date_text(word),
            NumberFormat::TimeOfDay => {
                let seconds = self.scaled_value(&DecodedValue::Unsigned(word))?;
                Some(clock_text(seconds, self.decimals))
            }
            NumberFormat::ParameterGroup => {
                let pgn = Pgn::new(u32::try_from(word).ok()?);
                Some(
                    pgn_name(pgn)
                        .map_or_else(|| pgn.number().to_string(), |name| format!("{} {name}", pgn.number())),
                )
            }
            _ => None,
        }
    }

    /// Length of the data type in bits, 1 to 64.
    fn width(&self) -> u16 {
        self.data_type.and_then(DataType::bits).unwrap_or(64).clamp(1, 64)
    }

    /// Whether a value has a name other than a quantity.
    fn is_special(&self, value: &DecodedValue) -> bool {
        let number = as_integer(value);
        number.zip(self.special.as_deref()).is_some_and(|(number, names)| names.get(number).is_some())
    }

    /// Whether a code indicates a missing or erroneous value: a J1939 indicator, or a code with such a name.
    pub fn has_no_value(&self, value: &DecodedValue) -> bool {
        /// Names used by SAE J1939-71 §5.1.4 and by databases ("SNA": signal not available).
        const NAMES: [&str; 5] = ["not available", "signal not available", "sna", "error", "error indicator"];
        if self.indicator_text(value).is_some() {
            return true;
        }
        let name = as_integer(value).and_then(|number| self.values.as_deref()?.get(number));
        name.is_some_and(|name| NAMES.iter().any(|known| name.trim().eq_ignore_ascii_case(known)))
    }

    /// Meaning of an indicator code.
    fn indicator_text(&self, value: &DecodedValue) -> Option<&'static str> {
        match value {
            DecodedValue::Unsigned(raw) => self.indicators?.code(*raw),
            DecodedValue::Integer(raw) => self.indicators?.code(u64::try_from(*raw).ok()?),
            _ => None,
        }
        .map(IndicatorCode::name)
    }

    /// Whether a value is outside the range permitted by the manual.
    pub fn is_outside(&self, value: &DecodedValue) -> bool {
        let Some(number) = as_integer(value) else { return false };
        if self.is_special(value) || self.has_no_value(value) {
            return false;
        }
        let outside_range = self.range.is_some_and(|[least, most]| number < least || number > most);
        #[expect(clippy::cast_precision_loss, reason = "compared with limits that have few digits")]
        let quantity = match self.scale {
            // A code with a name may exceed the limits of the quantity.
            Some(_) if self.value_label(value).is_some() => None,
            Some(_) => self.scaled_value(value),
            None => Some(number as f64),
        };
        let outside_limits = match (self.limits, quantity) {
            // Half a step of the raw number, because manuals state rounded limits.
            (Some([least, most]), Some(quantity)) => {
                let linear = self.scale.filter(|scale| !scale.is_reciprocal);
                let slack = linear.map_or(0.0, |scale| scale.factor.abs()) / 2.0 + f64::EPSILON;
                quantity < least - slack || quantity > most + slack
            }
            _ => false,
        };
        outside_range || outside_limits
    }

    /// Raw numbers that are permitted throughout: minimum and maximum; `None` if they form no single range.
    pub fn permitted_range(&self) -> Option<[i64; 2]> {
        let [mut least, mut most] = self.range.unwrap_or([i64::MIN, i64::MAX]);
        if let Some([low, high]) = self.limits {
            if self.scale.is_some_and(|scale| scale.is_reciprocal) {
                return None;
            }
            let (factor, offset) = self.scale.map_or((1.0, 0.0), |scale| (scale.factor, scale.offset));
            let ends = [low, high].map(|limit| (limit - offset) / factor);
            if !ends.iter().all(|end| end.is_finite()) {
                return None;
            }
            #[expect(clippy::cast_possible_truncation, reason = "saturates")]
            let [low, high] = [ends[0].min(ends[1]).ceil() as i64, ends[0].max(ends[1]).floor() as i64];
            (least, most) = (least.max(low), most.min(high));
        }
        // A quantity is monotonic in its number: if both ends are permitted, so are all numbers between them.
        let is_right = |number| !self.is_outside(&DecodedValue::Integer(number));
        (least <= most && is_right(least) && is_right(most)).then_some([least, most])
    }

    /// Value for output: `157.5 bar`, `CAN bus`, `80000185h`, `pressure control`.
    pub fn format_value(&self, value: &DecodedValue) -> String {
        if let Some(label) = self.value_label(value) {
            return match self.values {
                Some(_) if self.is_special(value) || self.has_no_value(value) => {
                    format!("{label} ({})", self.format_plain(value))
                }
                Some(_) => format!("{label} ({})", self.format_quantity(value)),
                None => label.to_owned(),
            };
        }
        if let Some(text) = as_word(value).and_then(|word| self.written_number(word)) {
            return text;
        }
        match as_word(value) {
            Some(word) if self.is_composed() && self.format != NumberFormat::Mapping => self.show_parts(word),
            _ => self.format_quantity(value),
        }
    }

    /// Number with its unit.
    fn format_quantity(&self, value: &DecodedValue) -> String {
        match self.scaled_value(value) {
            Some(quantity) => self.with_unit(&format!("{quantity:.*}", usize::from(self.decimals))),
            None if self.scale.is_some_and(|scale| scale.is_reciprocal) => self.format_plain(value),
            None => self.with_unit(&self.format_plain(value)),
        }
    }

    /// Formats a composed number: `08h pressure control, parameter-set 2`.
    fn show_parts(&self, word: u64) -> String {
        let digits = usize::from(self.width().div_ceil(4));
        let word = word & (u64::MAX >> (64 - self.width()));
        let mut text = format!("{word:0digits$X}h");
        for (place, part) in self.part_texts(word).iter().enumerate() {
            let separator = if place == 0 { " " } else { ", " };
            let _ = write!(text, "{separator}{part}");
        }
        text
    }

    /// Like [`Self::format_value`], with a sign if the value can be negative, and a remark if it is outside.
    pub fn format_signed(&self, value: &DecodedValue) -> String {
        let text = self.format_value(value);
        let shows = 0.5 / 10_f64.powi(i32::from(self.decimals));
        let is_positive = self.scaled_value(value).is_some_and(|quantity| quantity >= shows);
        let both_ways = self.range.is_some_and(|[least, _]| least < 0)
            || self.limits.is_some_and(|[least, _]| least < 0.0);
        let sign = if is_positive && both_ways { "+" } else { "" };
        let outside = if self.is_outside(value) { " (outside)" } else { "" };
        format!("{sign}{text}{outside}")
    }

    fn with_unit(&self, number: &str) -> String {
        // Avoids "-0.0".
        let number = match number.strip_prefix('-') {
            Some(digits) if digits.bytes().all(|digit| matches!(digit, b'0' | b'.')) => digits,
            _ => number,
        };
        if self.unit.is_empty() { number.to_owned() } else { format!("{number} {}", self.unit) }
    }

    fn format_plain(&self, value: &DecodedValue) -> String {
        match (value, self.format) {
            (DecodedValue::Unsigned(number), NumberFormat::Hex) => {
                let digits = usize::from(self.data_type.and_then(DataType::bits).unwrap_or(32).div_ceil(4));
                format!("{number:0digits$X}h")
            }
            (DecodedValue::Unsigned(number), NumberFormat::Mapping) if *number != 0 => mapping_entry(*number),
            _ => value.to_string(),
        }
    }
}

/// Value as a signed number.
pub fn as_integer(value: &DecodedValue) -> Option<i64> {
    match value {
        DecodedValue::Unsigned(number) => i64::try_from(*number).ok(),
        DecodedValue::Integer(number) => Some(*number),
        _ => None,
    }
}

/// Value as raw bits.
pub fn as_word(value: &DecodedValue) -> Option<u64> {
    match value {
        DecodedValue::Unsigned(number) => Some(*number),
        DecodedValue::Integer(number) => Some(number.cast_unsigned()),
        _ => None,
    }
}

/// Formats a mapping entry: bits 31..16 index, 15..8 sub-index, 7..0 length in bits (CiA 301 figure 70).
fn mapping_entry(word: u64) -> String {
    format!("{:04X}:{:02X}/{} bit", word >> 16, word >> 8 & 0xFF, word & 0xFF)
}

/// Formats a consumer heartbeat time: bits 23..16 node-ID, 15..0 time in ms. An entry with time 0, or with a
/// node-ID of 0 or above 127, is not used (CiA 301 §7.5.2.19).
fn consumer_heartbeat(word: u64) -> String {
    match (word >> 16 & 0xFF, word & 0xFFFF) {
        (0 | 128.., _) | (_, 0) => "unused".to_owned(),
        (node, time) => format!("node {node}, {time} ms"),
    }
}

/// `2022-09-10` for days since 1970-01-01.
fn date_text(days: u64) -> Option<String> {
    let days = jiff::Span::new().try_days(i64::try_from(days).ok()?).ok()?;
    jiff::civil::date(1970, 1, 1).checked_add(days).ok().map(|date| date.to_string())
}

/// `12:06:57.0000` for seconds since midnight.
fn clock_text(seconds: f64, decimals: u8) -> String {
    let digits = usize::from(decimals);
    let width = if digits == 0 { 2 } else { digits.saturating_add(3) };
    let minutes = (seconds / 60.0).floor();
    let rest = seconds - minutes * 60.0;
    format!("{:02.0}:{:02.0}:{rest:0width$.digits$}", (minutes / 60.0).floor(), minutes % 60.0)
}

/// Whether data consists of printable characters only.
fn is_signature(data: &[u8]) -> bool {
    !data.is_empty() && data.iter().all(|byte| byte.is_ascii_graphic() || *byte == b' ')
}

/// Texts for the bits of a word: names of set bits, texts of clear bits if defined, numbers.
pub fn bit_words(bits: &BitNames, word: u64) -> Vec<String> {
    let named = bits.list.iter().filter(|bit| !bit.reserved);
    named.filter_map(|bit| bit.bit_word(bit.bits_of(word))).collect()
}

impl super::names::BitName {
    /// Text of the set bit: that for event lines, else the name.
    pub fn bit_title(&self) -> &str {
        self.text.as_deref().unwrap_or(&self.name)
    }

    /// Text for the number in these bits; `None` if nothing is to be shown.
    pub fn bit_word(&self, number: u64) -> Option<String> {
        let title = self.bit_title();
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

#[cfg(test)]
mod tests {
    use super::*;

    /// RE 29015-01-Z/09.06 §6.3: 1310 is an integral time of 100 ms, greater values shorten it.
    #[test]
    fn a_reciprocal_scale_has_no_value_at_0() {
        let scale = RawConversion { factor: 131_000.0, offset: 0.0, full_scale: None, is_reciprocal: true };
        let meaning =
            ObjectMeaning { unit: "ms".into(), scale: Some(scale), decimals: 1, ..ObjectMeaning::default() };
        let show = |raw| meaning.format_value(&DecodedValue::Unsigned(raw));
        assert_eq!([show(1310), show(2620), show(65535), show(0)], ["100.0 ms", "50.0 ms", "2.0 ms", "0"]);
        assert_eq!(meaning.scaled_value(&DecodedValue::Unsigned(0)), None);
        let limited = ObjectMeaning { limits: Some([2.0, 100.0]), ..meaning };
        assert!(
            limited.is_outside(&DecodedValue::Unsigned(1309))
                && !limited.is_outside(&DecodedValue::Unsigned(1310))
        );
        assert_eq!(limited.permitted_range(), None);
    }
}
