//! Details of the selected row, below the table.

use std::fmt::Write as _;

use cobscope_decoder::event::{BootCause, EffectiveState, StateCause};
use cobscope_decoder::frame::CanId;
use cobscope_decoder::profile::ValueCarrier;
use cobscope_decoder::replay::{ErrorCode, LatestOfNode, ReplayState};
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::IdentifierRow;
use cobscope_decoder::suggestion::suggest_profiles;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::ObjectAddress;
use cobscope_decoder::words::count_noun;
use ratatui::text::{Line as Text, Span};

use super::line::{NodeRowKey, format_age, format_period};
use super::node::ShownNode;
use crate::state::{DIFFERS, UiState, both_values};
use crate::theme::TextRole;

/// Maximum number of differences from the other capture.
const MOST_DIFFERENCES: usize = 4;

/// Lines about a node: identity, differences, errors, closed gates, boots, identifiers.
pub fn of_node(core: &UiState, subject: &ShownNode<'_>, channel: Option<u8>) -> Vec<Text<'static>> {
    let mut lines = vec![(identity_text(subject), TextRole::Text)];
    lines.extend(difference_texts(core, subject).into_iter().map(|text| (text, TextRole::Caution)));
    lines.extend(error_texts(subject).into_iter().map(|text| (text, TextRole::Bad)));
    lines.extend(way_out(subject, channel).map(|text| (text, TextRole::Caution)));
    lines.extend(not_acting(subject, channel).map(|text| (text, TextRole::Caution)));
    lines.extend(boot_text(core, subject).map(|text| (text, TextRole::Text)));
    lines.extend(identifier_text(subject).map(|text| (text, TextRole::Quiet)));
    let styled = |(text, role): (String, TextRole)| {
        let text = escape(&text).into_owned();
        Text::from(Span::styled(text, core.theme.role_style(role)))
    };
    lines.into_iter().map(styled).collect()
}

/// Differences from the other capture: `≠ NMT: pre-operational 11.8 s, good.log operational 4.2 s`.
fn difference_texts(core: &UiState, subject: &ShownNode<'_>) -> Vec<String> {
    let all = core.against.differences_of(core.bus_state(), (subject.bus.index(), subject.node.id()));
    let name = core.against.compared_name().unwrap_or_default();
    let shown = all.iter().take(MOST_DIFFERENCES);
    let mut lines: Vec<_> =
        shown.map(|difference| format!("{DIFFERS} {}", both_values(difference, name))).collect();
    if let Some(more) = all.len().checked_sub(MOST_DIFFERENCES).filter(|more| *more > 0) {
        lines.push(format!("{DIFFERS} and {} (cobscope diff)", count_noun(more, "further difference")));
    }
    lines
}

/// Lines about the master or an orphan identifier.
pub fn of_other(core: &UiState, key: NodeRowKey) -> Vec<Text<'static>> {
    let Some(world) = core.bus_state() else { return Vec::new() };
    let texts = match key {
        NodeRowKey::Master(bus) => {
            world.buses().iter().find(|it| it.index() == bus).map(|bus| master_lines(world, bus))
        }
        NodeRowKey::Orphan(bus, id) => {
            let bus = world.buses().iter().find(|it| it.index() == bus);
            bus.and_then(|bus| orphan_lines(world, bus, id))
        }
        NodeRowKey::Bus(_) | NodeRowKey::Node(..) => None,
    };
    let texts = texts.unwrap_or_default().into_iter();
    texts.map(|text| Text::styled(text, core.theme.role_style(TextRole::Text))).collect()
}

fn row_of<'a>(world: &'a ReplayState, bus: &Bus, id: CanId) -> Option<&'a IdentifierRow> {
    world.identifiers().rows().iter().find(|row| row.bus == bus.index() && row.id == id && !row.is_remote)
}

