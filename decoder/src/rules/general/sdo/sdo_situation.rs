//! Reasons for which a server must refuse an SDO request, according to bus and object dictionary.

use super::abort_codes::SituationId;
use crate::event::{CrcCheck, SdoDirection, SdoIrregularityKind, SdoMode, SdoTransfer};
use crate::profile::object::SdoAccess;
use crate::profile::{
    DataType, DeviceProfile, ObjectEntry, PdoName, as_integer, little_endian, plain_device,
};
use crate::rules::general::facts::{INVALID, confirmed_number, is_restricted_write};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

/// Mandatory read-only objects (CiA 301 §7.5.2.1, §7.5.2.2, §7.5.2.19).
const MANDATORY: [u16; 3] = [0x1000, 0x1001, 0x1018];

/// End of the communication objects of CiA 301.
const COMMUNICATION: u16 = 0x2000;

/// Reserved index of CiA 301; never present.
const RESERVED: u16 = 0x1004;

/// Whether the dictionary of the device, rather than a standard, describes an object.
pub(in crate::rules::general) fn is_described(device: &DeviceProfile, object: ObjectAddress) -> bool {
    device.full_id != plain_device().full_id && device.dictionary.is_own(object)
}

/// Access by SDO, according to the dictionary of the device; for mandatory objects also according to the
/// standard.
pub(in crate::rules::general) fn object_access(
    device: &DeviceProfile,
    object: ObjectAddress,
) -> Option<SdoAccess> {
    let is_reported = is_described(device, object) || MANDATORY.contains(&object.index);
    device.dictionary.find_object(object).filter(|_| is_reported)?.entry?.access
}

/// Identifiers in `abort_codes.toml` of the errors in a request; several if the order of the checks is up to
/// the device.
pub(in crate::rules::general) fn find_situations(transfer: &SdoTransfer, node: &Node) -> Vec<SituationId> {
    if let Some(protocol) = of_protocol(transfer) {
        return vec![protocol];
    }
    let (Some(object), Some(direction)) = (transfer.object, transfer.direction) else { return Vec::new() };
    let mut found = Vec::new();
    if transfer.mode == Some(SdoMode::Block) && transfer.size == 0 {
        found.push(SituationId::NoBlockTransfer);
    }
    if let Some(missing) = missing_part(node.device(), object) {
        found.push(missing);
        return found;
    }
    match (object_access(node.device(), object), direction) {
        (Some(SdoAccess::Ro | SdoAccess::Const), SdoDirection::Download) => {
            found.push(SituationId::ReadOnlyWritten);
        }
        (Some(SdoAccess::Wo), SdoDirection::Upload) => found.push(SituationId::WriteOnlyRead),
        _ => {}
    }
    if direction == SdoDirection::Upload {
        if object.index == 0x1003 && object.sub > 0 && confirmed_number(node, 0x1003, 0) == Some(0) {
            found.push(SituationId::EmptyHistory);
        }
        return found;
    }
    found.extend(of_length(transfer, node.device(), object));
    if transfer.data.is_empty() || transfer.truncated || transfer.data.len() > 8 {
        return found;
    }
    found.extend(of_range(transfer));
    found.extend(of_object(little_endian(&transfer.data), &transfer.data, node, object));
    found
}

/// Errors of the SDO protocol.
fn of_protocol(transfer: &SdoTransfer) -> Option<SituationId> {
    let by_client = transfer.irregularity.filter(|irregularity| irregularity.by_client);
    match by_client.map(|irregularity| irregularity.what) {
        Some(SdoIrregularityKind::Toggle) => Some(SituationId::WrongToggle),
        Some(SdoIrregularityKind::BlockSize) => Some(SituationId::BlockSize),
        Some(SdoIrregularityKind::Sequence) => Some(SituationId::BlockSequence),
        None => (transfer.crc == Some(CrcCheck::Wrong)).then_some(SituationId::BlockCrc),
    }
}

/// Missing object or sub-index.
fn missing_part(device: &DeviceProfile, object: ObjectAddress) -> Option<SituationId> {
    if object.index == RESERVED {
        return Some(SituationId::NoObject);
    }
    let has_index = |list: &[ObjectEntry]| list.iter().any(|known| known.repeat_of(object.index).is_some());
    if device.is_file_alone() {
        let own = device.dictionary.own_objects();
        return match has_index(own) {
            false if object.index >= 0x1000 => Some(SituationId::NoObject),
            true if !device.dictionary.is_own(object) => Some(SituationId::NoSubIndex),
            _ => None,
        };
    }
    let is_variable = object.index < COMMUNICATION
        && object.sub != 0
        && device.dictionary.find_object(object).is_none()
        && device.dictionary.find_object(ObjectAddress::new(object.index, 0)).is_some();
    is_variable.then_some(SituationId::NoSubIndex)
}

