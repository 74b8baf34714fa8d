//! Mappings that a PDO cannot have.

use crate::event::{Abort, Direction, Event, EventKind, Outcome, SdoTransfer};
use crate::profile::device_file::Access;
use crate::profile::{DataType, Device, PdoDirection, PdoName, little_endian};
use crate::rules::general::facts::{about, number, sure};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A device accepts a mapping of more than 64 bits, or one of an object that its EDS does not have, does not let
    /// be mapped, lets only be read (RPDO) or only be written (TPDO), or that has fewer bits than are mapped; or it
    /// has such an entry set. Dummy objects (0001 to 001F) are not judged, and objects only where there is an EDS.
    ///
    /// # Why it matters
    /// Controller and device do not mean the same bits, or the PDO is never sent.
    ///
    /// # Source
    /// CiA 301 §7.5.2.36, §7.5.2.38 (PDO mapping parameter), CiA 306-1 §4.6.3 (PDOMapping, AccessType)
    ///
    /// # What to look at first
    /// Whether the EDS is the one of this firmware; then the entry that was mapped.
    ///
    /// # Mutation
    /// change the length of a mapping entry
    "mapping-invalid", Warning, "a mapping that the PDO cannot have",
    kinds: ["sdo-transfer"],
    cases: &["3.21", "3.25", "3.26", "3.27", "3.28", "3.29", "3.30", "3.31", "3.32", "3.33"],
    word: "MAP",
}

/// Bits of a CAN frame's data.
const MOST_BITS: u64 = 64;

/// Entries a PDO has at most; above are the codes of multiplexed PDOs.
const MOST_ENTRIES: u64 = 64;

/// Where data types end that may stand for objects (CiA 301 §7.4.7.1).
const DUMMY_END: u16 = 0x20;

struct MappingInvalid;

fn new(_policy: &Policy) -> MappingInvalid {
    MappingInvalid
}

/// What a value comes to.
#[derive(Debug, PartialEq, Eq)]
enum Judged {
    /// That cannot be said.
    Unknown,
    Right,
    /// What is wrong.
    Wrong(String),
}

/// Judges a mapping parameter's value.
fn judge(node: &Node, name: PdoName, object: ObjectAddress, value: u64) -> Judged {
    if object.sub == 0 {
        return of_count(node, object.index, value);
    }
    #[expect(clippy::cast_possible_truncation, reason = "fields of a mapping entry")]
    let (mapped, bits) = (ObjectAddress::new((value >> 16) as u16, (value >> 8) as u8), value & 0xFF);
    if value == 0 || mapped.index < DUMMY_END {
        return Judged::Unknown;
    }
    if bits > MOST_BITS {
        return Judged::Wrong(format!("{mapped} with {bits} bits, more than the 64 of a PDO"));
    }
    of_file(node.device(), name.direction, mapped, bits)
}

/// The bits of as many entries; one that was not seen has one at least.
fn of_count(node: &Node, index: u16, count: u64) -> Judged {
    let Some(number) = u8::try_from(count).ok().filter(|_| (1..=MOST_ENTRIES).contains(&count)) else {
        return Judged::Unknown;
    };
    let (mut bits, mut is_sure) = (0, true);
    for sub in 1..=number {
        let entry = sure(node, index, sub);
        is_sure &= entry.is_some();
        bits += entry.map_or(1, |entry| entry & 0xFF);
    }
    if bits <= MOST_BITS {
        return if is_sure { Judged::Right } else { Judged::Unknown };
    }
    let least = if is_sure { "" } else { "at least " };
    Judged::Wrong(format!("{count} objects of {least}{bits} bits, more than the 64 of a PDO"))
}

