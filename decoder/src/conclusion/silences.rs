//! Conclusions from silences of whole senders.

use super::failure::Conclusion;
use crate::finding::FindingSubject;
use crate::finding::phrase::format_interval;
use crate::observation::{NodeMoment, NodeMoments, Sender, SenderSilence, SenderStreams};
use crate::session::Bus;
use crate::wire::NodeId;
use crate::words::count_noun;

/// Time between a command and the end of the messages that it ends, in ns.
const COMMANDED: i64 = 1_000_000_000;

/// Time of a boot-up or an address claim before or after the return of the messages, in ns (SAE J1939-81 §4.2.2.3: 250 ms after
/// the claim).
const RETURNING: i64 = 2_000_000_000;

/// Senders that end one after the other within this time before the end of the capture are switched off, in ns.
const SWITCHED_OFF: i64 = 3_000_000_000;

/// Silence in ns after which a node that returns was rather switched off than disconnected.
const SWITCHED: i64 = 20_000_000_000;

/// Shortest silence of one node in ns that is no pause of its application.
const INTERRUPTED: i64 = 1_000_000_000;

/// Conclusions, with all silences that have a cause.
pub(super) struct SilentSenders {
    pub(super) conclusions: Vec<Conclusion>,
    pub(super) silences: Vec<SenderSilence>,
}

/// How a sender came back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SenderReturn {
    Never,
    Restarted,
    Continued,
}

pub(super) fn conclude_silences(
    bus: &Bus,
    senders: &[SenderStreams],
    mut silences: Vec<SenderSilence>,
    moments: &NodeMoments,
) -> SilentSenders {
    let nodes: Vec<NodeId> = senders.iter().filter_map(|sender| sender.sender.node()).collect();
    silences.extend(restarts(bus, senders, &silences, moments));
    for silence in &mut silences {
        silence.is_certain |= return_of(bus, silence, moments) == SenderReturn::Restarted;
    }
    silences.sort_by_key(|silence| silence.last);
    let all = silences.clone();
    let mut conclusions = Vec::new();
    if is_switched_off(senders, &silences, bus.now()) {
        silences.retain(|silence| silence.until.is_some());
    }
    silences.retain(|silence| {
        let until = silence.until.map_or(silence.latest, |until| until.0);
        !is_explained(bus, silence, moments) && !moments.is_machine_start(bus.index(), &nodes, until)
    });
    for moment in group_moments(bus, &silences, moments) {
        let moment = without_followers(senders, moment);
        if witnesses(senders, &all, &moment, bus.now()) > 0 {
            conclusions.extend(conclude_moment(bus, &moment, moments));
        }
    }
    SilentSenders { conclusions, silences: all }
}

/// Whether most senders end near the end of the capture, one after the other: the machine is switched off.
fn is_switched_off(senders: &[SenderStreams], silences: &[SenderSilence], end: i64) -> bool {
    let last: Vec<_> = silences.iter().filter(|silence| silence.until.is_none()).collect();
    let (first, latest) = (last.iter().map(|it| it.last.0).min(), last.iter().map(|it| it.latest).max());
    let is_staggered = first.zip(latest).is_some_and(|(first, latest)| {
        latest.saturating_sub(first) <= SWITCHED_OFF && end.saturating_sub(latest) <= SWITCHED_OFF
    });
    senders.len() >= 3 && last.len() * 2 > senders.len() && is_staggered
}

/// Whether an NMT command ended the messages of a sender, or the recorder reports lost frames in the silence.
fn is_explained(bus: &Bus, silence: &SenderSilence, moments: &NodeMoments) -> bool {
    let node = silence.sender.node();
    // The controller ends its messages before or after its command.
    let after = if node.is_none() { COMMANDED } else { 0 };
    let from = silence.last.0.saturating_sub(COMMANDED);
    let commanded = (from, silence.latest.saturating_add(after));
    let until = silence.until.map_or(silence.latest, |until| until.0);
    // A node that claims another address continues there (SAE J1939-81 §4.4).
    let moves = (silence.last.0, silence.latest.saturating_add(RETURNING));
    let is_moved = silence.until.is_none()
        && node.is_some_and(|node| node.j1939().is_some())
        && moments
            .restarts(bus.index())
            .any(|(of, at)| Some(of) != node && (moves.0..=moves.1).contains(&at.0));
    is_moved
        || moments.has_moment(NodeMoment::SwitchOff, (bus.index(), node), commanded)
        || node.is_none() && moments.is_common_stop(bus.index(), commanded)
        || [NodeMoment::LostFrames, NodeMoment::BusSilent].into_iter().any(|what| {
            moments.has_moment(what, (bus.index(), None), (from, until.saturating_add(COMMANDED)))
        })
}