/// Length that does not match the data type. Four bytes may be a request without a size indicator.
fn of_length(transfer: &SdoTransfer, device: &DeviceProfile, object: ObjectAddress) -> Option<SituationId> {
    let is_reported = is_described(device, object) || object.index < COMMUNICATION;
    let bits = device.dictionary.data_type(object).and_then(DataType::bits).filter(|_| is_reported)?;
    let sent = transfer.announced.map_or(transfer.size, u64::from);
    let wanted = u64::from(bits.div_ceil(8));
    let says_length = transfer.abort.is_some_and(|abort| abort.code >> 16 == 0x0607);
    if sent > wanted && (sent != 4 || says_length) {
        return Some(SituationId::TooLong);
    }
    (sent > 0 && sent < wanted).then_some(SituationId::TooShort)
}

fn of_range(transfer: &SdoTransfer) -> Vec<SituationId> {
    let Some(meaning) = transfer.meaning.as_deref() else { return Vec::new() };
    let value = meaning.decode(&transfer.data);
    if !meaning.is_outside(&value) {
        return Vec::new();
    }
    match (meaning.range, as_integer(&value)) {
        (Some([_, most]), Some(number)) if number > most => vec![SituationId::TooHigh],
        (Some([least, _]), Some(number)) if number < least => vec![SituationId::TooLow],
        _ => vec![SituationId::TooHigh, SituationId::TooLow],
    }
}

/// Errors for single objects of CiA 301.
fn of_object(number: u64, data: &[u8], node: &Node, object: ObjectAddress) -> Option<SituationId> {
    if is_restricted_write(object, number) {
        return Some(SituationId::RestrictedCanId);
    }
    match (object.index, object.sub) {
        (0x1003, 0) => (number != 0).then_some(SituationId::HistoryCount),
        (0x1010, 1..) => (data != b"save").then_some(SituationId::WrongSignature),
        (0x1011, 1..) => (data != b"load").then_some(SituationId::WrongSignature),
        (0x1016, 1..) => is_second(node, object, number).then_some(SituationId::SameProducerTwice),
        (0x1019, 0) if matches!(number, 1 | 241..=255) => Some(SituationId::CounterOverflowValue),
        (0x1019, 0) => confirmed_number(node, 0x1006, 0)
            .filter(|period| *period != 0)
            .map(|_| SituationId::CounterOverflowLocked),
        (0x1600..=0x17FF | 0x1A00..=0x1BFF, sub) => of_mapping(node, object, sub, number),
        _ => None,
    }
}

/// Whether another entry of the heartbeat consumer list already monitors the producer.
fn is_second(node: &Node, object: ObjectAddress, number: u64) -> bool {
    let producer = |entry: u64| (entry >> 16 & 0x7F, entry & 0xFFFF);
    let (id, time) = producer(number);
    let others = (1..=127_u8).filter(|sub| *sub != object.sub);
    let mut others = others.filter_map(|sub| confirmed_number(node, 0x1016, sub)).map(producer);
    id != 0 && time != 0 && others.any(|(other, time)| other == id && time != 0)
}

/// Errors in the remapping procedure of CiA 301 §7.5.2.36.
fn of_mapping(node: &Node, object: ObjectAddress, sub: u8, number: u64) -> Option<SituationId> {
    let name = PdoName::of_parameter(object.index)?;
    if confirmed_number(node, name.communication_index(), 1).is_some_and(|cob_id| cob_id & INVALID == 0) {
        return Some(SituationId::MappingOfValidPdo);
    }
    if sub > 0 {
        return confirmed_number(node, object.index, 0)
            .filter(|count| *count != 0)
            .map(|_| SituationId::MappingEnabled);
    }
    let count = u8::try_from(number).ok()?.min(64);
    let bits: Option<u64> =
        (1..=count).map(|sub| confirmed_number(node, object.index, sub).map(|entry| entry & 0xFF)).sum();
    bits.filter(|bits| *bits > 64).map(|_| SituationId::MappingTooLarge)
}
