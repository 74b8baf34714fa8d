//! Values in a filter: parsed for the type of their field and compared with field values of events.

use std::cmp::Ordering;

use super::expression::Operand;
use super::fields::{FieldTarget, FieldType, nearest_candidate};
use super::record::FieldValue;
use crate::profile::PdoName;
use crate::wire::canopen::ObjectAddress;

/// Factor of fixed-point numbers: nanoseconds, and nine decimals.
const SCALE: i128 = 1_000_000_000;

/// Decimals that [`SCALE`] can represent.
const SCALE_DIGITS: usize = 9;

/// A number as written: exact with up to nine decimals, otherwise the nearest `f64`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ExactNumber {
    /// Value multiplied by [`SCALE`]; `None` with more decimals.
    scaled: Option<i128>,
    real: f64,
}

/// A value, parsed in every form that its field can need.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Literal {
    number: Option<ExactNumber>,
    truth: Option<bool>,
    object: Option<ObjectAddress>,
    bytes: Option<Vec<u8>>,
    text: Option<String>,
}

impl Literal {
    /// Parses `operand` as a value of `target`.
    ///
    /// # Errors
    /// The value does not have the type of the field.
    pub(super) fn parse_literal(operand: &Operand, target: FieldTarget) -> Result<Self, String> {
        let needed = target.value();
        let is_word = !operand.is_quoted;
        let text = operand.text.as_str();
        let mut literal = Self::default();
        match needed {
            FieldType::Any => {
                literal.number = if is_word { parse_number(text) } else { None };
                literal.bytes = parse_data(operand);
                literal.text = Some(text.to_owned());
            }
            FieldType::Bool => {
                literal.truth = match text {
                    "true" | "1" => Some(true),
                    "false" | "0" => Some(false),
                    _ => None,
                };
            }
            FieldType::Unsigned | FieldType::Integer | FieldType::Real | FieldType::Seconds => {
                literal.number = if is_word { parse_number(text) } else { None };
            }
            FieldType::Code | FieldType::Id if is_word => literal.number = Some(parse_code(text)?),
            FieldType::Object if is_word => literal.object = Some(parse_object(text)?),
            FieldType::Bytes => literal.bytes = parse_data(operand),
            FieldType::Text => literal.text = Some(text.to_owned()),
            FieldType::Code | FieldType::Id | FieldType::Object | FieldType::Group => {}
        }
        if literal == Self::default() {
            return Err(format!("{} is {}; found '{text}'", target.field.key, needed.name()));
        }
        literal.check_values(target)?;
        Ok(literal)
    }

    /// Parses `operand` as a part that `contains` searches for in `target`.
    ///
    /// # Errors
    /// The field is neither text nor bytes, or the bytes are invalid.
    pub(super) fn read_part(operand: &Operand, target: FieldTarget) -> Result<Self, String> {
        let text = || Some(operand.text.clone());
        match target.value() {
            FieldType::Text => Ok(Self { text: text(), ..Self::default() }),
            FieldType::Any => Ok(Self { text: text(), bytes: parse_data(operand), ..Self::default() }),
            FieldType::Bytes => match parse_data(operand) {
                Some(bytes) => Ok(Self { bytes: Some(bytes), ..Self::default() }),
                None => Err(format!("'{}' is not a valid byte string; expected e.g. DE:AD", operand.text)),
            },
            other => {
                Err(format!("contains requires text or bytes; {} is {}", target.field.key, other.name()))
            }
        }
    }

    /// Rejects texts outside the fixed list of values of the field.
    fn check_values(&self, target: FieldTarget) -> Result<(), String> {
        let key = target.field.key.as_str();
        let values: Vec<&str> = if key == "kind" {
            target.field.kinds.names().collect()
        } else {
            target.field.values.iter().map(String::as_str).collect()
        };
        let Some(text) = self.text.as_deref() else { return Ok(()) };
        if key == "pdo" {
            return check_pdo(text);
        }
        if values.is_empty() || values.contains(&text) || self.number.is_some() {
            return Ok(());
        }
        let hint = match nearest_candidate(text, &values.iter().copied()) {
            Some(value) => format!("did you mean {value}?"),
            None => format!("expected {}", values.join(", ")),
        };
        Err(format!("unknown {key} '{text}'; {hint}"))
    }

