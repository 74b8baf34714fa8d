//! Suggestions for nodes without a profile, based on their behaviour.

use std::collections::BTreeSet;

use crate::frame::BusIndex;
use crate::profile::device::{BootSign, HintSign, ProfileHint};
use crate::profile::{Catalogue, DeviceProfile, little_endian};
use crate::session::{Bus, Node, OriginKind, ProfileSigns};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Maximum number of nodes per bus that get a suggestion.
const SUGGESTED: usize = 5;

/// Identity objects independent of settings, with the bits to compare: the profile number in the device type
/// (CiA 301 §7.5.2.1; the upper half depends on the equipment), and the complete vendor-ID.
const TELLING: [(ObjectAddress, u64); 2] =
    [(ObjectAddress::new(0x1000, 0), 0xFFFF), (ObjectAddress::new(0x1018, 1), 0xFFFF_FFFF)];

/// A possible profile for a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Suggestion {
    /// Bus of the node.
    pub bus: BusIndex,
    /// Node-ID or J1939 address.
    pub node: NodeId,
    /// Id of the profile.
    pub profile: String,
    /// Device name in output.
    pub title: String,
    /// Reasons, from the hints of the profile.
    pub because: Vec<String>,
    /// Whether the length of a single PDO is the only reason; many devices share it.
    pub is_weak: bool,
}

impl Suggestion {
    /// The suggestion as text, with the option that assigns the profile.
    ///
    /// `is_only` omits the name of the bus, for captures of one bus.
    pub fn text(&self, bus: &Bus, is_only: bool) -> String {
        let Self { node, profile, title, because, .. } = self;
        let place = if is_only { String::new() } else { format!("{}:", bus.name()) };
        let because = because.join("; ");
        format!("{} behaves like {title}: --node {place}{node}={profile} ({because})", node.sentence_label())
    }
}

/// Observed behaviour of one node.
struct ObservedBehaviour<'a> {
    signs: &'a ProfileSigns,
    /// Indexes of the objects in known mappings.
    mapped: BTreeSet<u16>,
    /// Objects that were read or written, with their sizes in bytes.
    transferred: Vec<(ObjectAddress, u64)>,
}

impl<'a> ObservedBehaviour<'a> {
    fn observe_node(node: &'a Node) -> Self {
        Self { signs: node.signs(), mapped: mapped_indexes(node), transferred: transferred_objects(node) }
    }

    fn is_any(&self) -> bool {
        self.signs.is_any() || !self.mapped.is_empty() || !self.transferred.is_empty()
    }

    /// Whether the node has an object with this index.
    fn has_object(&self, index: u16) -> bool {
        self.mapped.contains(&index) || self.transferred.iter().any(|(object, _)| object.index == index)
    }
}

/// Objects that the node read out or confirmed. The communication area is common to all devices (CiA 301 §7.4.1).
fn transferred_objects(node: &Node) -> Vec<(ObjectAddress, u64)> {
    let all = node.store().sorted().into_iter();
    let by_sdo = all.filter(|(object, entry)| {
        object.index >= 0x2000 && matches!(entry.origin.kind, OriginKind::Upload | OriginKind::Download)
    });
    by_sdo.map(|(object, entry)| (object, entry.size)).collect()
}

/// Indexes of the objects in the mapping parameters of a node, 1600 to 17FF and 1A00 to 1BFF (CiA 301 §7.5.2.36): the
/// upper 16 bits of an entry are the index.
fn mapped_indexes(node: &Node) -> BTreeSet<u16> {
    let is_mapping =
        |object: &ObjectAddress| matches!(object.index, 0x1600..=0x17FF | 0x1A00..=0x1BFF) && object.sub > 0;
    let entries = node.store().sorted().into_iter().filter(|(object, _)| is_mapping(object));
    let index = |entry: u64| u16::try_from(entry >> 16).ok().filter(|index| *index >= 0x1000);
    entries.filter_map(|(_, entry)| index(little_endian(&entry.value))).collect()
}

