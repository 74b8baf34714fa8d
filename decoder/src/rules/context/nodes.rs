//! What rules remember by node: small tables, an entry a number a node can have.

use crate::wire::{NODE_PLACES, NodeId};

/// A set of nodes.
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
    /// Adds a node; whether it is new.
    pub fn insert(&mut self, node: NodeId) -> bool {
        let is_new = self.places.get_mut(node.place()).is_some_and(|known| !std::mem::replace(known, true));
        self.count += usize::from(is_new);
        is_new
    }

    /// Takes a node out; whether it was in.
    pub fn remove(&mut self, node: NodeId) -> bool {
        let was_in = self.places.get_mut(node.place()).is_some_and(std::mem::take);
        self.count -= usize::from(was_in);
        was_in
    }

    /// Whether none is in.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Whether a node is in.
    pub fn contains(&self, node: NodeId) -> bool {
        self.places.get(node.place()).copied().unwrap_or(false)
    }
}

/// Something of each node that was looked at.
#[derive(Debug, Clone)]
pub(crate) struct NodeMap<T>(Vec<Option<T>>);

impl<T> Default for NodeMap<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Default> NodeMap<T> {
    /// What is remembered of a node, made if new; `None` for a number no node can have.
    pub fn entry(&mut self, node: NodeId) -> Option<&mut T> {
        let place = Some(node.place()).filter(|place| *place < NODE_PLACES)?;
        if self.0.len() <= place {
            self.0.resize_with(place + 1, || None);
        }
        self.0.get_mut(place).map(|known| known.get_or_insert_with(T::default))
    }
}

impl<T> NodeMap<T> {
    /// What is remembered of a node.
    pub fn get(&self, node: NodeId) -> Option<&T> {
        self.0.get(node.place())?.as_ref()
    }

    /// Remembers something of a node instead of what was known.
    pub fn insert(&mut self, node: NodeId, value: T) {
        let place = node.place();
        if place < NODE_PLACES {
            if self.0.len() <= place {
                self.0.resize_with(place + 1, || None);
            }
            if let Some(slot) = self.0.get_mut(place) {
                *slot = Some(value);
            }
        }
    }

    /// The same, to change it.
    pub fn get_mut(&mut self, node: NodeId) -> Option<&mut T> {
        self.0.get_mut(node.place())?.as_mut()
    }

    /// Forgets a node; gives what was known.
    pub fn remove(&mut self, node: NodeId) -> Option<T> {
        self.0.get_mut(node.place())?.take()
    }

    /// All that are known.
    pub fn iter(&self) -> impl Iterator<Item = (NodeId, &T)> {
        NodeId::all().filter_map(|node| Some((node, self.get(node)?)))
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
