//! CANopen nodes and J1939 addresses whose protocol is settled without evidence from the traffic: the user named
//! them, or their identity is known.

use crate::wire::j1939::J1939Id;
use crate::wire::{NODE_PLACES, NodeId};

/// Words of a bit per place of [`NodeId::table_place`].
const WORDS: usize = NODE_PLACES / 128;

/// Named nodes of one bus.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct NamedNodes {
    places: [u128; WORDS],
    /// Whether the bus carries an identifier of a named CANopen node, or the user named the bus.
    has_canopen: bool,
    /// Whether the bus carries a message of a named J1939 address.
    has_j1939: bool,
    /// Text on a frame invalid in the protocol of its named node.
    contradiction: Option<Box<str>>,
}

impl NamedNodes {
    /// Adds a node. An option without bus (`is_own` false) applies only once the node's identifiers occur.
    pub(in crate::session) fn add_node(&mut self, id: NodeId, is_own: bool) {
        if let Some((word, bit)) = bit_of(id)
            && let Some(places) = self.places.get_mut(word)
        {
            *places |= bit;
            self.has_canopen |= is_own && id.canopen().is_some();
        }
    }

    /// Whether a node is named.
    #[inline]
    pub(in crate::session) fn contains(&self, id: NodeId) -> bool {
        bit_of(id)
            .and_then(|(word, bit)| self.places.get(word).map(|places| places & bit != 0))
            .unwrap_or(false)
    }

    /// Stores the text on a frame invalid in the protocol of its named node.
    pub(in crate::session) fn note_contradiction(&mut self, text: &str) {
        self.contradiction = Some(text.into());
    }

    /// Frame, invalid in the protocol of its named node, as text.
    pub(in crate::session) fn contradiction(&self) -> Option<&str> {
        self.contradiction.as_deref()
    }

    /// Whether a CANopen node is named; its frame shows that this bus carries its identifiers.
    pub(in crate::session) fn note_canopen(&mut self, id: NodeId) -> bool {
        let is_named = self.contains(id);
        self.has_canopen |= is_named;
        is_named
    }

    /// Whether sender or receiver of a J1939 message is named; its frame shows that this bus carries its messages.
    pub(in crate::session) fn hear_message(&mut self, id: J1939Id) -> bool {
        let is_named = self.concerns_named(id);
        self.has_j1939 |= is_named;
        is_named
    }

    /// Whether sender or receiver of a J1939 message is named.
    pub(in crate::session) fn concerns_named(&self, id: J1939Id) -> bool {
        self.contains(NodeId::J1939(id.source)) || self.contains(NodeId::J1939(id.destination))
    }

    /// Whether the bus carries identifiers of a named CANopen node.
    pub(in crate::session) fn has_canopen(&self) -> bool {
        self.has_canopen
    }

    /// Whether the bus carries messages of a named J1939 address.
    pub(in crate::session) fn has_j1939(&self) -> bool {
        self.has_j1939
    }

    /// Whether any CANopen node is named, present or not.
    pub(in crate::session) fn names_canopen(&self) -> bool {
        self.places.first().is_some_and(|places| *places != 0)
    }

    /// Named CANopen nodes in ascending order, as text.
    pub(in crate::session) fn canopen_list(&self) -> String {
        let named = (1..=127).filter(|id| self.contains(NodeId::Canopen(*id)));
        named.map(|id| id.to_string()).collect::<Vec<_>>().join(", ")
    }
}

/// Word and bit of a valid node.
#[inline]
fn bit_of(id: NodeId) -> Option<(usize, u128)> {
    let place = id.table_place();
    (place < NODE_PLACES).then(|| (place / 128, 1 << (place % 128)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_named_node_and_its_neighbours() {
        let mut named = NamedNodes::default();
        named.add_node(NodeId::Canopen(127), false);
        named.add_node(NodeId::J1939(0), false);
        named.add_node(NodeId::Canopen(0), true);
        assert!(named.contains(NodeId::Canopen(127)) && named.contains(NodeId::J1939(0)));
        assert!(!named.contains(NodeId::Canopen(126)) && !named.contains(NodeId::J1939(127)));
        // The null address and node-ID 0 are not devices.
        assert!(!named.contains(NodeId::J1939(254)) && !named.contains(NodeId::Canopen(0)));
        assert!(!named.has_canopen() && !named.note_canopen(NodeId::Canopen(5)) && !named.has_canopen());
        assert!(named.note_canopen(NodeId::Canopen(127)) && named.has_canopen());
        assert_eq!(named.canopen_list(), "127");
    }

    #[test]
    fn a_bus_named_with_the_node_needs_no_frame() {
        let mut named = NamedNodes::default();
        named.add_node(NodeId::Canopen(5), true);
        assert!(named.has_canopen());
    }
}