/// Possible profiles of the nodes of a bus that have none, without weak suggestions.
pub fn firm_suggestions(bus: &Bus) -> Vec<Suggestion> {
    of_bus(bus, (bus.catalogue(), true), None)
}

/// Possible profiles of the nodes of a bus that have none; of one node if `wanted`.
pub fn suggest_profiles(bus: &Bus, catalogue: &Catalogue, wanted: Option<NodeId>) -> Vec<Suggestion> {
    of_bus(bus, (catalogue, false), wanted)
}

fn of_bus(bus: &Bus, catalogue: (&Catalogue, bool), wanted: Option<NodeId>) -> Vec<Suggestion> {
    let is_open = |node: &&Node| {
        node.assigned_by().is_none()
            && wanted.is_none_or(|wanted| wanted == node.id())
            && !bus.protocols().is_withdrawn(Some(node.id()))
    };
    let nodes = bus.nodes().filter(is_open).take(SUGGESTED);
    nodes.flat_map(|node| of_node(bus.index(), node, catalogue)).collect()
}

/// Profiles with a fitting hint, no contradicting hint and no contradicting identity.
fn of_node(bus: BusIndex, node: &Node, catalogue: (&Catalogue, bool)) -> Vec<Suggestion> {
    // Only values read from the node, without presumed ones.
    let reported = |object| node.store().seen_value(object).map(|entry| little_endian(&entry.value));
    let behaviour = ObservedBehaviour::observe_node(node);
    if !behaviour.is_any() {
        return Vec::new();
    }
    fitting_profiles(&behaviour, (bus, node.id()), reported, catalogue)
}

/// Firm suggestions; without one the weak ones, unless `is_firm`. Devices share codes and lengths: 8302 is one of the
/// IFB and of the VPCD.
fn fitting_profiles(
    behaviour: &ObservedBehaviour<'_>,
    place: (BusIndex, NodeId),
    reported: impl Fn(ObjectAddress) -> Option<u64>,
    (catalogue, is_firm): (&Catalogue, bool),
) -> Vec<Suggestion> {
    // Loading a device takes longer than reading a short capture: those with weak hints only if they are needed.
    let mut found = of_devices(behaviour, place, &reported, (catalogue, true));
    found.retain(|suggestion| !suggestion.is_weak);
    if found.is_empty() && !is_firm {
        found = of_devices(behaviour, place, &reported, (catalogue, false));
    }
    found
}

/// Suggestions of all devices with a firm hint, or with any hint.
fn of_devices(
    behaviour: &ObservedBehaviour<'_>,
    place: (BusIndex, NodeId),
    reported: &impl Fn(ObjectAddress) -> Option<u64>,
    (catalogue, is_firm): (&Catalogue, bool),
) -> Vec<Suggestion> {
    let hints = catalogue.hints();
    let is_fitting = |hints: &[ProfileHint]| {
        let mut fitting = hints.iter().filter(|hint| is_hint_fitting(behaviour, hint) == Some(true));
        // Several weak hints are firm too.
        fitting.next().is_some_and(|hint| !is_firm || !hint.sign.is_weak()) || fitting.next().is_some()
    };
    let devices = hints.iter().filter(|(_, hints)| is_fitting(hints));
    let devices = devices.filter_map(|(id, _)| catalogue.device(id).ok());
    let fitting = devices.filter_map(|device| {
        let suggestion = of_device(&device, behaviour, place)?;
        (!is_denied(&device, behaviour, reported)).then_some(suggestion)
    });
    fitting.collect()
}

