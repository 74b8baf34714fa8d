//! Comparison of the captures with another one.

use cobscope_decoder::comparison::{Difference, DifferenceMarks, DifferenceSection, Observation};
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::ObjectAddress;

use super::NodeKey;

/// Mark of what differs.
pub const DIFFERS: &str = "≠";

/// The other capture, and what differs from it.
pub struct OtherCapture {
    /// File name of the other capture, escaped.
    pub name: String,
    /// Result of the comparison; None while it runs.
    pub result: Option<Result<Box<DifferenceMarks>, String>>,
}

impl OtherCapture {
    /// Comparison with a capture that is still being read.
    pub fn new(name: &str) -> Self {
        Self { name: escape(name).into_owned(), result: None }
    }

    /// What differs, after the comparison.
    pub fn difference_marks(&self) -> Option<&DifferenceMarks> {
        self.result.as_ref()?.as_ref().ok().map(AsRef::as_ref)
    }
}

/// The comparison with another capture, if it was requested.
#[derive(Default)]
pub struct CaptureDifferences(pub Option<OtherCapture>);

impl CaptureDifferences {
    /// Whether the comparison runs.
    pub fn is_comparing(&self) -> bool {
        self.0.as_ref().is_some_and(|against| against.result.is_none())
    }

    /// File name of the other capture, after its comparison.
    pub fn compared_name(&self) -> Option<&str> {
        self.0
            .as_ref()
            .filter(|against| against.difference_marks().is_some())
            .map(|against| against.name.as_str())
    }

    fn difference_marks(&self) -> Option<&DifferenceMarks> {
        self.0.as_ref()?.difference_marks()
    }

    /// Differences of a node, most important first; `world` is the state at the cursor.
    pub fn differences_of(&self, world: Option<&ReplayState>, (bus, node): NodeKey) -> &[Difference] {
        let bus = world.and_then(|world| world.buses().get(usize::from(bus.0)));
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

/// Value in the other capture; not escaped.
pub fn other_value(difference: &Difference) -> &str {
    difference.good.as_ref().map_or("not seen", |value| value.text.as_str())
}

/// `NMT: pre-operational 11.8 s, good.log operational 4.2 s`; not escaped.
pub fn both_values(difference: &Difference, name: &str) -> String {
    let text = |value: Option<&Observation>| value.map_or("not seen", |value| value.text.as_str()).to_owned();
    let (good, bad) = (difference.good.as_ref(), difference.bad.as_ref());
    let Difference { section, subject, aspect, .. } = difference;
    let what = match (section, aspect.as_str()) {
        (DifferenceSection::Timing, _) => format!("{subject} {aspect}"),
        (_, "") => "node".to_owned(),
        (_, aspect) => aspect.to_owned(),
    };
    match (section, good, bad) {
        (DifferenceSection::Faults, None, Some(bad)) => format!("not in {name}: {}", bad.text),
        (DifferenceSection::Faults, Some(good), None) => format!("only in {name}: {}", good.text),
        _ => format!("{what}: {}, {name} {}", text(bad), text(good)),
    }
}

#[cfg(test)]
mod tests {
    use cobscope_decoder::comparison::{DifferenceKind, EvidenceMark};

    use super::*;

    #[test]
    fn the_value_of_this_capture_precedes_that_of_the_other_one() {
        let values = |section, aspect: &str, good: Option<&str>, bad: Option<&str>| {
            let value = |text: Option<&str>| text.map(|text| Observation::new(text, EvidenceMark::default()));
            let difference = Difference::new(
                (section, DifferenceKind::State),
                ("5/05", aspect),
                (value(good), value(bad)),
            );
            both_values(&difference, "good.log")
        };
        let parameter = values(DifferenceSection::Configuration, "1017:00", Some("500 ms"), Some("200 ms"));
        assert_eq!(parameter, "1017:00: 200 ms, good.log 500 ms");
        assert_eq!(
            values(DifferenceSection::Nodes, "", None, Some("present")),
            "node: present, good.log not seen"
        );
        assert_eq!(
            values(DifferenceSection::Faults, "emcy-raised", None, Some("EMCY")),
            "not in good.log: EMCY"
        );
        assert_eq!(
            values(DifferenceSection::Faults, "emcy-raised", Some("EMCY"), None),
            "only in good.log: EMCY"
        );
        let period = values(DifferenceSection::Timing, "period", Some("every 100 ms"), None);
        assert_eq!(period, "5/05 period: not seen, good.log every 100 ms");
    }
}
