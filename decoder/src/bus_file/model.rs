//! TOML model of the bus file and its checks.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;

use super::diff::DiffTolerances;
use super::initial::{AuthoredObject, AuthoredState};
use super::judgement::Judgement;
use super::settings::{AreaEntry, BIT_RATES, BusSettings, ProtocolChoice};
use super::written::{NO_IDENTIFIER, TextProblem, WrittenNumber, parse_address};
use super::{diff, judgement, uds};
use crate::frame::CanId;
use crate::profile::device::DeviceRule;
use crate::profile::{ExpectTable, IdentifierOwner, PdoName};
use crate::wire::NodeId;
use crate::wire::canopen::sdo::SdoSide;
use crate::wire::j1939::SpnConversion;

const NODE_ID: &str = "node-ID out of range; expected 1 to 127";

const SERVICES: &str = "nmt, sync, time, emcy, tpdo1 to tpdo512, rpdo1 to rpdo512, sdo-request, sdo-response, \
                        heartbeat, lss-master, lss-slave or none";

type Nodes = BTreeMap<Spanned<String>, NodeEntry>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AuthoredBusFile {
    #[serde(default)]
    pub(super) machine: Option<String>,
    #[serde(default)]
    dbc: NameEntries,
    #[serde(default)]
    master: Option<String>,
    #[serde(default)]
    bus: BTreeMap<String, BusTable>,
    #[serde(default)]
    node: Nodes,
    #[serde(default)]
    id: Vec<IdText>,
    #[serde(default)]
    uds: Vec<uds::UdsPairEntry>,
    #[serde(default)]
    rules: judgement::Rules,
    #[serde(default)]
    suppress: Vec<judgement::SuppressTable>,
    #[serde(default)]
    expect: Vec<ExpectTable>,
    #[serde(default)]
    rule: Vec<Spanned<DeviceRule>>,
    #[serde(default)]
    diff: diff::Table,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BusTable {
    #[serde(default)]
    bitrate: Option<Spanned<i64>>,
    #[serde(default)]
    protocol: Option<ProtocolChoice>,
    #[serde(default)]
    time_zone: Option<Spanned<String>>,
    #[serde(default)]
    master: Option<String>,
    #[serde(default)]
    dbc: NameEntries,
    #[serde(default)]
    node: Nodes,
    #[serde(default)]
    id: Vec<IdText>,
    #[serde(default)]
    uds: Vec<uds::UdsPairEntry>,
}

/// One file name or a list: `"a.dbc"`, or `["a.dbc", "b.dbc"]`.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a file name, or a list of file names")]
enum NameEntries {
    One(String),
    Many(Vec<String>),
}

impl Default for NameEntries {
    fn default() -> Self {
        Self::Many(Vec::new())
    }
}

impl From<NameEntries> for Vec<String> {
    fn from(files: NameEntries) -> Self {
        match files {
            NameEntries::One(file) => vec![file],
            NameEntries::Many(files) => files,
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NodeEntry {
    #[serde(default)]
    name: Option<String>,
    #[serde(default)]
    object: Vec<AuthoredObject>,
    #[serde(default)]
    device: Option<Spanned<String>>,
    /// Same as `eds`.
    #[serde(default)]
    dcf: Option<Spanned<String>>,
    #[serde(default)]
    eds: Option<String>,
    #[serde(default)]
    unit: BTreeMap<Spanned<String>, String>,
    #[serde(default)]
    tx_area: Vec<Spanned<String>>,
    #[serde(default)]
    rx_area: Vec<Spanned<String>>,
    #[serde(default)]
    spn_conversion: Option<Spanned<u8>>,
    #[serde(default)]
    state: Option<Spanned<AuthoredState>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct IdText {
    #[serde(rename = "id")]
    number: Spanned<WrittenNumber>,
    #[serde(default)]
    extended: bool,
    service: Spanned<String>,
    #[serde(default)]
    node: Option<Spanned<i64>>,
}

/// Settings of every bus, settings by bus name, rule settings, tolerances of comparisons.
pub(super) type Parts = (BusSettings, Vec<(String, BusSettings)>, Judgement, DiffTolerances);

impl AuthoredBusFile {
    /// Checks the file; returns the first problem.
    pub(super) fn check_file(self) -> Result<Parts, TextProblem> {
        let everywhere = build_settings(None, self.node, self.id, self.uds)?;
        let everywhere = BusSettings { databases: self.dbc.into(), master: self.master, ..everywhere };
        let buses = self.bus.into_iter().map(|(name, bus)| {
            let settings = build_settings(bus.bitrate, bus.node, bus.id, bus.uds)?;
            Ok((
                name,
                BusSettings {
                    databases: bus.dbc.into(),
                    master: bus.master,
                    protocol: bus.protocol,
                    time_zone: bus.time_zone.map(Into::into),
                    ..settings
                },
            ))
        });
        let judgement = judgement::check_judgement(self.rules, self.suppress, self.expect, self.rule)?;
        let buses = buses.collect::<Result<_, TextProblem>>()?;
        Ok((everywhere, buses, judgement, diff::check_tolerances(self.diff)?))
    }
}

fn build_settings(
    bit_rate: Option<Spanned<i64>>,
    nodes: Nodes,
    ids: Vec<IdText>,
    pairs: Vec<uds::UdsPairEntry>,
) -> Result<BusSettings, TextProblem> {
    let mut settings = BusSettings { uds: uds::check_pairs(pairs)?, ..BusSettings::default() };
    if let Some(rate) = bit_rate {
        let known = u32::try_from(*rate.get_ref()).ok().filter(|rate| BIT_RATES.contains(rate));
        let wrong = || {
            (rate.span(), "bitrate out of range; expected bit/s, such as 250000 for 250 kbit/s".to_owned())
        };
        settings.bit_rate = Some(known.ok_or_else(wrong)?);
    }
    let mut known: Vec<(NodeId, Range<usize>)> = Vec::new();
    for (key, node) in nodes {
        let id: NodeId = key.get_ref().parse().map_err(|message: &str| (key.span(), message.to_owned()))?;
        if let Some((_, other)) = known.iter().find(|(other, _)| *other == id) {
            // Keys are sorted by name; the error is reported at the later one in the file.
            let later = if other.start > key.span().start { other.clone() } else { key.span() };
            return Err((later, format!("duplicate entry for {}", id.sentence_label())));
        }
        known.push((id, key.span()));
        settings.nodes.push(id);
        settings.names.extend(node.name.map(|name| (id, name)));
        settings.devices.extend(node.device.map(|device| (id, device.into())));
        let file = device_file(node.eds, node.dcf)?;
        settings.device_files.extend(file.map(|file| (id, file)));
        for (object, unit) in node.unit {
            settings.units.push((id, parse_address(&object)?, unit));
        }
        for (name, list) in [("tx_area", node.tx_area), ("rx_area", node.rx_area)] {
            if !list.is_empty() {
                let list = list.iter().map(area_entry).collect::<Result<_, TextProblem>>()?;
                settings.areas.push((id, name.to_owned(), list));
            }
        }
        if let Some(version) = node.spn_conversion {
            settings.conversions.push((id, parse_conversion(id, &version)?));
        }
        for object in node.object {
            settings.objects.push(object.check_object(id)?);
        }
        if let Some(state) = node.state {
            settings.states.push((id, AuthoredState::check_state(state, id)?));
        }
    }
    for id in ids {
        let span = id.number.span();
        let (can_id, owner) = id.check_id()?;
        if settings.owners.iter().any(|(known, _)| *known == can_id) {
            return Err((span, format!("duplicate entry for {can_id}")));
        }
        settings.owners.push((can_id, owner));
    }
    Ok(settings)
}

/// The device file of a node, under either name of the key.
fn device_file(eds: Option<String>, dcf: Option<Spanned<String>>) -> Result<Option<String>, TextProblem> {
    match (eds, dcf) {
        (Some(_), Some(dcf)) => {
            Err((dcf.span(), "eds and dcf are the same key; expected one file per node".to_owned()))
        }
        (eds, dcf) => Ok(eds.or_else(|| dcf.map(Spanned::into_inner))),
    }
}

fn parse_conversion(id: NodeId, version: &Spanned<u8>) -> Result<SpnConversion, TextProblem> {
    let wrong = |message: &str| (version.span(), message.to_owned());
    if id.j1939().is_none() {
        return Err(wrong(
            "spn_conversion of a CANopen node; expected a J1939 address, such as [node.\"sa:0x0B\"]",
        ));
    }
    SpnConversion::try_from(*version.get_ref()).map_err(wrong)
}

fn area_entry(text: &Spanned<String>) -> Result<AreaEntry, TextProblem> {
    text.get_ref().parse().map_err(|message: &str| (text.span(), message.to_owned()))
}

impl IdText {
    fn check_id(&self) -> Result<(CanId, IdentifierOwner), TextProblem> {
        let id = self.number.get_ref().can_id(self.extended);
        let id = id.ok_or_else(|| (self.number.span(), NO_IDENTIFIER.to_owned()))?;
        let node = match &self.node {
            Some(node) => {
                let known = u8::try_from(*node.get_ref()).ok().filter(|id| (1..=127).contains(id));
                Some(known.ok_or_else(|| (node.span(), NODE_ID.to_owned()))?)
            }
            None => None,
        };
        Ok((id, self.parse_owner(node)?))
    }

    fn parse_owner(&self, node: Option<u8>) -> Result<IdentifierOwner, TextProblem> {
        let service = self.service.get_ref().as_str();
        let needed = node
            .ok_or_else(|| (self.service.span(), format!("node is missing; service {service} requires it")));
        let owner = match service {
            "emcy" => return needed.map(IdentifierOwner::Emcy),
            "heartbeat" => return needed.map(IdentifierOwner::ErrorControl),
            "sdo-request" => return needed.map(|node| IdentifierOwner::Sdo(SdoSide::Client, node)),
            "sdo-response" => return needed.map(|node| IdentifierOwner::Sdo(SdoSide::Server, node)),
            "nmt" => IdentifierOwner::Nmt,
            "sync" => IdentifierOwner::Sync,
            "time" => IdentifierOwner::Time,
            "lss-master" => IdentifierOwner::Lss(true),
            "lss-slave" => IdentifierOwner::Lss(false),
            "none" => IdentifierOwner::Unclassified,
            other => {
                let unknown =
                    || (self.service.span(), format!("unknown service '{other}'; expected {SERVICES}"));
                let name: PdoName = other.parse().map_err(|_| unknown())?;
                return needed.map(|node| IdentifierOwner::Pdo(name, node));
            }
        };
        match &self.node {
            Some(node) => {
                Err((node.span(), format!("service {service} does not belong to a node; remove node")))
            }
            None => Ok(owner),
        }
    }
}