/// Restarts of nodes that were shorter than a silence: an address claim without a request, a boot-up.
fn restarts(
    bus: &Bus,
    senders: &[SenderStreams],
    silences: &[SenderSilence],
    moments: &NodeMoments,
) -> Vec<SenderSilence> {
    let mut all: Vec<SenderSilence> = Vec::new();
    for (node, (time, frame)) in moments.restarts(bus.index()) {
        let own = senders.iter().find(|sender| sender.sender.node() == Some(node));
        let period = own.and_then(|sender| {
            let known = sender.streams.iter().filter(|each| each.stream.times.0 < time);
            known.map(|each| each.period).min()
        });
        let is_known = |silence: &SenderSilence| {
            silence.sender.node() == Some(node)
                && silence.last.0 <= time
                && silence.until.is_none_or(|until| until.0.saturating_add(RETURNING) >= time)
        };
        let requested = (time.saturating_sub(RETURNING), time);
        // Two claims in a row settle a conflict (SAE J1939-81 §4.4.3).
        let around = (time.saturating_sub(RETURNING), time.saturating_add(RETURNING));
        let claims = moments
            .restarts(bus.index())
            .filter(|(of, at)| *of == node && (around.0..=around.1).contains(&at.0));
        let is_conflict = node.j1939().is_some() && claims.count() > 1;
        let is_requested = moments.has_moment(NodeMoment::ClaimRequest, (bus.index(), None), requested);
        if let Some(period) = period
            && !is_requested
            && !is_conflict
            && !silences.iter().chain(&all).any(is_known)
        {
            let sender = Sender::Node(node);
            let last = (time.saturating_sub(1), frame);
            all.push(SenderSilence {
                sender,
                last,
                latest: time,
                until: Some((time, frame)),
                streams: 0,
                period,
                is_certain: true,
            });
        }
    }
    all
}

/// Silences of one moment: their beginnings overlap, or all of them end with a restart at one time. In order of time.
fn group_moments(bus: &Bus, silences: &[SenderSilence], moments: &NodeMoments) -> Vec<Vec<SenderSilence>> {
    let mut groups: Vec<Vec<SenderSilence>> = Vec::new();
    let is_restart = |silence: &SenderSilence| return_of(bus, silence, moments) == SenderReturn::Restarted;
    let restarts_with = |one: &SenderSilence, other: &SenderSilence| {
        let ends = one.until.zip(other.until);
        ends.is_some_and(|(one, other)| (one.0 - other.0).abs() <= RETURNING)
            && is_restart(one)
            && is_restart(other)
    };
    for silence in silences.iter().filter(|silence| silence.is_certain) {
        let known = groups.iter_mut().find(|group| {
            group.iter().any(|member| member.matches(silence) || restarts_with(member, silence))
        });
        match known {
            Some(group) if group.iter().any(|member| member.sender == silence.sender) => {}
            Some(group) => group.push(*silence),
            None => groups.push(vec![*silence]),
        }
    }
    for silence in silences.iter().filter(|silence| !silence.is_certain) {
        let known = groups.iter_mut().find(|group| {
            group.iter().any(|member| member.matches(silence))
                && group.iter().all(|member| member.sender != silence.sender)
        });
        if let Some(group) = known {
            group.push(*silence);
        }
    }
    groups
}

/// A moment without nodes that only answer the controller, if the controller is silent, too: they have no heartbeat of their own.
fn without_followers(senders: &[SenderStreams], moment: Vec<SenderSilence>) -> Vec<SenderSilence> {
    let has_controller = moment.iter().any(|silence| silence.sender == Sender::Controller);
    let has_heartbeat = |silence: &SenderSilence| {
        let own = senders.iter().find(|sender| sender.sender == silence.sender);
        own.is_some_and(SenderStreams::has_heartbeat)
    };
    let is_kept = |silence: &SenderSilence| {
        !has_controller || silence.sender == Sender::Controller || has_heartbeat(silence)
    };
    moment.into_iter().filter(is_kept).collect()
}

/// Number of senders that send in the middle of a moment's silences: else the whole machine was off.
fn witnesses(senders: &[SenderStreams], all: &[SenderSilence], moment: &[SenderSilence], end: i64) -> usize {
    let Some(first) = moment.first() else { return 0 };
    let over = moment.iter().map(|silence| silence.until.map_or(end, |until| until.0)).min().unwrap_or(end);
    let middle = i64::midpoint(first.last.0, over);
    let is_silent = |sender: Sender| {
        all.iter().any(|silence| {
            silence.sender == sender
                && silence.is_certain
                && silence.last.0 <= middle
                && silence.until.is_none_or(|until| until.0 >= middle)
        })
    };
    senders.iter().filter(|sender| sender.last.0 > middle && !is_silent(sender.sender)).count()
}