/// The suggestion of a device with a fitting hint and no contradicting one.
fn of_device(
    device: &DeviceProfile,
    behaviour: &ObservedBehaviour<'_>,
    (bus, node): (BusIndex, NodeId),
) -> Option<Suggestion> {
    let variant = device.variant.as_deref().unwrap_or_default();
    let hints = device.hints.iter().filter(|hint| hint.only.allows_variant(variant));
    let judged: Vec<_> = hints.map(|hint| (hint, is_hint_fitting(behaviour, hint))).collect();
    if judged.iter().any(|(_, fits)| *fits == Some(false)) {
        return None;
    }
    let fitting: Vec<_> = judged.iter().filter(|(_, fits)| fits.is_some()).map(|(hint, _)| *hint).collect();
    if fitting.iter().all(|hint| hint.not_alone) {
        return None;
    }
    let is_weak = matches!(fitting.as_slice(), [hint] if hint.sign.is_weak());
    let (profile, title) = (device.id.clone(), device.title.clone());
    let because = fitting.iter().map(|hint| hint.text.clone()).collect();
    Some(Suggestion { bus, node, profile, title, because, is_weak })
}

/// Whether a hint fits; `None` if not yet observed.
fn is_hint_fitting(behaviour: &ObservedBehaviour<'_>, hint: &ProfileHint) -> Option<bool> {
    match hint.sign {
        HintSign::ReadyTelegram => behaviour.signs.is_ready_sent.then_some(true),
        HintSign::Pdo => {
            let length = behaviour.signs.pdo_length(hint.pdo.as_deref()?)?;
            Some(length.is_some() && length == hint.length)
        }
        HintSign::Mapped => {
            let is_mapped = hint.objects.iter().all(|index| behaviour.mapped.contains(index));
            (is_mapped && !hint.objects.is_empty()).then_some(true)
        }
        HintSign::Objects => {
            let count = hint.objects.iter().filter(|index| behaviour.has_object(**index)).count();
            (count >= hint.at_least.unwrap_or(1).max(1)).then_some(true)
        }
        HintSign::Emcy => hint.codes.iter().any(|code| behaviour.signs.codes.contains(code)).then_some(true),
    }
}

/// Whether the identity of a node, an ordinary boot-up message, or the size of an object contradicts the device.
fn is_denied(
    device: &DeviceProfile,
    behaviour: &ObservedBehaviour<'_>,
    reported: impl Fn(ObjectAddress) -> Option<u64>,
) -> bool {
    let sends_no_boot_up = device.nmt.boot == BootSign::ReadyTelegram;
    (sends_no_boot_up && behaviour.signs.is_boot_up_sent)
        || behaviour.transferred.iter().any(|transferred| has_another_size(device, *transferred))
        || TELLING.iter().any(|(object, mask)| {
            let entry = device.dictionary.find_object(*object).and_then(|found| found.entry);
            let wanted = entry.and_then(|entry| entry.default_number(None)).map(i64::cast_unsigned);
            reported(*object).zip(wanted).is_some_and(|(reported, wanted)| reported & mask != wanted & mask)
        })
}

