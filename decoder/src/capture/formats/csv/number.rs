//! Times and data in the formats of known programs.

use nom::Parser;
use nom::character::complete::{char, digit1, one_of};
use nom::combinator::{all_consuming, opt, recognize};
use nom::error::Error;
use nom::sequence::preceded;

use super::dialect::CsvTimeFormat;
use crate::capture::TimeUnit;
use crate::capture::text::columns::{NumberBase, time_of_day};
use crate::frame::MAX_DATA;

/// Maximum number of digits in a number: a 128-bit integer can store them.
const MOST_DIGITS: usize = 30;

/// Parses a time into nanoseconds.
pub(super) fn parse_timestamp(text: &[u8], style: CsvTimeFormat) -> Option<i64> {
    match style {
        CsvTimeFormat::Unit(unit) => parse_number(text, unit),
        CsvTimeFormat::Gvret if text.contains(&b'.') => parse_number(text, TimeUnit::Second),
        CsvTimeFormat::Gvret => parse_number(text, TimeUnit::Microsecond),
        CsvTimeFormat::Clock => time_of_day(text),
        CsvTimeFormat::ZlgSystem | CsvTimeFormat::ZlgAdapter => parse_zlg(text),
    }
}

/// Unit of the times of ZLG's adapters in nanoseconds (`VCI_CAN_OBJ.TimeStamp`: 0.1 ms).
const ZLG_UNIT: i64 = 100_000;

/// A field of ZLG's programs without the marks that make a spreadsheet keep it as text: `="09:15:30.250"`.
pub(super) fn zlg_text(text: &[u8]) -> &[u8] {
    let is_mark = |byte: &u8| matches!(byte, b'=' | b'"' | b' ' | b'\t');
    let start = text.iter().position(|byte| !is_mark(byte)).unwrap_or(text.len());
    let end = text.iter().rposition(|byte| !is_mark(byte)).map_or(start, |last| last + 1);
    text.get(start..end).unwrap_or_default()
}

/// Whether a field of ZLG's programs contains a time; without one it is empty, a dash or a word.
pub(super) fn is_zlg_time(text: &[u8]) -> bool {
    zlg_text(text).first().is_some_and(u8::is_ascii_digit)
}

/// Parses a time of ZLG's programs.
fn parse_zlg(text: &[u8]) -> Option<i64> {
    let text = zlg_text(text);
    if let Some(digits) = text.strip_prefix(b"0x").or(text.strip_prefix(b"0X")) {
        return NumberBase::Hex.parse_number(digits).map(|count| i64::from(count) * ZLG_UNIT);
    }
    // CANTest appends units of less than a millisecond: `15:56:04.367.0`.
    let point = text.iter().position(|byte| *byte == b'.');
    let second =
        point.and_then(|point| Some(point + 1 + text.get(point + 1..)?.iter().position(|b| *b == b'.')?));
    let text = text.get(..second.unwrap_or(text.len())).unwrap_or(text);
    if text.contains(&b':') { time_of_day(text) } else { parse_number(text, TimeUnit::Second) }
}

/// Parses a number in the form of Python and others: `1700000000.5`, `-0,25`, `1e-05`. Fractions of a nanosecond are
/// truncated.
fn parse_number(text: &[u8], unit: TimeUnit) -> Option<i64> {
    let fraction = opt(preceded(one_of(".,"), digit1));
    let exponent = opt(preceded(one_of("eE"), recognize((opt(one_of("+-")), digit1))));
    let number = (opt(char('-')), digit1::<_, Error<&[u8]>>, fraction, exponent);
    let (_, (minus, whole, fraction, exponent)) = all_consuming(number).parse_complete(text).ok()?;
    let exponent: i32 = match exponent {
        Some(digits) => std::str::from_utf8(digits).ok()?.parse().ok()?,
        None => 0,
    };
    let fraction = fraction.unwrap_or_default();
    if whole.len() + fraction.len() > MOST_DIGITS {
        return None;
    }
    let digits = whole.iter().chain(fraction);
    let value = digits.fold(0_i128, |value, digit| value * 10 + i128::from(digit - b'0'));
    let decimals = i32::try_from(unit.nanoseconds().ilog10()).ok()?;
    let power = exponent.checked_add(decimals)?.checked_sub(i32::try_from(fraction.len()).ok()?)?;
    let scale = 10_i128.checked_pow(power.unsigned_abs());
    let nanoseconds = match scale {
        Some(scale) if power >= 0 => value.checked_mul(scale)?,
        Some(scale) => value / scale,
        None if power < 0 || value == 0 => 0,
        None => return None,
    };
    i64::try_from(if minus.is_some() { -nanoseconds } else { nanoseconds }).ok()
}

