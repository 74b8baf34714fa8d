//! The bus file: what the user knows about a machine and the frames do not contain. See `docs/bus-file.md`.
//!
//! ```toml
//! [bus.can0]
//! bitrate = 250000
//! dbc = "engine.dbc"
//! [node.5]
//! name = "pump"
//! [[id]]
//! id = 0x1A0
//! service = "tpdo1"
//! node = 5
//! ```

mod diff;
mod initial;
mod judgement;
mod model;
mod settings;
mod uds;
mod value;
mod write;
mod written;

pub use diff::DiffTolerances;

pub use initial::{InitialNmtState, InitialState, InitialValue, PendingReset, ValueOrigin, ValueRole};
pub use judgement::{Judgement, NodeRule, RuleSettings, Suppression};
pub use settings::{AreaEntry, BusSettings, ProtocolChoice};
pub use uds::UdsPair;
pub use value::{ObjectValue, encode_number};
pub use write::{BaseFile, write_bus_file};

use crate::frame::CanId;
pub use crate::profile::{ExpectCondition, ExpectEntry, SpannedText};
use crate::profile::{IdentifierOwner, TextError};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::SpnConversion;

/// A parsed and checked bus file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BusFile {
    /// Name of the machine, for the tables of many captures.
    pub machine: Option<String>,
    /// Settings for every bus.
    pub everywhere: BusSettings,
    /// Settings by bus name; they override `everywhere`.
    pub buses: Vec<(String, BusSettings)>,
    /// Rule settings, suppressions and expectations.
    pub judgement: Judgement,
    /// Tolerances of `cobscope diff`.
    pub diff: DiffTolerances,
}

impl BusFile {
    /// Parses the text of a bus file.
    ///
    /// # Errors
    /// Invalid TOML, unknown keys or values out of range, with line and column.
    pub fn parse(text: &str) -> Result<Self, TextError> {
        let mut file: model::AuthoredBusFile =
            toml::from_str(text).map_err(|error| TextError::of_toml(text, &error))?;
        let machine = file.machine.take();
        let (everywhere, buses, judgement, diff) =
            file.check_file().map_err(|(span, message)| TextError::at_place(text, span, message))?;
        Ok(Self { machine, everywhere, buses, judgement, diff })
    }

    /// Settings of this bus, then those of every bus.
    fn settings_of<'a>(&'a self, bus: &'a str) -> impl DoubleEndedIterator<Item = &'a BusSettings> {
        let own = self.buses.iter().filter(move |(name, _)| name == bus).map(|(_, settings)| settings);
        own.chain(std::iter::once(&self.everywhere))
    }

    /// Configured bit rate of a bus, in bit/s.
    pub fn bit_rate(&self, bus: &str) -> Option<u32> {
        self.settings_of(bus).find_map(|settings| settings.bit_rate)
    }

    /// Time zones of the recorders of buses: bus, and name of the zone.
    pub fn time_zones(&self) -> impl Iterator<Item = (&str, &SpannedText)> {
        self.buses.iter().filter_map(|(bus, settings)| Some((bus.as_str(), settings.time_zone.as_ref()?)))
    }

    /// Protocol that the user stated for a bus.
    pub fn protocol(&self, bus: &str) -> Option<ProtocolChoice> {
        self.settings_of(bus).find_map(|settings| settings.protocol)
    }

    /// Nodes of a bus that the file names, also as owner of an identifier, and whether the entry names the bus.
    pub fn named_nodes<'a>(&'a self, bus: &'a str) -> impl Iterator<Item = (NodeId, bool)> + 'a {
        let own =
            self.buses.iter().filter(move |(name, _)| name == bus).map(|(_, settings)| (settings, true));
        own.chain(std::iter::once((&self.everywhere, false))).flat_map(|(settings, is_own)| {
            let owners = settings.owners.iter().filter_map(|(_, owner)| owner.node().map(NodeId::Canopen));
            settings.nodes.iter().copied().chain(owners).map(move |node| (node, is_own))
        })
    }

    /// Configured name of the NMT master of a bus.
    pub fn master<'a>(&'a self, bus: &'a str) -> Option<&'a str> {
        self.settings_of(bus).find_map(|settings| settings.master.as_deref())
    }

    /// Configured name of a node.
    pub fn name<'a>(&'a self, bus: &'a str, node: NodeId) -> Option<&'a str> {
        let mut names = self.settings_of(bus).flat_map(|settings| &settings.names);
        names.find(|(id, _)| *id == node).map(|(_, name)| name.as_str())
    }

    /// Services of CAN identifiers; if an identifier is listed twice, the last entry wins.
    pub(crate) fn owners<'a>(&'a self, bus: &'a str) -> impl Iterator<Item = (CanId, IdentifierOwner)> + 'a {
        self.settings_of(bus).rev().flat_map(|settings| settings.owners.iter().copied())
    }

