//! Explains J1939 identifiers, parameter groups and faults.

use cobscope_decoder::profile::device::DeviceTroubleCode;
use cobscope_decoder::profile::{self, DeviceProfile};
use cobscope_decoder::wire::j1939::{ALL, J1939Id, Pgn};

use super::asked::LookupScope;
use super::code::section_of;
use crate::run::describe::{TextBlock, j1939, section_text};

/// `65226 (FECA) DM1 active faults`.
fn group_text(pgn: Pgn) -> String {
    profile::pgn_name(pgn).map_or_else(|| pgn.to_string(), |name| format!("{pgn} {name}"))
}

/// A 29-bit identifier; `None` if its extended data page is set.
pub(super) fn explain_identifier(id: u32) -> Option<String> {
    let parts = J1939Id::from_identifier(id)?;
    let to = if parts.destination == ALL { "all".into() } else { format!("{:02X}", parts.destination) };
    let what = format!(
        "J1939: priority {}, PGN {}, from {:02X} to {to}",
        parts.priority,
        group_text(parts.pgn),
        parts.source
    );
    Some(TextBlock::new(&format!("{id:08X}"), &what).finish())
}

/// Explains `pgn:65226`, `pgn:0xFECA` or `pgn:FECA`; `None` for other text and for invalid numbers.
pub(super) fn parameter_group(asked: &LookupScope, text: &str) -> Option<String> {
    let number = text.strip_prefix("pgn").or_else(|| text.strip_prefix("PGN"))?;
    let number = number.trim_start_matches([':', ' ']);
    let number = match number.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16).ok()?,
        // Hexadecimal letters identify a hexadecimal number; otherwise it is decimal.
        None => number.parse().or_else(|_| u32::from_str_radix(number, 16)).ok()?,
    };
    let pgn = Pgn::new(number);
    if pgn.number() != number {
        return None;
    }
    let name =
        profile::pgn_name(pgn).unwrap_or_else(|| "not defined in the protocol; decode it with --dbc".into());
    let mut block = TextBlock::new(&pgn.to_string(), &format!("parameter group: {name}"));
    block.push_row(
        "destination",
        if pgn.is_addressed() { "one address, or all (PDU1)" } else { "all (PDU2)" },
    );
    let devices = asked.device.iter().cloned().chain([profile::isobus().clone()]);
    for device in devices {
        for message in device.messages.iter().filter(|message| message.number_of(pgn).is_some()) {
            block.push_row(&device.title, &j1939::message_contents(&device, message));
        }
    }
    Some(block.finish())
}

/// Explains `298985/19` (SPN/FMI); `None` for other text.
pub(super) fn explain_fault(asked: &LookupScope, text: &str) -> Option<String> {
    let (spn, fmi) = text.split_once('/')?;
    let (spn, fmi): (u32, u8) = (spn.parse().ok()?, fmi.parse().ok()?);
    if spn >= 1 << 19 || fmi >= 1 << 5 {
        return None;
    }
    let mode = profile::failure_modes().find_code(u32::from(fmi)).map_or("reserved", |mode| &mode.text);
    let title = format!("SPN {spn} FMI {fmi}");
    let Some(device) = &asked.device else {
        let mut block = TextBlock::new(&title, &format!("J1939 fault: {mode}"));
        let entries = asked.every_device(|device| {
            let own = device.trouble_code_entry(spn, fmi)?;
            Some(format!("{}  {}", j1939::dtc_text(own), section_text(&own.source)))
        });
        block.push_row("sent as", &sent_as(spn, fmi));
        block.push_list(&entries, "(details: --device NAME)");
        return Some(block.finish());
    };
    if let Some(own) = device.trouble_code_entry(spn, fmi) {
        return Some(of_device(device, own, mode));
    }
    let what = format!("J1939 fault: not in the manual of {}", device.title);
    let mut block = TextBlock::new(&title, &what);
    block.push_row("FMI", mode);
    block.push_row("sent as", &sent_as(spn, fmi));
    Some(block.finish())
}

/// Explains the bytes of a trouble code: six hexadecimal digits, or eight with the occurrence count. Manuals
/// print them in either order: as sent in DM1 (`E98F93`, J1939-73 §5.7.1.6), or as a number (`938FE9`). If one
/// order gives a known fault, the other is omitted. Eight digits can be another code, so they must be known.
pub(super) fn trouble_code(asked: &LookupScope, digits: &str) -> Vec<String> {
    let Ok(number) = u32::from_str_radix(digits, 16) else { return Vec::new() };
    let (as_number, as_sent) = match (number.to_le_bytes(), digits.len()) {
        ([low, middle, high, _], 6) => ([low, middle, high], [high, middle, low]),
        ([low, middle, high, first], 8) => ([low, middle, high], [first, high, middle]),
        _ => return Vec::new(),
    };
    let is_known = |(spn, fmi): &(u32, u8)| match &asked.device {
        Some(device) => device.trouble_code_entry(*spn, *fmi).is_some(),
        None => !asked
            .every_device(|device| device.trouble_code_entry(*spn, *fmi).map(|_| String::new()))
            .is_empty(),
    };
    let mut readings = vec![fault_of(as_number), fault_of(as_sent)];
    readings.dedup();
    if digits.len() == 8 || readings.iter().any(is_known) {
        readings.retain(is_known);
    }
    readings.into_iter().filter_map(|(spn, fmi)| explain_fault(asked, &format!("{spn}/{fmi}"))).collect()
}

/// SPN and FMI of the first three bytes of a fault in DM1.
fn fault_of([low, middle, high]: [u8; 3]) -> (u32, u8) {
    (u32::from_le_bytes([low, middle, high >> 5, 0]), high & 0x1F)
}

fn of_device(device: &DeviceProfile, own: &DeviceTroubleCode, mode: &str) -> String {
    let title = format!("SPN {} FMI {}", own.spn, own.fmi);
    let mut block = TextBlock::new(&title, &format!("J1939 fault of {}: {}", device.title, own.text));
    block.push_row("severity", &own.severity);
    block.push_row("source", &own.origin);
    block.push_row("reaction", &own.reaction);
    block.push_row("recovery", &own.recovery);
    let priority = own.priority.map_or(String::new(), |priority| format!("{priority} (1 is shown first)"));
    block.push_row("priority", &priority);
    block.push_rows("check", &own.causes);
    block.push_row("sent as", &sent_as(own.spn, own.fmi));
    block.push_row("note", &own.note);
    block.push_row("FMI", mode);
    block.push_row("section", &section_of(device, &own.source));
    block.finish()
}

/// The first three bytes of the fault in DM1 (J1939-73 §5.7.1.6).
fn sent_as(spn: u32, fmi: u8) -> String {
    let [low, middle, high, _] = spn.to_le_bytes();
    format!("{low:02X} {middle:02X} {:02X}", high << 5 | fmi)
}
