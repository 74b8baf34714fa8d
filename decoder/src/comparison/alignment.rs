//! Alignment of buses and nodes by role: names of the bus file, then node-ID with vendor and product, then vendor and product
//! alone if unique, then the node-ID. Never by the serial number.

use super::record::{BusRecord, CaptureRecord, NodeBehaviour};
use crate::wire::NodeId;

/// Buses and nodes of two captures that have the same role.
#[derive(Debug, Default)]
pub(super) struct RoleAlignment<'a> {
    /// Pairs of buses.
    pub(super) buses: Vec<BusPair<'a>>,
    /// Buses of one capture only.
    pub(super) only_good: Vec<&'a BusRecord>,
    pub(super) only_bad: Vec<&'a BusRecord>,
}

/// A bus in both captures.
#[derive(Debug)]
pub(super) struct BusPair<'a> {
    /// Places in the captures.
    pub(super) places: (usize, usize),
    pub(super) good: &'a BusRecord,
    pub(super) bad: &'a BusRecord,
    pub(super) nodes: Vec<NodePair<'a>>,
    pub(super) only_good: Vec<&'a NodeBehaviour>,
    pub(super) only_bad: Vec<&'a NodeBehaviour>,
    /// Bus name before a subject, if there are several buses.
    pub(super) prefix: String,
}

/// A node in both captures.
#[derive(Debug, Clone)]
pub(super) struct NodePair<'a> {
    pub(super) good: &'a NodeBehaviour,
    pub(super) bad: &'a NodeBehaviour,
    /// Label of the node in output.
    pub(super) label: String,
}

impl BusPair<'_> {
    /// Node of the first capture with the role of a node of the second one.
    pub(super) fn good_of(&self, bad: NodeId) -> Option<NodeId> {
        self.nodes.iter().find(|pair| pair.bad.id == bad).map(|pair| pair.good.id)
    }

    /// Label of a node of either capture.
    pub(super) fn node_label(&self, node: &NodeBehaviour) -> String {
        prefixed_label(&self.prefix, node)
    }
}

fn prefixed_label(prefix: &str, node: &NodeBehaviour) -> String {
    let name = node.name.as_ref().map_or(String::new(), |name| format!(" {name}"));
    format!("{prefix}{}{name}", node.id.label())
}

/// Aligns two captures.
pub(super) fn align_captures<'a>(good: &'a CaptureRecord, bad: &'a CaptureRecord) -> RoleAlignment<'a> {
    let mut pairs: Vec<(usize, usize)> = Vec::new();
    for (at, bus) in good.buses.iter().enumerate() {
        if let Some(other) = bad.buses.iter().position(|other| other.name == bus.name) {
            pairs.push((at, other));
        }
    }
    // Formats without bus names: buses in their order.
    let mut rest = (0..bad.buses.len()).filter(|at| pairs.iter().all(|pair| pair.1 != *at));
    let unnamed: Vec<_> = (0..good.buses.len()).filter(|at| pairs.iter().all(|pair| pair.0 != *at)).collect();
    let by_order: Vec<_> = unnamed.into_iter().map_while(|at| Some((at, rest.next()?))).collect();
    pairs.extend(by_order);
    pairs.sort_unstable();
    let has_several = good.buses.len().max(bad.buses.len()) > 1;
    let buses = pairs.iter().filter_map(|places| {
        let (good, bad) = (good.buses.get(places.0)?, bad.buses.get(places.1)?);
        let prefix = if has_several { format!("{} ", good.name) } else { String::new() };
        Some(align_nodes(*places, (good, bad), prefix))
    });
    let only = |record: &'a CaptureRecord, is_paired: &dyn Fn(usize) -> bool| {
        let buses = record.buses.iter().enumerate();
        buses.filter(|(at, _)| !is_paired(*at)).map(|(_, bus)| bus).collect()
    };
    RoleAlignment {
        buses: buses.collect(),
        only_good: only(good, &|at| pairs.iter().any(|pair| pair.0 == at)),
        only_bad: only(bad, &|at| pairs.iter().any(|pair| pair.1 == at)),
    }
}

fn align_nodes<'a>(
    places: (usize, usize),
    (good, bad): (&'a BusRecord, &'a BusRecord),
    prefix: String,
) -> BusPair<'a> {
    let mut open: (Vec<_>, Vec<_>) = (good.nodes.iter().collect(), bad.nodes.iter().collect());
    let mut pairs = Vec::new();
    let by_name = |one: &NodeBehaviour, other: &NodeBehaviour| one.name.is_some() && one.name == other.name;
    let by_id_and_kind = |one: &NodeBehaviour, other: &NodeBehaviour| {
        one.id == other.id && one.kind.is_some() && one.kind == other.kind
    };
    let by_kind = |one: &NodeBehaviour, other: &NodeBehaviour| one.kind.is_some() && one.kind == other.kind;
    let by_id = |one: &NodeBehaviour, other: &NodeBehaviour| one.id == other.id;
    take_pairs(&mut open, &mut pairs, false, by_name);
    take_pairs(&mut open, &mut pairs, false, by_id_and_kind);
    take_pairs(&mut open, &mut pairs, true, by_kind);
    take_pairs(&mut open, &mut pairs, false, by_id);
    take_pairs(&mut open, &mut pairs, true, by_device);
    pairs.sort_by_key(|(good, _)| good.id);
    let pairs =
        pairs.into_iter().map(|(good, bad)| NodePair { good, bad, label: prefixed_label(&prefix, good) });
    BusPair { places, good, bad, nodes: pairs.collect(), only_good: open.0, only_bad: open.1, prefix }
}

