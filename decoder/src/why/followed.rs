//! PDOs by identifier: what a frame without an event can change in the report.

use super::cadence::{Beat, Rhythm};
use super::watch::NodeWatch;
use crate::frame::Timestamp;
use crate::profile::PdoName;
use crate::session::{Bus, Preview};
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
    fn of(bus: &Bus, identifier: usize) -> Self {
        match bus.pdo_at(identifier) {
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
    /// Times of the last frames with a time, if a node receives them.
    beat: Beat,
}

const UNKNOWN: FollowedIdentifier =
    FollowedIdentifier { version: None, role: PdoRole::None, beat: Beat::NONE };

/// Identifiers of a bus, by index.
#[derive(Debug, Clone, Default)]
pub(super) struct FollowedPdos(Vec<FollowedIdentifier>);

impl FollowedPdos {
    /// Counts a frame without an event; the meaning of its identifier, which has not changed since the last event.
    #[inline]
    pub(super) fn skip(&mut self, preview: &Preview) -> PdoRole {
        let Some(known) = self.0.get_mut(preview.identifier) else { return PdoRole::None };
        if let PdoRole::Received(..) = known.role {
            known.beat.add(preview.time, preview.frame);
        }
        known.role
    }

    /// Counts a PDO with an event; its node then has an entry.
    pub(super) fn add(
        &mut self,
        (identifier, time, frame): (usize, Option<Timestamp>, u64),
        bus: &Bus,
        nodes: &mut NodeMap<Box<NodeWatch>>,
    ) {
        let is_known =
            self.0.get(identifier).is_some_and(|known| known.version == Some(bus.version_of(identifier)));
        if !is_known {
            self.learn(identifier, bus, nodes);
        }
        if let Some(known) = self.0.get_mut(identifier)
            && let (PdoRole::Received(..), Some(time)) = (known.role, time)
        {
            known.beat.add(time, frame);
        }
    }

    /// Times of the last frames with an identifier.
    pub(super) fn beat(&self, identifier: usize) -> Option<Beat> {
        self.0.get(identifier).map(|known| known.beat)
    }

    #[cold]
    fn learn(&mut self, identifier: usize, bus: &Bus, nodes: &mut NodeMap<Box<NodeWatch>>) {
        if self.0.len() <= identifier {
            let Some(length) = identifier.checked_add(1) else { return };
            self.0.resize(length, UNKNOWN);
        }
        let role = PdoRole::of(bus, identifier);
        let known = self.0.get(identifier).copied().unwrap_or(UNKNOWN);
        let mut beat = known.beat;
        if role != known.role {
            if let PdoRole::Received(_, node) = known.role
                && let Some(node) = nodes.get_mut(node)
            {
                node.beats.release(identifier, beat);
            }
            beat = Beat::NONE;
            match role {
                PdoRole::Received(name, node) => {
                    if let Some(node) = nodes.entry(node) {
                        beat = node.beats.follow(Rhythm::Rpdo(name), identifier, |other| self.beat(other));
                    }
                }
                PdoRole::Sent(_, node) => {
                    nodes.entry(node);
                }
                PdoRole::None => {}
            }
        }
        if let Some(place) = self.0.get_mut(identifier) {
            *place = FollowedIdentifier { version: Some(bus.version_of(identifier)), role, beat };
        }
    }
}
