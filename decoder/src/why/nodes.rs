//! Data per node, found by node-ID without a search.

use super::watch::NodeWatch;
use crate::wire::{NODE_PLACES, NodeId};

/// Data of the nodes of one bus.
#[derive(Debug, Clone, Default)]
pub(super) struct NodeTable {
    /// Index + 1 in `nodes` by [`NodeId::place`], 0 for none; empty before the first node.
    places: Vec<u16>,
    nodes: Vec<(NodeId, NodeWatch)>,
}

impl NodeTable {
    /// Data of a node, created if missing; `None` for a number that is not valid.
    #[inline]
    pub(super) fn of(&mut self, id: NodeId) -> Option<&mut NodeWatch> {
        let place = match self.places.get(id.place()) {
            Some(place) if *place > 0 => usize::from(*place),
            _ => self.add(id)?,
        };
        self.nodes.get_mut(place.checked_sub(1)?).map(|(_, node)| node)
    }

    #[cold]
    fn add(&mut self, id: NodeId) -> Option<usize> {
        self.places.resize(NODE_PLACES, 0);
        let place = self.places.get_mut(id.place())?;
        self.nodes.push((id, NodeWatch::default()));
        *place = u16::try_from(self.nodes.len()).ok()?;
        Some(self.nodes.len())
    }

    /// Data of a node with events.
    pub(super) fn get(&self, id: NodeId) -> Option<&NodeWatch> {
        let place = usize::from(*self.places.get(id.place())?);
        self.nodes.get(place.checked_sub(1)?).map(|(_, node)| node)
    }

    /// All nodes in order of their node-IDs.
    pub(super) fn iter(&self) -> impl Iterator<Item = (NodeId, &NodeWatch)> {
        let known = self.places.iter().filter_map(|place| usize::from(*place).checked_sub(1));
        known.filter_map(|place| self.nodes.get(place)).map(|(id, node)| (*id, node))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_in_order_of_their_numbers() {
        let mut nodes = NodeTable::default();
        for id in [9, 3, 9, 127] {
            assert!(nodes.of(NodeId::Canopen(id)).is_some());
        }
        assert!(nodes.of(NodeId::J1939(0)).is_some());
        assert!(nodes.of(NodeId::Canopen(200)).is_none());
        let ids: Vec<_> = nodes.iter().map(|(id, _)| id).collect();
        assert_eq!(
            ids,
            [3, 9, 127].map(NodeId::Canopen).into_iter().chain([NodeId::J1939(0)]).collect::<Vec<_>>()
        );
        assert!(nodes.get(NodeId::Canopen(3)).is_some() && nodes.get(NodeId::Canopen(4)).is_none());
    }
}
