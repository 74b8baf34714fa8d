//! Text of device events.

use std::fmt::Write as _;

use super::Tone;
use super::parts::{LineContent, bytes, millis, seconds};
use crate::event::{
    BitsChanged, ChangeOrigin, Conflict, DeviceCause, DeviceState, Effective, ModeChange, NodeIdentified,
    ObjectChange, ProcedureEvent, ProcedurePhase, SetPoint,
};
use crate::profile::Value;
use crate::profile::device::ProcedureStatus;
use crate::wire::NodeId;

pub(super) fn identified(node: &NodeIdentified, id: Option<NodeId>) -> LineContent {
    let id = id.map_or(String::new(), |id| id.to_string());
    let what = format!(
        "identified as {} by its {}; --node {id}={} applies from the first frame",
        node.title,
        node.by.name().replace('-', " "),
        node.device
    );
    ("IDENT", what, Tone::Good)
}

/// Prefix `c1 ` for devices with several channels.
fn channel(channel: Option<u8>) -> String {
    channel.map_or(String::new(), |channel| format!("c{channel} "))
}

pub(super) fn state(state: &DeviceState) -> LineContent {
    let from = state.from.as_deref().unwrap_or("?");
    let mut what = format!("{}{from} → {}", channel(state.channel), state.to);
    let frame = if state.cause_frame == 0 { String::new() } else { format!(" {{{}}}", state.cause_frame) };
    let _ = match (state.cause, state.control, state.emcy) {
        (DeviceCause::ControlWord, Some(control), _) => write!(what, ", control {control:02X}{frame}"),
        (DeviceCause::Emcy, _, Some(code)) => write!(what, ", cause EMCY {code:04X}{frame}"),
        (DeviceCause::Dtc, ..) => write!(what, ", cause DM1 fault{frame}"),
        (DeviceCause::NmtCommand, ..) => write!(what, ", cause NMT command{frame}"),
        (DeviceCause::LifeGuard, ..) => write!(what, ", cause life guarding{frame}"),
        (DeviceCause::BootUp, ..) => write!(what, ", cause boot-up{frame}"),
        (DeviceCause::NotOnTheBus, ..) if state.from.is_none() => write!(what, ", first seen"),
        _ => write!(what, ", cause not on the bus (hardware enable, manufacturer's tool?)"),
    };
    if let Some(leave) = &state.leave {
        let _ = write!(what, "; to leave: {leave}");
    }
    if let Some(path) = &state.path {
        let frames: Vec<_> = path.frames.iter().map(u64::to_string).collect();
        let _ = write!(what, "; {}, {} × control", path.states.join(" → "), path.frames.len());
        if let Some(duration) = path.duration {
            let _ = write!(what, " in {} ms", duration / 1_000_000);
        }
        let _ = write!(what, " {{{}}}", frames.join(" "));
    }
    ("STATE", what, if state.fault { Tone::Bad } else { Tone::Plain })
}

pub(super) fn bits(bits: &BitsChanged) -> LineContent {
    ("STAT", format!("{}{}: {}", channel(bits.channel), bits.name, bits.words.join(", ")), Tone::Plain)
}

