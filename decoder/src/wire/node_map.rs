//! Tables by node-ID or address, found without a search.

use super::{NODE_PLACES, NodeId};

/// Set of nodes.
#[derive(Debug, Clone)]
pub(crate) struct NodeSet {
    places: [bool; NODE_PLACES],
    count: usize,
}

impl Default for NodeSet {
    fn default() -> Self {
        Self { places: [false; NODE_PLACES], count: 0 }
    }
}

impl NodeSet {
    /// Adds a node; returns whether it is new.
    pub fn insert(&mut self, node: NodeId) -> bool {
        let is_new =
            self.places.get_mut(node.table_place()).is_some_and(|known| !std::mem::replace(known, true));
        self.count += usize::from(is_new);
        is_new
    }

    /// Removes a node; returns whether it was in the set.
    pub fn remove(&mut self, node: NodeId) -> bool {
        let was_in = self.places.get_mut(node.table_place()).is_some_and(std::mem::take);
        self.count -= usize::from(was_in);
        was_in
    }

    /// Whether the set is empty.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Whether the set contains a node.
    pub fn contains(&self, node: NodeId) -> bool {
        self.places.get(node.table_place()).copied().unwrap_or(false)
    }
}

/// Map by node.
#[derive(Debug, Clone)]
pub(crate) struct NodeMap<T>(Vec<Option<T>>);

impl<T> Default for NodeMap<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Default> NodeMap<T> {
    /// Entry of a node, created if missing; None for an invalid node-ID.
    #[inline]
    pub fn entry(&mut self, node: NodeId) -> Option<&mut T> {
        let place = node.table_place();
        if !matches!(self.0.get(place), Some(Some(_))) {
            self.add_entry(place);
        }
        self.0.get_mut(place)?.as_mut()
    }

    #[cold]
    fn add_entry(&mut self, place: usize) {
        if place >= NODE_PLACES {
            return;
        }
        if self.0.len() <= place {
            self.0.resize_with(place + 1, || None);
        }
        if let Some(free) = self.0.get_mut(place) {
            *free = Some(T::default());
        }
    }
}

impl<T> NodeMap<T> {
    /// Entry of a node.
    pub fn get(&self, node: NodeId) -> Option<&T> {
        self.0.get(node.table_place())?.as_ref()
    }

    /// Sets the entry of a node.
    #[inline]
    pub fn insert(&mut self, node: NodeId, value: T) {
        let place = node.table_place();
        if place < NODE_PLACES {
            if self.0.len() <= place {
                self.0.resize_with(place + 1, || None);
            }
            if let Some(slot) = self.0.get_mut(place) {
                *slot = Some(value);
            }
        }
    }

    /// Mutable entry of a node.
    pub fn get_mut(&mut self, node: NodeId) -> Option<&mut T> {
        self.0.get_mut(node.table_place())?.as_mut()
    }

    /// Removes and returns the entry of a node.
    #[inline]
    pub fn remove(&mut self, node: NodeId) -> Option<T> {
        self.0.get_mut(node.table_place())?.take()
    }

    /// All entries.
    pub fn iter(&self) -> impl Iterator<Item = (NodeId, &T)> {
        self.0
            .iter()
            .enumerate()
            .filter_map(|(place, value)| Some((NodeId::of_place(place)?, value.as_ref()?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_kept_apart() {
        let mut set = NodeSet::default();
        assert!(set.insert(NodeId::Canopen(5)) && !set.insert(NodeId::Canopen(5)));
        assert!(!set.contains(NodeId::J1939(5)) && set.remove(NodeId::Canopen(5)));
        assert!(!set.insert(NodeId::J1939(254)));
        let mut map = NodeMap::<u32>::default();
        *map.entry(NodeId::J1939(0x80)).unwrap() += 3;
        assert_eq!((map.get(NodeId::J1939(0x80)), map.get(NodeId::Canopen(1))), (Some(&3), None));
        assert_eq!(map.iter().collect::<Vec<_>>(), [(NodeId::J1939(0x80), &3)]);
        assert!(map.entry(NodeId::Canopen(0)).is_none());
    }
}
