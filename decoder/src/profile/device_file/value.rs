//! Parses values in device files by the data type of their entry.

use super::LONGEST_VALUE;
use super::number::{parse_formula, parse_integer};
use crate::profile::DataType;
use crate::profile::quoted::quote_start;

/// Value in a device file.
#[derive(Debug, Clone, PartialEq)]
pub enum EntryValue {
    /// Integer, -2^63 ..= 2^64 - 1. Hexadecimal numbers of a signed type are in two's complement: `0xFD` as
    /// INTEGER8 is -3.
    Number(i128),
    /// `$NODEID` plus an offset (CiA 306-1 §4.6.3).
    Formula {
        /// Summand added to the node-ID.
        offset: u64,
    },
    /// REAL32 or REAL64; finite.
    Real(f64),
    /// String, or text other than a number if the type is unknown. May contain control characters.
    Text(String),
    /// OCTET_STRING or DOMAIN.
    Bytes(Vec<u8>),
}

/// Parsed value and problem, if any.
pub(super) type Reading = (Option<EntryValue>, Option<String>);

impl EntryValue {
    /// Value for a node; replaces a formula by its number.
    #[must_use]
    pub fn resolve_formula(&self, node_id: u8) -> Self {
        self.number_for(node_id).map_or_else(|| self.clone(), Self::Number)
    }

    /// Number for a node; `None` for other kinds of values.
    pub fn number_for(&self, node_id: u8) -> Option<i128> {
        match self {
            Self::Number(number) => Some(*number),
            Self::Formula { offset } => Some(i128::from(*offset) + i128::from(node_id)),
            Self::Real(_) | Self::Text(_) | Self::Bytes(_) => None,
        }
    }

    /// Parses `text`. Empty text is valid: CiA 306-1 permits a keyword without a value.
    pub(super) fn parse_value(text: &str, data_type: Option<DataType>) -> Reading {
        if text.len() > LONGEST_VALUE {
            return (None, Some(format!("{} bytes (max {LONGEST_VALUE}); ignored", text.len())));
        }
        match data_type {
            Some(DataType::VisibleString | DataType::UnicodeString) => {
                let text = text.trim();
                ((!text.is_empty()).then(|| Self::Text(text.to_owned())), None)
            }
            Some(DataType::OctetString | DataType::Domain) => parse_octets(text.trim()),
            Some(DataType::Real32 | DataType::Real64) => parse_real(strip_comment(text)),
            Some(data_type) => parse_number(strip_comment(text), data_type),
            None => parse_untyped(text),
        }
    }

    /// Parses a limit: a number even for string types, because some editors write limits for them.
    pub(super) fn read_limit(text: &str, data_type: Option<DataType>) -> Reading {
        match data_type {
            Some(data_type) if data_type.bits().is_none() => match Self::parse_value(text, None) {
                (Some(Self::Text(text)), _) => {
                    (None, Some(format!("{}: expected a number", quote_start(&text))))
                }
                reading => reading,
            },
            _ => Self::parse_value(text, data_type),
        }
    }
}

/// Number, keyword or type name without the comment after it; none of these contains `#` or `;`.
pub(super) fn strip_comment(text: &str) -> &str {
    text.split(['#', ';']).next().unwrap_or_default().trim()
}

/// Text without the comment after it, which starts with white space and a semicolon. `#` can be part of a
/// name: `Consumer Heartbeat Time #1`.
pub(super) fn uncommented_text(text: &str) -> &str {
    let text = text.trim();
    let comment = text
        .match_indices(';')
        .map(|(at, _)| text.split_at(at).0)
        .find(|before| before.is_empty() || before.ends_with(char::is_whitespace));
    comment.unwrap_or(text).trim_end()
}