pub(super) fn set_point(point: &SetPoint) -> LineContent {
    let name = point.short.as_deref().unwrap_or(&point.signal);
    let assumed = if point.assumed { "?" } else { "" };
    // A short name such as c1 already identifies the channel.
    let channel = channel(point.channel);
    let channel = if channel.trim_end() == name { "" } else { &channel };
    let mut what = format!("{channel}{name} ");
    if let Some(from) = point.from.as_ref().filter(|from| from.text != point.to.text) {
        let both = point.from.as_ref().is_some_and(|from| from.number.is_some()) && point.to.number.is_some();
        let unit = format!(" {}", point.unit);
        let from = if both { from.text.strip_suffix(&unit).unwrap_or(&from.text) } else { &from.text };
        let _ = write!(what, "{from} → ");
    }
    let _ = write!(what, "{}{assumed} ", point.to.text);
    let gates = point.gates.join("; ");
    let tone = match point.effective {
        Effective::Yes => {
            what.push_str("effective");
            Tone::Plain
        }
        Effective::No => {
            let _ = write!(what, "NOT effective: needs {gates}");
            Tone::Caution
        }
        Effective::Unknown => {
            // Without gates the effect of a set point cannot be evaluated.
            let why = if gates.is_empty() { "no gates in the profile" } else { &gates };
            let _ = write!(what, "effective: unknown ({why})");
            Tone::Plain
        }
    };
    if let Some(after) = point.sync_after {
        let _ = write!(what, ", at SYNC +{} ms", millis(after));
    }
    ("SETPT", what, tone)
}

pub(super) fn mode(mode: &ModeChange) -> LineContent {
    let from = mode.from.as_deref().map_or(String::new(), |from| format!("{from} → "));
    let consequence =
        if mode.consequence.is_empty() { String::new() } else { format!(" → {}", mode.consequence) };
    let what = format!("{}{} = {from}{}{consequence}", channel(mode.channel), mode.object, mode.to);
    ("MODE", what, Tone::Plain)
}

/// KIND column of a procedure; PROC for words defined by profiles.
fn word(word: Option<&str>) -> &'static str {
    const WORDS: [&str; 8] = ["CALIB", "STORE", "RESTORE", "SWITCH", "M/S", "IDENT", "RATE", "RESET"];
    WORDS.iter().find(|known| Some(**known) == word).unwrap_or(&"PROC")
}

pub(super) fn procedure(event: &ProcedureEvent) -> LineContent {
    let mut what = format!("{} {}", event.procedure, event.phase.name());
    if event.phase == ProcedurePhase::Finished {
        let _ = write!(what, ": {}", event.status.name());
    }
    let is_start = event.phase == ProcedurePhase::Started;
    if let Some(duration) = event.duration.filter(|_| !is_start) {
        let _ = write!(what, " after {} s", seconds(duration));
    }
    if let Some(object) = event.object.filter(|_| is_start) {
        let _ = write!(what, " ({object})");
    }
    if let Some(nominal) = event.nominal.filter(|_| is_start) {
        let _ = write!(what, "; about {nominal} s");
    }
    if event.takes_over && is_start {
        what.push_str("; CAN set points ignored");
    }
    if !event.text.is_empty() {
        let _ = write!(what, "; {}", event.text);
    }
    let tone = match event.status {
        ProcedureStatus::Error => Tone::Bad,
        ProcedureStatus::Stopped | ProcedureStatus::Busy => Tone::Caution,
        ProcedureStatus::Ok => Tone::Good,
        ProcedureStatus::Running | ProcedureStatus::Ended => Tone::Plain,
    };
    (word(event.word.as_deref()), what, tone)
}

pub(super) fn conflict(conflict: &Conflict) -> LineContent {
    let values: Vec<_> = conflict
        .sources
        .iter()
        .map(|(source, data)| format!("{source} {}", Value::Bytes(data.clone())))
        .collect();
    let what = format!("{} {}: {}; {}", conflict.object, conflict.name, values.join(", "), conflict.text);
    ("CONFLICT", what, Tone::Caution)
}

pub(super) fn object_change(change: &ObjectChange) -> LineContent {
    let shown = |value: &Option<Vec<u8>>| value.as_deref().map_or("?".into(), bytes);
    let what = format!("{} {} → {}", change.object, shown(&change.from), shown(&change.to));
    match change.origin {
        ChangeOrigin::Restart => ("OBJ", format!("{what}, effective since the restart"), Tone::Plain),
        ChangeOrigin::Reset => ("OBJ", format!("{what}, lost at the restart"), Tone::Plain),
        ChangeOrigin::Download => ("OBJ", what, Tone::Quiet),
    }
}
