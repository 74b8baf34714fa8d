//! PDO remapping in another order than CiA 301 requires.

use crate::event::{DeviceCause, DeviceState, Event, EventKind, Kind, SdoDirection, SdoOutcome, SdoTransfer};
use crate::finding::{FindingSubject, MergedFindings};
use crate::profile::{PdoDirection, PdoName};
use crate::rules::general::facts::value_or_default;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A device accepts a write to the mapping of a valid PDO, or to an entry while the number of entries
    /// (sub-index 0) is not 0. The required order is: set bit 31 of the COB-ID, write 0 entries, the entries
    /// and their number, clear bit 31. A PDO is valid by a transfer of its COB-ID, a value in the bus file, a
    /// frame of the TPDO since the boot sign, a control word in the RPDO that the device followed, or (lower
    /// severity) its default in the profile. Steps that the device refuses, and unknown states, are exempt.
    ///
    /// # Why it matters
    /// Between two such writes, PDOs contain a mixture of the old and the new mapping.
    ///
    /// # Source
    /// CiA 301 §7.5.2.36, §7.5.2.38 (PDO mapping parameter). The order is required of the configuring device.
    /// A refusal of other orders is not required, so the finding concerns both sides.
    ///
    /// # What to look at first
    /// Check the order of downloads in the configuration of the master. The EDS tool may have written it.
    ///
    /// # Mutation
    /// drop the download that sets bit 31 of the COB-ID
    "mapping-procedure", Warning, "PDO remapped in the wrong order",
    kinds: [
        Kind::SdoTransfer, Kind::BootUp, Kind::Emcy, Kind::DeviceState, Kind::BusSilent, Kind::LostFrames,
        Kind::Link,
    ],
    transfers: TransferSubset::Communication,
    needs: "a write to a PDO mapping, and the COB-ID of that PDO",
    merge: MergedFindings::Node,
    cases: &["3.22", "3.23", "3.24"],
    word: "MAP",
}

/// Bit 31 of the COB-ID of a PDO: the PDO does not exist (CiA 301 §7.5.2.35).
const INVALID: u64 = 1 << 31;

/// Maximum number of PDOs per node; further ones are not checked.
const PDO_LIMIT: usize = 1024;

/// Reason for a lower severity if only the profile states that the PDO is valid.
const ASSUMED: &str = "COB-ID assumed to be the default of the profile";

/// Missing for a verdict, although a mapping was written.
const UNKNOWN: &str = "the COB-ID of the PDO whose mapping was written";

/// Confirmed state of a PDO.
struct KnownMapping {
    name: PdoName,
    is_valid: Option<bool>,
    entries: Option<u64>,
    /// Frame of the RPDO whose control word the device followed.
    followed: Option<u64>,
    /// A write of the COB-ID had no response, or may be missing in the capture.
    is_unclear: bool,
}

/// Evidence that a PDO is valid.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ValidityEvidence {
    Setting,
    /// A frame of the TPDO.
    Sent(u64),
    /// A frame of the RPDO that the device followed.
    Followed(u64),
    Default,
}

#[derive(Default)]
struct MappingProcedure {
    nodes: NodeMap<Vec<KnownMapping>>,
    /// Frame of the last boot sign.
    boots: NodeMap<u64>,
    /// Frame after the last hole, in which a PDO may have been configured.
    hole: u64,
    has_judged: bool,
    /// A mapping was written, but the state of its PDO was unknown.
    is_unknown: bool,
}

fn new(_policy: &RulePolicy) -> MappingProcedure {
    MappingProcedure::default()
}

impl MappingProcedure {
    fn known_mapping(&mut self, node: NodeId, name: PdoName) -> Option<&mut KnownMapping> {
        let boot = self.boots.get(node).copied().unwrap_or(0);
        let all = self.nodes.entry(node)?;
        let place = match all.iter().position(|known| known.name == name) {
            Some(place) => place,
            None if all.len() < PDO_LIMIT => {
                let is_unclear = self.hole > boot;
                all.push(KnownMapping { name, is_valid: None, entries: None, followed: None, is_unclear });
                all.len() - 1
            }
            None => return None,
        };
        all.get_mut(place)
    }

