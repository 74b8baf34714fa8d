//! Text of J1939 events.

use std::fmt::Write as _;

use super::LineTone;
use super::changes::group_name;
use super::parts::{EventWords, format_bytes, format_millis, node_label, node_short};
use super::pdo::push_signals;
use super::transfer::TransferWords;
use crate::event::{
    AddressClaim, ClaimAction, CommandedAddress, Dtc, DtcAction, Event, IrregularityKind,
    J1939Acknowledgement, J1939Message, J1939Request, J1939Transfer, MessageGap, SdoOutcome,
    TransferIrregularity, TransportMode,
};
use crate::figures::format_seconds;
use crate::profile;
use crate::query::record::event_device as device_of;
use crate::session::Bus;
use crate::standard_tables::{function_name, manufacturer_name};
use crate::wire::NodeId;
use crate::wire::j1939::{ALL, J1939Name, Pgn};
use crate::words::count_noun;

pub(super) fn message_line(message: &J1939Message, bus: &Bus) -> EventWords {
    let who = pair_text(message.id.source, message.id.destination, bus);
    EventWords { who, kind: "PG", what: message_words(message), tone: LineTone::Plain }
}

pub(super) fn request_line(request: &J1939Request, bus: &Bus) -> EventWords {
    let who = pair_text(request.source, request.destination, bus);
    let what = format!("requests {}", group_text(request.pgn, request.name.as_deref()));
    EventWords { who, kind: "REQ", what, tone: LineTone::Plain }
}

/// `F1`, `SA80 boom2`, `all`.
fn address_text(address: u8, bus: &Bus) -> String {
    match address {
        ALL => "all".into(),
        known if bus.node(NodeId::J1939(known)).is_some_and(|node| node.name().is_some()) => {
            node_short(NodeId::J1939(known), bus)
        }
        other => format!("SA{other:02X}"),
    }
}

/// `F1→SA80 boom2`; only the source for a global message.
fn pair_text(source: u8, destination: u8, bus: &Bus) -> String {
    if destination == ALL {
        return node_label(NodeId::J1939(source), bus);
    }
    format!("{source:02X}→{}", address_text(destination, bus))
}

/// `65226 (FECA) DM1 active faults`.
pub(super) fn group_text(pgn: Pgn, name: Option<&str>) -> String {
    name.map_or_else(|| pgn.to_string(), |name| format!("{pgn} {name}"))
}

fn message_words(message: &J1939Message) -> String {
    let mut what = format!(
        "{} {}",
        group_text(message.id.pgn, message.name.as_deref()),
        format_bytes(message.payload())
    );
    if let Some(layout) = &message.layout {
        let mut signals = Vec::new();
        push_signals(layout, message.payload(), &mut signals);
        what.push_str(&String::from_utf8_lossy(&signals));
    }
    what
}

pub(super) fn transfer_line(transfer: &J1939Transfer, bus: &Bus) -> EventWords {
    let mut what = match transfer.pgn {
        Some(pgn) => group_text(pgn, transfer.name.as_deref()),
        None => "PGN unknown".into(),
    };
    let _ = write!(what, " {}", content_words(transfer));
    let tone = outcome_words(transfer, &mut what);
    push_irregular(transfer, &mut what);
    if let Some(duration) = transfer.duration.filter(|_| transfer.frame_count > 1) {
        let _ = write!(what, " dt={}ms", format_millis(duration));
    }
    if let Some(mode) = transfer.mode {
        let _ = write!(what, " {}", mode.name());
    }
    if transfer.cut_start {
        what.push_str(" (start not captured)");
    }
    if let Some(layout) = &transfer.layout {
        let mut signals = Vec::new();
        push_signals(layout, &transfer.data, &mut signals);
        what.push_str(&String::from_utf8_lossy(&signals));
    }
    let kind = if transfer.mode == Some(TransportMode::FastPacket) { "FP" } else { "TP" };
    EventWords { who: pair_text(transfer.source, transfer.destination, bus), kind, what, tone }
}

