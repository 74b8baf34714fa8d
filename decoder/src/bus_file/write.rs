//! Writes a bus file: the one of the user, with further settings.

use toml::{Table, Value};

use super::initial::{InitialNmtState, InitialState, InitialValue, ValueRole};
use super::settings::{BusSettings, ProtocolChoice};
use super::uds::UdsPair;
use super::value::ObjectValue;
use crate::frame::CanId;
use crate::profile::{IdentifierOwner, TextError};
use crate::wire::NodeId;
use crate::wire::canopen::sdo::SdoSide;

/// Max length of a comment line, in characters.
const LONGEST_COMMENT: usize = 200;

/// Bus file of the user, which a written one extends.
pub struct BaseFile<'a> {
    /// Text of the file; empty for none.
    pub text: &'a str,
    /// Converts a file name in it for the folder of the written file.
    pub rename: &'a dyn Fn(&str) -> String,
}

/// Adds the settings of buses to a bus file. Settings are added to those of the base; a name, device, device file or
/// state of a node, a bit rate and a protocol replace them. Comments of the base are lost; `comments` are the first
/// lines of the file.
///
/// # Errors
/// The base is not a TOML file.
pub fn write_bus_file(
    base: &BaseFile<'_>,
    everywhere: &BusSettings,
    buses: &[(String, BusSettings)],
    comments: &[String],
) -> Result<String, TextError> {
    let mut root: Table = toml::from_str(base.text).map_err(|error| TextError::of_toml(base.text, &error))?;
    rename_files(&mut root, base.rename);
    if let Some(buses) = root.get_mut("bus").and_then(Value::as_table_mut) {
        buses
            .iter_mut()
            .filter_map(|(_, bus)| bus.as_table_mut())
            .for_each(|bus| rename_files(bus, base.rename));
    }
    add_settings(&mut root, everywhere);
    for (name, settings) in buses {
        if let Some(bus) = get_table(&mut root, "bus").and_then(|buses| get_table(buses, name)) {
            add_bus(bus, settings);
        }
    }
    let mut text = String::new();
    for comment in comments {
        let shown = comment.chars().map(|letter| if letter.is_control() { ' ' } else { letter });
        text.push_str("# ");
        text.extend(shown.take(LONGEST_COMMENT));
        text.push('\n');
    }
    if !comments.is_empty() {
        text.push('\n');
    }
    // A table of strings, numbers and tables always has a text.
    text.push_str(&toml::to_string(&root).unwrap_or_default());
    Ok(text)
}

/// Table under a key, created if needed; `None` if the key has another value.
fn get_table<'a>(parent: &'a mut Table, key: &str) -> Option<&'a mut Table> {
    parent.entry(key).or_insert_with(|| Value::Table(Table::new())).as_table_mut()
}

/// List under a key, created if needed; `None` if the key has another value.
fn get_list<'a>(parent: &'a mut Table, key: &str) -> Option<&'a mut Vec<Value>> {
    parent.entry(key).or_insert_with(|| Value::Array(Vec::new())).as_array_mut()
}

/// Converts the names of databases and device files in the table of a bus, or of all buses.
fn rename_files(settings: &mut Table, rename: &dyn Fn(&str) -> String) {
    let renamed = |value: &mut Value| match value {
        Value::String(name) => *name = rename(name),
        Value::Array(names) => {
            for name in names {
                if let Value::String(name) = name {
                    *name = rename(name);
                }
            }
        }
        _ => {}
    };
    settings.get_mut("dbc").into_iter().for_each(renamed);
    let nodes = settings.get_mut("node").and_then(Value::as_table_mut);
    for node in nodes.into_iter().flatten().filter_map(|(_, node)| node.as_table_mut()) {
        node.get_mut("eds").into_iter().for_each(renamed);
        node.get_mut("dcf").into_iter().for_each(renamed);
    }
}