    fn on_transfer(
        &mut self,
        event: &Event,
        node: NodeId,
        transfer: &SdoTransfer,
        context: &mut RuleContext<'_>,
    ) {
        let (Some(object), Some(direction)) = (transfer.object, transfer.direction) else { return };
        let Some((name, is_mapping)) = mapping_parameter(object) else { return };
        let boot = self.boots.get(node).copied().unwrap_or(0);
        let Some(known) = self.known_mapping(node, name) else { return };
        if is_mapping && direction == SdoDirection::Download {
            let valid = known.pdo_validity(node, boot, context);
            let has_judged = known.judge_write(event, (object, transfer.outcome), valid, context);
            self.has_judged |= has_judged;
            self.is_unknown |= !has_judged;
        }
        let Some(known) = self.known_mapping(node, name) else { return };
        if transfer.outcome != SdoOutcome::Complete {
            // Without a response it is unknown whether the device took the value.
            if direction == SdoDirection::Download && transfer.outcome != SdoOutcome::Aborted {
                known.is_unclear |= !is_mapping && object.sub == 1;
                known.entries = known.entries.filter(|_| !is_mapping);
            }
            return;
        }
        let value = transferred_number(context.event_node(event), object, &transfer.data);
        match (is_mapping, object.sub) {
            (true, 0) => known.entries = value,
            // A COB-ID whose value the capture does not contain may be valid or invalid.
            (false, 1) => {
                known.is_valid = value.map(|id| id & INVALID == 0);
                known.is_unclear = known.is_valid.is_none();
            }
            _ => {}
        }
    }
}

/// PDO of a communication or mapping parameter, and whether it is a mapping parameter.
fn mapping_parameter(object: ObjectAddress) -> Option<(PdoName, bool)> {
    let is_mapping = object.index & 0x0200 != 0;
    let name = match object.index {
        0x1400..=0x1BFF => PdoName::of_parameter(object.index),
        _ => None,
    };
    name.map(|name| (name, is_mapping))
}

/// Transferred value without the padding of a transfer that has no size indicator.
fn transferred_number(node: Option<&Node>, object: ObjectAddress, data: &[u8]) -> Option<u64> {
    let value = node?.meaning(object)?.decode(data);
    crate::profile::as_word(&value)
}

impl KnownMapping {
    /// Whether the PDO is valid, and the evidence; `None` if unknown.
    fn pdo_validity(
        &self,
        id: NodeId,
        boot: u64,
        context: &RuleContext<'_>,
    ) -> Option<(bool, ValidityEvidence)> {
        if self.is_unclear {
            return None;
        }
        if let Some(is_valid) = self.is_valid {
            return Some((is_valid, ValidityEvidence::Setting));
        }
        let node = context.bus.node(id)?;
        let cob_id = value_or_default(node, ObjectAddress::new(self.name.communication_index(), 1));
        if let Some(setting) = cob_id.filter(|setting| !setting.is_default) {
            return Some((setting.value & INVALID == 0, ValidityEvidence::Setting));
        }
        if let Some(frame) = self.last_frame(id, context).filter(|frame| *frame > boot) {
            return Some((true, ValidityEvidence::Sent(frame)));
        }
        if let Some(frame) = self.followed {
            return Some((true, ValidityEvidence::Followed(frame)));
        }
        cob_id.map(|setting| (setting.value & INVALID == 0, ValidityEvidence::Default))
    }

    /// Last frame of a TPDO; frames of an RPDO prove only its producer.
    fn last_frame(&self, node: NodeId, context: &RuleContext<'_>) -> Option<u64> {
        if self.name.direction != PdoDirection::Transmit {
            return None;
        }
        let sent = context.traffic.slots().iter().filter(|slot| slot.count > 0);
        let mut own =
            sent.filter(|slot| context.bus.identifiers().pdo_on(slot.id) == Some((self.name, node)));
        own.next().map(|slot| slot.frames.0)
    }

