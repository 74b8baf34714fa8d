//! Text of device events.

use std::fmt::Write as _;

use super::LineTone;
use super::parts::{LineContent, format_bytes, format_millis};
use crate::event::{
    BitsChanged, ChangeOrigin, DeviceCause, DeviceState, EffectiveState, ModeChange, NodeIdentified,
    ObjectChange, ProcedureEvent, ProcedurePhase, SetPoint, SourceConflict,
};
use crate::figures::format_seconds;
use crate::profile::DecodedValue;
use crate::profile::device::ProcedureStatus;
use crate::wire::NodeId;

pub(super) fn identified_line(node: &NodeIdentified, id: Option<NodeId>) -> LineContent {
    let id = id.map_or(String::new(), |id| id.to_string());
    let what = format!(
        "identified as {} by its {}; --node {id}={} applies from the first frame",
        node.title,
        node.by.name().replace('-', " "),
        node.device
    );
    ("IDENT", what, LineTone::Good)
}

/// Prefix `c1 ` for devices with several channels.
fn channel_prefix(channel: Option<u8>) -> String {
    channel.map_or(String::new(), |channel| format!("c{channel} "))
}

pub(super) fn state_line(state: &DeviceState) -> LineContent {
    let from = state.from.as_deref().unwrap_or("?");
    let mut what = format!("{}{from} → {}", channel_prefix(state.channel), state.to);
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
    ("STATE", what, if state.fault { LineTone::Bad } else { LineTone::Plain })
}

pub(super) fn bits_line(bits: &BitsChanged) -> LineContent {
    (
        "STAT",
        format!("{}{}: {}", channel_prefix(bits.channel), bits.name, bits.words.join(", ")),
        LineTone::Plain,
    )
}

pub(super) fn set_point(point: &SetPoint) -> LineContent {
    let name = point.short.as_deref().unwrap_or(&point.signal);
    let assumed = if point.assumed { "?" } else { "" };
    // A short name such as c1 already identifies the channel.
    let channel = channel_prefix(point.channel);
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
        EffectiveState::Yes => {
            what.push_str("effective");
            if !point.invisible.is_empty() {
                let _ = write!(what, ", as far as visible: {} not on the bus", point.invisible.join(", "));
            }
            LineTone::Plain
        }
        EffectiveState::No => {
            let _ = write!(what, "NOT effective: needs {gates}");
            LineTone::Caution
        }
        EffectiveState::Unknown => {
            // Without gates the effect of a set point cannot be evaluated.
            let why = if gates.is_empty() { "no gates in the profile" } else { &gates };
            let _ = write!(what, "effective: unknown ({why})");
            LineTone::Plain
        }
    };
    if let Some(after) = point.sync_after {
        let _ = write!(what, ", at SYNC +{} ms", format_millis(after));
    }
    ("SETPT", what, tone)
}

pub(super) fn mode_line(mode: &ModeChange) -> LineContent {
    let from = mode.from.as_deref().map_or(String::new(), |from| format!("{from} → "));
    let consequence =
        if mode.consequence.is_empty() { String::new() } else { format!(" → {}", mode.consequence) };
    let what = format!("{}{} = {from}{}{consequence}", channel_prefix(mode.channel), mode.object, mode.to);
    ("MODE", what, LineTone::Plain)
}

/// KIND column of a procedure; PROC for words defined by profiles.
fn procedure_word(word: Option<&str>) -> &'static str {
    const WORDS: [&str; 8] = ["CALIB", "STORE", "RESTORE", "SWITCH", "M/S", "IDENT", "RATE", "RESET"];
    WORDS.iter().find(|known| Some(**known) == word).unwrap_or(&"PROC")
}

pub(super) fn procedure_line(event: &ProcedureEvent) -> LineContent {
    let mut what = format!("{} {}", event.procedure, event.phase.name());
    if event.phase == ProcedurePhase::Finished {
        let _ = write!(what, ": {}", event.status.name());
    }
    let is_start = event.phase == ProcedurePhase::Started;
    if let Some(duration) = event.duration.filter(|_| !is_start) {
        let _ = write!(what, " after {} s", format_seconds(duration));
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
        ProcedureStatus::Error => LineTone::Bad,
        ProcedureStatus::Stopped | ProcedureStatus::Busy => LineTone::Caution,
        ProcedureStatus::Ok => LineTone::Good,
        ProcedureStatus::Running | ProcedureStatus::Ended => LineTone::Plain,
    };
    (procedure_word(event.word.as_deref()), what, tone)
}

pub(super) fn conflict_line(conflict: &SourceConflict) -> LineContent {
    let values: Vec<_> = conflict
        .sources
        .iter()
        .map(|(source, data)| format!("{source} {}", DecodedValue::Bytes(data.clone())))
        .collect();
    let what = format!("{} {}: {}; {}", conflict.object, conflict.name, values.join(", "), conflict.text);
    ("CONFLICT", what, LineTone::Caution)
}

pub(super) fn object_change(change: &ObjectChange) -> LineContent {
    let shown = |value: &Option<Vec<u8>>| value.as_deref().map_or("?".into(), format_bytes);
    let what = format!("{} {} → {}", change.object, shown(&change.from), shown(&change.to));
    match change.origin {
        ChangeOrigin::Restart => ("OBJ", format!("{what}, effective since the restart"), LineTone::Plain),
        ChangeOrigin::Reset => ("OBJ", format!("{what}, lost at the restart"), LineTone::Plain),
        ChangeOrigin::Download => ("OBJ", what, LineTone::Quiet),
    }
}