/// Data bytes of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct RowBytes {
    /// The bytes; those after `count` are 0.
    pub(super) bytes: [u8; MAX_DATA],
    /// Number of valid bytes.
    pub(super) count: usize,
}

impl RowBytes {
    /// No bytes.
    pub(super) const NONE: Self = Self { bytes: [0; MAX_DATA], count: 0 };

    /// Appends a byte; `None` if the maximum of a frame is exceeded.
    pub(super) fn push(&mut self, byte: u8) -> Option<()> {
        *self.bytes.get_mut(self.count)? = byte;
        self.count += 1;
        Some(())
    }
}

/// Parses hex bytes, with or without spaces, 0x and brackets; `None` if invalid or too long.
pub(super) fn parse_hex(text: &[u8]) -> Option<RowBytes> {
    let mut found = RowBytes::NONE;
    let text = text.strip_prefix(b"x|").unwrap_or(text);
    let text = text.strip_prefix(b"[").and_then(|text| text.strip_suffix(b"]")).unwrap_or(text);
    for word in text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()) {
        let word = word.strip_prefix(b"0x").unwrap_or(word);
        match word {
            [_] => found.push(NumberBase::Hex.parse_byte(word)?)?,
            _ if word.len() % 2 == 0 => {
                for pair in word.chunks_exact(2) {
                    found.push(NumberBase::Hex.parse_byte(pair)?)?;
                }
            }
            _ => return None,
        }
    }
    Some(found)
}

/// Parses decimal bytes separated by spaces.
pub(super) fn parse_decimal(text: &[u8]) -> Option<RowBytes> {
    let mut found = RowBytes::NONE;
    for word in text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()) {
        found.push(NumberBase::Decimal.parse_byte(word)?)?;
    }
    Some(found)
}

/// Parses Base64 of RFC 4648, with or without padding.
pub(super) fn parse_base64(text: &[u8]) -> Option<RowBytes> {
    let padding = text.iter().rev().take_while(|byte| **byte == b'=').count();
    let text = text.get(..text.len().checked_sub(padding)?)?;
    let mut found = RowBytes::NONE;
    for group in text.chunks(4) {
        let value = group.iter().try_fold(0_u32, |value, byte| Some(value << 6 | base64_digit(*byte)?))?;
        let [_, first, second, third] = (value << (6 * (4 - group.len()))).to_be_bytes();
        let bytes = [first, second, third];
        // Two characters encode one byte, three encode two; a single character is invalid.
        for byte in bytes.get(..group.len().checked_sub(1).filter(|count| *count > 0)?)? {
            found.push(*byte)?;
        }
    }
    (padding <= 2).then_some(found)
}