fn add_bus(bus: &mut Table, settings: &BusSettings) {
    if let Some(rate) = settings.bit_rate {
        bus.insert("bitrate".to_owned(), Value::Integer(rate.into()));
    }
    if let Some(protocol) = settings.protocol {
        let name = match protocol {
            ProtocolChoice::Auto => "auto",
            ProtocolChoice::Canopen => "canopen",
            ProtocolChoice::J1939 => "j1939",
            ProtocolChoice::None => "none",
        };
        bus.insert("protocol".to_owned(), Value::from(name));
    }
    add_settings(bus, settings);
}

fn add_settings(place: &mut Table, settings: &BusSettings) {
    if !settings.databases.is_empty() {
        let mut names: Vec<Value> =
            settings.databases.iter().map(|name| Value::from(name.as_str())).collect();
        names.extend(match place.remove("dbc") {
            Some(Value::Array(own)) => own,
            own => own.into_iter().collect(),
        });
        place.insert("dbc".to_owned(), Value::Array(names));
    }
    for id in &settings.nodes {
        node_table(place, *id);
    }
    for (id, name) in &settings.names {
        set_key(node_table(place, *id), "name", Value::from(name.as_str()));
    }
    for (id, device) in &settings.devices {
        set_key(node_table(place, *id), "device", Value::from(device.text.as_str()));
    }
    for (id, file) in &settings.device_files {
        let own = node_table(place, *id);
        if let Some(own) = own {
            own.remove("dcf");
            own.insert("eds".to_owned(), Value::from(file.as_str()));
        }
    }
    for (id, state) in &settings.states {
        set_key(node_table(place, *id), "state", Value::Table(state_table(state)));
    }
    for object in &settings.objects {
        let objects = node_table(place, object.node).and_then(|node| get_list(node, "object"));
        if let Some(objects) = objects {
            objects.push(Value::Table(object_table(object)));
        }
    }
    let ids = settings.owners.iter().filter_map(|(id, owner)| id_table(*id, *owner));
    extend_list(place, "id", ids.collect());
    extend_list(place, "uds", settings.uds.iter().map(uds_table).collect());
}

fn extend_list(place: &mut Table, key: &str, entries: Vec<Table>) {
    if entries.is_empty() {
        return;
    }
    if let Some(all) = get_list(place, key) {
        all.extend(entries.into_iter().map(Value::Table));
    }
}

fn set_key(node: Option<&mut Table>, key: &str, value: Value) {
    if let Some(node) = node {
        node.insert(key.to_owned(), value);
    }
}

/// Table of a node, which the base may contain under another form of its node-ID.
fn node_table(place: &mut Table, id: NodeId) -> Option<&mut Table> {
    let nodes = get_table(place, "node")?;
    let known = nodes.keys().find(|key| key.parse() == Ok(id)).cloned();
    get_table(nodes, &known.unwrap_or_else(|| id.to_string()))
}

fn state_table(state: &InitialState) -> Table {
    let mut table = Table::new();
    if let Some(InitialNmtState { state, is_assumed, is_reported }) = state.nmt {
        table.insert("nmt".to_owned(), Value::from(state.name()));
        set_flag(&mut table, "assumed", is_assumed);
        set_flag(&mut table, "reported", is_reported);
    }
    set_flag(&mut table, "lost", state.is_lost);
    set_flag(&mut table, "saved", state.is_saved);
    if let Some(reset) = state.reset {
        table.insert("reset".to_owned(), Value::from(reset.name()));
    }
    if let Some(name) = state.name {
        table.insert("name".to_owned(), Value::from(format!("0x{:016X}", name.0)));
    }
    if state.device.iter().any(|name| !name.is_empty()) {
        let names = state.device.iter().map(|name| Value::from(name.as_str()));
        table.insert("device".to_owned(), Value::Array(names.collect()));
    }
    if !state.errors.is_empty() {
        let codes = state.errors.iter().map(|code| Value::from(format!("{code:04X}")));
        table.insert("errors".to_owned(), Value::Array(codes.collect()));
    }
    table
}