    /// Order of a field value relative to this value; `None` if the types differ.
    pub(super) fn compare_field(&self, reported: &FieldValue<'_>) -> Option<Ordering> {
        match *reported {
            FieldValue::Null => None,
            FieldValue::Bool(reported) => self.truth.map(|truth| reported.cmp(&truth)),
            FieldValue::Unsigned(reported) | FieldValue::Code(reported, _) => {
                self.number?.compare_number(i128::from(reported) * SCALE)
            }
            FieldValue::Integer(reported) => self.number?.compare_number(i128::from(reported) * SCALE),
            FieldValue::Id(id) => self.number?.compare_number(i128::from(id.number()) * SCALE),
            FieldValue::Seconds(reported) => self.number?.compare_number(i128::from(reported)),
            FieldValue::Real(reported) => reported.partial_cmp(&self.number?.real),
            FieldValue::Text(reported) => self.text.as_deref().map(|text| reported.cmp(text)),
            FieldValue::Object(reported) => self.object.map(|object| reported.cmp(&object)),
            FieldValue::Bytes(reported) => self.bytes.as_deref().map(|bytes| reported.cmp(bytes)),
        }
    }

    /// Whether the field value contains this value.
    pub(super) fn is_within(&self, reported: &FieldValue<'_>) -> bool {
        match *reported {
            FieldValue::Text(reported) => self.text.as_deref().is_some_and(|text| reported.contains(text)),
            FieldValue::Bytes(reported) => {
                self.bytes.as_deref().is_some_and(|bytes| has_within(reported, bytes))
            }
            _ => false,
        }
    }
}

/// Checks the form of a PDO name; PDO names have no fixed list.
fn check_pdo(text: &str) -> Result<(), String> {
    let name = text.parse::<PdoName>().map(|name| name.to_string());
    let hint = match name {
        Ok(name) if name == text => return Ok(()),
        Ok(name) => format!("did you mean {name}?"),
        Err(form) => {
            let letters = text.trim_end_matches(|letter: char| letter.is_ascii_digit());
            let number = text.strip_prefix(letters).filter(|number| !number.is_empty());
            let meant = nearest_candidate(letters, &["tpdo", "rpdo"].into_iter()).zip(number);
            let meant =
                meant.and_then(|(letters, number)| format!("{letters}{number}").parse::<PdoName>().ok());
            meant.map_or_else(|| form.to_owned(), |name| format!("did you mean {name}?"))
        }
    };
    Err(format!("unknown pdo '{text}'; {hint}"))
}

fn has_within(data: &[u8], part: &[u8]) -> bool {
    memchr::memmem::find(data, part).is_some()
}

/// Parses `12`, `-3`, `0x1F`, `1.5`, `2e3`.
fn parse_number(text: &str) -> Option<ExactNumber> {
    let (is_negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text),
    };
    let sign = if is_negative { -1 } else { 1 };
    if let Some(hex) = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")) {
        let value = i128::from(hex_number(hex)?) * sign;
        return Some(ExactNumber::from_whole(value));
    }
    if !digits.starts_with(|first: char| first.is_ascii_digit()) {
        return None;
    }
    let real: f64 = text.parse().ok()?;
    let scaled = scale_digits(digits).map(|value| value * sign);
    Some(ExactNumber { scaled, real })
}

fn hex_number(digits: &str) -> Option<u64> {
    let is_hex = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    if is_hex { u64::from_str_radix(digits, 16).ok() } else { None }
}

/// Digits with at most nine decimals, multiplied by [`SCALE`].
fn scale_digits(digits: &str) -> Option<i128> {
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let is_plain = whole.bytes().chain(fraction.bytes()).all(|digit| digit.is_ascii_digit());
    if !is_plain || fraction.len() > SCALE_DIGITS {
        return None;
    }
    format!("{whole}{fraction:0<SCALE_DIGITS$}").parse().ok()
}

impl ExactNumber {
    fn from_whole(value: i128) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "rounding to the nearest is intended")]
        let real = value as f64;
        Self { scaled: Some(value * SCALE), real }
    }

    /// Order of a number multiplied by [`SCALE`] relative to this number.
    fn compare_number(self, reported: i128) -> Option<Ordering> {
        #[expect(clippy::cast_precision_loss, reason = "used only if the literal is not exact either")]
        let real = || reported as f64 / SCALE as f64;
        match self.scaled {
            Some(own) => Some(reported.cmp(&own)),
            None => real().partial_cmp(&self.real),
        }
    }
}

