//! State of a node at a position of a capture, for a list of nodes. Its texts are escaped.

use serde::Serialize;

use super::numbers::to_seconds;
use crate::event::StateCertainty;
use crate::frame::Timestamp;
use crate::session::{AssignedBy, Bus, GateState, GateStatus, LifeWatch, Node};
use crate::sink::escape;
use crate::wire::NodeId;

/// A node.
#[derive(Debug, Clone, Serialize)]
pub struct NodeOverview {
    /// Last sign of life; null without timestamps.
    pub alive: Option<TonedText>,
    /// Origin of the profile.
    pub assigned: Option<&'static str>,
    /// Frame of the last boot-up.
    pub boot_frame: Option<u64>,
    /// Number of boot-ups.
    pub boots: u32,
    /// Index of the bus.
    pub bus: u8,
    /// Name of the bus.
    pub bus_name: String,
    /// Title of the device.
    pub device: Option<String>,
    /// Active EMCY codes, and trouble codes as SPN/FMI.
    pub errors: Vec<String>,
    /// Gates that are not open.
    pub gates: Vec<GateOverview>,
    /// A J1939 address.
    pub j1939: bool,
    /// Silent for longer than its monitoring time.
    pub lost: bool,
    /// Name in the bus file.
    pub name: Option<String>,
    /// NMT state.
    pub nmt: Option<&'static str>,
    /// Node-ID or J1939 address.
    pub node: u8,
    /// Node-ID in decimal and hexadecimal digits, or source address.
    pub number: String,
    /// Number of known objects.
    pub objects: usize,
    /// The NMT state is not confirmed.
    pub presumed: bool,
    /// Profile.
    pub profile: Option<String>,
    /// Set points received.
    pub set_points: Vec<SetPointOverview>,
    /// States that the device reports.
    pub states: Vec<TonedText>,
}

/// A text with its colour: good, plain, caution or bad.
#[derive(Debug, Clone, Serialize)]
pub struct TonedText {
    /// Text.
    pub text: String,
    /// Class of the colour.
    pub tone: &'static str,
}

/// The last set point of an output.
#[derive(Debug, Clone, Serialize)]
pub struct SetPointOverview {
    /// Whether it has an effect: yes, no or unknown.
    pub effective: &'static str,
    /// Name.
    pub name: String,
    /// Value with its unit.
    pub value: String,
}

/// A condition of a set point.
#[derive(Debug, Clone, Serialize)]
pub struct GateOverview {
    /// Action that opens the gate.
    pub advice: String,
    /// Fact that decided.
    pub detail: String,
    /// Name of the condition.
    pub gate: String,
    /// Name of the set point.
    pub set_point: String,
    /// closed, unknown or not on the bus.
    pub status: &'static str,
}

impl NodeOverview {
    /// The node at `now`; `boot_frame` is the frame of its last boot-up.
    pub fn new(bus: &Bus, node: &Node, now: Option<Timestamp>, boot_frame: Option<u64>) -> Self {
        let text = |text: &str| escape(text).into_owned();
        let dtcs = node.active_dtcs().map(|(spn, fmi)| format!("{spn}/{fmi}"));
        let errors = node.active_errors().iter().map(|code| format!("{code:04X}")).chain(dtcs);
        let gates = bus.gates(node.id());
        let gates = gates.iter().filter(|gate| gate.status != GateStatus::Open);
        Self {
            alive: find_sign_of_life(bus, node, now),
            assigned: node.assigned_by().map(AssignedBy::name),
            boot_frame,
            boots: node.boot_count(),
            bus: bus.index().0,
            bus_name: text(bus.name()),
            device: node.device_title().map(text),
            errors: errors.collect(),
            gates: gates.map(GateOverview::new).collect(),
            j1939: matches!(node.id(), NodeId::J1939(_)),
            lost: node.is_lost(),
            name: node.name().map(text),
            nmt: node.nmt().map(|nmt| nmt.state.name()),
            node: node.id().number(),
            number: node.id().label(),
            objects: node.store().len(),
            presumed: node.nmt().is_some_and(|nmt| nmt.certainty == StateCertainty::Presumed),
            profile: node.device_id().map(text),
            set_points: set_points(node),
            states: states(node),
        }
    }
}

impl GateOverview {
    fn new(gate: &GateState) -> Self {
        Self {
            advice: escape(&gate.gate_advice()).into_owned(),
            detail: escape(&gate.detail).into_owned(),
            gate: escape(&gate.gate).into_owned(),
            set_point: escape(&gate.name).into_owned(),
            status: gate.status.name(),
        }
    }
}

fn set_points(node: &Node) -> Vec<SetPointOverview> {
    let all = node.set_points().map(|point| SetPointOverview {
        effective: point.effective.name(),
        name: escape(&point.meaning.name).into_owned(),
        value: format!("{}{}", escape(&point.quantity.text), if point.is_assumed { "?" } else { "" }),
    });
    all.collect()
}

fn states(node: &Node) -> Vec<TonedText> {
    let all = node.device_states().map(|(channel, state)| {
        let name = escape(&state.name);
        let tone = match (state.fault, state.active) {
            (true, _) => "bad",
            (false, true) => "good",
            (false, false) => "plain",
        };
        TonedText { text: channel.map_or(name.to_string(), |channel| format!("c{channel} {name}")), tone }
    });
    all.collect()
}

/// Age of the last sign of life, its limit, and whether it is exceeded.
fn find_sign_of_life(bus: &Bus, node: &Node, now: Option<Timestamp>) -> Option<TonedText> {
    let Some(sign) = bus.sign_of_life(node.id()) else {
        return Some(TonedText { text: "never".to_owned(), tone: "caution" });
    };
    let past = now?.since(bus.stamp_of(sign.last)?);
    let kind = match &sign.by {
        LifeWatch::Heartbeat => "HB".to_owned(),
        LifeWatch::Guarding => "GD".to_owned(),
        LifeWatch::Message(name) => escape(name).into_owned(),
        LifeWatch::Boot => "boot".to_owned(),
        LifeWatch::Any => "rx".to_owned(),
    };
    let expected = sign.expected.map_or(String::new(), |it| format!(" of {} s", to_seconds(it)));
    let is_past = |limit: Option<i64>| limit.is_some_and(|limit| past > limit);
    let tone = match () {
        () if node.is_lost() || is_past(sign.limit) => "bad",
        () if is_past(sign.expected.map(|expected| expected.saturating_mul(3) / 2)) => "caution",
        () => "plain",
    };
    Some(TonedText { text: format!("{kind} {:.1}{expected}", to_seconds(past)), tone })
}
