//! PDOs by identifier: what a frame without an event can change in the report.

use super::cadence::{MessageRhythm, MessageTimes};
use super::node_watch::NodeWatch;
use crate::frame::Timestamp;
use crate::profile::PdoName;
use crate::session::{Bus, MessagePreview, SkippedTimes};
use crate::wire::{NodeId, NodeMap};

/// Meaning of an identifier for the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PdoRole {
    /// Not a PDO.
    None,
    /// PDO of a node.
    Sent(PdoName, NodeId),
    /// PDO to a node, whose times are followed.
    Received(PdoName, NodeId),
}

impl PdoRole {
    fn role_of(bus: &Bus, identifier: usize) -> Self {
        match bus.identifiers().pdo_at(identifier) {
            None => Self::None,
            Some((name, node)) if name.is_sent() => Self::Sent(name, node),
            Some((name, node)) => Self::Received(name, node),
        }
    }
}

/// An identifier of the bus.
#[derive(Debug, Clone, Copy)]
struct FollowedIdentifier {
    /// Number of the service for which `role` holds; `None` before the first frame.
    version: Option<u32>,
    role: PdoRole,
    /// Times of the last frames with a time, if a node receives them, without the last ones that had no event.
    beat: MessageTimes,
    /// Number of frames without an event that are in `beat`.
    seen: u64,
    /// Time in ns of the first changed contents since the last changed PDO to the node, if the node sends them. Later
    /// changes do not matter for [`crate::statistics::ReactionTimes`].
    changed: Option<i64>,
    /// Its number in [`crate::statistics::ReactionTimes::number_of_change`].
    number: Option<usize>,
}

const UNKNOWN: FollowedIdentifier = FollowedIdentifier {
    version: None,
    role: PdoRole::None,
    beat: MessageTimes::NONE,
    seen: 0,
    changed: None,
    number: None,
};

/// Identifiers of a bus, by index.
#[derive(Debug, Clone, Default)]
pub(super) struct FollowedPdos(Vec<FollowedIdentifier>);

impl FollowedPdos {
    /// Counts a frame without an event; the meaning of its identifier has not changed since the last event.
    #[inline]
    pub(super) fn skip_frame(&mut self, preview: &MessagePreview, nodes: &mut NodeMap<Box<NodeWatch>>) {
        let Some(known) = self.0.get_mut(preview.identifier) else { return };
        match known.role {
            PdoRole::None => {}
            PdoRole::Sent(..) => {
                if preview.change != 0 && known.changed.is_none() {
                    known.changed = Some(preview.time.0);
                }
            }
            PdoRole::Received(..) => {
                if preview.change != 0 {
                    self.note_reaction(preview.identifier, (preview.time, preview.frame), nodes);
                }
            }
        }
    }

    /// Counts changed contents of a PDO with an event.
    pub(super) fn count_change(
        &mut self,
        identifier: usize,
        (time, frame): (Timestamp, u64),
        nodes: &mut NodeMap<Box<NodeWatch>>,
    ) {
        let Some(known) = self.0.get_mut(identifier) else { return };
        match known.role {
            PdoRole::None => {}
            PdoRole::Sent(..) => {
                known.changed.get_or_insert(time.0);
            }
            PdoRole::Received(..) => self.note_reaction(identifier, (time, frame), nodes),
        }
    }

    /// Changed contents of a PDO to a node: the reaction to the PDOs that changed before.
    #[inline(never)]
    fn note_reaction(
        &mut self,
        identifier: usize,
        (time, frame): (Timestamp, u64),
        nodes: &mut NodeMap<Box<NodeWatch>>,
    ) {
        let Some(PdoRole::Received(pdo, id)) = self.0.get(identifier).map(|known| known.role) else { return };
        self.pass_on(id, nodes);
        if let Some(node) = nodes.get_mut(id) {
            node.reactions.change_rpdo(pdo, time.0, frame);
        }
    }

