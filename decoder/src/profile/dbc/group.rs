//! A message as one of its parameter group: codes without a value by the standard of the group, also if the
//! database does not list them.

use std::sync::Arc;

use super::DatabaseMessage;
use super::signal::largest_raw;
use crate::profile::data_type::DecodedValue;
use crate::profile::is_nmea2000_group;
use crate::profile::layout::{SignalField, SignalId};
use crate::profile::meaning::{IndicatorCoding, ObjectMeaning, ParameterIndicators};
use crate::wire::j1939::Pgn;

/// First group of data page 1, which NMEA 2000 uses.
const PAGE_1: u32 = 0x1_0000;

/// Longest J1939 parameter that is a number, in bits; longer ones are text or bytes.
const LONGEST_NUMBER: u16 = 32;

/// The message with the codes of its group; shared if nothing changes. Of a proprietary group, only the
/// database defines the codes.
pub(super) fn as_group(pgn: Pgn, message: &Arc<DatabaseMessage>) -> Arc<DatabaseMessage> {
    if pgn.is_proprietary() {
        return Arc::clone(message);
    }
    let mut changed = None;
    for (place, field) in message.layout.fields.iter().enumerate() {
        let Some(meaning) = field.meaning.as_deref() else { continue };
        let found = signal_indicators(pgn, field, meaning);
        if found != meaning.indicators {
            let layout = changed.get_or_insert_with(|| (*message.layout).clone());
            if let Some(field) = layout.fields.get_mut(place) {
                field.meaning = Some(Arc::new(ObjectMeaning { indicators: found, ..meaning.clone() }));
            }
        }
    }
    match changed {
        Some(layout) => {
            Arc::new(DatabaseMessage { layout: Arc::new(layout), ..DatabaseMessage::clone(message) })
        }
        None => Arc::clone(message),
    }
}

/// Codes of a signal; `None` for floats and for bits that are not a number.
fn signal_indicators(pgn: Pgn, field: &SignalField, meaning: &ObjectMeaning) -> Option<ParameterIndicators> {
    let is_signed = matches!(field.convert_raw(0), DecodedValue::Integer(_));
    let has_spn = matches!(field.id, SignalId::Spn(_));
    let is_nmea2000 = is_nmea2000_group(pgn) || pgn.number() >= PAGE_1 && !has_spn;
    let is_quantity = meaning.scale.is_some() || !meaning.unit.is_empty();
    let coding = match (is_nmea2000, field.bits) {
        _ if matches!(field.convert_raw(0), DecodedValue::Real(_)) => return None,
        (true, ..=LONGEST_NUMBER) => IndicatorCoding::Nmea2000 { is_signed },
        (true, _) if is_quantity => IndicatorCoding::Nmea2000 { is_signed },
        (false, ..=LONGEST_NUMBER) if !is_signed => IndicatorCoding::J1939,
        _ => return None,
    };
    let plain = ParameterIndicators { bits: field.bits, largest: 0, coding };
    let all = plain.greatest_number()?;
    let stated = match meaning.limits {
        Some([_, most]) => {
            let (factor, offset) = meaning.scale.map_or((1.0, 0.0), |scale| (scale.factor, scale.offset));
            Some(largest_raw(most, factor, offset)?).filter(|largest| *largest < all)
        }
        None => None,
    };
    // Limits that are those of the type do not state which codes are values. Tables 1 and 2 of J1939-71 define
    // the error of 2 bits and of whole bytes only, so that for 3 to 7 bits the largest code alone has a name.
    let by_width = match (coding, field.bits) {
        (IndicatorCoding::J1939, 3..=7) => all.saturating_sub(1),
        _ => 0,
    };
    Some(ParameterIndicators { largest: stated.unwrap_or(by_width), ..plain })
}

#[cfg(test)]
mod tests {
    use crate::profile::dbc::{Database, parse_database};
    use crate::wire::j1939::Pgn;

    /// Labels of raw codes of the only signal of a group; `signal` is the part of `SG_` from the size on.
    fn labels(pgn: u32, signal: &str, codes: &[u64]) -> Vec<Option<String>> {
        // Priority 6, source 254; 8000_0000 marks a 29-bit identifier.
        let id = 0x9800_00FE_u32 | pgn << 8;
        let text = format!("BO_ {id} M: 8 N\n SG_ S : 0|{signal} N\n");
        let mut database = Database::default();
        database.add_file(parse_database(text.as_bytes()).unwrap());
        let layout = &database.message_by_pgn(Pgn::new(pgn)).unwrap().layout;
        let label = |code: &u64| {
            let field = &layout.fields[0];
            let value = field.convert_raw(field.extract_bits(&code.to_le_bytes())?);
            field.meaning.as_deref()?.value_label(&value).map(str::to_owned)
        };
        codes.iter().map(label).collect()
    }

