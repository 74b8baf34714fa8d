//! What there is to say of the selected row, below the table.

use std::fmt::Write as _;

use cobscope_decoder::event::{BootCause, Effective, StateCause};
use cobscope_decoder::profile::Carrier;
use cobscope_decoder::replay::Code;
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::ObjectAddress;
use ratatui::text::{Line as Text, Span};

use super::line::{age, period};
use super::node::Subject;
use crate::app::Core;
use crate::theme::Role;

/// Lines about a node: what it is, what is wrong, what it sends.
pub fn of_node(core: &Core, subject: &Subject<'_>, channel: Option<u8>) -> Vec<Text<'static>> {
    let mut lines = vec![(identity(subject), Role::Text)];
    lines.extend(errors(subject).into_iter().map(|text| (text, Role::Bad)));
    lines.extend(way_out(subject, channel).map(|text| (text, Role::Caution)));
    lines.extend(not_acting(subject, channel).map(|text| (text, Role::Caution)));
    lines.extend(start(core, subject).map(|text| (text, Role::Text)));
    lines.extend(identifiers(subject).map(|text| (text, Role::Quiet)));
    let styled = |(text, role): (String, Role)| {
        let text = escape(&text).into_owned();
        Text::from(Span::styled(text, core.theme.style(role)))
    };
    lines.into_iter().map(styled).collect()
}

/// `node 32/20 boom · PVEA (danfoss-pve-ci:pvea, by option) · vendor 1234, product 5, serial 6`.
fn identity(subject: &Subject<'_>) -> String {
    let node = subject.node;
    let mut text = node.id().words();
    if let Some(name) = node.name() {
        let _ = write!(text, " {name}");
    }
    match (node.device_title(), node.device_id(), node.assigned()) {
        (Some(title), Some(id), Some(by)) => {
            let _ = write!(text, " · {title} ({id}, by {})", by.name());
        }
        _ => {
            let _ = write!(text, " · no profile: --node {}=PROFILE", node.id());
        }
    }
    for (sub, name) in [(1, "vendor"), (2, "product"), (4, "serial")] {
        if let Some(number) = node.store().number(ObjectAddress::new(0x1018, sub)) {
            let _ = write!(text, ", {name} {number:X}h");
        }
    }
    if let Some(name) = node.j1939_name() {
        let _ = write!(text, " · NAME {:016X}", name.0);
    }
    text
}

/// Each active error with its text.
fn errors(subject: &Subject<'_>) -> Vec<String> {
    let node = subject.node;
    let past = |code| subject.past(subject.latest.and_then(|latest| latest.raised(code)));
    let ago = |code| past(code).map_or_else(String::new, |past| format!(", {} ago", age(past)));
    let codes = node
        .active_errors()
        .iter()
        .map(|code| format!("EMCY {code:04X} {}{}", node.device().error_text(*code), ago(Code::Emcy(*code))));
    let dtcs = node.active_dtcs().map(|(spn, fmi)| {
        let text = node.device().dtc(spn, fmi).map_or("", |dtc| dtc.text.as_str());
        format!("SPN {spn} FMI {fmi} {text}{}", ago(Code::Dtc(spn, fmi)))
    });
    codes.chain(dtcs).collect()
}

/// Out of a fault.
fn way_out(subject: &Subject<'_>, channel: Option<u8>) -> Option<String> {
    let node = subject.node;
    let machines = node.device().machines.iter().enumerate();
    let mut own = machines.filter(|(_, machine)| channel.is_none() || machine.channel == channel);
    own.find_map(|(place, machine)| {
        let (state, way) = (node.reported_state(place)?, node.way_out(place)?);
        let since = subject.latest.and_then(|latest| latest.state_since(machine.channel));
        let since = subject.past(since).map_or_else(String::new, |past| format!(" for {}", age(past)));
        let control =
            node.control_word(place).map_or_else(String::new, |word| format!("; control is {word:02X}"));
        Some(format!("{}{since}: {way}{control}", state.name))
    })
}

/// Closed gates in one line; all of them are behind Enter.
fn not_acting(subject: &Subject<'_>, channel: Option<u8>) -> Option<String> {
    let points: Vec<_> = subject.node.set_points().collect();
    let mut points = points.iter().filter(|point| channel.is_none() || point.meaning.channel == channel);
    let point = points.find(|point| point.effective != Effective::Yes)?;
    let gates = point.gates.join(", ");
    Some(match point.effective {
        Effective::No => {
            format!("{} does not act, needs {gates}; enter on Eff shows all gates", point.meaning.name)
        }
        _ => {
            format!("whether {} acts is not known: {gates}; enter on Eff shows all gates", point.meaning.name)
        }
    })
}

/// NMT state and starts.
fn start(core: &Core, subject: &Subject<'_>) -> Option<String> {
    let mut text = String::new();
    if let Some(nmt) = subject.node.nmt() {
        let by = match nmt.cause {
            StateCause::Command => "commanded",
            StateCause::BootUp => "by boot-up",
            StateCause::Heartbeat => "by heartbeat",
            StateCause::GuardReply => "by guarding",
            StateCause::Pdo => "shown by a PDO",
            StateCause::LifeGuard => "by life guarding",
            StateCause::Emcy => "by an error",
        };
        let _ = write!(text, "{} {by} {{{}}}", nmt.state.name(), nmt.frame);
    }
    if let Some(start) = subject.latest.and_then(|latest| latest.start()) {
        let at = core.seconds(start.time).map_or_else(String::new, |time| format!(" at {time:.3} s"));
        let why = match start.cause {
            BootCause::Commanded { .. } => "commanded",
            BootCause::PresumedPowerOn { .. } => "power-on or of its own",
        };
        let separator = if text.is_empty() { "" } else { " · " };
        let _ = write!(
            text,
            "{separator}{} starts, the last{at} {{{}}}: {why}",
            subject.node.boots(),
            start.frame
        );
        if start.lost > 0 {
            let _ = write!(text, ", {} settings lost", start.lost);
        }
    }
    (!text.is_empty()).then_some(text)
}

/// `1A0 TPDO1 50.0 ms · 220 RPDO1 100.0 ms`.
fn identifiers(subject: &Subject<'_>) -> Option<String> {
    let words: Vec<_> = subject
        .rows
        .iter()
        .map(|row| {
            let mut text = row.id.to_string();
            if let Some(pdo) = row.pdo {
                let _ = write!(text, " {}", Carrier::Pdo(pdo));
            } else if let NodeId::Canopen(_) = subject.node.id() {
                let service = subject.bus.describe_id(row.id);
                let _ = write!(text, " {}", service.split(" of ").next().unwrap_or_default());
            }
            match row.intervals.mean().filter(|_| row.count > 3) {
                Some(mean) => {
                    let _ = write!(text, " {}", period(mean));
                }
                None => {
                    let _ = write!(text, " × {}", row.count);
                }
            }
            text
        })
        .collect();
    (!words.is_empty()).then(|| words.join(" · "))
}