    /// Judges a write to the mapping; returns whether the state of the PDO was known.
    fn judge_write(
        &self,
        event: &Event,
        (object, outcome): (ObjectAddress, SdoOutcome),
        valid: Option<(bool, ValidityEvidence)>,
        context: &mut RuleContext<'_>,
    ) -> bool {
        let is_entry = object.sub != 0;
        let (wrong, case) = match (valid, self.entries, is_entry) {
            (Some((true, _)), ..) => (Some("while the PDO is valid"), "3.24"),
            (_, Some(1..), true) => (Some("while entries are in use"), "3.23"),
            // No verdict for an unknown state.
            (None, ..) | (_, None, true) => return false,
            _ => (None, "3.22"),
        };
        match (wrong, outcome) {
            (Some(wrong), SdoOutcome::Complete) => {
                context.fail_case(case);
                self.report_procedure(event, (object, wrong), valid, context);
            }
            (Some(_), SdoOutcome::Aborted) | (None, SdoOutcome::Complete) => context.pass_case(case),
            _ => return false,
        }
        true
    }

    fn report_procedure(
        &self,
        event: &Event,
        (object, wrong): (ObjectAddress, &str),
        valid: Option<(bool, ValidityEvidence)>,
        context: &mut RuleContext<'_>,
    ) {
        let name = self.name;
        let evidence = valid.filter(|(is_valid, _)| *is_valid).map(|(_, evidence)| evidence);
        let assumed = (evidence == Some(ValidityEvidence::Default)).then_some(ASSUMED);
        let alarm = context
            .start_finding(event)
            .with_subject(FindingSubject::Name(name.to_string().into()))
            .with_assumption(assumed);
        alarm.report_finding(|| {
            let communication = name.communication_index();
            let first = match evidence {
                None => format!("{:04X}:00 must be set to 0 first", name.mapping_index()),
                Some(_) => format!("{communication:04X}:01 bit 31 must be set first"),
            };
            let proof = match evidence {
                None | Some(ValidityEvidence::Setting) => String::new(),
                Some(ValidityEvidence::Sent(frame)) => format!("{name} sent {{{frame}}}; "),
                Some(ValidityEvidence::Followed(frame)) => format!("{name} {{{frame}}} took effect; "),
                Some(ValidityEvidence::Default) => format!("{communication:04X}:01 default; "),
            };
            format!("{object} write accepted {wrong} ({proof}{first})")
        });
    }
}

impl MappingProcedure {
    fn on_boot(&mut self, event: &Event, node: NodeId) {
        self.nodes.remove(node);
        self.boots.insert(node, event.frames.last);
    }

    /// A device that follows a control word received its RPDO.
    fn on_state(&mut self, id: NodeId, state: &DeviceState, context: &RuleContext<'_>) {
        let Some(node) = context.bus.node(id).filter(|_| state.cause == DeviceCause::ControlWord) else {
            return;
        };
        let mut machines = node.device().machines.iter();
        let place = machines.position(|it| it.name == state.machine && it.channel == state.channel);
        let control = place.and_then(|place| context.bus.control_identifier(id, place));
        let Some((name, owner)) = control.and_then(|control| context.bus.identifiers().pdo_on(control))
        else {
            return;
        };
        if owner == id
            && state.cause_frame > 0
            && let Some(known) = self.known_mapping(id, name)
        {
            known.followed = Some(state.cause_frame);
        }
    }
}

impl Rule for MappingProcedure {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::BusSilent { .. } | EventKind::LostFrames { .. } | EventKind::Link { .. } =
            &event.kind
        {
            self.hole = event.frames.last;
            self.nodes = NodeMap::default();
        }
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::SdoTransfer(transfer) => self.on_transfer(event, node, transfer, context),
            EventKind::BootUp { .. } => self.on_boot(event, node),
            EventKind::Emcy(emergency) if emergency.boot.is_some() => self.on_boot(event, node),
            EventKind::DeviceState(state) => self.on_state(node, state, context),
            _ => {}
        }
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        if self.is_unknown && !self.has_judged {
            context.note_unexercised(UNKNOWN.to_owned());
        }
    }
}
