//! The words of each kind of event.

use std::fmt::Write as _;

use super::parts::{Words, bytes, millis, node_label, node_short, push_node, seconds};
use super::tone::Tone;
use super::{bus, device, emcy, finding, j1939, pdo, sdo, uds};
use crate::event::{
    BootCause, Certainty, Event, EventKind, ObjectChange, PowerSign, Silence, StateCause, StateChange,
};
use crate::profile;
use crate::query::record::device as device_of;
use crate::session::Bus;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::lss::Content;
use crate::wire::canopen::nmt::NmtService;

/// The columns of a line behind the time, as UTF-8, control characters not yet escaped.
#[derive(Default)]
pub(super) struct Columns {
    /// Node, or sender → receiver.
    pub(super) who: Vec<u8>,
    /// Kind in at most six letters.
    pub(super) kind: &'static str,
    /// What happened.
    pub(super) what: Vec<u8>,
    /// How it looks.
    pub(super) tone: Tone,
}

/// An event in words, as a line of text shows it; control characters are not yet escaped.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Line {
    /// Node, or sender → receiver.
    pub who: String,
    /// Kind in at most six letters.
    pub kind: &'static str,
    /// What happened.
    pub what: String,
    /// How it looks.
    pub tone: Tone,
}

impl Line {
    /// The words of an event.
    pub fn of(event: &Event, bus: &Bus) -> Self {
        let mut columns = Columns::default();
        columns.fill(event, bus);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Self { who: text(&columns.who), kind: columns.kind, what: text(&columns.what), tone: columns.tone }
    }
}

impl Columns {
    /// Replaces all of them by those of an event.
    pub(super) fn fill(&mut self, event: &Event, bus: &Bus) {
        self.who.clear();
        self.what.clear();
        // What storms are made of is written without the formatting machinery.
        match &event.kind {
            EventKind::Pdo(pdo) => {
                (self.kind, self.tone) = ("PDO", Tone::Plain);
                pdo::push_words(pdo, &mut self.what);
                if pdo.layout.is_none() {
                    pdo::push_missing(pdo, event, device_of(event, bus), &mut self.what);
                }
            }
            EventKind::Emcy(emergency) => {
                (self.kind, self.tone) = emcy::push_words(emergency, device_of(event, bus), &mut self.what);
            }
            _ => return self.fill_general(event, bus),
        }
        if let Some(node) = event.node {
            push_node(node, bus, &mut self.who);
        }
    }

    fn fill_general(&mut self, event: &Event, bus: &Bus) {
        let words = words(event, bus);
        (self.kind, self.tone) = (words.kind, words.tone);
        self.who.extend_from_slice(words.who.as_bytes());
        self.what.extend_from_slice(words.what.as_bytes());
    }
}

fn words(event: &Event, bus: &Bus) -> Words {
    if let Some(words) = uds::words(event, bus) {
        return words;
    }
    let who = event.node.map_or(String::new(), |node| node_label(node, bus));
    let words = |kind, what: String, tone| Words { who: who.clone(), kind, what, tone };
    match &event.kind {
        EventKind::NmtCommand { service, target, from, to } => {
            let to_whom = if *target == 0 { "all".to_owned() } else { node_short((*target).into(), bus) };
            let from = from.map_or("?", |from| from.name());
            let what = match (service, to) {
                (NmtService::Unknown(code), _) => format!("unknown NMT command {code:02X}"),
                (_, Some(to)) if *target != 0 => format!("{}: {from} → {}?", service.name(), to.name()),
                (_, Some(to)) => format!("{}: all nodes → {}?", service.name(), to.name()),
                (_, None) => service.name().to_owned(),
            };
            Words { who: format!("master→{to_whom}"), kind: "NMT", what, tone: Tone::Plain }
        }
        EventKind::NmtState(change) => words("STATE", state(change), Tone::Plain),
        EventKind::BootUp { cause, lost } => {
            let expected = matches!(cause, BootCause::Commanded { .. }) && *lost == 0;
            words("BOOT", boot_up(*cause, *lost), if expected { Tone::Good } else { Tone::Caution })
        }
        EventKind::Heartbeat { state: Some(state), .. } => words("HB", state.name().into(), Tone::Quiet),
        EventKind::Heartbeat { state: None, code } => {
            words("HB", format!("undefined state {code:02X}"), Tone::Caution)
        }
        EventKind::GuardRequest => Words {
            who: format!("master→{}", event.node.map_or(String::new(), |node| node_short(node, bus))),
            kind: "GUARD",
            what: "guarding request".into(),
            tone: Tone::Quiet,
        },
        EventKind::GuardReply { state, code, toggle, toggle_error } => {
            let tone = if *toggle_error { Tone::Caution } else { Tone::Quiet };
            words("GUARD", guard_reply(*state, *code, *toggle, *toggle_error), tone)
        }
        EventKind::NodeLost(silence) => words("LOST", lost(silence), Tone::Bad),
        EventKind::NodeBack(silence) => {
            words("BACK", format!("heard again after {} s", seconds(silence.gap)), Tone::Good)
        }
        EventKind::SdoTransfer(transfer) => sdo::words(transfer, event, bus),
        EventKind::Lss { command, from_master, content } => {
            let who = if *from_master { "LSS master" } else { "LSS slave" };
            Words { who: who.into(), kind: "LSS", what: lss(*command, content), tone: Tone::Plain }
        }
        EventKind::NodeIdChange { from, to, by } => {
            let from = from.map_or_else(String::new, |from| format!("{from} → "));
            words("ID", format!("node-ID {from}{to} in force, set by {by}"), Tone::Caution)
        }
        EventKind::ObjectChange(change) => object_change(change, words),
        _ => match device::words(event).or_else(|| finding::words(&event.kind)) {
            Some((kind, what, tone)) => words(kind, what, tone),
            None => j1939::words(event, bus).unwrap_or_else(|| bus::words(event, words)),
        },
    }
}

