//! Text of SDO transfers.

use std::io::Write as _;

use super::LineTone;
use super::parts::{push_bytes, push_millis, push_node_short, push_object, text_of};
use super::transfer::TransferWords;
use crate::ascii::{push_code, push_decimal};
use crate::event::{Event, MisplacedResponse, SdoDirection, SdoMode, SdoOutcome, SdoTransfer};
use crate::profile::{self, DataType, DecodedValue, DeviceProfile, ObjectMeaning, Persistence, WriteEffect};
use crate::query::record::event_device as device_of;
use crate::session::Bus;
use crate::words::{count_noun, group_digits};

/// Appends client and server in the direction of the transfer, and the text; returns the KIND column and the tone.
pub(super) fn push_words(
    transfer: &SdoTransfer,
    event: &Event,
    bus: &Bus,
    who: &mut Vec<u8>,
    what: &mut Vec<u8>,
) -> (&'static str, LineTone) {
    push_participants(transfer, event, bus, who);
    let kind = match transfer.direction {
        Some(SdoDirection::Download) => "SDO w",
        Some(SdoDirection::Upload) => "SDO r",
        None => "SDO",
    };
    (kind, push_line(transfer, device_of(event, bus), what))
}

fn push_participants(transfer: &SdoTransfer, event: &Event, bus: &Bus, who: &mut Vec<u8>) {
    let is_response = transfer.is_unrequested && transfer.abort.is_none_or(|abort| !abort.by_client);
    let push_server = |who: &mut Vec<u8>| {
        if let Some(node) = event.node {
            push_node_short(node, bus, who);
        }
    };
    if is_response {
        push_server(who);
        who.extend_from_slice("→".as_bytes());
    }
    match transfer.client {
        Some(client) => push_node_short(client.into(), bus, who),
        None => who.extend_from_slice(b"client"),
    }
    if !is_response {
        who.extend_from_slice("→".as_bytes());
        push_server(who);
    }
}

/// Appends object, name, value, outcome, details and consequence.
fn push_line(transfer: &SdoTransfer, device: &DeviceProfile, out: &mut Vec<u8>) -> LineTone {
    push_known_object(transfer, out);
    let name = object_name(transfer);
    if !name.is_empty() {
        out.push(b' ');
        out.extend_from_slice(name.as_bytes());
    }
    let without_value = out.len();
    out.extend_from_slice(b" = ");
    let start = out.len();
    push_value(transfer, out);
    if out.len() == start {
        out.truncate(without_value);
    }
    push_seen(transfer, out);
    out.push(b' ');
    let tone = push_outcome(transfer, device, out);
    push_details(transfer, out);
    push_consequence(transfer, out);
    tone
}

/// A transfer with its value or failure first; duration and mode are left out.
pub(super) fn transfer_words(transfer: &SdoTransfer, device: &DeviceProfile) -> TransferWords {
    let value = text_of(|out| push_value(transfer, out));
    let outcome = text_of(|out| {
        push_outcome(transfer, device, out);
    });
    let rest = text_of(|out| {
        push_seen(transfer, out);
        push_consequence(transfer, out);
    });
    let result = match (outcome == OK, value.is_empty()) {
        (_, true) => outcome,
        (true, false) => format!("= {value}"),
        (false, false) => format!("{outcome}, value {value}"),
    };
    TransferWords {
        object: text_of(|out| push_known_object(transfer, out)),
        name: object_name(transfer).to_owned(),
        result: format!("{result}{rest}"),
    }
}

/// Outcome of a complete transfer.
const OK: &str = "ok";

/// Appends the object, or that it is unknown.
fn push_known_object(transfer: &SdoTransfer, out: &mut Vec<u8>) {
    match transfer.object.filter(|_| has_object(transfer)) {
        Some(object) => push_object(object, out),
        None => out.extend_from_slice(b"object unknown"),
    }
}

/// Name of the object; empty if unknown.
fn object_name(transfer: &SdoTransfer) -> &str {
    let meaning = transfer.meaning.as_ref().filter(|_| transfer.object.is_some() && has_object(transfer));
    meaning.map_or("", |meaning| &meaning.name)
}

