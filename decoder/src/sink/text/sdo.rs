//! Text of SDO transfers.

use std::fmt::Write as _;

use super::Tone;
use super::parts::{EventWords, bytes, millis, node_short};
use super::transfer::TransferWords;
use crate::event::{Direction, Event, Mode, Outcome, SdoTransfer};
use crate::profile::{self, DataType, Device, Effect, Meaning, Value};
use crate::query::record::device as device_of;
use crate::session::Bus;
use crate::words::grouped;

/// Columns of a transfer.
pub(super) fn words(transfer: &SdoTransfer, event: &Event, bus: &Bus) -> EventWords {
    let server = event.node.map_or(String::new(), |node| node_short(node, bus));
    let client = transfer.client.map_or("client".to_owned(), |client| node_short(client.into(), bus));
    let kind = match transfer.direction {
        Some(Direction::Download) => "SDO w",
        Some(Direction::Upload) => "SDO r",
        None => "SDO",
    };
    let words = SdoWords::of(transfer, device_of(event, bus));
    let is_response = transfer.is_unrequested && transfer.abort.is_none_or(|abort| !abort.by_client);
    let who = if is_response { format!("{server}→{client}") } else { format!("{client}→{server}") };
    EventWords { who, kind, what: words.line(), tone: words.tone }
}

/// Parts of the text of a transfer in the order of `decode`.
#[derive(Default)]
struct SdoWords {
    /// Object, or that it is unknown.
    object: String,
    /// Name of the object; empty if unknown.
    name: String,
    /// Value with the value before; empty if none was transferred.
    value: String,
    /// Number of bytes seen of a value with gaps: `, 14 of 20 bytes seen`.
    seen: String,
    /// Result with the reason of a failure: `ok`, `REFUSED 06010002: attempt to write a read only object`.
    outcome: String,
    /// Duration, mode and order of the messages.
    details: String,
    /// When the value is effective, and whether it is stored: ` | active now | lost at a restart`.
    consequence: String,
    tone: Tone,
}

impl SdoWords {
    fn of(transfer: &SdoTransfer, device: &Device) -> Self {
        let object = transfer.object.filter(|_| transfer.direction.is_some() || transfer.abort.is_some());
        let name = transfer.meaning.as_ref().filter(|_| object.is_some());
        let mut words = Self {
            object: object.map_or("object unknown".to_owned(), |object| object.to_string()),
            name: name.map_or(String::new(), |meaning| meaning.name.clone()),
            ..Self::default()
        };
        let transferred =
            transfer.outcome == Outcome::Complete || transfer.direction == Some(Direction::Download);
        if let Some((seen, whole)) = transfer.partly_seen() {
            words.seen = format!(", {} of {} bytes seen", grouped(seen), grouped(whole));
        } else if transferred && transfer.size > 0 {
            words.value = value(transfer);
        }
        words.tone = outcome(transfer, device, &mut words.outcome);
        details(transfer, &mut words.details);
        consequence(transfer, &mut words.consequence);
        words
    }

    /// All parts in the order of `decode`.
    fn line(&self) -> String {
        let name = if self.name.is_empty() { String::new() } else { format!(" {}", self.name) };
        let value = if self.value.is_empty() { String::new() } else { format!(" = {}", self.value) };
        let Self { object, seen, outcome, details, consequence, .. } = self;
        format!("{object}{name}{value}{seen} {outcome}{details}{consequence}")
    }
}

/// A transfer with its value or failure first; duration and mode are left out.
pub(super) fn transfer(transfer: &SdoTransfer, device: &Device) -> TransferWords {
    let SdoWords { object, name, value, seen, outcome, consequence, .. } = SdoWords::of(transfer, device);
    let result = match (outcome == OK, value.is_empty()) {
        (_, true) => outcome,
        (true, false) => format!("= {value}"),
        (false, false) => format!("{outcome}, value {value}"),
    };
    TransferWords { object, name, result: format!("{result}{seen}{consequence}") }
}

/// Outcome of a complete transfer.
const OK: &str = "ok";

/// ` | active after power-on | lost at a restart`.
fn consequence(transfer: &SdoTransfer, what: &mut String) {
    let _ = match transfer.effect {
        None => Ok(()),
        Some(Effect::AtOnce) => write!(what, " | active now"),
        Some(Effect::Never) => write!(what, " | accepted without effect"),
        Some(effect) => write!(what, " | active {}", effect.when()),
    };
    what.push_str(match transfer.persists {
        Some("yes") => " | survives a restart",
        Some("no") => " | lost at a restart",
        Some("needs-save") => " | survives only if stored (1010)",
        _ => "",
    });
}

