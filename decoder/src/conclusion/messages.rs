//! Conclusions about single messages of senders that continue.

use super::failure::Conclusion;
use crate::finding::FindingSubject;
use crate::finding::phrase::format_interval;
use crate::frame::CanId;
use crate::observation::{NodeMoment, NodeMoments, PeriodicStream, Sender, SenderSilence, SenderStreams};
use crate::session::{Bus, BusStream, Node, StreamService};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

/// Time around the end of a message in which a command or a restart explains it, in ns.
const EXPLAINED: i64 = 2_000_000_000;

/// Frames of a message that can end while its sender continues.
const STOPPED: u32 = 20;

/// Elements of a second sender that show it.
const SECOND: u32 = 10;

/// Windows of 32 frames that are a message sent far too often.
const BURST: u32 = 6;

/// Changes of a payload before it can freeze.
const CHANGED: u32 = 25;

/// Multiple of the longest time between two changes after which a payload is frozen.
const FROZEN: i64 = 8;

/// Shortest time that counts as frozen, in ns.
const FROZEN_TIME: i64 = 3_000_000_000;

/// Usual intervals after a change of the period that show it.
const SETTLED: u32 = 8;

/// What a search for single messages needs.
struct MessageScene<'a> {
    bus: &'a Bus,
    senders: &'a [SenderStreams],
    silences: &'a [SenderSilence],
    moments: &'a NodeMoments,
    end: i64,
}

pub(super) fn conclude_messages(
    bus: &Bus,
    senders: &[SenderStreams],
    silences: &[SenderSilence],
    moments: &NodeMoments,
) -> Vec<Conclusion> {
    let scene = MessageScene { bus, senders, silences, moments, end: bus.now() };
    let mut all = Vec::new();
    for sender in senders {
        all.extend(scene.stopped(sender));
        for each in &sender.streams {
            let changed = scene.slower(sender, each).or_else(|| scene.second_sender(sender, each));
            all.extend(
                changed.or_else(|| scene.frozen(sender, each)).or_else(|| scene.jumping(sender, each)),
            );
        }
        all.extend(sender.bursts.iter().filter_map(|stream| scene.babbling(sender.sender, stream)));
    }
    all
}