    /// Values of objects; if an object is listed twice, the last entry wins.
    pub fn objects<'a>(&'a self, bus: &'a str) -> impl Iterator<Item = &'a InitialValue> {
        self.settings_of(bus).rev().flat_map(|settings| &settings.objects)
    }

    /// States of nodes before the first frame; if a node is listed twice, the last entry wins.
    pub fn states<'a>(&'a self, bus: &'a str) -> impl Iterator<Item = &'a (NodeId, InitialState)> {
        self.settings_of(bus).rev().flat_map(|settings| &settings.states)
    }

    /// Units of objects, as selected in the manufacturer's tool.
    pub fn units<'a>(&'a self, bus: &'a str) -> impl Iterator<Item = &'a (NodeId, ObjectAddress, String)> {
        self.settings_of(bus).rev().flat_map(|settings| &settings.units)
    }

    /// SPN conversion versions of J1939 devices that set the conversion method bit; the last entry wins.
    pub(crate) fn conversions<'a>(
        &'a self,
        bus: &'a str,
    ) -> impl Iterator<Item = (NodeId, SpnConversion)> + 'a {
        self.settings_of(bus).rev().flat_map(|settings| settings.conversions.iter().copied())
    }

    /// Identifiers of UDS servers; those of this bus first.
    pub fn uds<'a>(&'a self, bus: &'a str) -> impl Iterator<Item = &'a UdsPair> {
        self.settings_of(bus).flat_map(|settings| &settings.uds)
    }

    /// Entries of an area (`tx_area`, `rx_area`) of a node.
    pub fn area_entries<'a>(&'a self, bus: &'a str, node: NodeId, area: &'a str) -> Option<&'a [AreaEntry]> {
        let mut areas = self.settings_of(bus).flat_map(|settings| &settings.areas);
        areas.find(|(id, name, _)| *id == node && name == area).map(|(_, _, list)| list.as_slice())
    }

    /// Profiles of nodes: bus (`None` for every bus), node, profile; those for every bus first.
    pub fn devices(&self) -> impl Iterator<Item = (Option<&str>, NodeId, &SpannedText)> {
        self.settings_per_node(|settings| &settings.devices)
    }

    /// Tolerances of device rules: profile, rule, key, value.
    pub fn device_tolerances(&self) -> impl Iterator<Item = (&str, &str, &str, f64)> {
        let rules = self.judgement.rules.iter();
        let rules = rules.filter_map(|one| Some((one.rule.split_once(':')?, &one.tolerances)));
        rules.flat_map(|((profile, rule), all)| {
            all.iter().map(move |(key, _, value)| (profile, rule, key.as_str(), *value))
        })
    }

    /// EDS, DCF and XDD files of nodes: bus (`None` for every bus), node, file name.
    pub fn device_files(&self) -> impl Iterator<Item = (Option<&str>, NodeId, &str)> {
        let all = self.settings_per_node(|settings| &settings.device_files);
        all.map(|(bus, node, file)| (bus, node, file.as_str()))
    }

    fn settings_per_node<'a, T: 'a>(
        &'a self,
        list: impl Fn(&'a BusSettings) -> &'a Vec<(NodeId, T)>,
    ) -> impl Iterator<Item = (Option<&'a str>, NodeId, &'a T)> {
        let buses = self.buses.iter().map(|(name, settings)| (Some(name.as_str()), settings));
        std::iter::once((None, &self.everywhere)).chain(buses).flat_map(move |(bus, settings)| {
            list(settings).iter().map(move |(node, what)| (bus, *node, what))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::{PdoDirection, PdoName};
    use crate::wire::canopen::sdo::SdoSide;

    const NODE: NodeId = NodeId::Canopen(5);
    const PUMP: NodeId = NodeId::Canopen(63);
    const TPDO1: PdoName = PdoName { direction: PdoDirection::Transmit, number: 1 };

    #[test]
    fn databases_are_a_file_or_several_on_a_bus_or_all() {
        let file =
            BusFile::parse("dbc = 'a.dbc'\n[bus.can0]\ndbc = ['b.dbc', 'c.json']\n[bus.can1]").unwrap();
        assert_eq!(file.everywhere.databases, ["a.dbc"]);
        assert_eq!(file.buses[0].1.databases, ["b.dbc", "c.json"]);
        assert!(file.buses[1].1.databases.is_empty());
        let error = BusFile::parse("dbc = 5").unwrap_err();
        assert_eq!((error.line, error.column), (1, 7));
        assert_eq!(error.message, "expected a file name, or a list of file names");
    }

    #[test]
    fn a_value_of_another_type_is_refused_with_the_expected_ones() {
        const VALUE: &str =
            "expected a whole number or a text; give other values as data, bytes in hexadecimal";
        const IDENTIFIER: &str = "expected a CAN identifier: 0x1A0, \"1A0\" or \"000001A0\" as in candump";
        for value in ["1.5", "true", "[1]"] {
            let object = format!("[[node.5.object]]\nobject = '6000:00'\nvalue = {value}");
            let error = BusFile::parse(&object).unwrap_err();
            assert_eq!((error.line, error.message.as_str()), (3, VALUE), "{value}");
            let error = BusFile::parse(&format!("[[id]]\nid = {value}\nservice = 'sync'")).unwrap_err();
            assert_eq!((error.line, error.message.as_str()), (2, IDENTIFIER), "{value}");
        }
    }

    #[test]
    fn eds_and_dcf_are_one_key() {
        for key in ["eds", "dcf"] {
            let file = BusFile::parse(&format!("[node.5]\n{key} = 'a.dcf'")).unwrap();
            assert_eq!(file.device_files().map(|(_, _, name)| name).collect::<Vec<_>>(), ["a.dcf"]);
        }
        let error = BusFile::parse("[node.5]\neds = 'a.eds'\ndcf = 'a.dcf'").unwrap_err();
        assert_eq!((error.line, error.column), (3, 7));
        assert_eq!(error.message, "eds and dcf are the same key; expected one file per node");
    }

    #[test]
    fn everything_a_bus_file_can_say() {
        let file = BusFile::parse(
            r#"
            master = "PC"
            [bus.can0]
            bitrate = 250000
            master = "PLC"
            [bus.can0.node.0x05]
            name = "pump"
            [node.5]
            name = "any"
            [[node.5.object]]
            object = "1A00:01"
            value = 0x60410010
            [[node.5.object]]
            object = "2000sub1"
            data = "01 02 03"
            [[id]]
            id = 0x1A0
            service = "tpdo1"
            node = 5
            [[id]]
            id = 0x1A1
            extended = true
            service = "sdo-request"
            node = 5
            [[id]]
            id = "00000080"
            service = "sync"
            [[id]]
            id = "7E5"
            service = "none"
            "#,
        );
        let file = file.unwrap();
        assert_eq!((file.bit_rate("can0"), file.bit_rate("can1")), (Some(250_000), None));
        assert_eq!((file.name("can0", NODE), file.name("can1", NODE)), (Some("pump"), Some("any")));
        assert_eq!((file.master("can0"), file.master("can1")), (Some("PLC"), Some("PC")));
        let owners: Vec<_> = file.owners("can1").collect();
        assert_eq!(owners[0], (CanId::from_standard(0x1A0), IdentifierOwner::Pdo(TPDO1, 5)));
        assert_eq!(owners[1], (CanId::from_extended(0x1A1), IdentifierOwner::Sdo(SdoSide::Client, 5)));
        assert_eq!(owners[2], (CanId::from_extended(0x80), IdentifierOwner::Sync));
        assert_eq!(owners[3], (CanId::from_standard(0x7E5), IdentifierOwner::Unclassified));
        let objects: Vec<_> = file.objects("can0").collect();
        let given = |index, bytes: &[u8]| {
            InitialValue::new(NODE, ObjectAddress::new(index, 1), ObjectValue::Bytes(bytes.to_vec()))
        };
        assert_eq!(*objects[0], given(0x1A00, &[0x10, 0, 0x41, 0x60]));
        assert_eq!(*objects[1], given(0x2000, &[1, 2, 3]));
    }

    #[test]
    fn devices_files_units_and_areas() {
        let file = BusFile::parse(
            r#"
            [node.63]
            device = "rexroth-vpcd"
            unit = { "6601:01" = "mm" }
            tx_area = ["2F10/4", "2C74:00/2"]
            [bus.can1.node.63]
            eds = "pump.eds"
            "#,
        )
        .unwrap();
        let devices = file.devices().map(|(bus, node, device)| (bus, node, device.text.as_str()));
        assert_eq!(devices.collect::<Vec<_>>(), [(None, PUMP, "rexroth-vpcd")]);
        assert_eq!(file.device_files().collect::<Vec<_>>(), [(Some("can1"), PUMP, "pump.eds")]);
        let area = file.area_entries("can0", PUMP, "tx_area").unwrap();
        assert_eq!(area[1], AreaEntry { object: ObjectAddress::new(0x2C74, 0), bytes: 2 });
        assert_eq!(file.units("can0").next().unwrap().2, "mm");
        fails(
            "[node.5]\ntx_area = [\"2F10\"]",
            "2:12: invalid area entry; expected OBJECT/BYTES with 1 to 8 bytes, such as 2F10/4",
        );
        fails("[node.5]\nunit = { \"63\" = \"bar\", \"x\" = \"bar\" }", "not a valid object");
    }

    #[test]
    fn how_a_device_codes_an_spn() {
        let file = BusFile::parse(
            "[node.\"sa:0x0B\"]\nspn_conversion = 1\n[bus.can1.node.\"sa:11\"]\nspn_conversion = 2",
        );
        let file = file.unwrap();
        let of = |bus| file.conversions(bus).last();
        let device = NodeId::J1939(11);
        assert_eq!(of("can0"), Some((device, SpnConversion::Version1)));
        assert_eq!(of("can1"), Some((device, SpnConversion::Version2)));
        fails("[node.\"sa:11\"]\nspn_conversion = 4", "2:18: spn_conversion is 1, 2 or 3");
        fails(
            "[node.5]\nspn_conversion = 1",
            "2:18: spn_conversion of a CANopen node; expected a J1939 address",
        );
    }

    #[track_caller]
    fn fails(text: &str, message: &str) {
        let error = BusFile::parse(text).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }

    #[test]
    fn errors_have_a_place_and_a_caret() {
        let error = BusFile::parse("[node.5]\nnmae = \"pump\"\n").unwrap_err();
        let expected = "b.toml:2:1: unknown field `nmae`, expected one of `name`, `object`, `device`, `dcf`, `eds`, `unit`, `tx_area`, `rx_area`, `spn_conversion`, `state`\n  2 | nmae = \"pump\"\n    | ^^^^";
        assert_eq!(error.show_in_file("b.toml"), expected);
        let error = BusFile::parse("[[id]]\nid = 0x1A0\nservice = \"tpd1\"\n").unwrap_err();
        let shown = error.show_in_file("b.toml");
        assert!(shown.starts_with("b.toml:3:11: unknown service 'tpd1'"), "{shown}");
        assert!(shown.ends_with("\n  3 | service = \"tpd1\"\n    |           ^^^^^^"), "{shown}");
    }

    #[test]
    fn values_out_of_range_are_refused() {
        fails("[node.128]\nname = \"x\"", "1:7: expected a node-ID 1 to 127");
        fails("[node.pump]\nname = \"x\"", "expected a node-ID 1 to 127");
        fails("[node.2]\nname = \"x\"\n[node.0x02]\nname = \"y\"", "3:7: duplicate entry for node 2/02");
        fails("[bus.can0.node.0x02]\n[bus.can0.node.2]", "2:16: duplicate entry for node 2/02");
        fails("[bus.can0]\nbitrate = 250", "expected bit/s, such as 250000 for 250 kbit/s");
        fails(
            "[[id]]\nid = 0x20000000\nservice = \"sync\"",
            "2:6: invalid CAN identifier; expected 11 or 29 bits",
        );
        fails("[[id]]\nid = \"1FFG\"\nservice = \"sync\"", "invalid CAN identifier");
        fails("[[id]]\nid = 1\nservice = \"emcy\"", "3:11: node is missing; service emcy requires it");
        fails(
            "[[id]]\nid = 1\nservice = \"sync\"\nnode = 5",
            "4:8: service sync does not belong to a node; remove node",
        );
        fails("[[id]]\nid = 1\nservice = \"tpdo513\"\nnode = 5", "unknown service 'tpdo513'; expected nmt");
        fails("[[id]]\nid = 1\nservice = \"emcy\"\nnode = 0", "4:8: node-ID out of range; expected 1 to 127");
        fails(
            "[[id]]\nid = 1\nservice = \"sync\"\n[[id]]\nid = \"001\"\nservice = \"time\"",
            "5:6: duplicate entry for 001",
        );
    }

    #[test]
    fn values_must_fit_their_objects() {
        let object = |rest: &str| format!("[[node.5.object]]\nobject = \"1017:00\"\n{rest}");
        let value =
            |rest: &str| BusFile::parse(&object(rest)).map(|file| file.everywhere.objects[0].value.clone());
        assert_eq!(value("value = 1000"), Ok(ObjectValue::Bytes(vec![0xE8, 3])));
        fails(&object("value = 65536"), "3:9: 65536 does not fit UNSIGNED16; expected 0 to 65535");
        fails(&object("value = -1"), "does not fit");
        fails(&object(""), "value and data are missing; expected one");
        fails(&object("data = \"1\""), "pairs of hex digits");
        fails("[[node.5.object]]\nobject = \"10170\"\nvalue = 1", "2:10: not a valid object");
        fails(
            "[[node.5.object]]\nobject = \"1010:01\"\nvalue = \"save\"\ndata = \"00\"",
            "value and data are both present; remove one",
        );
    }
}
