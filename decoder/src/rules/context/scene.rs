//! State of a node and its bus when a finding begins, as evidence for the diagnosis.

use super::meter::FrameMeter;
use super::traffic::PdoTraffic;
use crate::event::{FrameRange, MonitoringMethod, StateCertainty};
use crate::finding::{
    Advice, AdviceSource, CommandStream, FactCause, FindingScene, FindingSubject, Occurrence, SceneLifeSign,
};
use crate::profile::{self, DeviceProfile, PdoDirection, PdoName};
use crate::session::{Bus, GateState, GateStatus, LifeWatch, Node};
use crate::wire::NodeId;
use crate::wire::canopen::{NmtState, ObjectAddress};

/// Maximum number of proposed steps.
const ADVICE: usize = 8;

/// Number of RPDOs of the predefined connection set.
const RPDOS: u16 = 4;

/// View of the bus at the beginning of a finding.
pub(super) struct SceneView<'a> {
    pub(super) bus: &'a Bus,
    pub(super) traffic: &'a PdoTraffic,
    pub(super) meter: &'a FrameMeter,
    /// Time of the traffic, in ns.
    pub(super) now: i64,
}

impl SceneView<'_> {
    /// Scene of a finding about a node.
    pub(super) fn build_scene(&self, node: Option<NodeId>, about: &FindingSubject) -> FindingScene {
        let bus_only = FindingScene {
            error_frames: self.meter.errors,
            recent_error_frames: self.meter.last.errors,
            ..FindingScene::default()
        };
        let Some(node) = node.and_then(|id| self.bus.node(id)) else { return bus_only };
        let gates = self.bus.gates(node.id());
        let invisible = gates.iter().filter(|gate| gate.status == GateStatus::Invisible);
        let mut invisible: Vec<_> = invisible.map(|gate| gate.gate.clone()).collect();
        invisible.dedup();
        let confirmed = node.nmt().filter(|nmt| nmt.certainty == StateCertainty::Confirmed);
        FindingScene {
            nmt: confirmed.map(|nmt| nmt.state),
            alive: self.life_sign(node),
            commands: self.command_stream(node.id()),
            advice: collect_advice(node, about, &gates),
            invisible,
            has_profile: node.assigned_by().is_some(),
            ..bus_only
        }
    }

    /// Commands on an identifier without a known consumer, while an RPDO of the node never arrived on its own.
    pub(super) fn no_consumer(&self, id: NodeId) -> Option<FactCause> {
        let orphan = self.traffic.slots().iter().find(|slot| {
            let is_rpdo = |(pdo, node): (PdoName, NodeId)| {
                pdo.direction == PdoDirection::Receive
                    && self.bus.node(node).is_none_or(|it| it.last_seen().0 == 0)
            };
            self.bus.identifiers().pdo_on(slot.id).is_some_and(is_rpdo)
                && self.bus.node_table().pdo_users(slot.id).is_empty()
        })?;
        let rpdos = (1..=RPDOS).map(|number| PdoName { direction: PdoDirection::Receive, number });
        let mut configured = rpdos.filter_map(|pdo| {
            let (own, is_confirmed) = self.bus.pdo_identifier(id, pdo)?;
            (is_confirmed
                && self.bus.identifiers().find_slot(own).and_then(|own| self.traffic.slot_of(own)).is_none())
            .then_some((pdo, own))
        });
        let (pdo, own) = configured.next()?;
        let object = ObjectAddress::new(pdo.communication_index(), 1);
        let text = format!(
            "commands on {}h without a known consumer; {pdo} of {} is {own}h ({object}), never on the bus",
            orphan.id,
            id.label()
        );
        let frames = FrameRange::one(orphan.frames.0);
        let time = self.bus.stamp_of(orphan.last);
        Some(FactCause {
            node: None,
            node_name: None,
            text,
            next: "".into(),
            at: Occurrence { time, frames },
        })
    }

    /// Heartbeat or guarding response, if it arrived within its configured time.
    fn life_sign(&self, node: &Node) -> Option<SceneLifeSign> {
        let sign = self.bus.sign_of_life(node.id())?;
        let by = match sign.by {
            LifeWatch::Heartbeat => MonitoringMethod::Heartbeat,
            LifeWatch::Guarding => MonitoringMethod::Guarding,
            LifeWatch::Message(_) | LifeWatch::Boot | LifeWatch::Any => return None,
        };
        let (expected, age) = (sign.expected?, self.bus.now().saturating_sub(sign.last));
        let is_timely = age <= expected.saturating_add(expected / 2) && !node.is_lost();
        is_timely.then_some(SceneLifeSign { by, expected, age })
    }

    /// The RPDO of the node with the shortest usual interval, if it arrived within twice this interval.
    fn command_stream(&self, id: NodeId) -> Option<CommandStream> {
        let streams = self.traffic.slots().iter().filter_map(|slot| {
            let (pdo, node) = self.bus.identifiers().pdo_on(slot.id)?;
            let is_command = node == id && pdo.direction == PdoDirection::Receive;
            let (period, age) = (slot.median?, self.now.saturating_sub(slot.last));
            (is_command && age <= period.saturating_mul(2)).then_some(CommandStream { pdo, period, age })
        });
        streams.min_by_key(|stream| stream.period)
    }
}