impl MessageScene<'_> {
    fn conclusion(
        &self,
        (hypothesis, text): (&'static str, String),
        sender: Sender,
        stream: &BusStream,
        began: (i64, u64),
    ) -> Conclusion {
        Conclusion {
            hypothesis,
            node: sender.node().or(stream.node.filter(|_| stream.service != StreamService::Sync)),
            nodes: sender.node().into_iter().collect(),
            about: message_subject(stream.id),
            text,
            began,
            is_note: false,
            ended: None,
        }
    }

    /// Whether a command, a restart or a silence of the sender explains what happened between two times.
    fn is_explained(&self, sender: Sender, from: i64, to: i64) -> bool {
        let range = (from.saturating_sub(EXPLAINED), to.saturating_add(EXPLAINED));
        let subject = (self.bus.index(), sender.node());
        let is_silent = |silence: &SenderSilence| {
            silence.sender == sender
                && silence.last.0 <= to
                && silence.until.is_none_or(|until| until.0 >= from)
        };
        let of_sender = [NodeMoment::SwitchOff, NodeMoment::Start, NodeMoment::Restart];
        let of_bus = [NodeMoment::LostFrames, NodeMoment::BusSilent];
        // A claim moves the addresses that messages go to.
        let is_moved = sender.node().is_some_and(|node| node.j1939().is_some())
            && self.moments.has_moment(NodeMoment::Restart, (self.bus.index(), None), range);
        is_moved
            || of_sender.into_iter().any(|what| self.moments.has_moment(what, subject, range))
            || of_bus.into_iter().any(|what| self.moments.has_moment(what, (self.bus.index(), None), range))
            || self.silences.iter().any(is_silent)
    }

    /// Messages that end while the sender continues: one of them, or all process data of a node.
    fn stopped(&self, sender: &SenderStreams) -> Option<Conclusion> {
        let has_ended = |each: &&PeriodicStream| each.is_missing_at(self.end);
        let is_last_silence = self.silences.iter().any(|it| it.sender == sender.sender && it.until.is_none());
        let ended: Vec<&PeriodicStream> = sender.streams.iter().filter(has_ended).collect();
        let first = ended.iter().min_by_key(|each| each.stream.times.1)?;
        let last = first.stream.times;
        if is_last_silence || self.is_explained(sender.sender, last.1, first.due()) {
            return None;
        }
        if first.stream.service == StreamService::Sync {
            let text = format!("SYNC ended after {{{}}}; its sender continues", first.stream.last_frame);
            return Some(self.conclusion(
                ("sync-stopped", text),
                sender.sender,
                &first.stream,
                (last.1, first.stream.last_frame),
            ));
        }
        if !self.is_expected(sender.sender, first) {
            return None;
        }
        let process_data: Vec<_> = sender
            .streams
            .iter()
            .filter(|each| each.stream.service == StreamService::TransmittedPdo)
            .collect();
        let is_all = process_data.len() >= 2 && process_data.iter().all(|each| each.is_missing_at(self.end));
        let began = (last.1, first.stream.last_frame);
        if is_all {
            let text = format!("all process data ended after {{{}}}; other messages continue", began.1);
            let all = self.conclusion(("application-stalled", text), sender.sender, &first.stream, began);
            return Some(Conclusion { about: FindingSubject::Whole, ..all });
        }
        let life = last.1.saturating_sub(last.0);
        if first.stream.count < STOPPED || life < EXPLAINED {
            return None;
        }
        let text = format!(
            "{} ended after {{{}}}, usually every {}; other messages of its sender continue",
            message_name(first.stream.id),
            began.1,
            format_interval(first.period)
        );
        Some(self.conclusion(("message-stopped", text), sender.sender, &first.stream, began))
    }

    /// Whether the node sends its messages all the time.
    fn is_expected(&self, sender: Sender, each: &PeriodicStream) -> bool {
        match (sender, each.stream.service) {
            (Sender::Node(node @ NodeId::Canopen(_)), StreamService::TransmittedPdo) => {
                let nmt = self.bus.node(node).and_then(|node| node.nmt()).map(|nmt| nmt.state);
                // A TPDO that follows SYNC ends with it.
                nmt == Some(NmtState::Operational) && !self.has_sync_ended()
            }
            (Sender::Node(NodeId::J1939(_)), StreamService::J1939Message) => true,
            _ => false,
        }
    }

    /// Whether SYNC has elements between its usual ones: the PDOs that follow it have them, too.
    fn is_sync_split(&self) -> bool {
        let mut streams = self.senders.iter().flat_map(|sender| &sender.streams);
        streams.any(|each| {
            let is_changed = each.stream.splits.0 > 0 || !each.stream.periods.is_empty();
            each.stream.service == StreamService::Sync && is_changed
        })
    }

    fn has_sync_ended(&self) -> bool {
        let streams = self.senders.iter().flat_map(|sender| &sender.streams);
        let mut syncs = streams.filter(|each| each.stream.service == StreamService::Sync);
        syncs.any(|sync| sync.is_missing_at(self.end))
    }

    /// A message whose period grew for good.
    fn slower(&self, sender: &SenderStreams, each: &PeriodicStream) -> Option<Conclusion> {
        let change = each.stream.periods.last()?;
        let is_slower = each.period > change.from.saturating_add(change.from / 2);
        let is_settled = each.stream.present_count >= SETTLED;
        if !is_slower || !is_settled || self.is_explained(sender.sender, change.time, change.time) {
            return None;
        }
        let text = format!(
            "{}: period {}, before {{{}}} {}",
            message_name(each.stream.id),
            format_interval(each.period),
            change.frame,
            format_interval(change.from)
        );
        Some(self.conclusion(
            ("message-slower", text),
            sender.sender,
            &each.stream,
            (change.time, change.frame),
        ))
    }

    /// A message with elements of a second sender.
    fn second_sender(&self, sender: &SenderStreams, each: &PeriodicStream) -> Option<Conclusion> {
        let (count, (time, frame)) = each.stream.splits;
        let is_guarded =
            || each.stream.node.and_then(|node| self.bus.node(node)).is_some_and(Node::is_guarded);
        let has_two_kinds = match each.stream.service {
            // A rule judges SYNC; requests and responses of guarding share an identifier.
            StreamService::Sync => true,
            StreamService::ErrorControl => is_guarded(),
            _ => false,
        };
        // From the first one on, half of the periods at least have one.
        let periods = each.stream.times.1.saturating_sub(time).checked_div(each.period).unwrap_or(0);
        if count < SECOND
            || i64::from(count).saturating_mul(2) < periods
            || has_two_kinds
            || self.is_sync_split()
        {
            return None;
        }
        let text = format!(
            "{}: {count} elements between those of the usual period of {}, from {{{frame}}} on",
            message_name(each.stream.id),
            format_interval(each.period)
        );
        Some(self.conclusion(("second-sender", text), sender.sender, &each.stream, (time, frame)))
    }

    /// A message that is sent far too often.
    fn babbling(&self, sender: Sender, stream: &BusStream) -> Option<Conclusion> {
        let burst = stream.burst;
        let begins_late = burst.mean > 0 || burst.began.0.saturating_sub(self.start()) > EXPLAINED;
        if burst.windows < BURST || !begins_late {
            return None;
        }
        let (duration, count) = (burst.ended.0.saturating_sub(burst.began.0), i64::from(burst.windows) * 32);
        let before = match burst.mean {
            0 => "none before".to_owned(),
            mean => format!("before one every {}", format_interval(mean)),
        };
        let text =
            format!("{}: {count} frames in {}, {before}", message_name(stream.id), format_interval(duration));
        let is_over = self.end.saturating_sub(burst.ended.0) > EXPLAINED / 4;
        let ended = is_over.then_some(burst.ended);
        Some(Conclusion { ended, ..self.conclusion(("babbling", text), sender, stream, burst.began) })
    }

    /// First frame of a periodic message, as a monotonic time.
    fn start(&self) -> i64 {
        let streams = self.senders.iter().flat_map(|sender| &sender.streams);
        streams.map(|each| each.stream.times.0).min().unwrap_or(self.end)
    }

    /// A value that jumps to another value in single frames.
    fn jumping(&self, sender: &SenderStreams, each: &PeriodicStream) -> Option<Conclusion> {
        let jumps = each.stream.jumps.filter(|_| is_measured(&each.stream))?;
        let text = format!(
            "{}: a value jumps in {} single frames from {{{}}} on, byte {} to {:02X}h",
            message_name(each.stream.id),
            jumps.count,
            jumps.first.1,
            jumps.byte,
            jumps.target
        );
        Some(self.conclusion(("value-jumps", text), sender.sender, &each.stream, jumps.first))
    }

    /// A message whose payload changed all the time and no longer does.
    fn frozen(&self, sender: &SenderStreams, each: &PeriodicStream) -> Option<Conclusion> {
        let frozen = frozen_for(each)?;
        // The others of the machine change as before: else it stands still.
        let others = self.senders.iter().flat_map(|sender| &sender.streams);
        let changing = || {
            others
                .clone()
                .filter(|other| other.stream.id != each.stream.id && other.stream.changes.count >= CHANGED)
        };
        let still = changing()
            .filter(|other| other.stream.changes.last < each.stream.changes.last.saturating_add(frozen / 2))
            .count();
        let total = changing().count();
        let is_alone = total >= 2 && still * 2 < total;
        if !is_alone
            || !is_measured(&each.stream)
            || self.is_explained(sender.sender, each.stream.changes.last, each.stream.changes.last)
        {
            return None;
        }
        let changes = each.stream.changes;
        let text = format!(
            "{}: payload unchanged after {{{}}}, {} changes before it, at most {} apart",
            message_name(each.stream.id),
            changes.frame,
            changes.count,
            format_interval(changes.longest)
        );
        Some(self.conclusion(
            ("value-frozen", text),
            sender.sender,
            &each.stream,
            (changes.last, changes.frame),
        ))
    }
}

