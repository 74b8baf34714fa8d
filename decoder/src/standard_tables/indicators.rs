//! Codes of a field without a value, by the rules of its standard.

use super::field::FieldDefinition;
use super::kind::FieldKind;
use crate::frame::low_bits;
use crate::profile::{IndicatorCoding, LayoutOrigin, ParameterIndicators};

/// Codes of a field; `None` for texts, bits and floats. A state of that number has precedence.
pub(super) fn indicator_codes(
    field: &FieldDefinition,
    bits: u16,
    origin: LayoutOrigin,
) -> Option<ParameterIndicators> {
    /// Longest J1939 parameter that is a number, in bits.
    const LONGEST_NUMBER: u16 = 32;
    let is_signed = match field.column.kind {
        FieldKind::Signed => true,
        FieldKind::Unsigned | FieldKind::Enumeration | FieldKind::Date | FieldKind::Clock => false,
        _ => return None,
    };
    let is_nmea2000 = origin == LayoutOrigin::Nmea2000;
    let coding = if is_nmea2000 { IndicatorCoding::Nmea2000 { is_signed } } else { IndicatorCoding::J1939 };
    if bits > 64 || !is_nmea2000 && (is_signed || bits > LONGEST_NUMBER) {
        return None;
    }
    // Tables 1 and 2 of J1939-71 define the error of 2 bits and of whole bytes only.
    let all = ParameterIndicators { bits, largest: 0, coding }.greatest_number()?;
    let by_width = match (coding, bits) {
        (IndicatorCoding::J1939, 3..=7) => all.saturating_sub(1),
        _ => 0,
    };
    let largest = [all, all.saturating_sub(1)].into_iter().find(|number| has_state(field, *number));
    let largest = largest.unwrap_or(0).max(by_width).min(low_bits(u32::from(bits)));
    Some(ParameterIndicators { bits, largest, coding })
}

/// Whether the table of a field has a text for this number.
fn has_state(field: &FieldDefinition, number: u64) -> bool {
    field.column.kind == FieldKind::Enumeration
        && field.table.is_some_and(|table| table.find_text(number).is_some())
}
