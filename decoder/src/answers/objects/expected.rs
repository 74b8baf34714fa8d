//! Comparison of a node's values with those of a DCF or XDC.

use std::fmt::Write as _;
use std::sync::Arc;

use super::ExpectedObject;
use super::text::{node_label, value_place};
use crate::escape::escape;
use crate::frame::Timestamp;
use crate::profile::device_file::{DeviceFile, DeviceObject, EntryAccess};
use crate::profile::{DataType, DecodedValue};
use crate::session::{Bus, Buses, Node, StoredObject};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Store and restore parameters: a read returns the capability of the device, not a configured value.
const COMMANDS: [u16; 2] = [0x1010, 0x1011];

/// Expected values of one node.
pub struct ExpectedValues {
    /// DCF or XDC.
    pub file: Arc<DeviceFile>,
    /// Name of the file.
    pub name: String,
    /// Name of the bus; `None` for all.
    pub bus: Option<String>,
    /// The node.
    pub node: NodeId,
}

/// Value of an object and expected value.
struct ValueComparison<'a> {
    object: &'a DeviceObject,
    wanted: Vec<u8>,
    is: Option<&'a StoredObject>,
}

impl ExpectedValues {
    /// The node, and its bus if one is given.
    pub fn chosen_node(&self) -> (Option<&str>, NodeId) {
        (self.bus.as_deref(), self.node)
    }

    /// The node on all its buses.
    fn places<'a>(&'a self, buses: Buses<'a>) -> impl Iterator<Item = (&'a Bus, &'a Node)> {
        let wanted = |bus: &&Bus| self.bus.as_deref().is_none_or(|name| name == bus.name());
        buses.iter().filter(wanted).filter_map(|bus| Some((bus, bus.node(self.node)?)))
    }

    /// Writes the comparison on each bus; `first` is the time of the first frame.
    pub fn write_text(&self, buses: Buses<'_>, first: Option<Timestamp>, output: &mut String) {
        self.places(buses).for_each(|(bus, node)| self.push_text(bus, node, first, output));
    }

    /// The comparison of each object.
    pub fn records<'a>(&'a self, buses: Buses<'a>, capture: &'a str) -> impl Iterator<Item = ExpectedObject> {
        self.places(buses).flat_map(move |place| {
            self.compared_values(place.1).map(move |compared| {
                let object = (compared.object.address, compared.is);
                let result = (compared.comparison_result().name(), compared.wanted.as_slice());
                ExpectedObject::new(place, object, result, capture)
            })
        })
    }

    /// All objects of the file that can be compared.
    fn compared_values<'a>(&'a self, node: &'a Node) -> impl Iterator<Item = ValueComparison<'a>> {
        let objects = self.file.objects.iter().filter(|object| !COMMANDS.contains(&object.address.index));
        objects.filter_map(|object| {
            let wanted = object.configured_bytes(self.node.number())?;
            Some(ValueComparison { object, wanted, is: node.store().seen_value(object.address) })
        })
    }

    fn push_text(&self, bus: &Bus, node: &Node, first: Option<Timestamp>, output: &mut String) {
        let (mut equal, mut differing, mut unseen) = (0, String::new(), Vec::new());
        let mut differ = 0;
        for compared in self.compared_values(node) {
            match compared.comparison_result() {
                ExpectationOutcome::Equal => equal += 1,
                ExpectationOutcome::Unseen if compared.object.access == Some(EntryAccess::Wo) => {}
                ExpectationOutcome::Unseen => unseen.push(compared.object.address),
                ExpectationOutcome::Differs => {
                    differ += 1;
                    compared.push_row(node, first, &mut differing);
                }
            }
        }
        let unknown = unseen.len();
        let _ = writeln!(
            output,
            "{} against {}: {differ} different, {equal} equal, {unknown} unknown",
            node_label(bus, node),
            escape(&self.name)
        );
        output.push_str(&differing);
        list_unknown(&unseen, output);
    }
}

/// Max columns and lines of the list of unknown objects.
const LIST: (usize, usize) = (100, 10);