/// Whether an object in the event is that of the transfer.
fn has_object(transfer: &SdoTransfer) -> bool {
    transfer.direction.is_some() || transfer.abort.is_some()
}

/// Appends the number of bytes seen of a value with gaps: `, 14 of 20 bytes seen`.
fn push_seen(transfer: &SdoTransfer, out: &mut Vec<u8>) {
    if let Some((seen, whole)) = transfer.partly_seen() {
        // Writing to a vector cannot fail.
        let _ = write!(out, ", {} of {} bytes seen", group_digits(seen), group_digits(whole));
    }
}

/// Appends ` | active after power-on | lost at a restart`.
fn push_consequence(transfer: &SdoTransfer, out: &mut Vec<u8>) {
    if let Some(effect) = transfer.effect {
        out.extend_from_slice(match effect {
            WriteEffect::AtOnce => b" | active now",
            WriteEffect::Never => b" | accepted without effect",
            _ => b" | active ",
        });
        if !matches!(effect, WriteEffect::AtOnce | WriteEffect::Never) {
            out.extend_from_slice(effect.time_text().as_bytes());
        }
    }
    out.extend_from_slice(match transfer.persists {
        Some(Persistence::Yes) => b" | survives a restart",
        Some(Persistence::No) => b" | lost at a restart",
        Some(Persistence::NeedsSave) => b" | survives only if stored (1010)",
        Some(Persistence::NotStored) | None => b"",
    });
}

/// Appends that requests and responses do not alternate, and a missing start.
fn push_order(transfer: &SdoTransfer, out: &mut Vec<u8>) {
    if transfer.is_unrequested && transfer.abort.is_some() {
        out.extend_from_slice(b" (no request)");
    }
    if transfer.retries > 0 {
        let retries = if transfer.retries == 1 { "retry" } else { "retries" };
        // Writing to a vector cannot fail.
        let _ = write!(out, " ({} {retries})", transfer.retries);
    }
    if transfer.unrequested_responses > 0 {
        let responses = count_noun(transfer.unrequested_responses, "response");
        let _ = write!(out, " ({responses} without a request)");
    }
    if let Some(MisplacedResponse { id, frame }) = transfer.misplaced {
        let _ = write!(out, " (response on {id} {{{frame}}} instead of {})", transfer.response);
    }
    if transfer.is_ambiguous {
        out.extend_from_slice(b" (ambiguous: segments of two transfers)");
    }
    if transfer.cut_start && !transfer.is_unrequested {
        out.extend_from_slice(b" (start not captured)");
    }
}

/// Appends `500 ms → 1000 ms`; nothing if no value was transferred completely.
fn push_value(transfer: &SdoTransfer, out: &mut Vec<u8>) {
    let is_download = transfer.direction == Some(SdoDirection::Download);
    let is_transferred = transfer.outcome == SdoOutcome::Complete || is_download;
    if !is_transferred || transfer.size == 0 || transfer.partly_seen().is_some() {
        return;
    }
    // A signature is a command, not a value.
    let is_command = transfer.meaning.as_deref().is_some_and(ObjectMeaning::is_signature);
    let previous = transfer.previous.as_deref().filter(|_| is_download && !is_command);
    if let Some(previous) = previous.filter(|previous| *previous != transfer.data.as_slice()) {
        push_data(transfer, previous, out);
        out.extend_from_slice(if transfer.previous_assumed { "? → " } else { " → " }.as_bytes());
    }
    push_data(transfer, &transfer.data, out);
    if transfer.size > 8 {
        out.extend_from_slice(b" (");
        push_decimal(out, transfer.size);
        out.extend_from_slice(b" bytes)");
    }
}

