//! Conclusions about NMT commands: a second master, and nodes that are never started.

use super::failure::Conclusion;
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::observation::{LastTransfer, NodeMoment, NodeMoments, Sender, SenderStreams};
use crate::session::{Bus, BusStream, Node, StreamService};
use crate::wire::canopen::{NmtState, ObjectAddress};

/// Time for which set points continue after a command that makes them void, in ns: then their sender did not command it.
const CONTINUED: i64 = 2_000_000_000;

/// Time in ns for which a node waits, after which it is not started any more.
const WAITED: i64 = 5_000_000_000;

/// SDO requests of the predefined connection set (CiA 301 §7.3.3).
const SDO_REQUEST: u16 = 0x600;

pub(super) fn conclude_commands(
    bus: &Bus,
    senders: &[SenderStreams],
    moments: &NodeMoments,
) -> Vec<Conclusion> {
    let commanded: Vec<BusStream> =
        bus.streams().filter(|stream| stream.service == StreamService::ReceivedPdo).collect();
    let mut all: Vec<Conclusion> = second_master(bus, senders, &commanded, moments)
        .or_else(|| stopped_node(bus, moments))
        .into_iter()
        .collect();
    all.extend(bus.nodes().filter_map(|node| not_started(bus, node, &commanded, moments)));
    all
}

/// A command that ends operation while the set points of the controller continue.
fn second_master(
    bus: &Bus,
    senders: &[SenderStreams],
    commanded: &[BusStream],
    moments: &NodeMoments,
) -> Option<Conclusion> {
    let controller = senders.iter().find(|sender| sender.sender == Sender::Controller)?;
    moments.switch_offs(bus.index()).find_map(|(target, (time, frame))| {
        let is_meant = |stream: &&BusStream| target.is_none() || stream.node == target;
        // Set points without a longer pause, from well before to well after the command.
        let continues = |stream: &&BusStream| {
            let (first, last) = stream.times;
            let pauses = &stream.silences;
            first <= time.saturating_sub(CONTINUED)
                && last >= time.saturating_add(CONTINUED)
                && stream.count >= 20
                && !pauses.iter().any(|pause| {
                    pause.duration() > CONTINUED / 4
                        && pause.times.0 <= time.saturating_add(CONTINUED)
                        && pause.times.1 >= time
                })
        };
        let meant: Vec<_> = commanded.iter().filter(is_meant).collect();
        let is_ignored = !meant.is_empty() && meant.iter().all(continues);
        // The controller may start what it stopped.
        let range = (time, time.saturating_add(CONTINUED));
        let is_restarted = moments.has_moment(NodeMoment::Start, (bus.index(), target), range);
        let has_effect = [NodeMoment::LeftOperational, NodeMoment::Restart]
            .into_iter()
            .any(|what| moments.has_moment(what, (bus.index(), target), range));
        let is_over = controller.last.0 < time.saturating_add(CONTINUED);
        (is_ignored && has_effect && !is_restarted && !is_over).then(|| Conclusion {
            hypothesis: "second-master",
            node: None,
            nodes: target.into_iter().collect(),
            about: FindingSubject::Whole,
            text: format!("NMT command {{{frame}}} while the set points of the controller continue"),
            began: (time, frame),
            is_note: false,
            ended: None,
        })
    })
}

/// A single node that a command took out of operation, without a start after it, while the others work.
fn stopped_node(bus: &Bus, moments: &NodeMoments) -> Option<Conclusion> {
    let state = |node: &Node| node.nmt().map(|nmt| nmt.state);
    moments.switch_offs(bus.index()).find_map(|(target, (time, frame))| {
        let id = target?;
        let end = bus.now();
        let waits = end.saturating_sub(time) > WAITED;
        let is_stopped = bus.node(id).and_then(state).is_some_and(|state| state != NmtState::Operational);
        let was_operational = moments.has_moment(
            NodeMoment::LeftOperational,
            (bus.index(), target),
            (time, time.saturating_add(CONTINUED)),
        );
        let is_started = moments.has_moment(NodeMoment::Start, (bus.index(), target), (time, end));
        let heard = bus.node(id).and_then(|node| node.last_seen().1).map_or(time, |last| bus.monotonic(last));
        let waits = waits && heard.saturating_sub(time) > CONTINUED;
        let others = bus.nodes().filter(|node| node.id() != id);
        let others_work = others.filter(|node| state(node) == Some(NmtState::Operational)).count() > 0;
        (waits && is_stopped && was_operational && !is_started && others_work).then(|| Conclusion {
            hypothesis: "second-master",
            node: target,
            nodes: vec![id],
            about: FindingSubject::Whole,
            text: format!(
                "NMT command {{{frame}}} to this node, and no NMT start after it; other nodes work"
            ),
            began: (time, frame),
            is_note: true,
            ended: None,
        })
    })
}

