//! Present state of buses as settings of a bus file, with which a later part of a capture is decoded as within the
//! whole capture.

use super::bus::{Bus, Node, OriginKind, RestartType, StoredOrigin};
use super::buses::Buses;
use crate::bus_file::{
    BaseFile, BusSettings, InitialNmtState, InitialState, InitialValue, ObjectValue, PendingReset,
    ProtocolChoice, SpannedText, ValueOrigin, ValueRole, write_bus_file,
};
use crate::event::{AssignedBy, StateCertainty};
use crate::profile::{DataType, TextError};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Max size of a value in the bus file, in bytes.
const VALUE_LIMIT: usize = 256;

/// Number of omitted values listed in the comments of the file.
const LISTED: usize = 20;

/// State of all buses of a capture after a frame.
#[derive(Debug, Clone, Default)]
pub struct BusSnapshot {
    /// Settings of all buses.
    pub everywhere: BusSettings,
    /// Settings by bus name.
    pub buses: Vec<(String, BusSettings)>,
    /// Values that are too large for the file, as text.
    omitted: Vec<String>,
}

impl BusSnapshot {
    /// Present state of the buses.
    pub fn snapshot_of(buses: Buses<'_>) -> Self {
        let mut snapshot = Self::default();
        for bus in buses {
            let settings = snapshot.bus_settings(bus);
            snapshot.buses.push((bus.name().to_owned(), settings));
        }
        snapshot
    }

    /// Settings of a bus, created if needed.
    pub fn bus_mut(&mut self, name: &str) -> &mut BusSettings {
        let place = self.buses.iter().position(|(known, _)| known == name).unwrap_or_else(|| {
            self.buses.push((name.to_owned(), BusSettings::default()));
            self.buses.len() - 1
        });
        match self.buses.get_mut(place) {
            Some((_, settings)) => settings,
            None => &mut self.everywhere,
        }
    }

    /// The bus file: `base` with the state; its first comment line is `title`.
    ///
    /// # Errors
    /// The base is not a TOML file.
    pub fn bus_file_text(&self, base: &BaseFile<'_>, title: &str) -> Result<String, TextError> {
        let mut comments = vec![title.to_owned()];
        comments.extend(self.omitted.iter().take(LISTED).cloned());
        if let Some(more) = self.omitted.len().checked_sub(LISTED).filter(|more| *more > 0) {
            comments.push(format!("and {more} more values omitted"));
        }
        write_bus_file(base, &self.everywhere, &self.buses, &comments)
    }

    fn bus_settings(&mut self, bus: &Bus) -> BusSettings {
        let given = bus.options.bus_file.uds(bus.name()).count();
        let mut settings = BusSettings {
            protocol: proven_protocol(bus),
            bit_rate: bus.bit_rate(),
            uds: bus.uds_pairs.all_pairs().iter().skip(given).cloned().collect(),
            ..BusSettings::default()
        };
        for node in bus.nodes.all() {
            // An entry would settle the protocol of a node whose traffic may be something else.
            if bus.protocols.is_settled(Some(node.id)) {
                self.add_node(bus, node, &mut settings);
            }
        }
        settings
    }

    fn add_node(&mut self, bus: &Bus, node: &Node, settings: &mut BusSettings) {
        let id = node.id;
        settings.nodes.push(id);
        settings.names.extend(node.name().map(|name| (id, name.to_owned())));
        settings
            .devices
            .extend(assigned_device(bus, node).map(|text| (id, SpannedText { text, span: 0..0 })));
        settings.states.extend(initial_state(node).map(|state| (id, state)));
        let store = node.store();
        for (address, entry) in store.sorted() {
            if matches!(entry.origin.kind, OriginKind::BusFile | OriginKind::DeviceFile) {
                continue;
            }
            if entry.value.len() > VALUE_LIMIT || entry.size > entry.value.len() as u64 {
                self.omitted.push(format!(
                    "omitted: {} {} {address}, {} bytes (limit {VALUE_LIMIT})",
                    bus.name(),
                    id.sentence_label(),
                    entry.size
                ));
                continue;
            }
            settings.objects.push(InitialValue {
                is_assumed: entry.stale,
                ..initial_value(id, address, &entry.value, Some(entry.origin))
            });
        }
        for (address, raw) in &node.behaviour.words {
            let bytes = word_bytes(node, *address, *raw);
            let object = initial_value(id, *address, &bytes, None);
            settings.objects.push(InitialValue { role: ValueRole::Process, ..object });
        }
        for (address, pending) in store.all_waiting() {
            let object = initial_value(id, address, &pending.value, Some(pending.origin));
            settings.objects.push(InitialValue { role: ValueRole::Pending, ..object });
        }
        for (address, kept) in store.all_kept() {
            let object = initial_value(id, address, kept, None);
            settings.objects.push(InitialValue { role: ValueRole::Stored, ..object });
        }
    }
}

