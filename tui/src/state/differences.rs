//! Differences from another capture, by what they concern.

use cobscope_decoder::comparison::{Difference, DifferenceMarks};
use cobscope_decoder::frame::BusIndex;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::ObjectAddress;

use super::UiState;

impl UiState {
    /// Whether the comparison with another capture runs.
    pub fn is_comparing(&self) -> bool {
        self.against.as_ref().is_some_and(|against| against.result.is_none())
    }

    /// File name of the other capture, after its comparison.
    pub fn compared_name(&self) -> Option<&str> {
        self.against
            .as_ref()
            .filter(|against| against.difference_marks().is_some())
            .map(|against| against.name.as_str())
    }

    fn difference_marks(&self) -> Option<&DifferenceMarks> {
        self.against.as_ref()?.difference_marks()
    }

    /// Differences of a node, most important first.
    pub fn differences_of(&self, (bus, node): (BusIndex, NodeId)) -> &[Difference] {
        let bus = self.bus_state().and_then(|world| world.buses().get(usize::from(bus.0)));
        bus.zip(self.difference_marks()).map_or(&[], |(bus, marks)| marks.of_node(bus.name(), node))
    }

    /// Difference of an object of a node on a bus.
    pub fn difference_of(&self, bus: &str, node: NodeId, object: ObjectAddress) -> Option<&Difference> {
        self.difference_marks()?.of_object(bus, node, object)
    }

    /// Number of objects of a node on a bus that differ.
    pub fn objects_that_differ(&self, bus: &str, node: NodeId) -> usize {
        self.difference_marks().map_or(0, |marks| marks.objects_of(bus, node))
    }

    /// Whether the other capture lacks a finding.
    pub fn is_new_finding(&self, id: u64) -> bool {
        self.difference_marks().is_some_and(|marks| marks.is_new_finding(id))
    }
}
