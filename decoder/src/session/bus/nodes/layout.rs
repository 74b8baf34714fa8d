//! Layout of a PDO on one node, from the mapping objects, the profile or the bus file.

use std::sync::Arc;

use super::node::Node;
use crate::profile::device::{MappingSource, PdoField, PdoSpec};
use crate::profile::{
    DataType, DecidingNumber, EntryResolver, LayoutOrigin, PayloadLayout, PdoName, SignalField,
};
use crate::session::bus::objects::OriginKind;
use crate::wire::canopen::ObjectAddress;

/// Max entries of a mapping (CiA 301 §7.5.2.36).
const MOST_ENTRIES: i64 = 64;

/// Last index of the data types, which serve as placeholders in a mapping (CiA 301 §7.4.7.1).
const LAST_DUMMY: u16 = 0x1F;

/// Layout of a PDO; `None` if unknown.
///
/// A fixed mapping in the profile has precedence, then the mapping objects seen on the bus, then the bus
/// file, then the delivery state in profile or EDS.
pub(in crate::session) fn pdo_layout(node: &Node, name: PdoName) -> Option<PayloadLayout> {
    let mut resolver = node.resolver();
    let (spec, assumed) = match profile_pdo(node, name, &mut resolver) {
        Some((spec, assumed)) => (Some(spec), assumed),
        None => (None, false),
    };
    let is_fixed = spec.is_some_and(|spec| spec.mapping == MappingSource::Fixed);
    let mut layout = match spec {
        Some(spec) if is_fixed => of_profile(&spec.fields, LayoutOrigin::Profile, assumed, &mut resolver)?,
        _ => match mapped_layout(node, name, &mut resolver) {
            Some(layout) => layout,
            None => match (node.given_pdo(name), spec?) {
                (Some(fields), _) => of_profile(fields, LayoutOrigin::BusFile, false, &mut resolver)?,
                (None, spec) if spec.mapping == MappingSource::Default => {
                    of_profile(&spec.fields, LayoutOrigin::Profile, true, &mut resolver)?
                }
                _ => return None,
            },
        },
    };
    layout.depends = resolver.looked_at;
    Some(layout)
}

/// PDO in the profile for the present modes, and whether the modes are assumed.
fn profile_pdo<'a>(
    node: &'a Node,
    name: PdoName,
    resolver: &mut EntryResolver<'_>,
) -> Option<(&'a PdoSpec, bool)> {
    let mut assumed = false;
    for spec in node.device().pdos.iter().filter(|spec| spec.pdo == name) {
        let Some(when) = &spec.when else { return Some((spec, assumed)) };
        match resolver.resolve_number(when.object.object) {
            Some(number) if when.equals.contains(number.raw) => return Some((spec, number.assumed)),
            Some(number) => assumed |= number.assumed,
            None => assumed = true,
        }
    }
    None
}

/// Layout from the fields in a profile; `None` if the profile lists no fields.
pub(in crate::session) fn of_profile(
    fields: &[PdoField],
    origin: LayoutOrigin,
    assumed: bool,
    resolver: &mut EntryResolver<'_>,
) -> Option<PayloadLayout> {
    if fields.is_empty() {
        return None;
    }
    let mut layout = PayloadLayout { origin, assumed, ..PayloadLayout::default() };
    for PdoField { object, bits, constant } in fields {
        if let Some(content) = constant {
            layout.fixed.add_field(layout.bits, *bits, *content);
        }
        if let Some(object) = object {
            layout.fields.push(mapped_field(object.object, layout.bits, *bits, resolver));
        }
        layout.bits = layout.bits.saturating_add(*bits);
    }
    Some(layout)
}

/// Layout from the mapping parameters; `None` if one of them is unknown.
fn mapped_layout(node: &Node, name: PdoName, resolver: &mut EntryResolver<'_>) -> Option<PayloadLayout> {
    let index = name.mapping_index();
    let count = resolver.resolve_number(ObjectAddress::new(index, 0))?;
    if !(1..=MOST_ENTRIES).contains(&count.raw) {
        return None;
    }
    let mut layout = PayloadLayout {
        origin: count_source(node, index),
        assumed: count.assumed,
        ..PayloadLayout::default()
    };
    for sub in 1..=u8::try_from(count.raw).ok()? {
        let DecidingNumber { raw, assumed } = resolver.resolve_number(ObjectAddress::new(index, sub))?;
        layout.assumed |= assumed;
        // Bits 31..16 index, 15..8 sub-index, 7..0 length in bits (CiA 301 figure 70).
        let [bits, sub, low, high, ..] = raw.to_le_bytes();
        let object = ObjectAddress::new(u16::from_le_bytes([low, high]), sub);
        let bits = u16::from(bits);
        let end = layout.bits.checked_add(bits)?;
        if object.index > LAST_DUMMY && (1..=64).contains(&bits) {
            layout.fields.push(mapped_field(object, layout.bits, bits, resolver));
        }
        layout.bits = end;
    }
    Some(layout)
}

/// Source of the number of mapped entries.
fn count_source(node: &Node, mapping: u16) -> LayoutOrigin {
    let count = ObjectAddress::new(mapping, 0);
    match node.store().get(count).map(|entry| entry.origin.kind) {
        Some(OriginKind::BusFile) => LayoutOrigin::BusFile,
        Some(OriginKind::DeviceFile) => LayoutOrigin::Dcf,
        Some(_) => LayoutOrigin::Wire,
        None => node.device().default_origin(count),
    }
}

fn mapped_field(object: ObjectAddress, bit: u16, bits: u16, resolver: &mut EntryResolver<'_>) -> SignalField {
    let mut meaning = resolver.resolve_meaning(object);
    let known = meaning.as_ref().and_then(|meaning| meaning.data_type);
    let same = known.filter(|known| known.bits() == Some(bits));
    // A field narrower than its object contains the low bits of the object.
    let narrowed = known.and_then(|known| DataType::narrow_to(known, bits));
    if let Some(meaning) = &mut meaning {
        meaning.data_type = same.or(narrowed).or(meaning.data_type);
    }
    let data_type = same.or(narrowed).unwrap_or(DataType::unsigned_of(bits));
    SignalField {
        meaning: meaning.map(Arc::new),
        is_typed: same.or(narrowed).is_some(),
        ..SignalField::of_object(object, bit, bits, data_type)
    }
}