/// `14 bytes`, `21 of 28 bytes`.
fn size_words(transfer: &J1939Transfer) -> String {
    match transfer.announced {
        Some(announced) if u64::from(announced) != transfer.size => {
            format!("{} of {announced} bytes", transfer.size)
        }
        _ => count_noun(transfer.size, "byte"),
    }
}

/// `14 bytes: 41 42 …`; without data only the size.
fn content_words(transfer: &J1939Transfer) -> String {
    let size = size_words(transfer);
    if transfer.data.is_empty() { size } else { format!("{size}: {}", format_bytes(&transfer.data)) }
}

/// Appends missing and repeated packets.
fn push_irregular(transfer: &J1939Transfer, what: &mut String) {
    if transfer.missing > 0 {
        let is_fast = transfer.mode == Some(TransportMode::FastPacket);
        let unit = if is_fast { "frame" } else { "packet" };
        let _ = write!(what, ", {} missing", count_noun(transfer.missing, unit));
    }
    if transfer.repeated > 0 {
        let _ = write!(what, ", {} repeated", transfer.repeated);
    }
}

/// A transport session with its failure or its signals first; duration and mode are left out.
pub(super) fn transfer_words(transfer: &J1939Transfer) -> TransferWords {
    let (acronym, name) = group_name(transfer.name.as_deref().unwrap_or_default());
    let object = match transfer.pgn {
        Some(pgn) => format!("{pgn}{acronym}"),
        None => "PGN unknown".to_owned(),
    };
    let mut outcome = String::new();
    outcome_words(transfer, &mut outcome);
    push_irregular(transfer, &mut outcome);
    let outcome = outcome.trim_start();
    let mut parts = Vec::new();
    parts.extend(Some(outcome.to_owned()).filter(|outcome| outcome != "ok"));
    match &transfer.layout {
        Some(layout) => {
            let mut signals = Vec::new();
            push_signals(layout, &transfer.data, &mut signals);
            parts.push(String::from_utf8_lossy(&signals).trim_start_matches([':', ' ']).to_owned());
        }
        None => parts.push(content_words(transfer)),
    }
    TransferWords { object, name: name.to_owned(), result: parts.join(", ") }
}

/// Appends the outcome of a transfer.
fn outcome_words(transfer: &J1939Transfer, what: &mut String) -> LineTone {
    match transfer.outcome {
        SdoOutcome::Complete => {
            what.push_str(" ok");
            LineTone::Plain
        }
        SdoOutcome::Aborted => {
            what.push_str(" ABORTED");
            if let Some(abort) = transfer.abort {
                let by = if abort.by_sender { "sender" } else { "receiver" };
                let text = profile::transport_aborts().code_text(u32::from(abort.reason));
                let _ = write!(what, " by {by}: {} {text}", abort.reason);
            }
            LineTone::Bad
        }
        SdoOutcome::Timeout => {
            let timer = transfer.timer.map_or(String::new(), |timer| format!(" ({})", timer.name()));
            let _ = write!(what, " TIME-OUT{timer}");
            LineTone::Bad
        }
        SdoOutcome::Superseded => {
            what.push_str(" superseded by a new transfer");
            LineTone::Caution
        }
        SdoOutcome::Incomplete => {
            what.push_str(" incomplete");
            LineTone::Caution
        }
        SdoOutcome::Unfinished => {
            what.push_str(" unfinished at end of capture");
            LineTone::Caution
        }
    }
}