fn parse_number(text: &str, data_type: DataType) -> Reading {
    if text.is_empty() {
        return (None, None);
    }
    if text.contains('$') {
        return match parse_formula(text) {
            Some(offset) => (Some(EntryValue::Formula { offset }), None),
            None => (None, Some(format!("{}: expected $NODEID plus a number", quote_start(text)))),
        };
    }
    if data_type == DataType::Boolean
        && (text.eq_ignore_ascii_case("true") || text.eq_ignore_ascii_case("false"))
    {
        return (Some(EntryValue::Number(i128::from(text.eq_ignore_ascii_case("true")))), None);
    }
    let Some(found) = parse_integer(text) else {
        return (None, Some(format!("{}: expected a number for {}", quote_start(text), data_type.name())));
    };
    let bits = data_type.bits().map_or(64, u32::from).clamp(1, 64);
    let modulus = 1_i128 << bits;
    let (least, limit) = if data_type.is_signed() { (-(modulus / 2), modulus / 2) } else { (0, modulus) };
    let value = match found.value {
        value if data_type.is_signed() && found.is_hex && (limit..modulus).contains(&value) => {
            value - modulus
        }
        value => value,
    };
    let complaint = if (least..limit).contains(&value) {
        found.doubt.map(|doubt| format!("{}: {doubt}", quote_start(text)))
    } else {
        Some(format!("{} does not fit {}", quote_start(text), data_type.name()))
    };
    (Some(EntryValue::Number(value)), complaint)
}

fn parse_real(text: &str) -> Reading {
    if text.is_empty() {
        return (None, None);
    }
    // Some editors write the zero of every type in hexadecimal. Any other hexadecimal number is ambiguous: a
    // value or its bits.
    let value = match parse_integer(text) {
        Some(found) if found.is_hex => (found.value == 0).then_some(0.0),
        _ => text.parse().ok().filter(|value: &f64| value.is_finite()),
    };
    match value {
        Some(value) => (Some(EntryValue::Real(value)), None),
        None => (None, Some(format!("{}: expected a decimal fraction", quote_start(text)))),
    }
}

/// Parses hexadecimal digits, with or without spaces; other characters make it text.
fn parse_octets(text: &str) -> Reading {
    let digits: Vec<_> = text.chars().filter(|digit| !digit.is_whitespace()).collect();
    if digits.is_empty() {
        return (None, None);
    }
    let octet = |pair: &[char; 2]| {
        let [high, low] = pair.map(|digit| digit.to_digit(16));
        u8::try_from(high? << 4 | low?).ok()
    };
    let (pairs, rest) = digits.as_chunks();
    match pairs.iter().map(octet).collect() {
        Some(bytes) if rest.is_empty() => (Some(EntryValue::Bytes(bytes)), None),
        _ => {
            let complaint =
                format!("{}: read as text, expected pairs of hexadecimal digits", quote_start(text));
            (Some(EntryValue::Text(text.to_owned())), Some(complaint))
        }
    }
}

