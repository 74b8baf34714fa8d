//! Invalid PDO mappings.

use crate::event::{Event, EventKind, Kind, SdoAbort, SdoDirection, SdoOutcome, SdoTransfer};
use crate::profile::device_file::EntryAccess;
use crate::profile::{DataType, DeviceProfile, PdoDirection, PdoName, little_endian};
use crate::rules::general::facts::{confirmed_number, transfer_number, transfer_subject};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A device accepts, or has, a mapping of more than 64 bits, or of an object that its EDS does not
    /// permit. Such objects are missing, not mappable, read-only (RPDO), write-only (TPDO) or shorter than
    /// mapped. Dummy objects (0001 to 001F), and objects without an EDS, are exempt.
    ///
    /// # Why it matters
    /// Controller and device interpret the bits differently, or the PDO is never sent.
    ///
    /// # Source
    /// CiA 301 §7.5.2.36, §7.5.2.38 (PDO mapping parameter), CiA 306-1 §4.6.3 (PDOMapping, AccessType)
    ///
    /// # What to look at first
    /// Check whether the EDS matches the firmware version. If it does, correct the mapping entry.
    ///
    /// # Mutation
    /// change the length of a mapping entry
    "mapping-invalid", Warning, "invalid PDO mapping",
    kinds: [Kind::SdoTransfer],
    transfers: TransferSubset::Communication,
    needs: "a written or read PDO mapping",
    cases: &["3.21", "3.25", "3.26", "3.27", "3.28", "3.29", "3.30", "3.31", "3.32", "3.33"],
    word: "MAP",
}

/// Maximum number of bits in a PDO.
const MOST_BITS: u64 = 64;

/// Maximum number of entries; higher values mark multiplexed PDOs.
const MOST_ENTRIES: u64 = 64;

/// End of the data types that can be mapped as dummy objects (CiA 301 §7.4.7.1).
const DUMMY_END: u16 = 0x20;

struct MappingInvalid;

fn new(_policy: &RulePolicy) -> MappingInvalid {
    MappingInvalid
}

/// Result of the check of a mapping value.
#[derive(Debug, PartialEq, Eq)]
enum MappingVerdict {
    /// Not enough information.
    Unknown,
    Right,
    /// Description of the error.
    Wrong(String),
}

/// Checks the value of a mapping parameter.
fn judge_mapping(node: &Node, name: PdoName, object: ObjectAddress, value: u64) -> MappingVerdict {
    if object.sub == 0 {
        return of_count(node, object.index, value);
    }
    #[expect(clippy::cast_possible_truncation, reason = "fields of a mapping entry")]
    let (mapped, bits) = (ObjectAddress::new((value >> 16) as u16, (value >> 8) as u8), value & 0xFF);
    if value == 0 || mapped.index < DUMMY_END {
        return MappingVerdict::Unknown;
    }
    if bits > MOST_BITS {
        return MappingVerdict::Wrong(format!("{mapped} with {bits} bits (max 64 per PDO)"));
    }
    of_file(node.device(), name.direction, mapped, bits)
}

/// Checks the total number of bits; an unknown entry counts as one bit.
fn of_count(node: &Node, index: u16, count: u64) -> MappingVerdict {
    let Some(number) = u8::try_from(count).ok().filter(|_| (1..=MOST_ENTRIES).contains(&count)) else {
        return MappingVerdict::Unknown;
    };
    let (mut bits, mut is_certain) = (0, true);
    for sub in 1..=number {
        let entry = confirmed_number(node, index, sub);
        is_certain &= entry.is_some();
        bits += entry.map_or(1, |entry| entry & 0xFF);
    }
    if bits <= MOST_BITS {
        return if is_certain { MappingVerdict::Right } else { MappingVerdict::Unknown };
    }
    let least = if is_certain { "" } else { "at least " };
    MappingVerdict::Wrong(format!("{count} objects with {least}{bits} bits (max 64 per PDO)"))
}