pub(super) fn acknowledgement_line(answer: &J1939Acknowledgement, bus: &Bus) -> EventWords {
    let (result, tone) = match answer.message.control {
        0 => ("acknowledged", LineTone::Plain),
        1 => ("NOT acknowledged", LineTone::Caution),
        2 => ("access DENIED", LineTone::Caution),
        3 => ("cannot respond now", LineTone::Caution),
        _ => ("reserved control byte", LineTone::Caution),
    };
    let for_whom = match answer.message.address {
        ALL => String::new(),
        requester => format!(", requested by {}", address_text(requester, bus)),
    };
    let what = format!("{result}: {}{for_whom}", group_text(answer.message.pgn, answer.name.as_deref()));
    let kind = if answer.message.control == 0 { "ACK" } else { "NACK" };
    EventWords { who: pair_text(answer.source, answer.destination, bus), kind, what, tone }
}

/// `NAME A322810A07212345 (manufacturer 57 Danfoss, function 129 section control, agriculture, number 74565)`.
fn name_words(name: J1939Name) -> String {
    let parts = name.fields();
    let industry = profile::industry_groups().text_of(u32::from(parts.industry_group));
    let named = |text: Option<&str>| text.map_or(String::new(), |text| format!(" {text}"));
    format!(
        "NAME {:016X} (manufacturer {}{}, function {}{}, {}, number {})",
        name.0,
        parts.manufacturer_code,
        named(manufacturer_name(&parts)),
        parts.function,
        named(function_name(&parts)),
        industry.unwrap_or("reserved industry"),
        parts.identity_number
    )
}

pub(super) fn claim_line(claim: &AddressClaim, bus: &Bus) -> EventWords {
    let name = name_words(claim.name);
    let from = claim.from.map_or(String::new(), |from| format!(", was {from:02X}"));
    let command =
        if claim.commanded == 0 { String::new() } else { format!(", commanded by {{{}}}", claim.commanded) };
    let (mut what, tone) = match claim.action {
        ClaimAction::Claimed => {
            (format!("claims address {:02X}{from}{command}: {name}", claim.source), LineTone::Plain)
        }
        ClaimAction::Confirmed => (format!("has address {:02X}: {name}", claim.source), LineTone::Quiet),
        ClaimAction::Lost => (format!("loses address {:02X}: {name}", claim.source), LineTone::Bad),
        ClaimAction::CannotClaim => (format!("CANNOT CLAIM an address{from}: {name}"), LineTone::Bad),
    };
    if let Some(contention) = claim.contention {
        let winner = if contention.winner == claim.name { "wins" } else { "loses" };
        let _ = write!(what, "; {winner} against {:016X} (lower NAME wins)", contention.other.0);
    }
    EventWords { who: node_label(NodeId::J1939(claim.source), bus), kind: "CLAIM", what, tone }
}

pub(super) fn commanded_address(command: &CommandedAddress, bus: &Bus) -> EventWords {
    let present = command.present.map_or(String::new(), |present| format!(", now {present:02X}"));
    let what =
        format!("commands {} to use address {:02X}{present}", name_words(command.name), command.address);
    EventWords { who: address_text(command.source, bus), kind: "ADDR", what, tone: LineTone::Caution }
}

