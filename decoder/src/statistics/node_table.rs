//! Statistics per node, found without a search.

use super::NodeStatistics;
use crate::wire::{NODE_PLACES, NodeId};

/// Statistics per node of one bus.
#[derive(Debug, Clone, Default)]
pub(super) struct NodeTable {
    /// In order of appearance.
    rows: Vec<(NodeId, NodeStatistics)>,
    /// Index + 1 in `rows` by [`NodeId::table_place`], 0 for none.
    places: Vec<u16>,
}

impl NodeTable {
    /// Statistics of a node, created if missing.
    #[inline]
    pub(super) fn entry(&mut self, node: NodeId) -> Option<&mut NodeStatistics> {
        let place = self.places.get(node.table_place()).copied().unwrap_or(0);
        let row = match usize::from(place).checked_sub(1) {
            Some(row) => row,
            None => self.add_node(node),
        };
        self.rows.get_mut(row).map(|(_, statistics)| statistics)
    }

    #[cold]
    fn add_node(&mut self, node: NodeId) -> usize {
        // Invalid numbers share the last place, so these nodes are found by search.
        if let Some(row) = self.rows.iter().position(|(known, _)| *known == node) {
            return row;
        }
        let row = self.rows.len();
        self.rows.push((node, NodeStatistics::default()));
        self.places.resize(NODE_PLACES, 0);
        if let (Some(place), Ok(number)) = (self.places.get_mut(node.table_place()), u16::try_from(row + 1)) {
            *place = number;
        }
        row
    }

    /// Statistics of a node.
    pub(super) fn get(&self, node: NodeId) -> Option<&NodeStatistics> {
        self.rows.iter().find(|(known, _)| *known == node).map(|(_, statistics)| statistics)
    }

    /// All nodes, in ascending order.
    pub(super) fn iter(&self) -> impl Iterator<Item = (NodeId, &NodeStatistics)> + use<'_> {
        let mut rows: Vec<_> = self.rows.iter().map(|(node, statistics)| (*node, statistics)).collect();
        rows.sort_by_key(|(node, _)| *node);
        rows.into_iter()
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut NodeStatistics> {
        self.rows.iter_mut().map(|(_, statistics)| statistics)
    }

    /// Removes the nodes for which `keeps` is false.
    pub(super) fn retain_nodes(&mut self, mut keeps: impl FnMut(NodeId, &NodeStatistics) -> bool) {
        let rows = std::mem::take(self).rows;
        for (node, statistics) in rows.into_iter().filter(|(node, statistics)| keeps(*node, statistics)) {
            if let Some(entry) = self.entry(node) {
                *entry = statistics;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_found_again_and_sorted() {
        let mut table = NodeTable::default();
        // Node-ID 0 and address 255 are not valid.
        let nodes = [NodeId::J1939(3), NodeId::Canopen(0), NodeId::Canopen(7), NodeId::J1939(255)];
        for _ in 0..2 {
            for node in nodes {
                table.entry(node).unwrap().boots += 1;
            }
        }
        let sorted = [NodeId::Canopen(0), NodeId::Canopen(7), NodeId::J1939(3), NodeId::J1939(255)];
        assert_eq!(
            table.iter().map(|(node, it)| (node, it.boots)).collect::<Vec<_>>(),
            sorted.map(|it| (it, 2))
        );
        table.retain_nodes(|node, _| node != NodeId::J1939(3));
        table.entry(NodeId::Canopen(7)).unwrap().boots += 5;
        assert_eq!(table.get(NodeId::Canopen(7)).unwrap().boots, 7);
        assert!(table.get(NodeId::J1939(3)).is_none());
        assert_eq!(table.iter().count(), 3);
    }
}
