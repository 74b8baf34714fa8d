//! Configuration: parameters with their origin, and mappings.

use super::alignment::NodePair;
use super::difference::{
    CaptureComparison, ComparedSide, DifferenceKind, DifferenceSection, Observation, SubjectNoun,
};
use super::record::{NodeBehaviour, ParameterRecord};
use super::scope::ComparisonScope;
use crate::wire::canopen::ObjectAddress;

const SECTION: DifferenceSection = DifferenceSection::Configuration;

/// Values of COB-IDs in these objects may contain the node-ID (CiA 301 §7.5.2): SYNC to EMCY, SDO and PDO parameters.
const COB_ID_OBJECTS: [std::ops::RangeInclusive<u16>; 3] =
    [0x1014..=0x1014, 0x1200..=0x12FF, 0x1400..=0x1BFF];

/// Compares the configuration of all nodes.
pub(super) fn compare_configuration(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    for pair in scope.alignment.buses.iter().flat_map(|bus| &bus.nodes) {
        compare_parameters(pair, scope, out);
        compare_mappings(pair, out);
    }
}

fn compare_parameters(pair: &NodePair<'_>, scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    let label = &pair.label;
    for (object, good) in pair.good.parameters.iter().filter(|(object, _)| !is_compared(pair, **object)) {
        match pair.bad.parameters.get(object) {
            Some(bad) => compare_parameter(pair, *object, (good, bad), scope, out),
            None if is_mapped(pair.bad, *object) => {}
            None => {
                let aspect = format!("{object} {} {}", good.name, good.text);
                out.add_not_seen(
                    (SECTION, SubjectNoun::Object),
                    ComparedSide::Bad,
                    (label, aspect),
                    good.mark,
                );
            }
        }
    }
    for (object, bad) in &pair.bad.parameters {
        let is_known = pair.good.parameters.contains_key(object) || is_compared(pair, *object);
        if is_known || is_mapped(pair.good, *object) {
            continue;
        }
        let aspect = format!("{object} {} {}", bad.name, bad.text);
        out.add_not_seen((SECTION, SubjectNoun::Object), ComparedSide::Good, (label, aspect), bad.mark);
    }
}

/// Whether the object is part of a mapping that is compared as a whole.
fn is_compared(pair: &NodePair<'_>, object: ObjectAddress) -> bool {
    let mut common = pair.good.mappings.keys().filter(|pdo| pair.bad.mappings.contains_key(pdo));
    common.any(|pdo| pdo.mapping_index() == object.index)
}

fn is_mapped(node: &NodeBehaviour, object: ObjectAddress) -> bool {
    let text = object.to_string();
    node.mappings.values().any(|mapping| mapping.objects.contains(&text))
}

fn compare_parameter(
    pair: &NodePair<'_>,
    object: ObjectAddress,
    (good, bad): (&ParameterRecord, &ParameterRecord),
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    let aspect = format!("{object} {}", good.name);
    let value = |it: &ParameterRecord| {
        let mark = if it.is_stale { "?" } else { "" };
        Some(Observation::new(format!("{}{mark}", it.text), it.mark))
    };
    if !is_equal(pair, object, (&good.data, &bad.data)) {
        let origin = if good.origin == bad.origin {
            bad.origin.to_owned()
        } else {
            format!("{} | {}", good.origin, bad.origin)
        };
        let place = (pair.label.as_str(), aspect);
        return out.add_difference(
            (SECTION, DifferenceKind::Parameter),
            place,
            (value(good), value(bad)),
            origin,
        );
    }
    if let (Some(one), Some(other)) = (&good.written, &bad.written)
        && !is_equal(pair, object, (&one.data, &other.data))
    {
        let values =
            (Some(Observation::new(&*one.text, one.mark)), Some(Observation::new(&*other.text, other.mark)));
        return out.add_difference(
            (SECTION, DifferenceKind::Write),
            (pair.label.as_str(), aspect),
            values,
            "written, not effective",
        );
    }
    let writes = |it: &ParameterRecord| it.written.as_ref().map_or(0, |written| written.in_operation);
    if scope.counts_differ(writes(good), writes(bad)) {
        let text = |it: &ParameterRecord| {
            let mark = it.written.as_ref().map_or(it.mark, |written| written.mark);
            Some(Observation::new(writes(it).to_string(), mark))
        };
        let place = (pair.label.as_str(), format!("{aspect} writes in operation"));
        return out.add_difference(
            (SECTION, DifferenceKind::WriteInOperation),
            place,
            (text(good), text(bad)),
            "",
        );
    }
    if good.is_stale != bad.is_stale {
        let place = (pair.label.as_str(), aspect);
        return out.add_difference(
            (SECTION, DifferenceKind::ParameterLost),
            place,
            (value(good), value(bad)),
            "? uncertain after a restart",
        );
    }
    out.add_equal(SECTION, SubjectNoun::Object);
}

/// Whether values are equal, or differ only by the node-ID that a COB-ID contains.
fn is_equal(pair: &NodePair<'_>, object: ObjectAddress, (good, bad): (&[u8], &[u8])) -> bool {
    if good == bad {
        return true;
    }
    let number = |bytes: &[u8]| {
        bytes.first_chunk::<4>().filter(|_| bytes.len() == 4).map(|it| u32::from_le_bytes(*it))
    };
    let is_cob_id = COB_ID_OBJECTS.iter().any(|range| range.contains(&object.index));
    let (Some(one), Some(other)) = (number(good), number(bad)) else { return false };
    let ids = (u32::from(pair.good.id.number()), u32::from(pair.bad.id.number()));
    is_cob_id && one.wrapping_sub(ids.0) == other.wrapping_sub(ids.1)
}

fn compare_mappings(pair: &NodePair<'_>, out: &mut CaptureComparison) {
    for (pdo, good) in &pair.good.mappings {
        let Some(bad) = pair.bad.mappings.get(pdo) else { continue };
        if good.objects == bad.objects {
            out.add_equal(SECTION, SubjectNoun::PdoMapping);
            continue;
        }
        let aspect = format!("{:04X} mapping of {pdo}", pdo.mapping_index());
        let value = |mapping: &super::record::MappingRecord| {
            let mark = if mapping.is_assumed { "?" } else { "" };
            Some(Observation::new(format!("{}{mark}", mapping.objects.join(" ")), mapping.mark))
        };
        out.add_difference(
            (SECTION, DifferenceKind::Mapping),
            (pair.label.as_str(), aspect),
            (value(good), value(bad)),
            "",
        );
    }
}
