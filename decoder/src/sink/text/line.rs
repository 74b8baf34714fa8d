//! The words of each kind of event.

use std::fmt::Write as _;

use super::{Tone, pdo};
use crate::event::{
    BootCause, Certainty, Direction, EmcyAction, Emergency, Event, EventKind, FrameRange, Mode, Outcome,
    PowerSign, SdoTransfer, Silence, StateCause, StateChange, Undecoded,
};
use crate::frame::FrameFlags;
use crate::profile::{self, DataType, Value};
use crate::query::record::{can_error_text, time_of_day};
use crate::session::Bus;
use crate::sink::ascii::push_decimal;
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

impl Columns {
    /// Replaces all of them by those of an event.
    pub(super) fn fill(&mut self, event: &Event, bus: &Bus) {
        self.who.clear();
        self.what.clear();
        if let EventKind::Pdo(pdo) = &event.kind {
            (self.kind, self.tone) = ("PDO", Tone::Plain);
            if let Some(node) = event.node {
                pdo::push_node(node, bus, &mut self.who);
            }
            return pdo::push_words(pdo, &mut self.what);
        }
        let words = words(event, bus);
        (self.kind, self.tone) = (words.kind, words.tone);
        self.who.extend_from_slice(words.who.as_bytes());
        self.what.extend_from_slice(words.what.as_bytes());
    }
}

/// The columns of an event that is no PDO.
struct Words {
    who: String,
    kind: &'static str,
    what: String,
    tone: Tone,
}

/// Bytes of data shown in a line.
pub(super) const SHOWN_BYTES: usize = 16;