/// Checks a mapped object against the EDS of the device.
fn of_file(
    device: &DeviceProfile,
    direction: PdoDirection,
    mapped: ObjectAddress,
    bits: u64,
) -> MappingVerdict {
    let Some(file) = device.file.as_ref().map(|import| &import.file) else { return MappingVerdict::Unknown };
    let by = file.kind.name().to_ascii_uppercase();
    let Some(entry) = file.find_object(mapped) else {
        // The profile may describe the object.
        let is_missing = device.is_file_alone();
        let wrong = || MappingVerdict::Wrong(format!("{mapped} not in the {by}"));
        return if is_missing { wrong() } else { MappingVerdict::Unknown };
    };
    let wide = entry.data_type.and_then(DataType::bits).map(u64::from);
    let what = match (direction, entry.access) {
        _ if entry.mappable == Some(false) => "not mappable",
        (PdoDirection::Receive, Some(EntryAccess::Ro | EntryAccess::Const)) => "read-only",
        (PdoDirection::Transmit, Some(EntryAccess::Wo)) => "write-only",
        _ => {
            // Single bits are often mapped as bytes.
            return match wide.filter(|wide| *wide >= 8 && bits > *wide) {
                Some(wide) => {
                    MappingVerdict::Wrong(format!("{mapped} with {bits} bits ({wide} in the {by})"))
                }
                None => MappingVerdict::Right,
            };
        }
    };
    MappingVerdict::Wrong(format!("{mapped} {what} in the {by}"))
}

/// Value of a write, including a refused one.
fn written_value(transfer: &SdoTransfer) -> Option<u64> {
    let is_whole = !transfer.truncated && !transfer.cut_start && (1..=8).contains(&transfer.data.len());
    match transfer.outcome {
        SdoOutcome::Complete => transfer_number(transfer),
        SdoOutcome::Aborted if is_whole => Some(little_endian(&transfer.data)),
        _ => None,
    }
}

impl Rule for MappingInvalid {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let (Some(object), Some(direction)) = (transfer.object, transfer.direction) else { return };
        if !matches!(object.index, 0x1600..=0x17FF | 0x1A00..=0x1BFF) {
            return;
        }
        let (Some(name), Some(value)) = (PdoName::of_parameter(object.index), written_value(transfer)) else {
            return;
        };
        // Entries beyond the number of entries are not in use.
        let is_set = direction == SdoDirection::Download || object.sub != 0;
        let Some(node) = context.event_node(event).filter(|_| is_set) else { return };
        let is_unused = direction == SdoDirection::Upload
            && confirmed_number(node, object.index, 0).is_none_or(|count| u64::from(object.sub) > count);
        if is_unused {
            return;
        }
        match (transfer.outcome, judge_mapping(node, name, object, value)) {
            (SdoOutcome::Complete, MappingVerdict::Right) => context.count_pass(),
            (SdoOutcome::Complete, MappingVerdict::Wrong(wrong)) => {
                let verb = if direction == SdoDirection::Download { "accepted" } else { "present" };
                let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
                alarm.report_finding(|| format!("invalid mapping {verb}: {wrong}"));
            }
            (_, MappingVerdict::Wrong(_))
                if matches!(transfer.abort, Some(SdoAbort { by_client: false, .. })) =>
            {
                context.count_pass();
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::profile::{device_file, imported};

    #[test]
    fn objects_are_held_to_the_eds() {
        let text = "[2000]\nParameterName=a\nDataType=6\nAccessType=ro\nPDOMapping=1\n\
            [2001]\nParameterName=b\nDataType=6\nAccessType=rw\nPDOMapping=0\n\
            [2002]\nParameterName=c\nDataType=6\nAccessType=wo\nPDOMapping=1\n";
        let file = Arc::new(device_file::parse_device_file(text.as_bytes()).unwrap());
        let device = imported::describe_device(&file, "a.eds");
        let of = |direction, index, bits| of_file(&device, direction, ObjectAddress::new(index, 0), bits);
        let wrong = |text: &str| MappingVerdict::Wrong(text.to_owned());
        let (receive, transmit) = (PdoDirection::Receive, PdoDirection::Transmit);
        assert_eq!(of(transmit, 0x2000, 16), MappingVerdict::Right);
        assert_eq!(of(transmit, 0x2000, 8), MappingVerdict::Right);
        assert_eq!(of(transmit, 0x2000, 32), wrong("2000:00 with 32 bits (16 in the EDS)"));
        assert_eq!(of(receive, 0x2000, 16), wrong("2000:00 read-only in the EDS"));
        assert_eq!(of(receive, 0x2001, 16), wrong("2001:00 not mappable in the EDS"));
        assert_eq!(of(receive, 0x2002, 16), MappingVerdict::Right);
        assert_eq!(of(transmit, 0x2002, 16), wrong("2002:00 write-only in the EDS"));
        assert_eq!(of(transmit, 0x2003, 16), wrong("2003:00 not in the EDS"));
        // Without an EDS there is no verdict.
        let plain = crate::profile::plain_device();
        assert_eq!(of_file(plain, receive, ObjectAddress::new(0x2003, 0), 16), MappingVerdict::Unknown);
    }
}
