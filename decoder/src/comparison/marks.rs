//! Differences by node, object and finding of the second capture, for a view of that capture.

use std::collections::{BTreeMap, BTreeSet};

use super::alignment::{BusPair, align_captures};
use super::difference::{CaptureComparison, Difference, DifferenceKind, DifferenceSection};
use super::record::{CaptureRecord, MessageRole};
use super::timing::message_label;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// A node by the name of its bus.
type NodePlace = (String, NodeId);

/// Differences by what they concern in the second capture.
#[derive(Debug, Clone, Default)]
pub struct DifferenceMarks {
    nodes: BTreeMap<NodePlace, Vec<Difference>>,
    objects: BTreeMap<(NodePlace, ObjectAddress), Difference>,
    /// Ids of findings that the first capture does not have.
    new_findings: BTreeSet<u64>,
    count: usize,
}

impl DifferenceMarks {
    /// Marks of a comparison of these captures.
    pub fn new(comparison: &CaptureComparison, good: &CaptureRecord, bad: &CaptureRecord) -> Self {
        let alignment = align_captures(good, bad);
        let mut places: BTreeMap<String, NodePlace> = BTreeMap::new();
        for bus in &alignment.buses {
            add_places(bus, &mut places);
        }
        let new_findings = comparison.new_findings.clone();
        let count = comparison.differences.len();
        let mut marks = Self { new_findings, count, ..Self::default() };
        for difference in &comparison.differences {
            let Some(place) = places.get(&difference.subject) else { continue };
            if let Some(object) = object_of(difference) {
                marks.objects.insert((place.clone(), object), difference.clone());
            }
            marks.nodes.entry(place.clone()).or_default().push(difference.clone());
        }
        marks
    }

    /// Number of all differences.
    pub fn difference_count(&self) -> usize {
        self.count
    }

    /// Differences of a node, most important first.
    pub fn of_node(&self, bus: &str, node: NodeId) -> &[Difference] {
        self.nodes.get(&(bus.to_owned(), node)).map_or(&[], Vec::as_slice)
    }

    /// Difference of a parameter or mapping.
    pub fn of_object(&self, bus: &str, node: NodeId, object: ObjectAddress) -> Option<&Difference> {
        self.objects.get(&((bus.to_owned(), node), object))
    }

    /// Number of objects of a node that differ.
    pub fn objects_of(&self, bus: &str, node: NodeId) -> usize {
        self.objects.keys().filter(|((of, id), _)| of == bus && *id == node).count()
    }

    /// Whether the first capture lacks a finding.
    pub fn is_new_finding(&self, id: u64) -> bool {
        self.new_findings.contains(&id)
    }
}

/// Subjects of differences with the node of the second capture that they concern.
fn add_places(bus: &BusPair<'_>, places: &mut BTreeMap<String, NodePlace>) {
    let place = |node| (bus.bad.name.clone(), node);
    for pair in &bus.nodes {
        places.insert(pair.label.clone(), place(pair.bad.id));
        places.insert(bus.node_label(pair.bad), place(pair.bad.id));
    }
    for node in &bus.only_bad {
        places.insert(bus.node_label(node), place(node.id));
    }
    let in_bad = |good: NodeId| {
        let pair = bus.nodes.iter().find(|pair| pair.good.id == good);
        pair.map_or(good, |pair| pair.bad.id)
    };
    let of_good = bus.good.messages.iter().map(|message| (message, true));
    for (message, is_good) in of_good.chain(bus.bad.messages.iter().map(|message| (message, false))) {
        if let MessageRole::Pdo(node, _) | MessageRole::Service(_, node) = message.role {
            places.insert(message_label(bus, message), place(if is_good { in_bad(node) } else { node }));
        }
    }
}

/// Object of a difference of the configuration; sub-index 0 for a mapping.
fn object_of(difference: &Difference) -> Option<ObjectAddress> {
    if difference.section != DifferenceSection::Configuration {
        return None;
    }
    let first = difference.aspect.split(' ').next()?;
    match difference.kind {
        DifferenceKind::Mapping => {
            u16::from_str_radix(first, 16).ok().map(|index| ObjectAddress::new(index, 0))
        }
        _ => first.parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparison::difference::Observation;
    use crate::comparison::record::{BusRecord, EvidenceMark, NodeBehaviour};

    fn record(node: u8) -> CaptureRecord {
        let name = Some("lift".to_owned());
        let node = NodeBehaviour { name, is_present: true, ..NodeBehaviour::new(node.into()) };
        let bus = BusRecord { name: "can0".to_owned(), nodes: vec![node], ..BusRecord::default() };
        CaptureRecord { buses: vec![bus], ..CaptureRecord::default() }
    }

    #[test]
    fn a_difference_belongs_to_the_node_of_the_second_capture() {
        let mut comparison = CaptureComparison::default();
        let value = |text: &str| Some(Observation::new(text, EvidenceMark::default()));
        let mut add = |kind, aspect: &str| {
            comparison.add_difference(
                (DifferenceSection::Configuration, kind),
                ("5/05 lift", aspect),
                (value("1"), value("2")),
                "",
            );
        };
        add(DifferenceKind::Parameter, "6083:00 acceleration");
        add(DifferenceKind::Mapping, "1A00 mapping of TPDO1");
        comparison.new_findings.insert(7);
        // "lift" moved from node-ID 5 to 6.
        let marks = DifferenceMarks::new(&comparison, &record(5), &record(6));
        assert_eq!((marks.difference_count(), marks.of_node("can0", 6.into()).len()), (2, 2));
        assert!(marks.of_node("can0", 5.into()).is_empty() && marks.of_node("can1", 6.into()).is_empty());
        let object = |index| marks.of_object("can0", 6.into(), ObjectAddress::new(index, 0));
        assert_eq!(object(0x6083).map(|it| it.kind), Some(DifferenceKind::Parameter));
        assert_eq!(object(0x1A00).map(|it| it.kind), Some(DifferenceKind::Mapping));
        assert_eq!((object(0x1A01), marks.objects_of("can0", 6.into())), (None, 2));
        assert!(marks.is_new_finding(7) && !marks.is_new_finding(1));
    }
}