fn object_change(change: &ObjectChange, words: impl Fn(&'static str, String, Tone) -> Words) -> Words {
    let shown = |value: &Option<Vec<u8>>| value.as_deref().map_or("?".into(), bytes);
    let what = format!("{} {} → {}", change.object, shown(&change.from), shown(&change.to));
    match change.origin {
        "restart" => words("OBJ", format!("{what} in force since the restart"), Tone::Plain),
        "reset" => words("OBJ", format!("{what}, not kept over the restart"), Tone::Plain),
        _ => words("OBJ", what, Tone::Quiet),
    }
}

fn guard_reply(state: Option<NmtState>, code: u8, toggle: bool, toggle_error: bool) -> String {
    let state = state.map_or_else(|| format!("undefined state {code:02X}"), |state| state.name().into());
    let error = if toggle_error { ", toggle bit did not alternate" } else { "" };
    format!("reply: {state}, toggle {}{error}", u8::from(toggle))
}

fn boot_up(cause: BootCause, lost: u32) -> String {
    let settings = match lost {
        0 => String::new(),
        1 => "; 1 setting gone that was not kept".into(),
        _ => format!("; {lost} settings gone that were not kept"),
    };
    let sign = match cause {
        BootCause::Commanded { frame } => {
            return format!("boot-up, reset was commanded {{{frame}}}{settings}");
        }
        BootCause::PresumedPowerOn { sign } => sign,
    };
    let why = match sign {
        None => "power-on or self-reset",
        Some(PowerSign::OtherNodesToo) => "power-on, other nodes booted too",
        Some(PowerSign::BusWasSilent) => "power-on, the bus was silent before",
    };
    format!("boot-up, no NMT reset before → {why}{settings}")
}

fn state(change: &StateChange) -> String {
    let to = change.to.name();
    let by = match change.cause {
        StateCause::Command => "NMT command",
        StateCause::BootUp => "boot-up",
        StateCause::Heartbeat => "heartbeat",
        StateCause::GuardReply => "guarding reply",
        StateCause::Pdo => "its PDO",
        StateCause::LifeGuard => "life guarding",
        StateCause::Emcy => "EMCY",
    };
    match (change.certainty, change.from, change.after) {
        (Certainty::Presumed, from, _) => {
            format!("{} → {to}? after {by}", from.map_or("?", |from| from.name()))
        }
        (_, Some(from), Some(after)) if from == change.to => {
            format!("{to} confirmed by {by}, +{} ms after {{{}}}", millis(after), change.cause_frame)
        }
        (_, Some(from), _) if from == change.to => format!("{to} confirmed by {by}"),
        (_, Some(from), _) => format!("{} → {to}, told by {by}", from.name()),
        (_, None, _) => format!("{to}, told by {by}"),
    }
}

fn lost(silence: &Silence) -> String {
    let mut what = format!("silent for {} s ({})", seconds(silence.gap), silence.monitored_by);
    let _ = write!(what, ", last frame {{{}}}", silence.last_frame);
    if let Some(state) = silence.last_state {
        let _ = write!(what, ", was {}", state.name());
    }
    if let Some(code) = silence.last_emcy {
        let _ = write!(what, ", last EMCY {code:04X}");
    }
    what
}

fn lss(command: u8, content: &Content) -> String {
    let title = profile::lss().title(command);
    let detail = match *content {
        Content::Nothing => String::new(),
        Content::Mode(0) => ": waiting".into(),
        Content::Mode(1) => ": configuration".into(),
        Content::Mode(other) => format!(": undefined mode {other}"),
        Content::NodeId(255) => ": none configured".into(),
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
        Content::FastScan { bit: 128, .. } => ": is any slave without node-ID there?".into(),
        Content::FastScan { number, bit, sub, .. } => {
            format!(": number {sub} {number:08X} from bit {bit} up?")
        }
    };
    format!("{title}{detail}")
}