/// A node that waits in pre-operational up to the end, although its controller asked it or sends to it.
fn not_started(bus: &Bus, node: &Node, commanded: &[BusStream], moments: &NodeMoments) -> Option<Conclusion> {
    let id = node.id();
    let number = id.canopen()?;
    let nmt = node.nmt().filter(|nmt| nmt.state == NmtState::PreOperational)?;
    let since = moments.restarts(bus.index()).filter(|(of, _)| *of == id).map(|(_, at)| at).last();
    let (start, frame) = since.unwrap_or((bus.now().saturating_sub(nmt_age(bus, node)), nmt.frame));
    let request = CanId::from_standard(SDO_REQUEST + u16::from(number));
    let is_addressed = bus.identifiers().find_slot(request).is_some()
        || commanded.iter().any(|stream| stream.node == Some(id));
    let end = bus.now();
    let has_started = moments.has_moment(NodeMoment::Start, (bus.index(), Some(id)), (start, end))
        || moments.has_moment(NodeMoment::SwitchOff, (bus.index(), Some(id)), (start.saturating_add(1), end))
        || moments.has_moment(NodeMoment::LeftOperational, (bus.index(), Some(id)), (start, end));
    let others = bus
        .nodes()
        .any(|other| other.id() != id && other.nmt().is_some_and(|nmt| nmt.state == NmtState::Operational));
    let last = moments.last_transfer(bus.index(), id);
    // A refused request is the cause, and has a rule of its own.
    if last.is_some_and(|last| !last.is_complete) {
        return None;
    }
    let idle = last.map_or(start, |last| last.at.0).max(start);
    let waits = end.saturating_sub(idle) > WAITED && !node.is_lost();
    if !is_addressed || has_started || !others || !waits {
        return None;
    }
    let asked = last.map_or_else(String::new, |last| format!("; {}", last_request(last)));
    // A controller that compares identities ends at the first difference.
    let is_identified = last.is_some_and(is_identification) && moments.is_identity_cut(bus.index(), id);
    Some(Conclusion {
        hypothesis: if is_identified { "not-accepted" } else { "not-started" },
        node: Some(id),
        nodes: vec![id],
        about: FindingSubject::Whole,
        text: format!("pre-operational up to the end, no NMT start after {{{frame}}}{asked}"),
        began: (idle, last.map_or(frame, |last| last.at.1.max(frame))),
        is_note: false,
        ended: None,
    })
}

/// Time in ns since the last evidence for the state of a node.
fn nmt_age(bus: &Bus, node: &Node) -> i64 {
    node.nmt().map_or(0, |nmt| bus.now().saturating_sub(nmt.since))
}

/// Whether a controller that compares identities read one last (CiA 302-2 §7: 1000, 1018 against 1F84 to 1F88).
fn is_identification(last: &LastTransfer) -> bool {
    let is_identity = |object: ObjectAddress| matches!(object.index, 0x1000 | 0x1018);
    last.is_upload && last.object.is_some_and(is_identity)
}

/// `last request of the controller: read of 1018:01 {31}`.
fn last_request(last: &LastTransfer) -> String {
    let what = if last.is_upload { "read" } else { "write" };
    let object = last.object.map_or_else(String::new, |object| format!(" of {object}"));
    format!("last request of the controller: {what}{object} {{{}}}", last.at.1)
}