fn return_of(bus: &Bus, silence: &SenderSilence, moments: &NodeMoments) -> SenderReturn {
    let Some((until, _)) = silence.until else { return SenderReturn::Never };
    let range = (silence.last.0.saturating_add(1), until.saturating_add(RETURNING));
    match silence.sender.node() {
        Some(node) if moments.has_moment(NodeMoment::Restart, (bus.index(), Some(node)), range) => {
            SenderReturn::Restarted
        }
        _ => SenderReturn::Continued,
    }
}

fn conclude_moment(bus: &Bus, moment: &[SenderSilence], moments: &NodeMoments) -> Option<Conclusion> {
    let first = moment.first()?;
    let mut nodes: Vec<NodeId> = moment.iter().filter_map(|silence| silence.sender.node()).collect();
    nodes.sort_unstable();
    let returns: Vec<SenderReturn> = moment.iter().map(|silence| return_of(bus, silence, moments)).collect();
    let has = |what| returns.contains(&what);
    let is_controller = moment.iter().any(|silence| silence.sender == Sender::Controller);
    let hypothesis = match nodes.len() {
        // One message may end for its own reason.
        0 | 1 if moment.len() == 1 && first.streams < 2 && !has(SenderReturn::Restarted) => return None,
        0 if has(SenderReturn::Never) => "controller-silent",
        0 => "controller-interrupted",
        1 if !is_controller && has(SenderReturn::Restarted) => "node-restarted",
        1 if !is_controller && has(SenderReturn::Continued) && first.duration() < INTERRUPTED => return None,
        1 if !is_controller && has(SenderReturn::Continued) => "node-interrupted",
        1 if !is_controller && is_bus_off(bus, first, moments) => "node-bus-off",
        1 if !is_controller => "node-silent",
        _ if has(SenderReturn::Restarted) => "nodes-restarted",
        _ if has(SenderReturn::Continued) => "nodes-interrupted",
        _ => "nodes-silent",
    };
    let until = moment.iter().map(|silence| silence.until).collect::<Option<Vec<_>>>();
    let ended = until.and_then(|until| until.into_iter().max());
    Some(Conclusion {
        hypothesis,
        node: nodes.first().copied().filter(|_| nodes.len() == 1 && !is_controller),
        about: FindingSubject::Whole,
        text: moment_text(moment, &returns),
        began: first.last,
        is_note: hypothesis == "node-interrupted" && first.duration() > SWITCHED,
        ended,
        nodes,
    })
}

/// Time between the last error frame and the last frame of a node that goes bus-off, in ns.
const BUS_OFF: i64 = 200_000_000;

/// Error frames of a node on its way to bus-off: its transmit error counter grows by 8 up to 256 (ISO 11898-1 §12.1.4).
const BUS_OFF_ERRORS: u64 = 16;

/// Whether a burst of error frames ends where the messages of a node end.
fn is_bus_off(bus: &Bus, silence: &SenderSilence, moments: &NodeMoments) -> bool {
    let (from, to) = (silence.last.0, silence.latest.max(silence.last.0.saturating_add(BUS_OFF)));
    moments.error_bursts(bus.index()).any(|burst| {
        burst.count >= BUS_OFF_ERRORS
            && burst.times.0 <= to
            && burst.times.1.saturating_add(BUS_OFF) >= from
            && burst.times.1 <= to.saturating_add(BUS_OFF)
    })
}

/// `no message between {120} and {340}, usual interval 20 ms`, `SA21, SA27 and SA31: no message after {120}`.
fn moment_text(moment: &[SenderSilence], returns: &[SenderReturn]) -> String {
    let Some(first) = moment.first() else { return String::new() };
    let who = |silence: &SenderSilence| match silence.sender {
        Sender::Controller => "controller".to_owned(),
        Sender::Node(node) => node.sentence_label(),
    };
    let after = |silence: &SenderSilence| match silence.until {
        Some((_, frame)) if silence.streams == 0 => format!("restart {{{frame}}}"),
        None => format!("no message after {{{}}}", silence.last.1),
        Some((_, frame)) => format!("no message between {{{}}} and {{{frame}}}", silence.last.1),
    };
    let restarted = returns.iter().filter(|it| **it == SenderReturn::Restarted).count();
    let then = match restarted {
        0 => String::new(),
        1 if moment.len() == 1 => ", then a restart".to_owned(),
        count => format!(", then {} without a command", count_noun(count, "restart")),
    };
    if moment.len() == 1 {
        let who = if first.sender == Sender::Controller { "controller: " } else { "" };
        let every = format_interval(first.period);
        if first.streams == 0 {
            return format!("restart {{{}}} without a command", first.last.1);
        }
        return format!("{who}{}, usually every {every}{then}", after(first));
    }
    let all: Vec<_> = moment.iter().map(|silence| format!("{} {}", who(silence), after(silence))).collect();
    format!("{} at the same moment{then}: {}", count_noun(moment.len(), "silent sender"), all.join(", "))
}