fn master_lines(world: &ReplayState, bus: &Bus) -> Vec<String> {
    let mut texts =
        vec!["sends NMT commands, SYNC and guarding requests; CAN frames do not identify it".to_owned()];
    if let Some(row) = row_of(world, bus, CanId::Standard(0)) {
        texts.push(format!("{} NMT commands, last {{{}}}", row.count, row.last_frame));
    }
    if let Some(row) = bus.last_sync().and_then(|id| row_of(world, bus, id)) {
        texts.push(format!("SYNC {}: {}", row.id, rhythm_text(row)));
    }
    let guarded: Vec<_> =
        bus.nodes().filter(|node| node.is_guarded()).map(|node| node.id().label()).collect();
    if !guarded.is_empty() {
        texts.push(format!("guards {}", guarded.join(", ")));
    }
    texts
}

/// Period, last bytes and predefined use of an identifier without a known node.
fn orphan_lines(world: &ReplayState, bus: &Bus, id: CanId) -> Option<Vec<String>> {
    let row = row_of(world, bus, id)?;
    let bytes: Vec<_> = row.payload().iter().take(8).map(|byte| format!("{byte:02X}")).collect();
    let mut texts =
        vec![format!("{id}: {}, last {{{}}} {}", rhythm_text(row), row.last_frame, bytes.join(" "))];
    if let Some((pdo, node)) = row.pdo.zip(row.node) {
        let node = node.sentence_label();
        texts.push(format!(
            "CiA 301 default COB-ID of {pdo} of {node}, which is not on the bus; assign it in the bus file"
        ));
    } else {
        texts.push("assign it in the bus file".into());
    }
    Some(texts)
}

#[expect(clippy::cast_precision_loss, reason = "shown with one decimal")]
fn to_milliseconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e6
}

/// `500 times, mean 20.0 ms, 19.4 to 20.6 ms`.
fn rhythm_text(row: &IdentifierRow) -> String {
    let intervals = &row.intervals;
    match (intervals.mean(), intervals.shortest(), intervals.longest()) {
        (Some(mean), Some(shortest), Some((longest, _))) => {
            let all = [mean, shortest, longest].map(|it| format!("{:.1}", to_milliseconds(it)));
            let [mean, shortest, longest] = all;
            format!("{}, mean {mean} ms, {shortest} to {longest} ms", count_noun(row.count, "time"))
        }
        _ => count_noun(row.count, "time"),
    }
}