/// The same profile on a present node.
fn by_device(one: &NodeBehaviour, other: &NodeBehaviour) -> bool {
    let is_known = one.kind.is_none() || other.kind.is_none();
    is_known && one.device.is_some() && one.device == other.device && one.is_present && other.is_present
}

/// Moves pairs that match from `open` to `pairs`; with `unique` only if no other node matches.
fn take_pairs<'a>(
    open: &mut (Vec<&'a NodeBehaviour>, Vec<&'a NodeBehaviour>),
    pairs: &mut Vec<(&'a NodeBehaviour, &'a NodeBehaviour)>,
    unique: bool,
    is_match: impl Fn(&NodeBehaviour, &NodeBehaviour) -> bool,
) {
    let mut at = 0;
    while let Some(node) = open.0.get(at).copied() {
        let mut others =
            (0..open.1.len()).filter(|place| open.1.get(*place).is_some_and(|it| is_match(node, it)));
        let (first, second) = (others.next(), others.next());
        let is_alone = open
            .0
            .iter()
            .filter(|one| first.and_then(|at| open.1.get(at)).is_some_and(|it| is_match(one, it)));
        let is_unique = !unique || (second.is_none() && is_alone.count() == 1);
        match first.filter(|_| is_unique) {
            Some(place) => {
                pairs.push((node, open.1.remove(place)));
                open.0.remove(at);
            }
            None => at += 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(id: u8, name: Option<&str>, kind: Option<(u64, u64)>) -> NodeBehaviour {
        NodeBehaviour {
            name: name.map(str::to_owned),
            kind,
            is_present: true,
            ..NodeBehaviour::new(id.into())
        }
    }

    fn record(buses: &[(&str, &[NodeBehaviour])]) -> CaptureRecord {
        let bus = |(name, nodes): &(&str, &[NodeBehaviour])| BusRecord {
            name: (*name).to_owned(),
            nodes: nodes.to_vec(),
            ..BusRecord::default()
        };
        CaptureRecord { buses: buses.iter().map(bus).collect(), ..CaptureRecord::default() }
    }

    /// Node-IDs of the pairs of the first bus.
    fn pairs(good: &[NodeBehaviour], bad: &[NodeBehaviour]) -> Vec<(u8, u8)> {
        let (good, bad) = (record(&[("can0", good)]), record(&[("can0", bad)]));
        let alignment = align_captures(&good, &bad);
        let nodes = alignment.buses.first().unwrap().nodes.iter();
        nodes.map(|pair| (pair.good.id.number(), pair.bad.id.number())).collect()
    }

    #[test]
    fn names_precede_identity_and_identity_the_node_id() {
        let (pump, valve) = (Some((0x19, 1)), Some((0x19, 2)));
        // "lift" moved from 5 to 7, although another node of its type has its node-ID.
        let good = [node(5, Some("lift"), pump)];
        assert_eq!(pairs(&good, &[node(5, None, pump), node(7, Some("lift"), pump)]), [(5, 7)]);
        // The only valve moved from 5 to 6; the pump at 5 is another node.
        assert_eq!(pairs(&[node(5, None, valve)], &[node(5, None, pump), node(6, None, valve)]), [(5, 6)]);
        // Two pumps cannot be told apart by vendor and product: the node-ID decides.
        let good = [node(5, None, pump), node(6, None, pump)];
        assert_eq!(pairs(&good, &[node(6, None, pump), node(5, None, pump)]), [(5, 5), (6, 6)]);
        // An unknown identity is no contradiction; a replaced device is compared.
        assert_eq!(pairs(&[node(5, None, pump)], &[node(5, None, None)]), [(5, 5)]);
        assert_eq!(pairs(&[node(5, None, pump)], &[node(5, None, valve)]), [(5, 5)]);
    }

    #[test]
    fn buses_without_their_names_are_aligned_in_their_order() {
        let (good, bad) = (record(&[("can0", &[]), ("can1", &[])]), record(&[("can1", &[]), ("1", &[])]));
        let alignment = align_captures(&good, &bad);
        let places: Vec<_> = alignment.buses.iter().map(|pair| pair.places).collect();
        assert_eq!(places, [(0, 1), (1, 0)]);
        assert!(alignment.only_good.is_empty() && alignment.only_bad.is_empty());
    }
}