    fn names(found: &[Option<String>]) -> Vec<&str> {
        found.iter().map(|label| label.as_deref().unwrap_or("-")).collect()
    }

    #[test]
    fn codes_of_j1939_by_width() {
        // J1939-71 tables 1 and 2; the limits are those of the type, or are not stated ([0|0]).
        for limits in ["[0|65535]", "[0|0]", "[0|64255]"] {
            let found = labels(
                0xF004,
                &format!("16@1+ (1,0) {limits} \"\""),
                &[0xFAFF, 0xFE00, 0xFEFF, 0xFF00, 0xFFFF],
            );
            assert_eq!(names(&found), ["-", "error", "error", "not available", "not available"], "{limits}");
        }
        let eight = labels(0xF004, "8@1+ (0.4,0) [0|102] \"%\"", &[250, 253, 254, 255]);
        assert_eq!(names(&eight), ["-", "-", "error", "not available"]);
        let two = labels(0xF004, "2@1+ (1,0) [0|3] \"\"", &[0, 1, 2, 3]);
        assert_eq!(names(&two), ["-", "-", "error", "not available"]);
        // Four bits: 14 is a state of some parameters (SPN 899: other), so only 15 has a name.
        let four = labels(0xF004, "4@1+ (1,0) [0|15] \"\"", &[14, 15]);
        assert_eq!(names(&four), ["-", "not available"]);
        let word = labels(0xFEE5, "32@1+ (0.05,0) [0|0] \"h\"", &[0xFDFF_FFFF, 0xFE00_0000, 0xFF00_0000]);
        assert_eq!(names(&word), ["-", "error", "not available"]);
    }

    #[test]
    fn bits_texts_signed_numbers_and_proprietary_groups_have_none() {
        assert_eq!(names(&labels(0xF004, "1@1+ (1,0) [0|1] \"\"", &[1])), ["-"]);
        assert_eq!(names(&labels(0xFEEC, "64@1+ (1,0) [0|0] \"\"", &[u64::MAX])), ["-"]);
        assert_eq!(names(&labels(0xF004, "16@1- (1,0) [0|0] \"\"", &[0xFFFF, 0x7FFF])), ["-", "-"]);
        for pgn in [0xEF00, 0x1_EF00, 0xFF10, 0x1_FF10] {
            assert_eq!(
                names(&labels(pgn, "16@1+ (1,0) [0|65535] \"\"", &[0xFFFF, 0xFE00])),
                ["-", "-"],
                "{pgn:X}"
            );
        }
    }

    #[test]
    fn codes_of_nmea_2000_by_width_and_sign() {
        // canboat: the largest number is not available, the one below it an error if the type has at least 4 bits.
        let signed =
            labels(127_250, "16@1- (0.0001,0) [0|0] \"rad\"", &[0x7FFD, 0x7FFE, 0x7FFF, 0x8000, 0xFFFF]);
        assert_eq!(names(&signed), ["-", "error", "not available", "-", "-"]);
        // FE00 is a value here, unlike in J1939.
        let unsigned = labels(127_250, "16@1+ (0.0001,0) [0|0] \"rad\"", &[0xFE00, 0xFFFD, 0xFFFE, 0xFFFF]);
        assert_eq!(names(&unsigned), ["-", "-", "error", "not available"]);
        assert_eq!(names(&labels(127_250, "2@1+ (1,0) [0|3] \"\"", &[2, 3])), ["-", "not available"]);
        assert_eq!(names(&labels(127_250, "1@1+ (1,0) [0|1] \"\"", &[1])), ["-"]);
        let position = labels(129_029, "64@1- (1e-16,0) [0|0] \"deg\"", &[u64::MAX >> 1, u64::MAX]);
        assert_eq!(names(&position), ["not available", "-"]);
        assert_eq!(names(&labels(129_029, "64@1+ (1,0) [0|0] \"\"", &[u64::MAX])), ["-"], "raw bytes");
    }

    #[test]
    fn an_identifier_alone_says_nothing_about_the_protocol() {
        let text = "BO_ 2566844926 M: 8 N\n SG_ S : 0|8@1+ (1,0) [0|255] \"\" N\n";
        let mut database = Database::default();
        database.add_file(parse_database(text.as_bytes()).unwrap());
        // 2566844926 is 98FEF1FE: the 29-bit identifier 18FEF1FE.
        let id = crate::frame::CanId::from_extended(0x18FE_F1FE);
        let field = &database.message_by_id(id).unwrap().layout.fields[0];
        assert_eq!(field.meaning.as_deref().unwrap().indicators, None);
    }
}
