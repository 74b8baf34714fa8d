//! State of nodes, set points and periodic messages at the moment of a fault.

use serde::Serialize;

use super::ground::AnswerGround;
use crate::answers::numbers::{to_millis, to_seconds};
use crate::answers::statistics::SpnFmi;
use crate::event::StateCertainty;
use crate::frame::Timestamp;
use crate::session::GateState;
use crate::why::{ControllerReaction, MessageRhythm, NodeState, PointState, StoppedMessage};

/// State of a node.
#[derive(Debug, Clone, Serialize)]
pub struct NodeSituation {
    /// Active trouble codes.
    pub active_dtcs: Vec<SpnFmi>,
    /// Active EMCY codes.
    pub active_errors: Vec<String>,
    /// Bus.
    pub bus: Option<String>,
    /// Profile.
    pub device: Option<String>,
    /// Silent for longer than its monitoring time.
    pub lost: bool,
    /// Name in the bus file.
    pub name: Option<String>,
    /// NMT state.
    pub nmt: Option<&'static str>,
    /// Whether the state is confirmed.
    pub nmt_confirmed: bool,
    /// Node-ID or J1939 address.
    pub node: u8,
    /// Set points received.
    pub set_points: Vec<SetPointSituation>,
    /// States of the device.
    pub states: Vec<DeviceStateName>,
}

/// A state that a device reports.
#[derive(Debug, Clone, Serialize)]
pub struct DeviceStateName {
    /// Channel.
    pub channel: Option<u8>,
    /// State reported by the device.
    pub state: String,
}

/// The last set point that a node received, and its effect.
#[derive(Debug, Clone, Serialize)]
pub struct SetPointSituation {
    /// The value depends on an assumption.
    pub assumed: bool,
    /// Channel of the device.
    pub channel: Option<u8>,
    /// yes, no or unknown.
    pub effective: &'static str,
    /// Conditions of the set point.
    pub gates: Vec<GateSituation>,
    /// Object of the set point.
    pub object: String,
    /// Name.
    pub signal: String,
    /// Value with its unit.
    pub text: String,
    /// Unit.
    pub unit: String,
    /// Value as a number.
    pub value: Option<f64>,
}

/// A condition of a set point.
#[derive(Debug, Clone, Serialize)]
pub struct GateSituation {
    /// Action that opens the gate.
    pub check: String,
    /// Fact that decided.
    pub detail: String,
    /// Name of the condition.
    pub gate: String,
    /// Section of the manual.
    pub source: String,
    /// open, closed, unknown or not on the bus.
    pub status: &'static str,
    /// Effect of the closed gate.
    pub text: String,
}

/// A periodic message that had stopped.
#[derive(Debug, Clone, Serialize)]
pub struct SilentMessage {
    /// Time since the last one, in seconds.
    pub gap: f64,
    /// Frame of the last one.
    pub last_frame: u64,
    /// Usual interval, in seconds.
    pub usual: f64,
    /// sync, guard-request or the RPDO.
    pub what: String,
}

/// Reaction time of the controller to one TPDO of a node.
#[derive(Debug, Clone, Serialize)]
pub struct ReactionSummary {
    /// Bus.
    pub bus: Option<String>,
    /// Number of reactions.
    pub count: u64,
    /// Time of the maximum, in seconds from the first frame.
    pub max_at: Option<String>,
    /// Frame of the maximum.
    pub max_frame: u64,
    /// Maximum.
    pub max_ms: f64,
    /// Node.
    pub node: u8,
    /// Median.
    pub p50_ms: Option<f64>,
    /// 99 %.
    pub p99_ms: Option<f64>,
    /// RPDO.
    pub rpdo: String,
    /// TPDO.
    pub tpdo: String,
}

impl NodeSituation {
    pub(super) fn new(state: &NodeState, ground: &AnswerGround<'_>) -> Self {
        let node = ground.bus(state.bus).and_then(|bus| bus.node(state.node));
        let states = state.states.iter().cloned();
        Self {
            active_dtcs: state.dtcs.iter().map(|(spn, fmi)| SpnFmi { fmi: *fmi, spn: *spn }).collect(),
            active_errors: state.errors.iter().map(|code| format!("0x{code:04X}")).collect(),
            bus: ground.bus_name(state.bus),
            device: node.and_then(|node| node.device_id()).map(str::to_owned),
            lost: state.lost,
            name: node.and_then(|node| node.name()).map(str::to_owned),
            nmt: state.nmt.map(|nmt| nmt.state.name()),
            nmt_confirmed: state.nmt.is_some_and(|nmt| nmt.certainty == StateCertainty::Confirmed),
            node: state.node.number(),
            set_points: state.set_points.iter().map(SetPointSituation::new).collect(),
            states: states.map(|(channel, state)| DeviceStateName { channel, state }).collect(),
        }
    }
}

impl SetPointSituation {
    fn new(state: &PointState) -> Self {
        let point = &state.point;
        Self {
            assumed: point.assumed,
            channel: point.channel,
            effective: state.effective.name(),
            gates: state.gates.iter().map(GateSituation::new).collect(),
            object: format!("0x{}", point.object),
            signal: point.signal.clone(),
            text: point.to.text.clone(),
            unit: point.unit.clone(),
            value: point.to.number,
        }
    }
}

impl GateSituation {
    fn new(gate: &GateState) -> Self {
        Self {
            check: gate.check.clone(),
            detail: gate.detail.clone(),
            gate: gate.gate.clone(),
            source: gate.source.clone(),
            status: gate.status.name(),
            text: gate.text.clone(),
        }
    }
}

impl SilentMessage {
    pub(super) fn new(message: &StoppedMessage) -> Self {
        Self {
            gap: to_seconds(message.gap),
            last_frame: message.last_frame,
            usual: to_seconds(message.usual),
            what: match message.what {
                MessageRhythm::Sync => "sync".to_owned(),
                MessageRhythm::Guarding => "guard-request".to_owned(),
                MessageRhythm::Rpdo(name) => name.to_string(),
            },
        }
    }
}

impl ReactionSummary {
    pub(super) fn new(reaction: &ControllerReaction, ground: &AnswerGround<'_>) -> Self {
        let ControllerReaction { bus, node, time } = reaction;
        let part = |part| time.times.percentile(part).map(to_millis);
        let (at, frame) = time.longest_at;
        Self {
            bus: ground.bus_name(*bus),
            count: time.times.duration_count(),
            max_at: ground.first.map(|first| Timestamp(at.saturating_sub(first.0)).to_string()),
            max_frame: frame,
            max_ms: to_millis(time.times.longest()),
            node: node.number(),
            p50_ms: part(50),
            p99_ms: part(99),
            rpdo: time.rpdo.to_string(),
            tpdo: time.tpdo.to_string(),
        }
    }
}
