//! The words of an SDO transfer.

use std::fmt::Write as _;

use super::Tone;
use super::parts::{Words, bytes, millis, node_short};
use crate::event::{Direction, Event, Mode, Outcome, SdoTransfer};
use crate::profile::{self, DataType, Device, Effect, Value};
use crate::query::record::device as device_of;
use crate::session::Bus;

/// The columns of a transfer.
pub(super) fn words(transfer: &SdoTransfer, event: &Event, bus: &Bus) -> Words {
    let server = event.node.map_or(String::new(), |node| node_short(node, bus));
    let client = transfer.client.map_or("client".to_owned(), |client| node_short(client.into(), bus));
    let kind = match transfer.direction {
        Some(Direction::Download) => "SDO w",
        Some(Direction::Upload) => "SDO r",
        None => "SDO",
    };
    let mut what = String::new();
    let object = transfer.object.filter(|_| transfer.direction.is_some() || transfer.abort.is_some());
    match object {
        Some(object) => {
            let _ = write!(what, "{object}");
            if let Some(meaning) = &transfer.meaning {
                let _ = write!(what, " {}", meaning.name);
            }
        }
        None => what.push_str("object not seen"),
    }
    let transferred =
        transfer.outcome == Outcome::Complete || transfer.direction == Some(Direction::Download);
    if transferred && transfer.size > 0 {
        what.push_str(&value(transfer));
    }
    let tone = outcome(transfer, device_of(event, bus), &mut what);
    Words { who: format!("{client}→{server}"), kind, what, tone }
}

/// ` | active after power-on | lost at reset`.
fn consequence(transfer: &SdoTransfer, what: &mut String) {
    let _ = match transfer.effect {
        None => Ok(()),
        Some(Effect::AtOnce) => write!(what, " | active now"),
        Some(Effect::Never) => write!(what, " | accepted, never effective"),
        Some(effect) => write!(what, " | active {}", effect.when()),
    };
    what.push_str(match transfer.persists {
        Some("yes") => " | survives a restart",
        Some("no") => " | lost at a restart",
        Some("needs-save") => " | survives only if stored (1010)",
        _ => "",
    });
}

/// ` = 500 ms → 1000 ms`.
fn value(transfer: &SdoTransfer) -> String {
    let show = |data: &[u8]| match &transfer.meaning {
        Some(meaning) => match meaning.decode(data) {
            Value::Bytes(data) => unknown(&data),
            known if meaning.is_outside(&known) => format!("{} (outside)", meaning.show(&known)),
            known => meaning.show(&known),
        },
        None => unknown(data),
    };
    let changed = transfer.direction == Some(Direction::Download);
    let previous =
        transfer.previous.as_deref().filter(|previous| changed && *previous != transfer.data.as_slice());
    let assumed = if transfer.previous_assumed { "?" } else { "" };
    let before = previous.map_or(String::new(), |previous| format!("{}{assumed} → ", show(previous)));
    let size = if transfer.size > 8 { format!(" ({} bytes)", transfer.size) } else { String::new() };
    format!(" = {before}{}{size}", show(&transfer.data))
}

/// Bytes of unknown type; a longer run of characters is most likely a text, so it is shown as one.
fn unknown(data: &[u8]) -> String {
    let characters = data.trim_ascii_end().strip_suffix(b"\0").unwrap_or(data);
    if characters.len() > 4 && characters.iter().all(|byte| byte.is_ascii_graphic() || *byte == b' ') {
        return format!("{}?", DataType::VisibleString.decode(characters));
    }
    bytes(data)
}

fn outcome(transfer: &SdoTransfer, device: &Device, what: &mut String) -> Tone {
    let tone = match (transfer.outcome, transfer.abort) {
        (Outcome::Aborted, Some(abort)) => {
            let by = if abort.by_client { "ABORTED by client" } else { "REFUSED" };
            let standard = profile::abort_codes().text(abort.code);
            let _ = match device.abort(abort.code, transfer.object) {
                Some(own) if own.text != standard => {
                    write!(what, " {by} {:08X}: {} (CiA 301: {standard})", abort.code, own.text)
                }
                _ => write!(what, " {by} {:08X}: {standard}", abort.code),
            };
            Tone::Bad
        }
        (Outcome::Complete | Outcome::Aborted, _) => {
            what.push_str(" ok");
            Tone::Plain
        }
        (Outcome::Timeout, _) => {
            what.push_str(" NO ANSWER");
            Tone::Bad
        }
        (Outcome::Superseded, _) => {
            what.push_str(if transfer.waited.is_some() {
                " NO ANSWER, another one began"
            } else {
                " given up: another one began"
            });
            Tone::Caution
        }
        (Outcome::Incomplete | Outcome::Unfinished, _) => {
            what.push_str(" unfinished when the capture ends");
            Tone::Caution
        }
    };
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
    if transfer.cut_start {
        what.push_str(" (start not seen)");
    }
    consequence(transfer, what);
    tone
}
