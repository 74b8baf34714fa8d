//! Text of node events: NMT states, boot-up, loss, LSS.

use std::fmt::Write as _;

use super::Tone;
use super::parts::{EventWords, LineContent, millis, node_short, seconds};
use crate::event::{BootCause, Certainty, NodeIdSource, PowerSign, Silence, StateCause, StateChange};
use crate::profile;
use crate::session::Bus;
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::lss::Content;
use crate::wire::canopen::nmt::NmtService;

/// The third argument contains the presumed states before and after the command.
pub(super) fn nmt_command(
    service: NmtService,
    target: u8,
    [from, to]: [Option<NmtState>; 2],
    bus: &Bus,
) -> EventWords {
    let to_whom = if target == 0 { "all".to_owned() } else { node_short(target.into(), bus) };
    let from = from.map_or("?", |from| from.name());
    let what = match (service, to) {
        (NmtService::Unknown(code), _) => format!("undefined NMT command {code:02X}h"),
        (_, Some(to)) if target != 0 => format!("{}: {from} → {}?", service.name(), to.name()),
        (_, Some(to)) => format!("{}: all nodes → {}?", service.name(), to.name()),
        (_, None) => service.name().to_owned(),
    };
    EventWords { who: format!("master→{to_whom}"), kind: "NMT", what, tone: Tone::Plain }
}

pub(super) fn heartbeat(state: Option<NmtState>, code: u8) -> LineContent {
    match state {
        Some(state) => ("HB", state.name().into(), Tone::Quiet),
        None => ("HB", format!("undefined state {code:02X}h"), Tone::Caution),
    }
}

pub(super) fn guard_request(node: Option<NodeId>, bus: &Bus) -> EventWords {
    let who = format!("master→{}", node.map_or(String::new(), |node| node_short(node, bus)));
    EventWords { who, kind: "GUARD", what: "guarding request".into(), tone: Tone::Quiet }
}

pub(super) fn node_id_change(from: Option<u8>, to: u8, by: NodeIdSource) -> LineContent {
    let from = from.map_or_else(String::new, |from| format!("{from} → "));
    ("ID", format!("node-ID {from}{to}, set by {}", by.name()), Tone::Caution)
}

pub(super) fn guard_reply(
    state: Option<NmtState>,
    code: u8,
    toggle: bool,
    is_toggle_wrong: bool,
) -> LineContent {
    let state = state.map_or_else(|| format!("undefined state {code:02X}h"), |state| state.name().into());
    let error = if is_toggle_wrong { ", toggle bit repeated" } else { "" };
    let tone = if is_toggle_wrong { Tone::Caution } else { Tone::Quiet };
    ("GUARD", format!("response: {state}, toggle {}{error}", u8::from(toggle)), tone)
}

pub(super) fn boot_up(cause: BootCause, lost: u32) -> LineContent {
    let is_expected = matches!(cause, BootCause::Commanded { .. }) && lost == 0;
    ("BOOT", boot_cause(cause, lost), if is_expected { Tone::Good } else { Tone::Caution })
}

/// ` {12}`; nothing for a frame before the capture.
pub(super) fn evidence(frame: u64) -> String {
    if frame == 0 { String::new() } else { format!(" {{{frame}}}") }
}

fn boot_cause(cause: BootCause, lost: u32) -> String {
    let settings = match lost {
        0 => String::new(),
        1 => "; 1 volatile setting lost".into(),
        _ => format!("; {lost} volatile settings lost"),
    };
    let sign = match cause {
        BootCause::Commanded { frame } => {
            return format!("boot-up after NMT reset{}{settings}", evidence(frame));
        }
        BootCause::PresumedPowerOn { sign } => sign,
    };
    let why = match sign {
        None => "power cycle or self-reset",
        Some(PowerSign::OtherNodesToo) => "power cycle, other nodes booted too",
        Some(PowerSign::BusWasSilent) => "power cycle, bus silent before",
    };
    format!("boot-up, no NMT reset before → {why}{settings}")
}

pub(super) fn nmt_state(change: &StateChange) -> LineContent {
    ("STATE", state(change), Tone::Plain)
}

fn state(change: &StateChange) -> String {
    let to = change.to.name();
    let by = match change.cause {
        StateCause::Command => "NMT command",
        StateCause::BootUp => "boot-up",
        StateCause::Heartbeat => "heartbeat",
        StateCause::GuardReply => "guarding response",
        StateCause::Pdo => "PDO",
        StateCause::LifeGuard => "life guarding",
        StateCause::Emcy => "EMCY",
        StateCause::BusFile { .. } => "bus file",
    };
    match (change.certainty, change.from, change.after) {
        (Certainty::Presumed, from, _) => {
            format!("{} → {to}? after {by}", from.map_or("?", |from| from.name()))
        }
        (_, Some(from), Some(after)) if from == change.to => {
            format!("{to} confirmed by {by}, +{} ms after {{{}}}", millis(after), change.cause_frame)
        }
        (_, Some(from), _) if from == change.to => format!("{to} confirmed by {by}"),
        (_, Some(from), _) => format!("{} → {to}, reported by {by}", from.name()),
        (_, None, _) => format!("{to}, reported by {by}"),
    }
}

pub(super) fn node_lost(silence: &Silence) -> LineContent {
    ("LOST", lost(silence), Tone::Bad)
}

pub(super) fn node_back(silence: &Silence) -> LineContent {
    ("BACK", format!("after {} s of silence", seconds(silence.gap)), Tone::Good)
}

fn lost(silence: &Silence) -> String {
    let mut what = format!("silent for {} s ({})", seconds(silence.gap), silence.monitored_by.name());
    let _ = write!(what, ", last frame {{{}}}", silence.last_frame);
    if let Some(state) = silence.last_state {
        let _ = write!(what, ", was {}", state.name());
    }
    if let Some(code) = silence.last_emcy {
        let _ = write!(what, ", last EMCY {code:04X}");
    }
    what
}

pub(super) fn lss(command: u8, is_from_master: bool, content: &Content) -> EventWords {
    let who = if is_from_master { "LSS master" } else { "LSS slave" };
    EventWords { who: who.into(), kind: "LSS", what: lss_message(command, content), tone: Tone::Plain }
}

fn lss_message(command: u8, content: &Content) -> String {
    let title = profile::lss().title(command);
    let detail = match *content {
        Content::Nothing => String::new(),
        Content::Mode(0) => ": waiting".into(),
        Content::Mode(1) => ": configuration".into(),
        Content::Mode(other) => format!(": undefined mode {other}"),
        Content::NodeId(255) => ": not configured".into(),
        Content::NodeId(id) => format!(": {id}/{id:02X}"),
        Content::BitTiming { table: 0, entry } => match profile::lss().bit_rate(entry) {
            Some(rate) => format!(": {rate} kbit/s"),
            None => format!(": entry {entry}"),
        },
        Content::BitTiming { table, entry } => format!(": table {table} entry {entry}"),
        Content::Delay(delay) => format!(": delay {delay} ms"),
        Content::Number(number) => format!(": {number:08X}"),
        Content::Result { code, specific } => {
            let specific = if code == u8::MAX { format!(" {specific:02X}") } else { String::new() };
            format!(": {}{specific}", profile::lss().result(command, code))
        }
        Content::FastScan { bit: 128, .. } => ": any slave without node-ID?".into(),
        Content::FastScan { number, bit, sub, .. } => {
            format!(": number {sub} {number:08X}, bits 31 to {bit}?")
        }
    };
    format!("{title}{detail}")
}
