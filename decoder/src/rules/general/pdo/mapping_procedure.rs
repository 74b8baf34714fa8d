//! A PDO is mapped anew in another order than CiA 301 lays down.

use crate::event::{Direction, Event, EventKind, Outcome, SdoTransfer};
use crate::finding::About;
use crate::profile::PdoName;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::session::Node;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A PDO is mapped anew by writing its mapping parameter while the PDO is valid, or entries of it while their
    /// number (sub-index 0) is not 0, and the device accepts that. The order is: bit 31 of the COB-ID set, number of
    /// entries 0, entries, number of entries, bit 31 clear. A device that refuses a step out of this order is right;
    /// the refused download is told elsewhere. States that were not seen are not judged.
    ///
    /// # Why it matters
    /// Between two such writes PDOs are sent with half of the old and half of the new contents.
    ///
    /// # Source
    /// CiA 301 §7.5.2.36, §7.5.2.38 (PDO mapping parameter). It lays the order down for who configures; that a device
    /// has to refuse another one it does not say, so the finding is that both sides got on without it.
    ///
    /// # What to look at first
    /// The order of downloads in the master's configuration, or the order its EDS tool wrote.
    ///
    /// # Mutation
    /// drop the download that sets bit 31 of the COB-ID
    "mapping-procedure", Warning, "a PDO is mapped anew in the wrong order",
    kinds: ["sdo-transfer", "boot-up"],
    cases: &["3.22", "3.23", "3.24"],
    word: "MAP",
}

/// Bit 31 of a PDO's COB-ID: it does not exist (CiA 301 §7.5.2.35).
const INVALID: u64 = 1 << 31;

/// PDOs remembered of a node; further ones are not judged.
const PDO_LIMIT: usize = 1024;

/// What is sure of a PDO.
struct Known {
    name: PdoName,
    is_valid: Option<bool>,
    entries: Option<u64>,
}

#[derive(Default)]
struct MappingProcedure {
    nodes: NodeMap<Vec<Known>>,
}

fn new(_policy: &Policy) -> MappingProcedure {
    MappingProcedure::default()
}

impl MappingProcedure {
    fn known(&mut self, node: NodeId, name: PdoName) -> Option<&mut Known> {
        let all = self.nodes.entry(node)?;
        let place = match all.iter().position(|known| known.name == name) {
            Some(place) => place,
            None if all.len() < PDO_LIMIT => {
                all.push(Known { name, is_valid: None, entries: None });
                all.len() - 1
            }
            None => return None,
        };
        all.get_mut(place)
    }

    fn transfer(&mut self, event: &Event, node: NodeId, transfer: &SdoTransfer, context: &mut Context<'_>) {
        let (Some(object), Some(direction)) = (transfer.object, transfer.direction) else { return };
        let Some((name, is_mapping)) = parameter(object) else { return };
        let Some(known) = self.known(node, name) else { return };
        let is_download = direction == Direction::Download;
        if is_mapping && is_download {
            known.judge(event, object, transfer.outcome, context);
        }
        if transfer.outcome != Outcome::Complete {
            return;
        }
        let value = number(context.node(event), object, &transfer.data);
        match (is_mapping, object.sub) {
            (true, 0) => known.entries = value,
            (false, 1) => known.is_valid = value.map(|id| id & INVALID == 0),
            _ => {}
        }
    }
}

/// The PDO a communication or mapping parameter is of, and whether it is a mapping parameter.
fn parameter(object: ObjectAddress) -> Option<(PdoName, bool)> {
    let is_mapping = object.index & 0x0200 != 0;
    let name = match object.index {
        0x1400..=0x1BFF => PdoName::of_parameter(object.index),
        _ => None,
    };
    name.map(|name| (name, is_mapping))
}

/// The number that was transferred, without the padding of a transfer that does not tell its size.
fn number(node: Option<&Node>, object: ObjectAddress, data: &[u8]) -> Option<u64> {
    let value = node?.meaning(object)?.decode(data);
    crate::profile::word(&value)
}

impl Known {
    fn judge(&self, event: &Event, object: ObjectAddress, outcome: Outcome, context: &mut Context<'_>) {
        let (name, is_entry) = (self.name, object.sub != 0);
        let (wrong, case) = match (self.is_valid, self.entries, is_entry) {
            (Some(true), ..) => (Some("while the PDO is valid"), "3.24"),
            (_, Some(1..), true) => (Some("while entries are in use"), "3.23"),
            // What is not known cannot be right either.
            (None, ..) | (_, None, true) => return,
            _ => (None, "3.22"),
        };
        match (wrong, outcome) {
            (Some(wrong), Outcome::Complete) => {
                context.fail_case(case);
                let alarm = context.fail(event).about(About::Name(name.to_string().into()));
                alarm.say(|| {
                    let first = if self.is_valid == Some(true) {
                        format!("bit 31 of {:04X}:01 is to be set first", name.communication_index())
                    } else {
                        format!("{:04X}:00 is to be set to 0 first", name.mapping_index())
                    };
                    format!("{object} written {wrong}, and accepted: {first}")
                });
            }
            (Some(_), Outcome::Aborted) | (None, Outcome::Complete) => context.pass_case(case),
            _ => {}
        }
    }
}

impl Rule for MappingProcedure {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::SdoTransfer(transfer) => self.transfer(event, node, transfer, context),
            EventKind::BootUp { .. } => {
                self.nodes.remove(node);
            }
            _ => {}
        }
    }
}
