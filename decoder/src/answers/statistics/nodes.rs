//! Statistics of the nodes of a bus.

use std::collections::BTreeMap;

use serde::Serialize;

use super::figures::{DurationFigures, IntervalFigures};
use crate::answers::numbers::{to_millis, to_seconds};
use crate::event::StateCertainty;
use crate::session::{Bus, Node};
use crate::standard_tables::{function_name, manufacturer_name};
use crate::statistics::{
    AddressStatistics, BusStatistics, CodeCounts, DeviceProduct, NodeStatistics, ReactionTime, dtc_of_key,
};
use crate::wire::NodeId;
use crate::wire::j1939::J1939Name;

/// Statistics of one CANopen node.
#[derive(Debug, Clone, Serialize)]
pub struct NodeFigures {
    /// Number of boot-ups.
    pub boots: u64,
    /// Active EMCY codes.
    pub emcy_active: usize,
    /// EMCY messages by error code.
    pub emcy_codes: BTreeMap<String, u64>,
    /// Time between guarding requests.
    pub guard_period_ms: Option<IntervalFigures>,
    /// Guarding responses.
    pub guard_replies: u64,
    /// Guarding requests.
    pub guard_requests: u64,
    /// Median time between heartbeats.
    pub heartbeat_median_ms: Option<f64>,
    /// Time between heartbeats.
    pub heartbeat_ms: Option<IntervalFigures>,
    /// How often it was lost.
    pub lost: u64,
    /// Name in the bus file.
    pub name: Option<String>,
    /// NMT state at the end.
    pub nmt: Option<&'static str>,
    /// Whether the NMT state is confirmed.
    pub nmt_confirmed: Option<bool>,
    /// Node-ID.
    pub node: u8,
    /// Names and identifiers of its PDOs.
    pub pdo_ids: Vec<[String; 2]>,
    /// Number of PDOs.
    pub pdos: u64,
    /// Times from a changed TPDO to the next changed RPDO.
    pub reactions: Vec<ReactionFigures>,
    /// SDO transfers with the node as server.
    pub sdo: SdoServerFigures,
    /// Time of the last heartbeat before it stopped, in s.
    pub silent_since: Option<f64>,
}

/// Reaction times of the controller to one TPDO.
#[derive(Debug, Clone, Serialize)]
pub struct ReactionFigures {
    /// Time of the longest reaction, in s.
    pub max_at: f64,
    /// Frame of the longest reaction.
    pub max_frame: u64,
    /// RPDO.
    pub rpdo: String,
    /// Reaction times.
    pub time_ms: Option<DurationFigures>,
    /// TPDO.
    pub tpdo: String,
}

/// SDO transfers with a node as server.
#[derive(Debug, Clone, Serialize)]
pub struct SdoServerFigures {
    /// Aborted transfers by abort code.
    pub abort_codes: BTreeMap<String, u64>,
    /// Aborted transfers.
    pub aborted: u64,
    /// Complete transfers.
    pub complete: u64,
    /// Duration of complete and aborted transfers.
    pub duration_ms: Option<DurationFigures>,
    /// Superseded transfers, and those unfinished at the end.
    pub other: u64,
    /// Time from the end of a transfer to the client's next request.
    pub think_time_ms: Option<DurationFigures>,
    /// Transfers without a response.
    pub timeout: u64,
}

/// Statistics of one J1939 source address.
#[derive(Debug, Clone, Serialize)]
pub struct J1939DeviceFigures {
    /// Source address.
    pub address: u8,
    /// Address claims.
    pub claims: u64,
    /// Profile.
    pub device: Option<String>,
    /// Trouble codes that were raised.
    pub dtcs: Vec<RaisedDtc>,
    /// Active trouble codes.
    pub dtcs_active: Vec<SpnFmi>,
    /// Number of frames.
    pub frames: u64,
    /// Function, from the NAME.
    pub function: Option<u8>,
    /// Instance of the function, from the NAME.
    pub function_instance: Option<u8>,
    /// Name of the function.
    pub function_name: Option<&'static str>,
    /// Parameter groups.
    pub groups: Vec<u32>,
    /// Industry group, from the NAME.
    pub industry_group: Option<u8>,
    /// NAME of the address claim.
    pub j1939_name: Option<String>,
    /// Make of the component, from its identification.
    pub make: Option<String>,
    /// Name of the manufacturer.
    pub manufacturer: Option<&'static str>,
    /// Manufacturer code, from the NAME.
    pub manufacturer_code: Option<u16>,
    /// Model, from its identification or product information.
    pub model: Option<String>,
    /// Name in the bus file.
    pub name: Option<String>,
    /// Serial number, from its identification or product information.
    pub serial_number: Option<String>,
    /// Software version, from its identification or product information.
    pub software: Option<String>,
    /// Vehicle identification number.
    pub vehicle: Option<String>,
}

/// A trouble code with its number of occurrences.
#[derive(Debug, Clone, Serialize)]
pub struct RaisedDtc {
    /// FMI.
    pub fmi: u8,
    /// How often it was raised.
    pub raised: u64,
    /// SPN.
    pub spn: u32,
}