/// Parses a value without a data type by its form.
fn parse_untyped(text: &str) -> Reading {
    let word = strip_comment(text);
    if let Some(offset) = parse_formula(word) {
        return (Some(EntryValue::Formula { offset }), None);
    }
    if let Some(found) = parse_integer(word) {
        return (
            Some(EntryValue::Number(found.value)),
            found.doubt.map(|doubt| format!("{}: {doubt}", quote_start(word))),
        );
    }
    let text = text.trim();
    ((!text.is_empty()).then(|| EntryValue::Text(text.to_owned())), None)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(text: &str, data_type: DataType) -> Option<EntryValue> {
        let (given, complaint) = EntryValue::parse_value(text, Some(data_type));
        assert_eq!(complaint, None, "{text}");
        given
    }

    fn complaint(text: &str, data_type: DataType) -> (Option<EntryValue>, String) {
        let (given, complaint) = EntryValue::parse_value(text, Some(data_type));
        (given, complaint.unwrap())
    }

    #[test]
    fn values_by_type() {
        assert_eq!(given("0x07 # VAR", DataType::Unsigned8), Some(EntryValue::Number(7)));
        assert_eq!(given("5 ; seconds", DataType::Unsigned8), Some(EntryValue::Number(5)));
        assert_eq!(given("", DataType::Unsigned32), None);
        assert_eq!(given("# nothing", DataType::Unsigned32), None);
        assert_eq!(given("5.2", DataType::Real32), Some(EntryValue::Real(5.2)));
        assert_eq!(given("0x00", DataType::Real64), Some(EntryValue::Real(0.0)));
        assert_eq!(given(" a ; b", DataType::VisibleString), Some(EntryValue::Text("a ; b".into())));
        assert_eq!(given("C8 3D BB", DataType::OctetString), Some(EntryValue::Bytes(vec![0xC8, 0x3D, 0xBB])));
        assert_eq!(given("true", DataType::Boolean), Some(EntryValue::Number(1)));
        assert_eq!(given("0x80+$NODEID", DataType::Unsigned32), Some(EntryValue::Formula { offset: 0x80 }));
    }

    #[test]
    fn comments_behind_text_begin_with_white_space_and_a_semicolon() {
        assert_eq!(uncommented_text(" No #1; really ; a comment"), "No #1; really");
        assert_eq!(uncommented_text("; all of it"), "");
        assert_eq!(strip_comment("rw # rw;"), "rw");
    }

    #[test]
    fn hexadecimal_of_a_signed_type_is_two_s_complement() {
        assert_eq!(given("0xFD", DataType::Integer8), Some(EntryValue::Number(-3)));
        assert_eq!(given("0x7F", DataType::Integer8), Some(EntryValue::Number(127)));
        assert_eq!(given("0xFFFFFF", DataType::Integer24), Some(EntryValue::Number(-1)));
        assert_eq!(
            given("0x8000000000000000", DataType::Integer64),
            Some(EntryValue::Number(i128::from(i64::MIN)))
        );
        assert_eq!(given("-0x80000000", DataType::Integer32), Some(EntryValue::Number(-0x8000_0000)));
        assert_eq!(
            complaint("200", DataType::Integer8),
            (Some(EntryValue::Number(200)), "\"200\" does not fit INTEGER8".into())
        );
    }

    #[test]
    fn an_invalid_value_is_reported() {
        assert_eq!(
            complaint("Manufacturer-specific", DataType::Unsigned32),
            (None, "\"Manufacturer-specific\": expected a number for UNSIGNED32".into())
        );
        assert_eq!(complaint("$NODEID*2", DataType::Unsigned32).0, None);
        assert_eq!(complaint("0x3F800000", DataType::Real32).0, None);
        assert_eq!(complaint("inf", DataType::Real32).0, None);
        assert_eq!(complaint("@ABCD", DataType::Domain).0, Some(EntryValue::Text("@ABCD".into())));
        assert_eq!(complaint("010", DataType::Unsigned8).0, Some(EntryValue::Number(10)));
        assert_eq!(complaint("-1", DataType::Unsigned8).0, Some(EntryValue::Number(-1)));
        assert_eq!(complaint(&"1".repeat(2000), DataType::VisibleString).0, None);
    }

    #[test]
    fn limits_of_strings_are_numbers_and_unknown_types_are_what_they_look_like() {
        assert_eq!(
            EntryValue::read_limit("0", Some(DataType::VisibleString)),
            (Some(EntryValue::Number(0)), None)
        );
        assert!(EntryValue::read_limit("many", Some(DataType::Domain)).1.is_some());
        assert_eq!(EntryValue::parse_value("$NODEID", None).0, Some(EntryValue::Formula { offset: 0 }));
        assert_eq!(EntryValue::parse_value("No", None).0, Some(EntryValue::Text("No".into())));
    }

    #[test]
    fn formulas_are_numbers_of_a_node() {
        let formula = EntryValue::Formula { offset: 0x180 };
        assert_eq!(formula.resolve_formula(5), EntryValue::Number(0x185));
        assert_eq!(EntryValue::Real(1.5).resolve_formula(5), EntryValue::Real(1.5));
    }
}