/// Parses `0x8130` or `8130h`. Digits without a prefix are rejected if decimal and hex differ: output shows
/// codes and identifiers in hex, so the wrong base would match nothing without an error.
fn parse_code(text: &str) -> Result<ExactNumber, String> {
    let by_suffix = || text.strip_suffix(['h', 'H']).and_then(hex_number);
    if let Some(value) = by_suffix() {
        return Ok(ExactNumber::from_whole(i128::from(value)));
    }
    let is_marked = text.starts_with("0x") || text.starts_with("0X");
    match (parse_number(text), hex_number(text)) {
        (Some(number), _) if is_marked => Ok(number),
        (Some(number), Some(hex)) if number == ExactNumber::from_whole(i128::from(hex)) => Ok(number),
        (Some(ExactNumber { scaled: Some(scaled), .. }), Some(hex)) => {
            let decimal = scaled / SCALE;
            Err(format!("'{text}' is ambiguous; write 0x{hex:X}, or 0x{decimal:X} for decimal {decimal}"))
        }
        (_, Some(hex)) => Err(format!("'{text}' needs a prefix; write 0x{hex:X}")),
        _ => Err(format!("'{text}' is not a valid number; expected e.g. 0x8130")),
    }
}

/// Parses `0x1018:01`, `1018:01`, `1018h:01h`, `1018sub1`: always hexadecimal.
fn parse_object(text: &str) -> Result<ObjectAddress, String> {
    let lower = text.to_ascii_lowercase();
    let hex = |text: &str| {
        let digits = text.strip_prefix("0x").unwrap_or(text);
        hex_number(digits.strip_suffix('h').unwrap_or(digits))
    };
    let Some((index, sub)) = lower.split_once(':').or_else(|| lower.split_once("sub")) else {
        let index = hex(&lower).map_or_else(|| "0x1018".into(), |index| format!("0x{index:04X}"));
        return Err(format!("sub-index missing; write {index}:00, or use .index for all sub-indexes"));
    };
    let (index, sub) = (hex(index), hex(sub));
    let index = index.and_then(|index| u16::try_from(index).ok());
    let sub = sub.and_then(|sub| u8::try_from(sub).ok());
    match (index, sub) {
        (Some(index), Some(sub)) => Ok(ObjectAddress::new(index, sub)),
        _ => Err(format!("'{text}' is not a valid object; expected e.g. 0x1018:01")),
    }
}