/// Service of values that a device measures.
fn is_measured(stream: &BusStream) -> bool {
    matches!(stream.service, StreamService::TransmittedPdo | StreamService::J1939Message)
}

/// Parameter groups of ISO 11783: a working set announces itself (11783-7), messages of a virtual terminal (11783-6).
const WORKING_SET: u32 = 0xFE0D;
const FROM_TERMINAL: u32 = 0xE600;

/// A working set that announces itself where no virtual terminal is.
pub(super) fn absent_terminal(bus: &Bus) -> Option<Conclusion> {
    let group_of = |stream: &BusStream| match message_subject(stream.id) {
        FindingSubject::Pgn(pgn) if stream.service == StreamService::J1939Message => Some(pgn),
        _ => None,
    };
    let streams: Vec<BusStream> = bus.streams().collect();
    let set = streams.iter().find(|stream| group_of(stream) == Some(WORKING_SET))?;
    let (first, last) = set.times;
    let waits = bus.now().saturating_sub(last) > FROZEN_TIME;
    let has_terminal = streams.iter().any(|stream| group_of(stream) == Some(FROM_TERMINAL));
    (waits && !has_terminal).then(|| Conclusion {
        hypothesis: "terminal-absent",
        node: set.node,
        nodes: set.node.into_iter().collect(),
        about: FindingSubject::Whole,
        text: format!("working set announced {{{}}}, no message of a virtual terminal", set.last_frame),
        began: (first, set.last_frame),
        is_note: false,
        ended: None,
    })
}

/// Time in ns for which the payload of a message did not change up to its last frame, if it changed all the time before.
fn frozen_for(each: &PeriodicStream) -> Option<i64> {
    let changes = each.stream.changes;
    let time = each.stream.times.1.saturating_sub(changes.last);
    let limit = changes.longest.saturating_mul(FROZEN).max(FROZEN_TIME);
    (changes.count >= CHANGED && time > limit).then_some(time)
}

/// `PGN 61444`, `185`.
fn message_name(id: CanId) -> String {
    match message_subject(id) {
        FindingSubject::Pgn(pgn) => format!("PGN {pgn}"),
        _ => format!("message {id}"),
    }
}

fn message_subject(id: CanId) -> FindingSubject {
    match id {
        CanId::Standard(_) => FindingSubject::Id(id),
        CanId::Extended(raw) => {
            let pgn = raw >> 8 & 0x3_FFFF;
            // PDU1 has the destination in its low byte (SAE J1939-21 §5.2.2).
            FindingSubject::Pgn(if pgn >> 8 & 0xFF < 0xF0 { pgn & 0x3_FF00 } else { pgn })
        }
    }
}