fn initial_value(
    node: NodeId,
    address: ObjectAddress,
    bytes: &[u8],
    origin: Option<StoredOrigin>,
) -> InitialValue {
    let kind = origin.and_then(|origin| match origin.kind {
        OriginKind::Download => Some(ValueOrigin::Download),
        OriginKind::Upload => Some(ValueOrigin::Upload),
        OriginKind::Pdo => Some(ValueOrigin::Pdo),
        OriginKind::BusFile | OriginKind::DeviceFile => None,
    });
    InitialValue {
        origin: kind,
        frame: origin.map(|origin| origin.frame).filter(|frame| *frame > 0),
        ..InitialValue::new(node, address, ObjectValue::Bytes(bytes.to_vec()))
    }
}

/// Bytes of a value in a PDO, in the width of its object.
fn word_bytes(node: &Node, address: ObjectAddress, raw: u64) -> Vec<u8> {
    let bits = node.device.dictionary.data_type(address).and_then(DataType::bits).unwrap_or(64);
    raw.to_le_bytes().into_iter().take(usize::from(bits.div_ceil(8))).collect()
}

/// Protocol that the user stated or the traffic proved.
fn proven_protocol(bus: &Bus) -> Option<ProtocolChoice> {
    match bus.protocols.choice {
        ProtocolChoice::Auto if bus.protocols.canopen.is_confirmed() => Some(ProtocolChoice::Canopen),
        ProtocolChoice::Auto if bus.protocols.j1939.is_confirmed() => Some(ProtocolChoice::J1939),
        ProtocolChoice::Auto if is_without_protocol(bus) => Some(ProtocolChoice::None),
        ProtocolChoice::Auto => None,
        chosen => Some(chosen),
    }
}

/// Whether CANopen was rejected and no frame suggests another protocol.
fn is_without_protocol(bus: &Bus) -> bool {
    bus.protocols.is_canopen_rejected()
        && !bus.protocols.has_uds
        && !bus.routes.has_extended()
        && !bus.protocols.named.names_canopen()
}

/// Profile that the user assigned or the identity selected. A generic one for a device type is found again.
fn assigned_device(bus: &Bus, node: &Node) -> Option<String> {
    let is_own = matches!(
        node.assigned?,
        AssignedBy::Option | AssignedBy::BusFile | AssignedBy::DeviceFile | AssignedBy::Identity
    );
    let id = node.device_id().filter(|_| is_own && !node.device.is_file_alone())?;
    bus.catalogue().device(id).is_ok().then(|| id.to_owned())
}

/// Reported states in the order of the state machines; empty if none is known.
fn device_states(node: &Node) -> Vec<String> {
    let name = |place| node.reported_state(place).map_or_else(String::new, |state| state.name.clone());
    let names: Vec<String> = (0..node.device.machines.len()).map(name).collect();
    if names.iter().all(String::is_empty) { Vec::new() } else { names }
}

/// State of a node; `None` if nothing is known.
fn initial_state(node: &Node) -> Option<InitialState> {
    let state = InitialState {
        nmt: node.nmt.map(|nmt| InitialNmtState {
            state: nmt.state,
            is_assumed: nmt.certainty == StateCertainty::Presumed,
            is_reported: nmt.is_reported(),
        }),
        is_lost: node.lost,
        is_saved: node.saved,
        errors: node.active_errors().to_vec(),
        reset: node.reset_frame.and_then(|(_, restart)| match restart {
            RestartType::Communication => Some(PendingReset::Communication),
            RestartType::Node => Some(PendingReset::Node),
            RestartType::PowerOn => None,
        }),
        name: node.j1939_name(),
        device: device_states(node),
    };
    (state != InitialState::default()).then_some(state)
}
