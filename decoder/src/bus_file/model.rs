//! TOML model of the bus file and its checks.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;

use super::diff::DiffTolerances;
use super::initial::{AuthoredObject, AuthoredState};
use super::judgement::Judgement;
use super::settings::{AreaEntry, BIT_RATES, ProtocolChoice, Settings};
use super::written::{NO_IDENTIFIER, Number, TextProblem, address};
use super::{diff, expectation, judgement, uds};
use crate::frame::CanId;
use crate::profile::{Owner, PdoName};
use crate::wire::NodeId;
use crate::wire::canopen::sdo::Side;
use crate::wire::j1939::SpnConversion;

const NODE_ID: &str = "node-ID out of range; expected 1 to 127";

const SERVICES: &str = "nmt, sync, time, emcy, tpdo1 to tpdo512, rpdo1 to rpdo512, sdo-request, sdo-response, \
                        heartbeat, lss-master, lss-slave or none";

type Nodes = BTreeMap<Spanned<String>, Node>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AuthoredBusFile {
    #[serde(default)]
    pub(super) machine: Option<String>,
    #[serde(default)]
    dbc: Files,
    #[serde(default)]
    master: Option<String>,
    #[serde(default)]
    bus: BTreeMap<String, Bus>,
    #[serde(default)]
    node: Nodes,
    #[serde(default)]
    id: Vec<Id>,
    #[serde(default)]
    uds: Vec<uds::Pair>,
    #[serde(default)]
    rules: judgement::Rules,
    #[serde(default)]
    suppress: Vec<judgement::Suppress>,
    #[serde(default)]
    expect: Vec<expectation::Entry>,
    #[serde(default)]
    diff: diff::Table,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Bus {
    #[serde(default)]
    bitrate: Option<Spanned<i64>>,
    #[serde(default)]
    protocol: Option<ProtocolChoice>,
    #[serde(default)]
    master: Option<String>,
    #[serde(default)]
    dbc: Files,
    #[serde(default)]
    node: Nodes,
    #[serde(default)]
    id: Vec<Id>,
    #[serde(default)]
    uds: Vec<uds::Pair>,
}

/// One file name or a list: `"a.dbc"`, or `["a.dbc", "b.dbc"]`.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a file name, or a list of file names")]
enum Files {
    One(String),
    Many(Vec<String>),
}

impl Default for Files {
    fn default() -> Self {
        Self::Many(Vec::new())
    }
}

impl From<Files> for Vec<String> {
    fn from(files: Files) -> Self {
        match files {
            Files::One(file) => vec![file],
            Files::Many(files) => files,
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Node {
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
struct Id {
    #[serde(rename = "id")]
    number: Spanned<Number>,
    #[serde(default)]
    extended: bool,
    service: Spanned<String>,
    #[serde(default)]
    node: Option<Spanned<i64>>,
}

/// Settings of every bus, settings by bus name, rule settings, tolerances of comparisons.
pub(super) type Parts = (Settings, Vec<(String, Settings)>, Judgement, DiffTolerances);

impl AuthoredBusFile {
    /// Checks the file; returns the first problem.
    pub(super) fn check(self) -> Result<Parts, TextProblem> {
        let everywhere = settings(None, self.node, self.id, self.uds)?;
        let everywhere = Settings { databases: self.dbc.into(), master: self.master, ..everywhere };
        let buses = self.bus.into_iter().map(|(name, bus)| {
            let settings = settings(bus.bitrate, bus.node, bus.id, bus.uds)?;
            Ok((
                name,
                Settings {
                    databases: bus.dbc.into(),
                    master: bus.master,
                    protocol: bus.protocol,
                    ..settings
                },
            ))
        });
        let judgement = judgement::check(self.rules, self.suppress, self.expect)?;
        let buses = buses.collect::<Result<_, TextProblem>>()?;
        Ok((everywhere, buses, judgement, diff::check(self.diff)?))
    }
}

fn settings(
    bit_rate: Option<Spanned<i64>>,
    nodes: Nodes,
    ids: Vec<Id>,
    pairs: Vec<uds::Pair>,
) -> Result<Settings, TextProblem> {
    let mut settings = Settings { uds: uds::check(pairs)?, ..Settings::default() };
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
            return Err((later, format!("duplicate entry for {}", id.words())));
        }
        known.push((id, key.span()));
        settings.nodes.push(id);
        settings.names.extend(node.name.map(|name| (id, name)));
        settings.devices.extend(node.device.map(|device| (id, device.into())));
        let file = device_file(node.eds, node.dcf)?;
        settings.device_files.extend(file.map(|file| (id, file)));
        for (object, unit) in node.unit {
            settings.units.push((id, address(&object)?, unit));
        }
        for (name, list) in [("tx_area", node.tx_area), ("rx_area", node.rx_area)] {
            if !list.is_empty() {
                let list = list.iter().map(area_entry).collect::<Result<_, TextProblem>>()?;
                settings.areas.push((id, name.to_owned(), list));
            }
        }
        if let Some(version) = node.spn_conversion {
            settings.conversions.push((id, conversion(id, &version)?));
        }
        for object in node.object {
            settings.objects.push(object.check(id)?);
        }
        if let Some(state) = node.state {
            settings.states.push((id, AuthoredState::check(state, id)?));
        }
    }
    for id in ids {
        let span = id.number.span();
        let (can_id, owner) = id.check()?;
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

fn conversion(id: NodeId, version: &Spanned<u8>) -> Result<SpnConversion, TextProblem> {
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

impl Id {
    fn check(&self) -> Result<(CanId, Owner), TextProblem> {
        let id = self.number.get_ref().can_id(self.extended);
        let id = id.ok_or_else(|| (self.number.span(), NO_IDENTIFIER.to_owned()))?;
        let node = match &self.node {
            Some(node) => {
                let known = u8::try_from(*node.get_ref()).ok().filter(|id| (1..=127).contains(id));
                Some(known.ok_or_else(|| (node.span(), NODE_ID.to_owned()))?)
            }
            None => None,
        };
        Ok((id, self.owner(node)?))
    }

    fn owner(&self, node: Option<u8>) -> Result<Owner, TextProblem> {
        let service = self.service.get_ref().as_str();
        let needed = node
            .ok_or_else(|| (self.service.span(), format!("node is missing; service {service} requires it")));
        let owner = match service {
            "emcy" => return needed.map(Owner::Emcy),
            "heartbeat" => return needed.map(Owner::ErrorControl),
            "sdo-request" => return needed.map(|node| Owner::Sdo(Side::Client, node)),
            "sdo-response" => return needed.map(|node| Owner::Sdo(Side::Server, node)),
            "nmt" => Owner::Nmt,
            "sync" => Owner::Sync,
            "time" => Owner::Time,
            "lss-master" => Owner::Lss(true),
            "lss-slave" => Owner::Lss(false),
            "none" => Owner::Unclassified,
            other => {
                let unknown =
                    || (self.service.span(), format!("unknown service '{other}'; expected {SERVICES}"));
                let name: PdoName = other.parse().map_err(|_| unknown())?;
                return needed.map(|node| Owner::Pdo(name, node));
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