/// Whether an object in the manufacturer area has another size than in the device. Objects of standards are left out:
/// their types are the same in all devices of a class. A server may send four bytes without stating the size (CiA 301
/// §7.2.4.3.6).
fn has_another_size(device: &DeviceProfile, (object, size): (ObjectAddress, u64)) -> bool {
    let entry = device.dictionary.find_object(object).and_then(|found| found.entry);
    let bits = entry.filter(|_| object.index < 0x6000).and_then(|entry| entry.data_type?.bits());
    let wanted = bits.map(|bits| u64::from(bits.div_ceil(8)));
    wanted.is_some_and(|wanted| size < wanted || (size != wanted && size != 4))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of<'a>(signs: &'a ProfileSigns, mapped: &[u16]) -> ObservedBehaviour<'a> {
        ObservedBehaviour { signs, mapped: mapped.iter().copied().collect(), transferred: Vec::new() }
    }

    #[test]
    fn a_drive_maps_its_mode_or_target_position_next_to_control_and_status_word() {
        let signs = ProfileSigns::default();
        let with = |mapped: &[u16]| -> Vec<String> {
            let found = fitting_profiles(
                &of(&signs, mapped),
                (BusIndex(0), 2.into()),
                |_| None,
                (&Catalogue::default(), false),
            );
            found.into_iter().map(|suggestion| suggestion.profile).collect()
        };
        assert_eq!(with(&[0x6040, 0x6041, 0x6060]), ["cia402"]);
        assert_eq!(with(&[0x6040, 0x6041, 0x607A]), ["cia402"]);
        // CiA 408 has the same control and status word.
        assert!(with(&[0x6040, 0x6041, 0x6042]).is_empty());
        assert!(with(&[0x607A]).is_empty());
    }

    fn profiles(ready: bool, pdos: &[(&str, u8)]) -> Vec<String> {
        suggest_profiles(ready, pdos, &[])
    }

    /// Whether the first suggestion is weak.
    fn is_weak(ready: bool, pdos: &[(&str, u8)]) -> bool {
        let mut signs = ProfileSigns { is_ready_sent: ready, ..ProfileSigns::default() };
        for (name, length) in pdos {
            signs.note_pdo(name.parse().unwrap(), *length);
        }
        let found = fitting_profiles(
            &of(&signs, &[]),
            (BusIndex(0), 2.into()),
            |_| None,
            (&Catalogue::default(), false),
        );
        found[0].is_weak
    }

    fn suggest_profiles(ready: bool, pdos: &[(&str, u8)], values: &[(u16, u8, u64)]) -> Vec<String> {
        let mut signs = ProfileSigns { is_ready_sent: ready, ..ProfileSigns::default() };
        for (name, length) in pdos {
            signs.note_pdo(name.parse().unwrap(), *length);
        }
        let value_of = |object: ObjectAddress| {
            let of = |(index, sub, _): &&(u16, u8, u64)| (*index, *sub) == (object.index, object.sub);
            values.iter().find(of).map(|(_, _, value)| *value)
        };
        let found = fitting_profiles(
            &of(&signs, &[]),
            (BusIndex(0), 2.into()),
            value_of,
            (&Catalogue::default(), false),
        );
        found.into_iter().map(|suggestion| suggestion.profile).collect()
    }

    #[test]
    fn hints_of_the_profiles() {
        // SYDFEC: ready telegram, TPDO1 of 5 bytes. MD2: TPDO1 of 2 bytes.
        assert_eq!(profiles(true, &[]), ["rexroth-sydfec"]);
        assert_eq!(profiles(true, &[("TPDO1", 5)]), ["rexroth-sydfec"]);
        assert_eq!(profiles(false, &[("TPDO1", 2)]), ["wandfluh-md2"]);
        assert!(is_weak(false, &[("TPDO1", 2)]) && is_weak(false, &[("TPDO1", 5)]));
        assert!(!is_weak(true, &[]) && !is_weak(true, &[("TPDO1", 5)]));
        // One contradicts the other.
        assert!(profiles(true, &[("TPDO1", 4)]).is_empty());
        assert!(profiles(false, &[("TPDO1", 5), ("TPDO1", 4)]).is_empty());
        assert!(profiles(false, &[("TPDO2", 5)]).is_empty());
    }

    #[test]
    fn an_ordinary_boot_up_contradicts_a_device_without_one() {
        // The SYDFEC sends an empty EMCY instead of 700h + node-ID with 00.
        let mut signs =
            ProfileSigns { is_ready_sent: true, is_boot_up_sent: true, ..ProfileSigns::default() };
        signs.note_pdo("TPDO1".parse().unwrap(), 5);
        assert!(
            fitting_profiles(
                &of(&signs, &[]),
                (BusIndex(0), 2.into()),
                |_| None,
                (&Catalogue::default(), false)
            )
            .is_empty()
        );
    }

    #[test]
    fn the_identity_of_a_node_overrides_hints() {
        let with = |reported| suggest_profiles(false, &[("TPDO1", 2)], reported);
        // CiA 408 with other equipment, and the vendor-ID of Wandfluh.
        assert_eq!(with(&[(0x1000, 0, 0x0001_0198), (0x1018, 1, 0x14D)]), ["wandfluh-md2"]);
        // CiA 402; another manufacturer.
        assert!(with(&[(0x1000, 0, 0x0002_0192)]).is_empty());
        assert!(with(&[(0x1018, 1, 0x22)]).is_empty());
    }

    /// Profiles that fit transferred objects with their sizes, EMCY codes and lengths of TPDO1.
    fn by_objects(objects: &[(u16, u64)], codes: &[u16], length: Option<u8>, is_firm: bool) -> Vec<String> {
        let mut signs = ProfileSigns::default();
        for code in codes {
            signs.note_emcy(*code);
        }
        if let Some(length) = length {
            signs.note_pdo("TPDO1".parse().unwrap(), length);
        }
        let transferred =
            objects.iter().map(|(index, size)| (ObjectAddress::new(*index, 0), *size)).collect();
        let behaviour = ObservedBehaviour { signs: &signs, mapped: BTreeSet::new(), transferred };
        let found =
            fitting_profiles(&behaviour, (BusIndex(0), 5.into()), |_| None, (&Catalogue::default(), is_firm));
        found.into_iter().map(|suggestion| suggestion.profile).collect()
    }

    #[test]
    fn objects_of_the_manufacturer_area_suggest_valves_and_pump_cards() {
        // VPCD, RE 30028-02-Z 4: bus status 2C68 of two bytes and actual angle 2F07 of four.
        assert_eq!(by_objects(&[(0x2C68, 2), (0x2F07, 4)], &[], None, true), ["rexroth-vpcd"]);
        // The size is not stated.
        assert_eq!(by_objects(&[(0x2C68, 4), (0x2F07, 4)], &[], None, true), ["rexroth-vpcd"]);
        assert!(by_objects(&[(0x2C68, 4)], &[], None, false).is_empty());
        // A code that another device has too is no suggestion beside the objects.
        assert_eq!(by_objects(&[(0x2C68, 2), (0x2F07, 4)], &[0x8302], None, false), ["rexroth-vpcd"]);
        // Another device with the same indexes and other sizes.
        assert!(by_objects(&[(0x2C68, 2), (0x2F07, 1)], &[], None, false).is_empty());
        // IFB, RE 29015-01-2 M421 and 12: internal status 4001 of four bytes, valve address 4200 of one.
        assert_eq!(by_objects(&[(0x4001, 4), (0x4200, 1)], &[], None, true), ["rexroth-ifb-iac"]);
        assert!(by_objects(&[(0x4001, 2), (0x4200, 1)], &[], None, false).is_empty());
        // PVE: set point 3300 and actual value 3301 of 8 bits; an object of CiA 408 is no sign.
        assert_eq!(by_objects(&[(0x3300, 1), (0x3301, 1)], &[], None, true), ["danfoss-pve-ci"]);
        assert!(by_objects(&[(0x6040, 2), (0x6300, 2)], &[], None, false).is_empty());
    }

    #[test]
    fn an_error_code_suggests_a_device_with_the_length_of_its_pdo() {
        // PVE: 8305 spool position error; TPDO1 has status word and spool position, 4 bytes.
        assert_eq!(by_objects(&[], &[0x8305], Some(4), true), ["danfoss-pve-ci"]);
        assert!(by_objects(&[], &[0x8305], None, true).is_empty());
        assert_eq!(by_objects(&[], &[0x8305], None, false), ["danfoss-pve-ci"]);
        // The length contradicts; 8130 is an error of CiA 301; four bytes alone are too common.
        assert!(by_objects(&[], &[0x8305], Some(8), false).is_empty());
        assert!(by_objects(&[], &[0x8130], Some(4), false).is_empty());
        assert!(by_objects(&[], &[], Some(4), false).is_empty());
    }
}
