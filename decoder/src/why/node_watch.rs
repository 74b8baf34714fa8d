//! Data collected for one node.

use super::cadence::PeriodicMessages;
use super::change::RecentChanges;
use crate::event::SetPoint;
use crate::frame::Timestamp;
use crate::statistics::ReactionTimes;

/// Maximum number of set points per node.
const POINTS: usize = 64;

/// Data collected for one node.
#[derive(Debug, Clone, Default)]
pub(super) struct NodeWatch {
    pub(super) changes: RecentChanges,
    /// Time of the last NMT command to the node.
    pub(super) commanded: Option<Timestamp>,
    pub(super) was_operational: bool,
    pub(super) beats: PeriodicMessages,
    pub(super) points: Vec<SetPoint>,
    /// Indices of the identifiers of its PDOs.
    pub(super) sent: Vec<usize>,
    pub(super) reactions: ReactionTimes,
}

impl NodeWatch {
    /// Stores the last value of a set point.
    pub(super) fn remember_point(&mut self, point: &SetPoint) {
        let has_room = self.points.len() < POINTS;
        match self.points.iter_mut().find(|known| is_same_point(known, point)) {
            Some(known) => known.clone_from(point),
            None if has_room => self.points.push(point.clone()),
            None => {}
        }
    }
}

/// Whether two set points are of the same object, output and message.
pub(super) fn is_same_point(one: &SetPoint, other: &SetPoint) -> bool {
    (one.object, one.channel, &one.carrier) == (other.object, other.channel, &other.carrier)
}