fn set_flag(table: &mut Table, key: &str, is_set: bool) {
    if is_set {
        table.insert(key.to_owned(), Value::Boolean(true));
    }
}

fn object_table(object: &InitialValue) -> Table {
    let mut table = Table::new();
    table.insert("object".to_owned(), Value::from(object.address.to_string()));
    match &object.value {
        ObjectValue::Bytes(bytes) => {
            let digits: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
            table.insert("data".to_owned(), Value::from(digits.join(" ")));
        }
        ObjectValue::Number(number) => {
            table.insert("value".to_owned(), Value::Integer(*number));
        }
    }
    if let Some(origin) = object.origin {
        table.insert("origin".to_owned(), Value::from(origin.name()));
    }
    if let Some(frame) = object.frame.and_then(|frame| i64::try_from(frame).ok()) {
        table.insert("frame".to_owned(), Value::Integer(frame));
    }
    set_flag(&mut table, "assumed", object.is_assumed);
    set_flag(&mut table, "pending", object.role == ValueRole::Pending);
    set_flag(&mut table, "stored", object.role == ValueRole::Stored);
    set_flag(&mut table, "process", object.role == ValueRole::Process);
    table
}

/// Entry of an identifier; `None` for a service without a name in the bus file.
fn id_table(id: CanId, owner: IdentifierOwner) -> Option<Table> {
    let service = match owner {
        IdentifierOwner::Unclassified => "none".to_owned(),
        IdentifierOwner::Nmt => "nmt".to_owned(),
        IdentifierOwner::Sync => "sync".to_owned(),
        IdentifierOwner::Time => "time".to_owned(),
        IdentifierOwner::Emcy(_) => "emcy".to_owned(),
        IdentifierOwner::Pdo(name, _) => name.to_string().to_ascii_lowercase(),
        IdentifierOwner::Sdo(SdoSide::Client, _) => "sdo-request".to_owned(),
        IdentifierOwner::Sdo(SdoSide::Server, _) => "sdo-response".to_owned(),
        IdentifierOwner::ErrorControl(_) => "heartbeat".to_owned(),
        IdentifierOwner::Lss(true) => "lss-master".to_owned(),
        IdentifierOwner::Lss(false) => "lss-slave".to_owned(),
        IdentifierOwner::Named(_) | IdentifierOwner::TestMarker => return None,
    };
    let mut table = Table::new();
    table.insert("id".to_owned(), Value::from(id.to_string()));
    table.insert("service".to_owned(), Value::from(service));
    if let Some(node) = owner.node() {
        table.insert("node".to_owned(), Value::Integer(node.into()));
    }
    Some(table)
}