/// What the device's EDS says of a mapped object.
fn of_file(device: &Device, direction: PdoDirection, mapped: ObjectAddress, bits: u64) -> Judged {
    let Some(file) = device.file.as_ref().map(|import| &import.file) else { return Judged::Unknown };
    let by = file.kind.name().to_ascii_uppercase();
    let Some(entry) = file.find(mapped) else {
        // A profile may describe it.
        let is_missing = device.is_file_alone();
        let wrong = || Judged::Wrong(format!("{mapped}, which the {by} does not have"));
        return if is_missing { wrong() } else { Judged::Unknown };
    };
    let wide = entry.data_type.and_then(DataType::bits).map(u64::from);
    let what = match (direction, entry.access) {
        _ if entry.mappable == Some(false) => "mapped",
        (PdoDirection::Receive, Some(Access::Ro | Access::Const)) => "written",
        (PdoDirection::Transmit, Some(Access::Wo)) => "read",
        _ => {
            // Single bits are mapped as bytes by many.
            return match wide.filter(|wide| *wide >= 8 && bits > *wide) {
                Some(wide) => Judged::Wrong(format!("{mapped} with {bits} bits; it has {wide} by the {by}")),
                None => Judged::Right,
            };
        }
    };
    Judged::Wrong(format!("{mapped}, not to be {what} by the {by}"))
}

/// The value that was written, also of a refused write.
fn value(transfer: &SdoTransfer) -> Option<u64> {
    let is_whole = !transfer.truncated && !transfer.cut_start && (1..=8).contains(&transfer.data.len());
    match transfer.outcome {
        Outcome::Complete => number(transfer),
        Outcome::Aborted if is_whole => Some(little_endian(&transfer.data)),
        _ => None,
    }
}

impl Rule for MappingInvalid {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let (Some(object), Some(direction)) = (transfer.object, transfer.direction) else { return };
        if !matches!(object.index, 0x1600..=0x17FF | 0x1A00..=0x1BFF) {
            return;
        }
        let (Some(name), Some(value)) = (PdoName::of_parameter(object.index), value(transfer)) else {
            return;
        };
        // What is behind the number of entries does not count.
        let is_set = direction == Direction::Download || object.sub != 0;
        let Some(node) = context.node(event).filter(|_| is_set) else { return };
        let is_unused = direction == Direction::Upload
            && sure(node, object.index, 0).is_none_or(|count| u64::from(object.sub) > count);
        if is_unused {
            return;
        }
        match (transfer.outcome, judge(node, name, object, value)) {
            (Outcome::Complete, Judged::Right) => context.pass(),
            (Outcome::Complete, Judged::Wrong(wrong)) => {
                let verb = if direction == Direction::Download { "accepted" } else { "set" };
                let alarm = context.fail(event).about(about(transfer));
                alarm.say(|| format!("{verb}: {wrong}"));
            }
            (_, Judged::Wrong(_)) if matches!(transfer.abort, Some(Abort { by_client: false, .. })) => {
                context.pass();
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
        let file = Arc::new(device_file::parse(text.as_bytes()).unwrap());
        let device = imported::device(&file, "a.eds");
        let of = |direction, index, bits| of_file(&device, direction, ObjectAddress::new(index, 0), bits);
        let wrong = |text: &str| Judged::Wrong(text.to_owned());
        let (receive, transmit) = (PdoDirection::Receive, PdoDirection::Transmit);
        assert_eq!(of(transmit, 0x2000, 16), Judged::Right);
        assert_eq!(of(transmit, 0x2000, 8), Judged::Right);
        assert_eq!(of(transmit, 0x2000, 32), wrong("2000:00 with 32 bits; it has 16 by the EDS"));
        assert_eq!(of(receive, 0x2000, 16), wrong("2000:00, not to be written by the EDS"));
        assert_eq!(of(receive, 0x2001, 16), wrong("2001:00, not to be mapped by the EDS"));
        assert_eq!(of(receive, 0x2002, 16), Judged::Right);
        assert_eq!(of(transmit, 0x2002, 16), wrong("2002:00, not to be read by the EDS"));
        assert_eq!(of(transmit, 0x2003, 16), wrong("2003:00, which the EDS does not have"));
        // Without an EDS nothing is said.
        let plain = crate::profile::plain_device();
        assert_eq!(of_file(plain, receive, ObjectAddress::new(0x2003, 0), 16), Judged::Unknown);
    }
}