/// A trouble code.
#[derive(Debug, Clone, Serialize)]
pub struct SpnFmi {
    /// FMI.
    pub fmi: u8,
    /// SPN.
    pub spn: u32,
}

impl NodeFigures {
    pub(super) fn new(bus: &Bus, id: NodeId, figures: &NodeStatistics, end: Option<i64>) -> Self {
        let known = bus.node(id);
        let nmt = known.and_then(Node::nmt);
        let median = figures.heartbeat_distribution.percentile(50);
        let pdos = figures.pdo_ids.iter().map(|(name, id)| [name.to_string(), id.to_string()]);
        Self {
            boots: figures.boots,
            emcy_active: known.map_or(0, |node| node.active_errors().len()),
            emcy_codes: count_codes(&figures.emcy, 4),
            guard_period_ms: IntervalFigures::new(&figures.guard_requests),
            guard_replies: figures.guarding.1,
            guard_requests: figures.guarding.0,
            heartbeat_median_ms: median.map(to_millis),
            heartbeat_ms: IntervalFigures::new(&figures.heartbeat),
            lost: figures.lost,
            name: known.and_then(|node| node.name()).map(str::to_owned),
            nmt: nmt.map(|nmt| nmt.state.name()),
            nmt_confirmed: nmt.map(|nmt| nmt.certainty == StateCertainty::Confirmed),
            node: id.number(),
            pdo_ids: pdos.collect(),
            pdos: figures.pdos,
            reactions: figures.reactions.pairs().iter().map(ReactionFigures::new).collect(),
            sdo: SdoServerFigures::new(figures),
            silent_since: figures.heartbeat.silent_since(end).map(to_seconds),
        }
    }
}

impl ReactionFigures {
    fn new(pair: &ReactionTime) -> Self {
        let (time, frame) = pair.longest_at;
        Self {
            max_at: to_seconds(time),
            max_frame: frame,
            rpdo: pair.rpdo.to_string(),
            time_ms: DurationFigures::new(&pair.times),
            tpdo: pair.tpdo.to_string(),
        }
    }
}

impl SdoServerFigures {
    fn new(node: &NodeStatistics) -> Self {
        Self {
            abort_codes: count_codes(&node.aborts, 8),
            aborted: node.sdo.aborted,
            complete: node.sdo.complete,
            duration_ms: DurationFigures::new(&node.sdo_duration),
            other: node.sdo.other,
            think_time_ms: DurationFigures::new(&node.think_time),
            timeout: node.sdo.timeout,
        }
    }
}

impl J1939DeviceFigures {
    /// All source addresses of a J1939 bus.
    pub(super) fn all(bus: &Bus, statistics: &BusStatistics) -> Vec<Self> {
        if !bus.protocols().is_j1939() {
            return Vec::new();
        }
        let addresses = statistics.addresses().into_iter();
        addresses.map(|(address, figures)| Self::new(bus, statistics, address, &figures)).collect()
    }

    fn new(bus: &Bus, statistics: &BusStatistics, address: u8, figures: &AddressStatistics) -> Self {
        let id = NodeId::J1939(address);
        let (known, counted) = (bus.node(id), statistics.node(id));
        let name = known.and_then(Node::j1939_name);
        let fields = name.map(J1939Name::fields);
        let raised = counted.into_iter().flat_map(|node| node.dtcs.sort_by_count());
        let raised = raised.map(|(key, raised)| {
            let (spn, fmi) = dtc_of_key(key);
            RaisedDtc { fmi, raised, spn }
        });
        let active = known.into_iter().flat_map(Node::active_dtcs);
        let product = counted.map_or(DeviceProduct::default(), |node| node.product.clone());
        Self {
            address,
            claims: counted.map_or(0, |node| node.claims),
            device: known.and_then(|node| node.device_id()).map(str::to_owned),
            dtcs: raised.collect(),
            dtcs_active: active.map(|(spn, fmi)| SpnFmi { fmi, spn }).collect(),
            frames: figures.frames,
            function: fields.map(|fields| fields.function),
            function_instance: fields.map(|fields| fields.function_instance),
            function_name: fields.as_ref().and_then(function_name),
            groups: figures.groups.iter().map(|group| group.number()).collect(),
            industry_group: fields.map(|fields| fields.industry_group),
            j1939_name: name.map(|name| format!("0x{:016X}", name.0)),
            make: product.make,
            manufacturer: fields.as_ref().and_then(manufacturer_name),
            manufacturer_code: fields.map(|fields| fields.manufacturer_code),
            model: product.model,
            name: known.and_then(|node| node.name()).map(str::to_owned),
            serial_number: product.serial_number,
            software: product.software,
            vehicle: product.vehicle,
        }
    }
}

/// Number of occurrences of each code, by its hexadecimal text.
fn count_codes(counts: &CodeCounts, digits: usize) -> BTreeMap<String, u64> {
    let all = counts.sort_by_count().into_iter();
    all.map(|(code, count)| (format!("0x{code:0digits$X}"), count)).collect()
}
