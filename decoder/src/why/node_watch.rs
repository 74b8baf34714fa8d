//! Data collected for one node.

use super::cadence::Beats;
use super::change::Changes;
use crate::event::SetPoint;
use crate::frame::Timestamp;
use crate::statistics::Reactions;

/// Maximum number of set points per node.
const POINTS: usize = 64;

/// Data collected for one node.
#[derive(Debug, Clone, Default)]
pub(super) struct NodeWatch {
    pub(super) changes: Changes,
    /// Time of the last NMT command to the node.
    pub(super) commanded: Option<Timestamp>,
    pub(super) was_operational: bool,
    pub(super) beats: Beats,
    pub(super) points: Vec<SetPoint>,
    /// Indices of the identifiers of its PDOs.
    pub(super) sent: Vec<usize>,
    pub(super) reactions: Reactions,
}

impl NodeWatch {
    /// Stores the last value of a set point.
    pub(super) fn remember(&mut self, point: &SetPoint) {
        let has_room = self.points.len() < POINTS;
        match self.points.iter_mut().find(|known| same(known, point)) {
            Some(known) => known.clone_from(point),
            None if has_room => self.points.push(point.clone()),
            None => {}
        }
    }
}

/// Whether two set points are of the same object, output and message.
pub(super) fn same(one: &SetPoint, other: &SetPoint) -> bool {
    (one.object, one.channel, &one.carrier) == (other.object, other.channel, &other.carrier)
}