/// Requests and responses that do not alternate, and a missing start.
fn order(transfer: &SdoTransfer, what: &mut String) {
    if transfer.is_unrequested && transfer.abort.is_some() {
        what.push_str(" (no request)");
    }
    if transfer.retries > 0 {
        let retries = if transfer.retries == 1 { "retry" } else { "retries" };
        let _ = write!(what, " ({} {retries})", transfer.retries);
    }
    if transfer.is_ambiguous {
        what.push_str(" (ambiguous: segments of two transfers)");
    }
    if transfer.cut_start && !transfer.is_unrequested {
        what.push_str(" (start not captured)");
    }
}

/// `500 ms → 1000 ms`.
fn value(transfer: &SdoTransfer) -> String {
    let show = |data: &[u8]| match &transfer.meaning {
        Some(meaning) => match meaning.decode(data) {
            Value::Bytes(data) => unknown(&data),
            known if meaning.is_outside(&known) => format!("{} (outside)", meaning.show(&known)),
            known => meaning.show(&known),
        },
        None => unknown(data),
    };
    // A signature is a command, not a value.
    let is_command = transfer.meaning.as_deref().is_some_and(Meaning::is_signature);
    let changed = transfer.direction == Some(Direction::Download) && !is_command;
    let previous =
        transfer.previous.as_deref().filter(|previous| changed && *previous != transfer.data.as_slice());
    let assumed = if transfer.previous_assumed { "?" } else { "" };
    let before = previous.map_or(String::new(), |previous| format!("{}{assumed} → ", show(previous)));
    let size = if transfer.size > 8 { format!(" ({} bytes)", transfer.size) } else { String::new() };
    format!("{before}{}{size}", show(&transfer.data))
}

/// Bytes of unknown type. More than four printable characters are shown as text.
fn unknown(data: &[u8]) -> String {
    let characters = data.trim_ascii_end().strip_suffix(b"\0").unwrap_or(data);
    if characters.len() > 4 && characters.iter().all(|byte| byte.is_ascii_graphic() || *byte == b' ') {
        return format!("{}?", DataType::VisibleString.decode(characters));
    }
    bytes(data)
}

fn outcome(transfer: &SdoTransfer, device: &Device, what: &mut String) -> Tone {
    match (transfer.outcome, transfer.abort) {
        (Outcome::Aborted, Some(abort)) => {
            let by = if abort.by_client { "ABORTED by client" } else { "REFUSED" };
            let text = profile::abort_codes().text(abort.code);
            let standard = profile::abort_codes().find(abort.code).map_or(text, |entry| &entry.standard);
            let _ = match device.abort(abort.code, transfer.object) {
                Some(own) if own.text != text => {
                    write!(what, "{by} {:08X}: {} (CiA 301: {standard})", abort.code, own.text)
                }
                _ => write!(what, "{by} {:08X}: {text}", abort.code),
            };
            Tone::Bad
        }
        (Outcome::Complete, _) if transfer.is_unrequested => {
            what.push_str("response without a request");
            Tone::Caution
        }
        (Outcome::Complete | Outcome::Aborted, _) => {
            what.push_str(OK);
            Tone::Plain
        }
        (Outcome::Timeout, _) if transfer.cut_start && transfer.awaits_client => {
            what.push_str("no further message");
            Tone::Caution
        }
        (Outcome::Timeout, _) => {
            what.push_str("NO RESPONSE");
            Tone::Bad
        }
        (Outcome::Superseded, _) => {
            what.push_str(if transfer.waited.is_some() {
                "NO RESPONSE before the next request"
            } else {
                "superseded by a new transfer"
            });
            Tone::Caution
        }
        (Outcome::Incomplete | Outcome::Unfinished, _) => {
            what.push_str("unfinished at end of capture");
            Tone::Caution
        }
    }
}

/// ` dt=1.0ms exp crc ok (1 retry)`.
fn details(transfer: &SdoTransfer, what: &mut String) {
    if let Some(duration) = transfer.duration.filter(|_| transfer.frame_count > 1) {
        let _ = write!(what, " dt={}ms", millis(duration));
    }
    if let Some(mode) = transfer.mode {
        what.push_str(match mode {
            Mode::Expedited => " exp",
            Mode::Segmented => " seg",
            Mode::Block => " blk",
        });
    }
    if let Some(crc) = transfer.crc {
        let _ = write!(what, " crc {}", crc.name());
    }
    order(transfer, what);
}