/// Causes in the manual, conditions of closed gates, ways out of a fault, and hints of code tables.
fn collect_advice(node: &Node, about: &FindingSubject, gates: &[GateState]) -> Vec<Advice> {
    let mut all = Vec::new();
    let device = node.device();
    add_causes(device, about, &mut all);
    for gate in gates.iter().filter(|gate| gate.status == GateStatus::Closed) {
        add_advice(&mut all, &gate.gate_advice(), &gate.source, AdviceSource::Gate);
    }
    // Control words have no effect outside operational.
    if node.nmt().is_none_or(|nmt| nmt.state == NmtState::Operational) {
        ways_out(node, &mut all);
    }
    let code = match about {
        FindingSubject::Code(code) => profile::emcy_codes().find_code(u32::from(*code)),
        FindingSubject::Fault(_, fmi) => profile::failure_modes().find_code(u32::from(*fmi)),
        _ => None,
    };
    add_advice(&mut all, code.map_or("", |entry| &entry.hint), "", AdviceSource::Code);
    all.truncate(ADVICE);
    all
}

fn add_advice(all: &mut Vec<Advice>, text: &str, section: &str, by: AdviceSource) {
    if !text.is_empty() && !all.iter().any(|known: &Advice| known.text == text) {
        all.push(Advice { text: text.to_owned(), section: section.to_owned(), by });
    }
}

/// Adds causes that the device manual lists for the code.
fn add_causes(device: &DeviceProfile, about: &FindingSubject, all: &mut Vec<Advice>) {
    let known = match about {
        FindingSubject::Code(code) => {
            device.error_entry(*code).map(|error| (&error.causes, &error.source, AdviceSource::Emcy))
        }
        FindingSubject::Fault(spn, fmi) => {
            device.trouble_code_entry(*spn, *fmi).map(|own| (&own.causes, &own.source, AdviceSource::Dtc))
        }
        _ => None,
    };
    let Some((causes, source, by)) = known else { return };
    for cause in causes {
        add_advice(all, cause, source, by);
    }
}

/// Adds transitions out of a fault state, from the device manual.
fn ways_out(node: &Node, all: &mut Vec<Advice>) {
    for (place, machine) in node.device().machines.iter().enumerate() {
        let Some(state) = node.reported_state(place).filter(|state| state.fault) else { continue };
        let from =
            machine.transitions.iter().filter(|it| it.from.0.contains(&state.name) && it.to != state.name);
        for (it, text) in from.filter_map(|it| Some((it, it.text.as_deref()?))) {
            let text = format!("from {} to {}: {text}", state.name, it.to);
            add_advice(all, &text, &machine.source, AdviceSource::State);
        }
    }
}