/// Parses `DEADBEEF`, `de:ad:be:ef` or `0xDEAD`; in quotes the bytes of the text.
fn parse_data(operand: &Operand) -> Option<Vec<u8>> {
    if operand.is_quoted {
        return Some(operand.text.clone().into_bytes());
    }
    let text = operand.text.strip_prefix("0x").unwrap_or(&operand.text);
    let digits: Vec<u8> = text.bytes().filter(|letter| !matches!(letter, b':' | b'-' | b'.')).collect();
    let mut pairs = digits.chunks_exact(2);
    let bytes = pairs.by_ref().map(|pair| {
        let pair = std::str::from_utf8(pair).ok()?;
        hex_number(pair).and_then(|byte| u8::try_from(byte).ok())
    });
    let bytes: Option<Vec<u8>> = bytes.collect();
    bytes.filter(|bytes| !bytes.is_empty() && digits.len().is_multiple_of(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;
    use crate::query::fields::resolve_name;

    fn parse_literal(field: &str, text: &str) -> Result<Literal, String> {
        Literal::parse_literal(&Operand::from_word(text, 0..0), resolve_name(field)[0])
    }

    fn order(field: &str, text: &str, reported: FieldValue<'_>) -> Option<Ordering> {
        parse_literal(field, text).unwrap().compare_field(&reported)
    }

    #[test]
    fn numbers_compare_exactly() {
        use Ordering::{Equal, Greater, Less};
        assert_eq!(order("size", "0x10", FieldValue::Unsigned(16)), Some(Equal));
        assert_eq!(order("size", "-1", FieldValue::Unsigned(0)), Some(Greater));
        assert_eq!(order("size", "2.5", FieldValue::Unsigned(2)), Some(Less));
        assert_eq!(order("size", "18446744073709551615", FieldValue::Unsigned(u64::MAX)), Some(Equal));
        assert_eq!(order("size", "18446744073709551615", FieldValue::Unsigned(u64::MAX - 1)), Some(Less));
        assert_eq!(order("size", "1e3", FieldValue::Unsigned(1_000)), Some(Equal));
        let reported = FieldValue::Seconds(1_700_000_000_020_000_001);
        assert_eq!(order("t", "1700000000.020000001", reported), Some(Equal));
        assert_eq!(order("t", "1700000000.02", reported), Some(Greater));
        assert_eq!(order("value", "-0.5", FieldValue::Real(-0.5)), Some(Equal));
        assert_eq!(order("value", "1", FieldValue::Real(f64::NAN)), None);
        assert_eq!(order("value", "5", FieldValue::Text("5")), Some(Equal));
        for text in ["", "-", "x", "0x", "1x", "inf", "nan", "1..2", "--1", "1e", "+1"] {
            assert_eq!(parse_number(text), None, "{text}");
        }
    }

    #[test]
    fn codes_and_identifiers_must_say_that_they_are_hexadecimal() {
        use Ordering::Equal;
        for text in ["0x8130", "0X8130", "8130h"] {
            assert_eq!(order("code", text, FieldValue::Code(0x8130, 4)), Some(Equal), "{text}");
        }
        assert_eq!(order("cob_id", "0x181", FieldValue::Id(CanId::from_standard(0x181))), Some(Equal));
        assert_eq!(order("object.sub", "7", FieldValue::Code(7, 2)), Some(Equal));
        assert_eq!(
            parse_literal("code", "8130").unwrap_err(),
            "'8130' is ambiguous; write 0x8130, or 0x1FC2 for decimal 8130"
        );
        assert_eq!(parse_literal("code", "FF01").unwrap_err(), "'FF01' needs a prefix; write 0xFF01");
        assert_eq!(
            parse_literal("code", "raised").unwrap_err(),
            "'raised' is not a valid number; expected e.g. 0x8130"
        );
    }

    #[test]
    fn objects_in_all_four_notations() {
        for text in ["0x1018:01", "1018:01", "1018:1", "1018h:01h", "1018sub1", "1018SUB1", "0x1018:0x01"] {
            assert_eq!(parse_object(text), Ok(ObjectAddress::new(0x1018, 1)), "{text}");
        }
        assert_eq!(parse_object("1018subA"), Ok(ObjectAddress::new(0x1018, 10)));
        assert!(parse_object("1018").unwrap_err().contains("0x1018:00"));
        for text in ["", ":", "1018:", "11018:01", "1018:100", "x:1", "1018:01:02", "-1018:01"] {
            assert!(parse_object(text).is_err(), "{text}");
        }
    }

    #[test]
    fn bytes() {
        let word = |text| parse_data(&Operand::from_word(text, 0..0));
        assert_eq!(word("dead"), Some(vec![0xDE, 0xAD]));
        assert_eq!(word("de:AD"), Some(vec![0xDE, 0xAD]));
        assert_eq!(word("0x00"), Some(vec![0]));
        assert_eq!(word("dea"), None);
        assert_eq!(word("-"), None);
        assert_eq!(word("xy"), None);
        assert_eq!(word("öö"), None);
        assert_eq!(parse_data(&Operand::from_quoted("ab".into(), 0..0)), Some(vec![b'a', b'b']));
    }

    #[test]
    fn texts_that_never_come_are_slips() {
        assert_eq!(parse_literal("kind", "emcyy").unwrap_err(), "unknown kind 'emcyy'; did you mean emcy?");
        assert_eq!(
            parse_literal("kind", "sdo").unwrap_err(),
            "unknown kind 'sdo'; did you mean sdo-transfer?"
        );
        assert_eq!(
            parse_literal("crc", "broken").unwrap_err(),
            "unknown crc 'broken'; expected correct, wrong, not-used, unchecked"
        );
        assert_eq!(parse_literal("pdo", "TPD1").unwrap_err(), "unknown pdo 'TPD1'; did you mean TPDO1?");
        assert_eq!(parse_literal("pdo", "rpdo12").unwrap_err(), "unknown pdo 'rpdo12'; did you mean RPDO12?");
        assert_eq!(
            parse_literal("pdo", "x").unwrap_err(),
            "unknown pdo 'x'; expected a PDO such as TPDO1 or RPDO1"
        );
        assert_eq!(
            parse_literal("pdo", "TPDO513").unwrap_err(),
            "unknown pdo 'TPDO513'; expected a PDO number 1 to 512"
        );
        assert!(parse_literal("pdo", "TPDO512").is_ok());
        assert!(parse_literal("bus", "whatever").is_ok());
        assert_eq!(parse_literal("node", "master").unwrap_err(), "node is a number; found 'master'");
        assert!(parse_literal("signals", "1").is_err());
    }
}