fn base64_digit(byte: u8) -> Option<u32> {
    let (first, value) = match byte {
        b'A'..=b'Z' => (b'A', 0),
        b'a'..=b'z' => (b'a', 26),
        b'0'..=b'9' => (b'0', 52),
        b'+' => (b'+', 62),
        b'/' => (b'/', 63),
        _ => return None,
    };
    Some(u32::from(byte - first) + value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_in_every_form() {
        for (text, expected) in [
            ("1700000000.123456789", 1_700_000_000_123_456_789),
            ("1483389946.197", 1_483_389_946_197_000_000),
            ("5", 5_000_000_000),
            ("-0.25", -250_000_000),
            ("1e-05", 10_000),
            ("1.5E+2", 150_000_000_000),
            ("1e-300", 0),
            ("0.0000000019", 1),
            ("0e999", 0),
        ] {
            assert_eq!(
                parse_timestamp(text.as_bytes(), CsvTimeFormat::Unit(TimeUnit::Second)),
                Some(expected),
                "{text}"
            );
        }
        for text in
            ["", "-", "1.", ".5", "1e", "1e99", "nan", "inf", "1 2", "1e999999999999", "9999999999999"]
        {
            assert_eq!(
                parse_timestamp(text.as_bytes(), CsvTimeFormat::Unit(TimeUnit::Second)),
                None,
                "{text}"
            );
        }
    }

    #[test]
    fn other_stamps() {
        assert_eq!(
            parse_timestamp(b"144,500", CsvTimeFormat::Unit(TimeUnit::Millisecond)),
            Some(144_500_000)
        );
        assert_eq!(parse_timestamp(b"166064000", CsvTimeFormat::Gvret), Some(166_064_000_000));
        assert_eq!(parse_timestamp(b"166.064", CsvTimeFormat::Gvret), Some(166_064_000_000));
        // Microseconds since 1970 exceed 64 bits if they are scaled as seconds first.
        for (text, expected) in [
            (&b"1700000000000001"[..], 1_700_000_000_000_001_000),
            (b"-1767062175875212", -1_767_062_175_875_212_000),
            (b"-1.5", -1_500_000_000),
        ] {
            assert_eq!(parse_timestamp(text, CsvTimeFormat::Gvret), Some(expected));
        }
        assert_eq!(parse_timestamp(b"9300000000000000", CsvTimeFormat::Gvret), None, "beyond the year 2262");
        assert_eq!(parse_timestamp(b"12.5", CsvTimeFormat::Unit(TimeUnit::Nanosecond)), Some(12));
        assert_eq!(parse_timestamp(b"00:30:06.866", CsvTimeFormat::Clock), Some(1_806_866_000_000));
        assert_eq!(parse_timestamp(b"1:0:0,5", CsvTimeFormat::Clock), Some(3_600_500_000_000));
        assert_eq!(parse_timestamp(b"30:06.866", CsvTimeFormat::Clock), None);
        for (text, expected) in [
            ("=\"09:15:30.250\"", Some(33_330_250_000_000)),
            ("=\"17:54:13.761949", Some(64_453_761_949_000)),
            ("=\"\"09:15:30.250\"\"", Some(33_330_250_000_000)),
            ("15:56:04.367.0", Some(57_364_367_000_000)),
            ("0x592897", Some(584_309_500_000)),
            ("385.624895", Some(385_624_895_000)),
            ("0x", None),
            ("12:60", None),
        ] {
            assert_eq!(parse_timestamp(text.as_bytes(), CsvTimeFormat::ZlgSystem), expected, "{text}");
        }
        assert!(!is_zlg_time("无".as_bytes()) && !is_zlg_time(b"") && is_zlg_time(b"=\"09:15:30.250\""));
    }

    #[test]
    fn data_in_every_coding() {
        let bytes = |found: Option<RowBytes>| found.map(|found| found.bytes[..found.count].to_vec());
        for text in ["01A0ff", "01 A0 FF", "[0x01 0xa0 0xff]", "1 a0 FF "] {
            assert_eq!(bytes(parse_hex(text.as_bytes())), Some(vec![1, 0xA0, 0xFF]), "{text}");
        }
        for text in ["0x", "01A", "0g", "[01", &"00".repeat(65)] {
            assert!(parse_hex(text.as_bytes()).is_none_or(|found| found.count == 0), "{text}");
        }
        assert_eq!(bytes(parse_decimal(b" 1 160 255")), Some(vec![1, 160, 255]));
        assert_eq!(bytes(parse_decimal(b"256")), None);
        // RFC 4648, 10
        for (text, expected) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYmE=", "fooba")]
        {
            assert_eq!(bytes(parse_base64(text.as_bytes())), Some(expected.as_bytes().to_vec()), "{text}");
        }
        for text in ["Z", "Zm9vY", "Z*==", "====", "Zg==Zg=="] {
            assert_eq!(bytes(parse_base64(text.as_bytes())), None, "{text}");
        }
    }
}
