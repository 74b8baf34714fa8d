//! Layout of a message from the places of its fields.

use std::sync::Arc;

use super::definition::GroupDefinition;
use super::field::FieldDefinition;
use super::indicators::indicator_codes;
use super::kind::FieldKind;
use super::place::{FieldOrigin, FieldPlace};
use super::standard::referenced_field;
use crate::profile::object::NumberFormat;
use crate::profile::{
    BitOrder, DataType, LayoutOrigin, ObjectMeaning, PayloadLayout, RawConversion, SignalField, SignalId,
    fraction_digits, shown_digits,
};

/// Decimals of a float, whose precision is unknown.
const FLOAT_DIGITS: u8 = 6;

/// Layout of the placed fields; never longer than the last field.
pub(super) fn layout_of(
    definition: &GroupDefinition,
    places: &[FieldPlace],
    origin: LayoutOrigin,
) -> PayloadLayout {
    let fields = places.iter().filter_map(|place| {
        let field = match place.origin {
            FieldOrigin::Line => definition.field(usize::from(place.line))?,
            FieldOrigin::Key { line, key } => {
                definition.field(usize::from(line))?.table?.key_entry(key, definition.tables)?
            }
            FieldOrigin::Group { number, field } => referenced_field(number, field)?,
        };
        Some(placed_field(field, place, origin))
    });
    let fields: Vec<_> = fields.collect();
    let bits = fields.iter().filter_map(SignalField::end).max().unwrap_or(0);
    PayloadLayout { fields, bits, origin, ..PayloadLayout::default() }
}

fn placed_field(field: &FieldDefinition, place: &FieldPlace, origin: LayoutOrigin) -> SignalField {
    let data_type = data_type_of(field, place);
    let is_own =
        place.origin == FieldOrigin::Line && place.repetition == 0 && place.bits == field.column.bits;
    let meaning = || Arc::new(meaning_of(field, place, data_type, origin));
    SignalField {
        id: field.column.spn.map_or(SignalId::Name, SignalId::Spn),
        // The meaning of a repeated field has its number.
        meaning: Some(if is_own { Arc::clone(field.meaning.get_or_init(meaning)) } else { meaning() }),
        bit: place.bit,
        bits: place.bits,
        order: BitOrder::LittleEndian,
        present: None,
        data_type,
        is_typed: true,
    }
}

/// Type of the bits. Bytes within a byte, and numbers of more than 64 bits, are not numbers of any type.
fn data_type_of(field: &FieldDefinition, place: &FieldPlace) -> DataType {
    let is_aligned = place.bit.is_multiple_of(8) && place.bits.is_multiple_of(8);
    match field.column.kind {
        FieldKind::Signed if place.bits <= 64 => DataType::signed_of(place.bits),
        FieldKind::Real if place.bits == 32 => DataType::Real32,
        FieldKind::Real if place.bits == 64 => DataType::Real64,
        kind if kind.is_text() && place.is_wide => DataType::UnicodeString,
        kind if kind.is_text() => DataType::VisibleString,
        FieldKind::Bytes | FieldKind::Digits | FieldKind::KeyedValue | FieldKind::Referenced
            if is_aligned =>
        {
            DataType::OctetString
        }
        _ if place.bits > 64 => DataType::OctetString,
        _ => DataType::unsigned_of(place.bits),
    }
}

fn meaning_of(
    field: &FieldDefinition,
    place: &FieldPlace,
    data_type: DataType,
    origin: LayoutOrigin,
) -> ObjectMeaning {
    // A key or a field number names its value.
    let name = match (place.repetition, place.origin) {
        (number @ 1.., FieldOrigin::Line) => format!("{} {number}", field.name),
        _ => field.name.to_owned(),
    };
    let format = match field.column.kind {
        FieldKind::Digits => NumberFormat::DecimalPairs,
        FieldKind::Date => NumberFormat::Date,
        FieldKind::Clock => NumberFormat::TimeOfDay,
        FieldKind::Group => NumberFormat::ParameterGroup,
        _ => NumberFormat::Decimal,
    };
    let table = |kind| field.table.filter(|_| field.column.kind == kind);
    let is_scaled = (field.factor - 1.0).abs() > 0.0 || field.offset.abs() > 0.0;
    let is_real = field.column.kind == FieldKind::Real;
    let scale =
        RawConversion { factor: field.factor, offset: field.offset, full_scale: None, is_reciprocal: false };
    let digits = fraction_digits(field.factor).max(fraction_digits(field.offset));
    ObjectMeaning {
        name,
        data_type: Some(data_type),
        format,
        unit: field.unit.to_owned(),
        scale: is_scaled.then_some(scale),
        decimals: if is_real { FLOAT_DIGITS } else { shown_digits(field.factor, digits) },
        digits: if is_real { u8::MAX } else { digits },
        values: table(FieldKind::Enumeration)
            .or_else(|| table(FieldKind::Key))
            .map(|table| Arc::clone(table.names())),
        bits: table(FieldKind::Bits).map(|table| Arc::clone(table.bits())),
        indicators: indicator_codes(field, place.bits, origin),
        ..ObjectMeaning::default()
    }
}
