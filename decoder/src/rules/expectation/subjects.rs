//! Scope of an expectation: a bus as a whole, or each node on its own.

use crate::wire::{NodeId, NodeMap};

/// Ranges of wake-up tokens: the whole bus, a node-ID, a J1939 address.
const WHOLE: u64 = 0;
const ADDRESSES: u64 = 0x100;

/// State of an expectation, per bus or per node.
#[derive(Debug, Clone)]
pub(super) enum ExpectationSubjects<T> {
    Whole(Box<T>),
    Nodes(NodeMap<T>),
}

impl<T: Default> ExpectationSubjects<T> {
    pub(super) fn new(is_per_node: bool) -> Self {
        if is_per_node { Self::Nodes(NodeMap::default()) } else { Self::Whole(Box::default()) }
    }

    /// State and wake-up token for the node of an event; None for an event without a node if the state is per
    /// node.
    pub(super) fn state_of(&mut self, node: Option<NodeId>) -> Option<(&mut T, u64)> {
        match self {
            Self::Whole(whole) => Some((whole, WHOLE)),
            Self::Nodes(nodes) => {
                let node = node?;
                let token = match node {
                    NodeId::Canopen(id) => u64::from(id),
                    NodeId::J1939(address) => ADDRESSES + u64::from(address),
                };
                Some((nodes.entry(node)?, token))
            }
        }
    }

    /// State that belongs to a wake-up token.
    pub(super) fn of_token(&mut self, token: u64) -> Option<&mut T> {
        match self {
            Self::Whole(whole) => Some(whole),
            Self::Nodes(nodes) => {
                let node = match token {
                    ADDRESSES.. => NodeId::J1939(u8::try_from(token - ADDRESSES).ok()?),
                    _ => NodeId::Canopen(u8::try_from(token).ok()?),
                };
                nodes.get_mut(node)
            }
        }
    }

    /// Calls `act` for each state.
    pub(super) fn for_each(&mut self, mut act: impl FnMut(Option<NodeId>, &mut T)) {
        match self {
            Self::Whole(whole) => act(None, whole),
            Self::Nodes(nodes) => {
                for node in NodeId::all_ids() {
                    if let Some(known) = nodes.get_mut(node) {
                        act(Some(node), known);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_finds_whom_it_is_of() {
        let mut nodes = ExpectationSubjects::<u8>::new(true);
        for (node, value) in [(NodeId::Canopen(5), 1), (NodeId::J1939(0), 2), (NodeId::J1939(5), 3)] {
            let (known, token) = nodes.state_of(Some(node)).unwrap();
            *known = value;
            assert_eq!(nodes.of_token(token), Some(&mut value.clone()));
        }
        assert!(nodes.state_of(None).is_none());
        let mut seen = Vec::new();
        nodes.for_each(|node, value| seen.push((node.unwrap(), *value)));
        assert_eq!(seen, [(NodeId::Canopen(5), 1), (NodeId::J1939(0), 2), (NodeId::J1939(5), 3)]);
        assert!(ExpectationSubjects::<u8>::new(false).state_of(None).is_some());
    }
}