/// Appends data with its meaning.
fn push_data(transfer: &SdoTransfer, data: &[u8], out: &mut Vec<u8>) {
    let Some(meaning) = transfer.meaning.as_deref() else { return push_unknown(data, out) };
    match meaning.decode(data) {
        DecodedValue::Bytes(data) => push_unknown(&data, out),
        known => {
            out.extend_from_slice(meaning.format_value(&known).as_bytes());
            if meaning.is_outside(&known) {
                out.extend_from_slice(b" (outside)");
            }
        }
    }
}

/// Appends bytes of unknown type. More than four printable characters are shown as text.
fn push_unknown(data: &[u8], out: &mut Vec<u8>) {
    let characters = data.trim_ascii_end().strip_suffix(b"\0").unwrap_or(data);
    if characters.len() > 4 && characters.iter().all(|byte| byte.is_ascii_graphic() || *byte == b' ') {
        // Writing to a vector cannot fail.
        let _ = write!(out, "{}?", DataType::VisibleString.decode(characters));
    } else {
        push_bytes(out, data);
    }
}

/// Appends the result with the reason of a failure: `ok`, `REFUSED 06010002: attempt to write a read only object`.
fn push_outcome(transfer: &SdoTransfer, device: &DeviceProfile, out: &mut Vec<u8>) -> LineTone {
    match (transfer.outcome, transfer.abort) {
        (SdoOutcome::Aborted, Some(abort)) => {
            let by = if abort.by_client { "ABORTED by client" } else { "REFUSED" };
            let text = profile::abort_codes().code_text(abort.code);
            let standard = profile::abort_codes().find_code(abort.code).map_or(text, |entry| &entry.standard);
            let own = device.abort_entry(abort.code, transfer.object).filter(|own| own.text != text);
            out.extend_from_slice(by.as_bytes());
            out.push(b' ');
            push_code(out, abort.code, 8);
            out.extend_from_slice(b": ");
            out.extend_from_slice(own.map_or(text, |own| &own.text).as_bytes());
            if own.is_some() {
                // Writing to a vector cannot fail.
                let _ = write!(out, " (CiA 301: {standard})");
            }
            LineTone::Bad
        }
        (SdoOutcome::Complete, _) if transfer.is_unrequested => {
            out.extend_from_slice(b"response without a request");
            LineTone::Caution
        }
        (SdoOutcome::Complete | SdoOutcome::Aborted, _) => {
            out.extend_from_slice(OK.as_bytes());
            LineTone::Plain
        }
        _ if transfer.is_unrequested && transfer.abort.is_none() => {
            // Writing to a vector cannot fail.
            let _ = write!(out, "{} without a request", count_noun(transfer.frame_count, "response"));
            LineTone::Caution
        }
        (SdoOutcome::Timeout, _) if transfer.cut_start && transfer.awaits_client => {
            out.extend_from_slice(b"no further message");
            LineTone::Caution
        }
        (SdoOutcome::Timeout, _) => {
            out.extend_from_slice(b"NO RESPONSE");
            LineTone::Bad
        }
        (SdoOutcome::Superseded, _) => {
            out.extend_from_slice(if transfer.waited.is_some() {
                b"NO RESPONSE before the next request"
            } else {
                b"superseded by a new transfer"
            });
            LineTone::Caution
        }
        (SdoOutcome::Incomplete | SdoOutcome::Unfinished, _) => {
            out.extend_from_slice(b"unfinished at end of capture");
            LineTone::Caution
        }
    }
}

/// Appends ` dt=1.0ms exp crc ok (1 retry)`.
fn push_details(transfer: &SdoTransfer, out: &mut Vec<u8>) {
    if let Some(duration) = transfer.duration.filter(|_| transfer.frame_count > 1) {
        out.extend_from_slice(b" dt=");
        push_millis(duration, out);
        out.extend_from_slice(b"ms");
    }
    if let Some(mode) = transfer.mode {
        out.extend_from_slice(match mode {
            SdoMode::Expedited => b" exp",
            SdoMode::Segmented => b" seg",
            SdoMode::Block => b" blk",
        });
    }
    if let Some(crc) = transfer.crc {
        out.extend_from_slice(b" crc ");
        out.extend_from_slice(crc.name().as_bytes());
    }
    push_order(transfer, out);
}