/// `node 32/20 boom · PVEA (danfoss-pve-ci:pvea, by option) · vendor 1234, product 5, serial 6`.
fn identity_text(subject: &ShownNode<'_>) -> String {
    let node = subject.node;
    let mut text = node.id().sentence_label();
    if let Some(name) = node.name() {
        let _ = write!(text, " {name}");
    }
    let assigned = node.device_title().zip(node.device_id()).zip(node.assigned_by());
    if let Some(((title, id), by)) = assigned {
        let _ = write!(text, " · {title} ({id}, by {})", by.name());
    } else {
        let suggested = suggest_profiles(subject.bus, subject.bus.catalogue(), Some(node.id()));
        let _ = match suggested.iter().find(|one| !one.is_weak).or(suggested.first()) {
            Some(one) => write!(text, " · no profile; behaves like {}: a assigns {}", one.title, one.profile),
            None => write!(text, " · no profile: --node {}=PROFILE", node.id()),
        };
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

/// Active errors with their texts.
fn error_texts(subject: &ShownNode<'_>) -> Vec<String> {
    let node = subject.node;
    let past = |code| subject.time_ago(subject.latest.and_then(|latest| latest.raised_at(code)));
    let ago = |code| past(code).map_or_else(String::new, |past| format!(", {} ago", format_age(past)));
    let codes = node.active_errors().iter().map(|code| {
        format!("EMCY {code:04X} {}{}", node.device().error_text(*code), ago(ErrorCode::Emcy(*code)))
    });
    let dtcs = node.active_dtcs().map(|(spn, fmi)| {
        let text = node.device().trouble_code_entry(spn, fmi).map_or("", |dtc| dtc.text.as_str());
        format!("SPN {spn} FMI {fmi} {text}{}", ago(ErrorCode::Dtc(spn, fmi)))
    });
    codes.chain(dtcs).collect()
}

/// Steps that leave the fault state.
fn way_out(subject: &ShownNode<'_>, channel: Option<u8>) -> Option<String> {
    let node = subject.node;
    let machines = node.device().machines.iter().enumerate();
    let mut own = machines.filter(|(_, machine)| channel.is_none() || machine.channel == channel);
    own.find_map(|(place, machine)| {
        let (state, way) = (node.reported_state(place)?, node.way_out(place)?);
        let since = subject.latest.and_then(|latest| latest.state_since(machine.channel));
        let since =
            subject.time_ago(since).map_or_else(String::new, |past| format!(" for {}", format_age(past)));
        let control =
            node.control_word(place).map_or_else(String::new, |word| format!("; control is {word:02X}"));
        Some(format!("{}{since}: {way}{control}", state.name))
    })
}

/// Closed gates in one line; Enter lists all gates.
fn not_acting(subject: &ShownNode<'_>, channel: Option<u8>) -> Option<String> {
    let points: Vec<_> = subject.node.set_points().collect();
    let mut points = points.iter().filter(|point| channel.is_none() || point.meaning.channel == channel);
    let point = points.find(|point| point.effective != EffectiveState::Yes)?;
    let gates = point.gates.join(", ");
    Some(match point.effective {
        EffectiveState::No => {
            format!("{} not effective, needs {gates}; Enter on Eff shows all gates", point.meaning.name)
        }
        _ => {
            format!("{} effective: unknown ({gates}); Enter on Eff shows all gates", point.meaning.name)
        }
    })
}

/// NMT state, number of boots and the last one.
fn boot_text(core: &UiState, subject: &ShownNode<'_>) -> Option<String> {
    let mut text = String::new();
    if let Some(nmt) = subject.node.nmt() {
        let by = match nmt.cause {
            StateCause::Command => "commanded",
            StateCause::BootUp => "by boot-up",
            StateCause::Heartbeat => "by heartbeat",
            StateCause::GuardReply => "by guarding",
            StateCause::Pdo => "by PDO",
            StateCause::LifeGuard => "by life guarding",
            StateCause::Emcy => "by EMCY",
            StateCause::BusFile { .. } => "by the bus file",
        };
        let frame = if nmt.frame == 0 { String::new() } else { format!(" {{{}}}", nmt.frame) };
        let _ = write!(text, "{} {by}{frame}", nmt.state.name());
    }
    if let Some(start) = subject.latest.and_then(LatestOfNode::last_boot) {
        let at = core.time_words(start.time, 3).map_or_else(String::new, |time| format!(" at {time}"));
        let why = match start.cause {
            BootCause::Commanded { .. } => "commanded",
            BootCause::PresumedPowerOn { .. } => "power cycle or self-reset",
        };
        let separator = if text.is_empty() { "" } else { " · " };
        let _ = write!(
            text,
            "{separator}{}, last{at} {{{}}}: {why}",
            count_noun(subject.node.boot_count(), "boot"),
            start.frame
        );
        if start.lost > 0 {
            let _ = write!(text, ", {} lost", count_noun(start.lost, "setting"));
        }
    }
    (!text.is_empty()).then_some(text)
}

/// `1A0 TPDO1 50.0 ms · 220 RPDO1 100.0 ms`.
fn identifier_text(subject: &ShownNode<'_>) -> Option<String> {
    let words: Vec<_> = subject
        .rows
        .iter()
        .map(|row| {
            let mut text = row.id.to_string();
            if let Some(pdo) = row.pdo {
                let _ = write!(text, " {}", ValueCarrier::Pdo(pdo));
            } else if let NodeId::Canopen(_) = subject.node.id() {
                let service = subject.bus.describe_id(row.id);
                let _ = write!(text, " {}", service.split(" of ").next().unwrap_or_default());
            }
            match row.intervals.mean().filter(|_| row.count > 3) {
                Some(mean) => {
                    let _ = write!(text, " {}", format_period(mean));
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