fn uds_table(pair: &UdsPair) -> Table {
    let mut table = Table::new();
    table.insert("request".to_owned(), Value::from(pair.request.to_string()));
    table.insert("response".to_owned(), Value::from(pair.response.to_string()));
    if let Some(functional) = pair.functional {
        table.insert("functional".to_owned(), Value::from(functional.to_string()));
    }
    if let Some(name) = &pair.name {
        table.insert("name".to_owned(), Value::from(name.as_str()));
    }
    set_flag(&mut table, "extended_addressing", pair.extended_addressing);
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus_file::{BusFile, PendingReset, SpannedText, ValueOrigin};
    use crate::profile::{PdoDirection, PdoName};
    use crate::wire::canopen::{NmtState, ObjectAddress};
    use crate::wire::j1939::J1939Name;

    const NODE: NodeId = NodeId::Canopen(5);

    fn written(base: &str, settings: BusSettings) -> String {
        let base = BaseFile { text: base, rename: &|name| format!("/m/{name}") };
        write_bus_file(&base, &BusSettings::default(), &[("can0".to_owned(), settings)], &[]).unwrap()
    }

    fn full() -> BusSettings {
        let tpdo1 = PdoName { direction: PdoDirection::Transmit, number: 1 };
        let entry = InitialValue::new(
            NODE,
            ObjectAddress::new(0x1A00, 1),
            ObjectValue::Bytes(vec![0x10, 0, 0x41, 0x60]),
        );
        BusSettings {
            protocol: Some(ProtocolChoice::Canopen),
            nodes: vec![NODE, NodeId::J1939(0x80)],
            bit_rate: Some(250_000),
            names: vec![(NODE, "p\"u\nm]p = '\u{7F}".to_owned())],
            owners: vec![
                (CanId::from_standard(0x1A0), IdentifierOwner::Pdo(tpdo1, 5)),
                (CanId::from_extended(0x1A1), IdentifierOwner::Sdo(SdoSide::Client, 5)),
            ],
            objects: vec![
                InitialValue { origin: Some(ValueOrigin::Download), frame: Some(7), ..entry.clone() },
                InitialValue { role: ValueRole::Process, ..entry.clone() },
                InitialValue { role: ValueRole::Stored, is_assumed: true, ..entry },
            ],
            states: vec![
                (
                    NODE,
                    InitialState {
                        nmt: Some(InitialNmtState {
                            state: NmtState::Initialising,
                            is_assumed: true,
                            is_reported: true,
                        }),
                        is_lost: true,
                        is_saved: true,
                        errors: vec![0x8130],
                        reset: Some(PendingReset::Communication),
                        name: None,
                        device: vec!["FAULT".to_owned()],
                    },
                ),
                (NodeId::J1939(0x80), InitialState { name: Some(J1939Name(0xA)), ..InitialState::default() }),
            ],
            uds: vec![UdsPair {
                request: CanId::from_extended(0x7E0),
                response: CanId::from_extended(0x7E8),
                functional: None,
                name: Some("[x]\n".to_owned()),
                extended_addressing: true,
            }],
            ..BusSettings::default()
        }
    }

    #[test]
    fn what_is_written_reads_back() {
        let read = BusFile::parse(&written("", full())).unwrap();
        assert_eq!(read.buses, [("can0".to_owned(), full())]);
    }

    #[test]
    fn settings_of_the_base_remain() {
        let base = "dbc = 'a.dbc'\n[node.5]\nname = 'any'\ndcf = 'pump.dcf'\n[bus.can0.node.0x05]\nname = 'old'\n\
                    unit = { \"6601:01\" = 'mm' }\n[[bus.can0.node.5x]]\n";
        assert!(BusFile::parse(base).is_err());
        let base = base.replace("[[bus.can0.node.5x]]\n", "[rules.node-lost]\nseverity = 'warning'\n");
        let device = SpannedText { text: "wandfluh-md2:controller".to_owned(), span: 0..0 };
        let text = written(&base, BusSettings { devices: vec![(NODE, device)], ..full() });
        let read = BusFile::parse(&text).unwrap();
        assert_eq!(read.everywhere.databases, ["/m/a.dbc"]);
        assert_eq!(read.everywhere.device_files, [(NODE, "/m/pump.dcf".to_owned())]);
        assert_eq!(read.name("can1", NODE), Some("any"));
        let own = &read.buses[0].1;
        assert_eq!(own.names, full().names);
        assert_eq!((own.devices[0].1.text.as_str(), own.units.len()), ("wandfluh-md2:controller", 1));
        assert_eq!(read.judgement.rules.len(), 1);
    }

    #[test]
    fn comments_cannot_leave_their_line() {
        let base = BaseFile { text: "", rename: &str::to_owned };
        let comments = ["cut of a\n[node.5]\u{85}\r".to_owned()];
        let text = write_bus_file(&base, &BusSettings::default(), &[], &comments).unwrap();
        assert_eq!(text.lines().next(), Some("# cut of a [node.5]  "));
        assert!(BusFile::parse(&text).unwrap().everywhere.nodes.is_empty());
    }

    #[test]
    fn a_base_that_is_no_toml_is_an_error() {
        let base = BaseFile { text: "[node.5]\nname = \n", rename: &str::to_owned };
        let error = write_bus_file(&base, &BusSettings::default(), &[], &[]).unwrap_err();
        assert_eq!(error.line, 2);
    }
}