/// `SPN 298985 FMI 19 time guarding, warning; needs 2 neutral AVC and spool neutral`.
pub(super) fn trouble_code(dtc: &Dtc, event: &Event, bus: &Bus) -> EventWords {
    let own = device_of(event, bus).trouble_code_entry(dtc.spn, dtc.fmi);
    let assumed = if dtc.is_old_coding { "?" } else { "" };
    let name =
        bus.suspect_parameter(dtc.spn).map_or(String::new(), |parameter| format!(" {},", parameter.name));
    let mut what = format!("SPN {}{assumed}{name} FMI {}", dtc.spn, dtc.fmi);
    let mode = profile::failure_modes().find_code(u32::from(dtc.fmi));
    match (own, mode) {
        (Some(own), _) => {
            let _ = write!(what, " {}", own.text);
            if !own.severity.is_empty() {
                let _ = write!(what, ", {}", own.severity);
            }
        }
        (None, Some(mode)) => {
            let _ = write!(what, " {}", mode.text);
        }
        (None, None) => {}
    }
    if let Some(count) = dtc.count.filter(|count| *count > 0) {
        let _ = write!(what, ", {count} ×");
    }
    if !dtc.lamps.is_empty() {
        let _ = write!(what, ", lamps: {}", dtc.lamps.join(" "));
    }
    let since = dtc.since.map_or(String::new(), |since| format!(" after {} s", format_seconds(since)));
    let tone = match dtc.action {
        DtcAction::Raised | DtcAction::Recurred => {
            if dtc.action == DtcAction::Recurred {
                what.push_str(", recurred");
            }
            if let Some(own) = own.filter(|own| !own.recovery.is_empty()) {
                let _ = write!(what, "; needs {}", own.recovery);
            }
            LineTone::Bad
        }
        DtcAction::NoLongerReported => {
            let how = match (dtc.by_silence, dtc.may_be_hidden) {
                (true, _) => ": DM1 stopped",
                (false, true) => ": cleared, or hidden by a more urgent fault",
                (false, false) => "",
            };
            let _ = write!(what, ", no longer reported{since}{how}");
            LineTone::Caution
        }
        DtcAction::PreviouslyActive => {
            what.push_str(", previously active");
            LineTone::Plain
        }
        DtcAction::Cleared => {
            let _ = write!(what, ", cleared{since}");
            LineTone::Good
        }
    };
    EventWords { who: node_label(NodeId::J1939(dtc.source), bus), kind: "DTC", what, tone }
}

/// `AVC valve 0: 312 ms > 250 ms (usual 100 ± 3)`.
pub(super) fn message_gap(gap: &MessageGap, event: &Event, bus: &Bus) -> EventWords {
    let whole = |nanoseconds: i64| (nanoseconds + 500_000) / 1_000_000;
    let mut what = format!("{}: {} ms > {} ms", gap.message, whole(gap.gap), whole(gap.limit));
    if let Some((usual, deviation)) = gap.usual {
        let _ = write!(what, " (usual {} ± {})", whole(usual), whole(deviation));
    }
    if !gap.has_returned {
        what.push_str(", not received again");
    }
    let who = match event.node {
        Some(NodeId::J1939(to)) if to != gap.source => pair_text(gap.source, to, bus),
        _ => node_label(NodeId::J1939(gap.source), bus),
    };
    EventWords { who, kind: "GAP", what, tone: LineTone::Caution }
}

pub(super) fn irregularity_line(irregularity: &TransferIrregularity, bus: &Bus) -> EventWords {
    let pgn = irregularity.pgn.map_or(String::new(), |pgn| format!(" of {pgn}"));
    let number = |number: Option<u32>| number.map_or("?".into(), |number: u32| number.to_string());
    let what = match irregularity.what {
        IrregularityKind::Gap => {
            let (received, expected) = (number(irregularity.packet), number(irregularity.expected));
            format!("{}{pgn}: received {received}, expected {expected}", irregularity.message)
        }
        IrregularityKind::Duplicate => {
            format!("{} {}{pgn} repeated", irregularity.message, number(irregularity.packet))
        }
        IrregularityKind::Retransmission => match irregularity.expected {
            Some(next) => format!("{}{pgn} requests packets from {next} on again", irregularity.message),
            None => format!("{}{pgn} repeated", irregularity.message),
        },
        IrregularityKind::Late => {
            let timer = irregularity.timer.map_or("", |timer| timer.name());
            let delay = irregularity
                .delay
                .map_or(String::new(), |delay| format!(" after {} ms", format_millis(delay)));
            format!("{}{pgn} late{delay}, {timer} expired", irregularity.message)
        }
        IrregularityKind::Unexpected => format!("unexpected {}{pgn}", irregularity.message),
    };
    let who = match (irregularity.source, irregularity.destination) {
        (Some(source), Some(destination)) => pair_text(source, destination, bus),
        _ => String::new(),
    };
    EventWords { who, kind: "TP", what, tone: LineTone::Caution }
}
