//! Text of node events: NMT states, boot-up, loss, LSS.

use std::fmt::Write as _;

use super::LineTone;
use super::parts::{EventWords, LineContent, format_millis, node_short};
use crate::event::{
    BootCause, NodeIdSource, NodeSilence, PowerSign, StateCause, StateCertainty, StateChange,
};
use crate::figures::format_seconds;
use crate::profile;
use crate::session::Bus;
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::lss::LssContent;
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
    EventWords { who: format!("master→{to_whom}"), kind: "NMT", what, tone: LineTone::Plain }
}

pub(super) fn heartbeat_line(state: Option<NmtState>, code: u8) -> LineContent {
    match state {
        Some(state) => ("HB", state.name().into(), LineTone::Quiet),
        None => ("HB", format!("undefined state {code:02X}h"), LineTone::Caution),
    }
}

pub(super) fn guard_request(node: Option<NodeId>, bus: &Bus) -> EventWords {
    let who = format!("master→{}", node.map_or(String::new(), |node| node_short(node, bus)));
    EventWords { who, kind: "GUARD", what: "guarding request".into(), tone: LineTone::Quiet }
}

pub(super) fn node_id_change(from: Option<u8>, to: u8, by: NodeIdSource) -> LineContent {
    let from = from.map_or_else(String::new, |from| format!("{from} → "));
    ("ID", format!("node-ID {from}{to}, set by {}", by.name()), LineTone::Caution)
}

pub(super) fn guard_reply(
    state: Option<NmtState>,
    code: u8,
    toggle: bool,
    is_toggle_wrong: bool,
) -> LineContent {
    let state = state.map_or_else(|| format!("undefined state {code:02X}h"), |state| state.name().into());
    let error = if is_toggle_wrong { ", toggle bit repeated" } else { "" };
    let tone = if is_toggle_wrong { LineTone::Caution } else { LineTone::Quiet };
    ("GUARD", format!("response: {state}, toggle {}{error}", u8::from(toggle)), tone)
}

pub(super) fn boot_up(cause: BootCause, lost: u32) -> LineContent {
    let is_expected = matches!(cause, BootCause::Commanded { .. }) && lost == 0;
    ("BOOT", boot_cause(cause, lost), if is_expected { LineTone::Good } else { LineTone::Caution })
}

/// ` {12}`; nothing for a frame before the capture.
pub(super) fn evidence_text(frame: u64) -> String {
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
            return format!("boot-up after NMT reset{}{settings}", evidence_text(frame));
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
    ("STATE", state_text(change), LineTone::Plain)
}

fn state_text(change: &StateChange) -> String {
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
        (StateCertainty::Presumed, from, _) => {
            format!("{} → {to}? after {by}", from.map_or("?", |from| from.name()))
        }
        (_, Some(from), Some(after)) if from == change.to => {
            format!("{to} confirmed by {by}, +{} ms after {{{}}}", format_millis(after), change.cause_frame)
        }
        (_, Some(from), _) if from == change.to => format!("{to} confirmed by {by}"),
        (_, Some(from), _) => format!("{} → {to}, reported by {by}", from.name()),
        (_, None, _) => format!("{to}, reported by {by}"),
    }
}

pub(super) fn node_lost(silence: &NodeSilence) -> LineContent {
    ("LOST", lost_text(silence), LineTone::Bad)
}

pub(super) fn node_back(silence: &NodeSilence) -> LineContent {
    let gap = format_seconds(silence.gap);
    let what = if silence.others_continue {
        format!("{} again after {gap} s", silence.monitored_by.name())
    } else {
        format!("after {gap} s of silence")
    };
    ("BACK", what, LineTone::Good)
}

fn lost_text(silence: &NodeSilence) -> String {
    let (gap, by) = (format_seconds(silence.gap), silence.monitored_by.name());
    let mut what = if silence.others_continue {
        format!("{by} missing for {gap} s, {}", silence.others_text())
    } else {
        format!("silent for {gap} s ({by})")
    };
    if let Some(boot) = silence.boot_frame {
        let _ = write!(what, " since the boot-up {{{boot}}}");
    }
    let _ = write!(what, ", last frame {{{}}}", silence.last_frame);
    if let Some(state) = silence.last_state {
        let _ = write!(what, ", was {}", state.name());
    }
    if let Some(code) = silence.last_emcy {
        let _ = write!(what, ", last EMCY {code:04X}");
    }
    what
}

pub(super) fn lss_words(command: u8, is_from_master: bool, content: &LssContent) -> EventWords {
    let who = if is_from_master { "LSS master" } else { "LSS slave" };
    EventWords { who: who.into(), kind: "LSS", what: lss_message(command, content), tone: LineTone::Plain }
}

fn lss_message(command: u8, content: &LssContent) -> String {
    let title = profile::lss_names().service_title(command);
    let detail = match *content {
        LssContent::Nothing => String::new(),
        LssContent::Mode(0) => ": waiting".into(),
        LssContent::Mode(1) => ": configuration".into(),
        LssContent::Mode(other) => format!(": undefined mode {other}"),
        LssContent::NodeId(255) => ": not configured".into(),
        LssContent::NodeId(id) => format!(": {id}/{id:02X}"),
        LssContent::BitTiming { table: 0, entry } => match profile::lss_names().bit_rate(entry) {
            Some(rate) => format!(": {rate} kbit/s"),
            None => format!(": entry {entry}"),
        },
        LssContent::BitTiming { table, entry } => format!(": table {table} entry {entry}"),
        LssContent::Delay(delay) => format!(": delay {delay} ms"),
        LssContent::Number(number) => format!(": {number:08X}"),
        LssContent::Result { code, specific } => {
            let specific = if code == u8::MAX { format!(" {specific:02X}") } else { String::new() };
            format!(": {}{specific}", profile::lss_names().result_text(command, code))
        }
        LssContent::FastScan { bit: 128, .. } => ": any slave without node-ID?".into(),
        LssContent::FastScan { number, bit, sub, .. } => {
            format!(": number {sub} {number:08X}, bits 31 to {bit}?")
        }
    };
    format!("{title}{detail}")
}