    /// Passes changed contents of the PDOs of a node to its reaction times, in order of time.
    #[inline]
    pub(super) fn pass_on(&mut self, id: NodeId, nodes: &mut NodeMap<Box<NodeWatch>>) {
        let Some(node) = nodes.get_mut(id) else { return };
        let NodeWatch { sent, reactions, .. } = &mut **node;
        // The order matters only for PDOs that have not changed before.
        let mut new = Vec::new();
        for place in sent {
            let Some(known) = self.0.get_mut(*place) else { continue };
            let (PdoRole::Sent(pdo, _), Some(time)) = (known.role, known.changed.take()) else { continue };
            if known.number.is_none() {
                known.number = reactions.number_of_change(pdo);
            }
            match known.number {
                Some(number) => reactions.changed_again(number, time),
                None => new.push((time, pdo)),
            }
        }
        if !new.is_empty() {
            new.sort_unstable();
            for (time, pdo) in new {
                reactions.change_tpdo(pdo, time);
            }
        }
    }

    /// Counts a PDO with an event; its node then has an entry.
    pub(super) fn count_pdo(
        &mut self,
        (identifier, time, frame): (usize, Option<Timestamp>, u64),
        bus: &Bus,
        nodes: &mut NodeMap<Box<NodeWatch>>,
    ) {
        let is_known = self
            .0
            .get(identifier)
            .is_some_and(|known| known.version == Some(bus.identifiers().version_of(identifier)));
        if !is_known {
            self.learn_identifier(identifier, bus, nodes);
        }
        let current = self.message_times(identifier, bus);
        if let (Some(known), Some((beat, seen))) = (self.0.get_mut(identifier), current)
            && let PdoRole::Received(..) = known.role
        {
            (known.beat, known.seen) = (beat, seen);
            if let Some(time) = time {
                known.beat.add_message(time, frame);
            }
        }
    }

    /// Times of the last frames with an identifier, and the number of those without an event.
    pub(super) fn message_times(&self, identifier: usize, bus: &Bus) -> Option<(MessageTimes, u64)> {
        let known = self.0.get(identifier)?;
        let mut beat = known.beat;
        let Some(skipped) = bus.identifiers().skipped_times(identifier) else {
            return Some((beat, known.seen));
        };
        for (time, frame) in skipped.times_after(known.seen) {
            beat.add_message(time, frame);
        }
        Some((beat, skipped.skipped_count()))
    }

    #[cold]
    fn learn_identifier(&mut self, identifier: usize, bus: &Bus, nodes: &mut NodeMap<Box<NodeWatch>>) {
        if self.0.len() <= identifier {
            let Some(length) = identifier.checked_add(1) else { return };
            self.0.resize(length, UNKNOWN);
        }
        let role = PdoRole::role_of(bus, identifier);
        let mut known = self.0.get(identifier).copied().unwrap_or(UNKNOWN);
        let count = bus.identifiers().skipped_times(identifier).map_or(0, SkippedTimes::skipped_count);
        if known.version.is_none() {
            known.seen = count;
        }
        let (mut beat, mut seen) = (known.beat, known.seen);
        if role != known.role {
            known.beat = self.message_times(identifier, bus).map_or(MessageTimes::NONE, |(beat, _)| beat);
            self.release_identifier(identifier, known, nodes);
            seen = count;
            beat = MessageTimes::NONE;
            match role {
                PdoRole::Received(name, node) => {
                    if let Some(node) = nodes.entry(node) {
                        beat = node.beats.take_times(MessageRhythm::Rpdo(name), identifier, |other| {
                            self.message_times(other, bus).map(|(beat, _)| beat)
                        });
                    }
                }
                PdoRole::Sent(_, node) => {
                    if let Some(node) = nodes.entry(node) {
                        node.sent.push(identifier);
                    }
                }
                PdoRole::None => {}
            }
        }
        if let Some(place) = self.0.get_mut(identifier) {
            let version = Some(bus.identifiers().version_of(identifier));
            let number = place.number.filter(|_| role == place.role);
            *place = FollowedIdentifier { version, role, beat, seen, changed: place.changed, number };
        }
    }

    /// Keeps what is known of an identifier that is another PDO from now on.
    fn release_identifier(
        &mut self,
        identifier: usize,
        known: FollowedIdentifier,
        nodes: &mut NodeMap<Box<NodeWatch>>,
    ) {
        match known.role {
            PdoRole::None => {}
            PdoRole::Received(_, node) => {
                if let Some(node) = nodes.get_mut(node) {
                    node.beats.keep_times(identifier, known.beat);
                }
            }
            PdoRole::Sent(_, node) => {
                self.pass_on(node, nodes);
                if let Some(node) = nodes.get_mut(node) {
                    node.sent.retain(|sent| *sent != identifier);
                }
            }
        }
    }
}