/// Lists unknown objects: sub-indexes in ranges, several entries per line.
fn list_unknown(unseen: &[ObjectAddress], output: &mut String) {
    let (columns, most) = LIST;
    let mut lines: Vec<String> = Vec::new();
    let mut listed = 0;
    for run in
        unseen.chunk_by(|one, next| (one.index, one.sub.checked_add(1)) == (next.index, Some(next.sub)))
    {
        let (Some(first), Some(last)) = (run.first(), run.last()) else { continue };
        let entry = if run.len() > 1 { format!("{first}..{:02X}", last.sub) } else { first.to_string() };
        let is_full = lines.len() >= most;
        match lines.last_mut() {
            Some(line) if line.len() + entry.len() < columns => {
                line.push(' ');
                line.push_str(&entry);
            }
            _ if is_full => break,
            _ => lines.push(format!("unknown: {entry}")),
        }
        listed += run.len();
    }
    for line in lines {
        let _ = writeln!(output, "{line}");
    }
    if listed < unseen.len() {
        let _ = writeln!(output, "unknown: {} more (-f json lists all)", unseen.len() - listed);
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum ExpectationOutcome {
    Equal,
    Differs,
    Unseen,
}

impl ExpectationOutcome {
    const fn name(self) -> &'static str {
        match self {
            Self::Equal => "equal",
            Self::Differs => "differs",
            Self::Unseen => "never-seen",
        }
    }
}

impl ValueComparison<'_> {
    fn comparison_result(&self) -> ExpectationOutcome {
        let Some(entry) = self.is else { return ExpectationOutcome::Unseen };
        let decode = |bytes: &[u8]| self.object.data_type.map(|data_type| data_type.decode(bytes));
        if decode(&self.wanted) == decode(&entry.value) {
            ExpectationOutcome::Equal
        } else {
            ExpectationOutcome::Differs
        }
    }

    /// Appends `1017:00  Producer heartbeat time   expected 500 ms, is 1000 ms  written {88} 1.234 s`.
    fn push_row(&self, node: &Node, first: Option<Timestamp>, output: &mut String) {
        let Some(entry) = self.is else { return };
        let object = self.object.address;
        let meaning = node.meaning(object);
        let show = |bytes: &[u8]| match meaning.as_ref().map(|meaning| (meaning, meaning.decode(bytes))) {
            Some((_, DecodedValue::Bytes(_))) | None => plain_value(bytes, self.object.data_type),
            Some((meaning, value)) => meaning.format_value(&value),
        };
        let name = meaning.as_ref().map_or(self.object.object_name.as_str(), |meaning| meaning.name.as_str());
        let stale = if entry.stale { "?" } else { "" };
        let waiting = node.store().waiting_value(object).filter(|waiting| waiting.value == self.wanted);
        let waits = waiting.map_or(String::new(), |waiting| {
            format!(", expected value active {}", waiting.effect.time_text())
        });
        let line = format!(
            "{object}  {name:<50}  expected {}, is {}{stale}  {}{}{waits}",
            show(&self.wanted),
            show(&entry.value),
            entry.origin.kind.origin_text(),
            value_place(entry, first),
        );
        let _ = writeln!(output, "{}", escape(&line));
    }
}

/// A value with the data type from the file.
fn plain_value(bytes: &[u8], data_type: Option<DataType>) -> String {
    data_type.map_or(DecodedValue::Bytes(bytes.to_vec()), |data_type| data_type.decode(bytes)).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_objects_are_listed_in_ranges_and_short_lines() {
        let list = |unseen: &[ObjectAddress]| {
            let mut output = String::new();
            list_unknown(unseen, &mut output);
            output
        };
        assert_eq!(list(&[]), "");
        let few = [(0x1003, 1), (0x1003, 2), (0x1003, 4), (0x1004, 5), (0x1005, 0xFF), (0x1006, 0)];
        let few = few.map(|(index, sub)| ObjectAddress::new(index, sub));
        assert_eq!(list(&few), "unknown: 1003:01..02 1003:04 1004:05 1005:FF 1006:00\n");
        let many: Vec<_> = (0x2000..0x2000 + 1_675).map(|index| ObjectAddress::new(index, 0)).collect();
        let text = list(&many);
        assert_eq!(text.lines().count(), 11);
        assert!(text.lines().all(|line| line.len() <= 100), "{text}");
        // Ten lines of 90 columns after "unknown:", eight per address: 11 addresses each.
        assert!(text.ends_with("unknown: 1565 more (-f json lists all)\n"), "{text}");
    }
}