fn words(event: &Event, bus: &Bus) -> Words {
    let who = event.node.map_or(String::new(), |node| node_label(node, bus));
    let words = |kind, what: String, tone| Words { who: who.clone(), kind, what, tone };
    match &event.kind {
        EventKind::NmtCommand { service, target, from, to } => {
            let to_whom = if *target == 0 { "all".to_owned() } else { node_short(*target, bus) };
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
        EventKind::BootUp { cause } => {
            let expected = matches!(cause, BootCause::Commanded { .. });
            words("BOOT", boot_up(*cause), if expected { Tone::Good } else { Tone::Caution })
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
            let state =
                state.map_or_else(|| format!("undefined state {code:02X}"), |state| state.name().into());
            let error = if *toggle_error { ", toggle bit did not alternate" } else { "" };
            let tone = if *toggle_error { Tone::Caution } else { Tone::Quiet };
            words("GUARD", format!("reply: {state}, toggle {}{error}", u8::from(*toggle)), tone)
        }
        EventKind::NodeLost(silence) => words("LOST", lost(silence), Tone::Bad),
        EventKind::NodeBack(silence) => {
            words("BACK", format!("heard again after {} s", seconds(silence.gap)), Tone::Good)
        }
        EventKind::Emcy(emergency) => emcy(emergency, words),
        EventKind::SdoTransfer(transfer) => sdo(transfer, event, bus),
        EventKind::Lss { command, from_master, content } => {
            let who = if *from_master { "LSS master" } else { "LSS slave" };
            Words { who: who.into(), kind: "LSS", what: lss(*command, content), tone: Tone::Plain }
        }
        EventKind::NodeIdChange { from, to, by } => {
            let from = from.map_or_else(String::new, |from| format!("{from} → "));
            words("ID", format!("node-ID {from}{to} in force, set by {by}"), Tone::Caution)
        }
        EventKind::ObjectChange(change) => {
            let from = change.from.as_deref().map_or("?".into(), bytes);
            words("OBJ", format!("{} {from} → {}", change.object, bytes(&change.to)), Tone::Quiet)
        }
        _ => bus_words(event, words),
    }
}

/// Kinds that are about bus and capture rather than a node.
fn bus_words(event: &Event, words: impl Fn(&'static str, String, Tone) -> Words) -> Words {
    match &event.kind {
        EventKind::Sync { counter, expected } => {
            let counter = counter.map_or(String::new(), |counter| format!(" counter {counter}"));
            match expected {
                Some(expected) => words("SYNC", format!("SYNC{counter}, expected {expected}"), Tone::Caution),
                None => words("SYNC", format!("SYNC{counter}"), Tone::Quiet),
            }
        }
        EventKind::Time { milliseconds, days } => {
            words("TIME", time_of_day(*milliseconds, *days), Tone::Plain)
        }
        EventKind::CanError(error) => {
            let mut what = can_error_text(*error);
            if error.transmit_errors != 0 || error.receive_errors != 0 {
                let _ = write!(what, ", counters tx {} rx {}", error.transmit_errors, error.receive_errors);
            }
            words("ERROR", what, Tone::Bad)
        }
        EventKind::Frame(undecoded) => words("FRAME", frame(undecoded), Tone::Quiet),
        EventKind::Malformed { error, reason } => {
            let what = format!(
                "{reason}: {} of {} bytes there from byte {}",
                error.available, error.needed, error.offset
            );
            let what = if error.needed == 0 { (*reason).to_owned() } else { what };
            words("BAD", what, Tone::Caution)
        }
        EventKind::Evicted { what, count } => {
            words("LIMIT", format!("{count} × {what} given up: limit reached"), Tone::Caution)
        }
        EventKind::ClockStep { step } => words(
            "CLOCK",
            format!("time stamps went back by {} s", seconds(step.saturating_neg())),
            Tone::Caution,
        ),
        EventKind::BusSilent { gap } => words(
            "SILENT",
            format!("no frame at all for {} s; deadlines within it do not count", seconds(*gap)),
            Tone::Caution,
        ),
        EventKind::LostFrames { count } => {
            let count = count.map_or("some".into(), |count| count.to_string());
            words("DROP", format!("the recorder lost {count} frames"), Tone::Bad)
        }
        EventKind::Unreadable { line, offset, reason } => {
            let place = match (line, offset) {
                (Some(line), _) => format!("line {line}: "),
                (None, Some(offset)) => format!("byte {offset}: "),
                (None, None) => String::new(),
            };
            words("UNREAD", format!("{place}{reason}"), Tone::Caution)
        }
        EventKind::Note { text } => words("NOTE", text.clone(), Tone::Caution),
        _ => words("", event.kind.name().into(), Tone::Plain),
    }
}

fn frame(undecoded: &Undecoded) -> String {
    let frame = &undecoded.frame;
    let name = undecoded.name.map_or(String::new(), |name| format!(" ({name})"));
    let remote = if frame.flags.contains(FrameFlags::REMOTE) { " remote" } else { "" };
    let fd = if frame.flags.contains(FrameFlags::FD) { " FD" } else { "" };
    format!("{}{fd}{remote} [{}] {}{name}", frame.id, frame.length, bytes(frame.data()))
}

/// `32/20 boom`.
fn node_label(node: u8, bus: &Bus) -> String {
    let name = bus.node(node).and_then(|node| node.name());
    format!("{node}/{node:02X}{}{}", if name.is_some() { " " } else { "" }, name.unwrap_or(""))
}

/// `32 boom`.
fn node_short(node: u8, bus: &Bus) -> String {
    let name = bus.node(node).and_then(|node| node.name());
    format!("{node}{}{}", if name.is_some() { " " } else { "" }, name.unwrap_or(""))
}

/// Appends ` {118}`, ` {118-121}`.
pub(super) fn push_frames(frames: FrameRange, out: &mut Vec<u8>) {
    if frames.last == 0 {
        return;
    }
    out.extend_from_slice(b" {");
    push_decimal(out, frames.first);
    if frames.first != frames.last {
        out.push(b'-');
        push_decimal(out, frames.last);
    }
    out.push(b'}');
}

fn boot_up(cause: BootCause) -> String {
    let sign = match cause {
        BootCause::Commanded { frame } => return format!("boot-up, reset was commanded {{{frame}}}"),
        BootCause::PresumedPowerOn { sign } => sign,
    };
    let why = match sign {
        None => "power-on or self-reset",
        Some(PowerSign::OtherNodesToo) => "power-on, other nodes booted too",
        Some(PowerSign::BusWasSilent) => "power-on, the bus was silent before",
    };
    format!("boot-up, no NMT reset before → {why}")
}

fn state(change: &StateChange) -> String {
    let to = change.to.name();
    let by = match change.cause {
        StateCause::Command => "NMT command",
        StateCause::BootUp => "boot-up",
        StateCause::Heartbeat => "heartbeat",
        StateCause::GuardReply => "guarding reply",
        StateCause::Pdo => "its PDO",
        StateCause::LifeGuard => "EMCY 8130",
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

fn emcy(emergency: &Emergency, words: impl Fn(&'static str, String, Tone) -> Words) -> Words {
    let register = emergency.register.unwrap_or(0);
    let Some(code) = emergency.code else {
        return words("READY", "empty EMCY message = started without error".into(), Tone::Good);
    };
    match emergency.action {
        EmcyAction::NoErrorAtBoot => {
            return words("EMCY", "0000 no error, sent at boot: no recovery".into(), Tone::Plain);
        }
        EmcyAction::AllCleared => return words("EMCY", "0000 no error left".into(), Tone::Good),
        EmcyAction::Cleared => {
            return words(
                "EMCY",
                format!("0000 an error went, register still {}", register_words(register)),
                Tone::Caution,
            );
        }
        EmcyAction::Raised | EmcyAction::Ready => {}
    }
    let text = profile::emcy_codes().find(u32::from(code)).map_or("no CiA 301 code", |entry| &entry.text);
    let mut what = format!("{code:04X} {text}");
    if emergency.register.is_some() {
        let _ = write!(what, ", register {}", register_words(register));
    }
    let vendor = emergency.vendor.get(..usize::from(emergency.vendor_length)).unwrap_or_default();
    if vendor.iter().any(|byte| *byte != 0) {
        let _ = write!(what, ", vendor {}", bytes(vendor));
    }
    if emergency.active > 1 {
        let _ = write!(what, ", {} active", emergency.active);
    }
    words("EMCY", what, Tone::Bad)
}

fn register_words(register: u8) -> String {
    let names: Vec<_> = profile::error_register().names(u32::from(register)).collect();
    if names.is_empty() {
        format!("{register:02X}")
    } else {
        format!("{register:02X} ({})", names.join(", "))
    }
}

fn sdo(transfer: &SdoTransfer, event: &Event, bus: &Bus) -> Words {
    let server = event.node.map_or(String::new(), |node| node_short(node, bus));
    let client = transfer.client.map_or("client".to_owned(), |client| node_short(client, bus));
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
            if let Some(entry) = profile::communication_objects().find(object) {
                let _ = write!(what, " {}", entry.name());
            }
        }
        None => what.push_str("object not seen"),
    }
    let transferred =
        transfer.outcome == Outcome::Complete || transfer.direction == Some(Direction::Download);
    if transferred && transfer.size > 0 {
        what.push_str(&value(transfer));
    }
    let tone = outcome(transfer, &mut what);
    Words { who: format!("{client}→{server}"), kind, what, tone }
}

/// ` = 500 ms → 1000 ms`.
fn value(transfer: &SdoTransfer) -> String {
    let entry = transfer.object.and_then(|object| profile::communication_objects().find(object));
    let show = |data: &[u8]| match entry {
        Some(entry) => match entry.decode(data) {
            Value::Bytes(data) => unknown(&data),
            known => entry.show(&known),
        },
        None => unknown(data),
    };
    let changed = transfer.direction == Some(Direction::Download);
    let previous =
        transfer.previous.as_deref().filter(|previous| changed && *previous != transfer.data.as_slice());
    let before = previous.map_or(String::new(), |previous| format!("{} → ", show(previous)));
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

fn outcome(transfer: &SdoTransfer, what: &mut String) -> Tone {
    let tone = match (transfer.outcome, transfer.abort) {
        (Outcome::Aborted, Some(abort)) => {
            let by = if abort.by_client { "ABORTED by client" } else { "REFUSED" };
            let _ = write!(what, " {by} {:08X}: {}", abort.code, profile::abort_codes().text(abort.code));
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
            what.push_str(" given up: another one began");
            Tone::Caution
        }
        (Outcome::Unfinished, _) => {
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
    tone
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

fn bytes(data: &[u8]) -> String {
    let shown = data.get(..SHOWN_BYTES).unwrap_or(data);
    let mut text = Value::Bytes(shown.to_vec()).to_string();
    if shown.len() < data.len() {
        text.push_str(" …");
    }
    text
}

fn millis(nanoseconds: i64) -> String {
    let micros = nanoseconds.unsigned_abs() / 1_000;
    format!("{}.{}", micros / 1_000, micros % 1_000 / 100)
}

fn seconds(nanoseconds: i64) -> String {
    let millis = nanoseconds.unsigned_abs() / 1_000_000;
    format!("{}.{:03}", millis / 1_000, millis % 1_000)
}
