//! The bus file: what the user knows of a machine and no frame tells. `docs/bus-file.md` shows it.
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

mod expectation;
mod judgement;
mod model;
mod settings;
mod uds;
mod value;
mod written;

pub use expectation::{Demand, Expectation};

pub use judgement::{Judgement, RuleSettings, Suppression};
pub use settings::{AreaEntry, ObjectValue, Settings};
pub use uds::UdsPair;
pub use value::encode;
pub use written::Written;

use crate::frame::CanId;
use crate::profile::{Owner, TextError};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::SpnConversion;

/// A bus file that was understood.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BusFile {
    /// What holds on every bus.
    pub everywhere: Settings,
    /// What holds on one bus, by its name; it goes before what holds everywhere.
    pub buses: Vec<(String, Settings)>,
    /// What it says of rules.
    pub judgement: Judgement,
}

impl BusFile {
    /// Reads the text of a bus file.
    ///
    /// # Errors
    /// Text that is no TOML, unknown keys, values out of range; with the place.
    pub fn parse(text: &str) -> Result<Self, TextError> {
        let file: model::File = toml::from_str(text).map_err(|error| TextError::of_toml(text, &error))?;
        let (everywhere, buses, judgement) =
            file.check().map_err(|(span, message)| TextError::at(text, span, message))?;
        Ok(Self { everywhere, buses, judgement })
    }

    /// What is said of the bus with this name and of every bus, the special before the general.
    fn of<'a>(&'a self, bus: &'a str) -> impl DoubleEndedIterator<Item = &'a Settings> {
        let own = self.buses.iter().filter(move |(name, _)| name == bus).map(|(_, settings)| settings);
        own.chain(std::iter::once(&self.everywhere))
    }

    /// Bit rate of a bus.
    pub fn bit_rate(&self, bus: &str) -> Option<u32> {
        self.of(bus).find_map(|settings| settings.bit_rate)
    }

    /// Name of the NMT master of a bus.
    pub fn master<'a>(&'a self, bus: &'a str) -> Option<&'a str> {
        self.of(bus).find_map(|settings| settings.master.as_deref())
    }

    /// Name of a node.
    pub fn name<'a>(&'a self, bus: &'a str, node: NodeId) -> Option<&'a str> {
        let mut names = self.of(bus).flat_map(|settings| &settings.names);
        names.find(|(id, _)| *id == node).map(|(_, name)| name.as_str())
    }

    /// What identifiers mean; of two statements about one the last counts.
    pub(crate) fn owners<'a>(&'a self, bus: &'a str) -> impl Iterator<Item = (CanId, Owner)> + 'a {
        self.of(bus).rev().flat_map(|settings| settings.owners.iter().copied())
    }

    /// Values of objects; of two for one object the last counts.
    pub fn objects<'a>(
        &'a self,
        bus: &'a str,
    ) -> impl Iterator<Item = &'a (NodeId, ObjectAddress, ObjectValue)> {
        self.of(bus).rev().flat_map(|settings| &settings.objects)
    }

    /// Units of objects.
    pub fn units<'a>(&'a self, bus: &'a str) -> impl Iterator<Item = &'a (NodeId, ObjectAddress, String)> {
        self.of(bus).rev().flat_map(|settings| &settings.units)
    }

    /// How J1939 devices code SPNs whose conversion method bit is set; of two for one the last counts.
    pub(crate) fn conversions<'a>(
        &'a self,
        bus: &'a str,
    ) -> impl Iterator<Item = (NodeId, SpnConversion)> + 'a {
        self.of(bus).rev().flat_map(|settings| settings.conversions.iter().copied())
    }

    /// Identifiers of UDS servers, the special before the general.
    pub fn uds<'a>(&'a self, bus: &'a str) -> impl Iterator<Item = &'a UdsPair> {
        self.of(bus).flat_map(|settings| &settings.uds)
    }

    /// What fills an area of a node.
    pub fn area<'a>(&'a self, bus: &'a str, node: NodeId, area: &'a str) -> Option<&'a [AreaEntry]> {
        let mut areas = self.of(bus).flat_map(|settings| &settings.areas);
        areas.find(|(id, name, _)| *id == node && name == area).map(|(_, _, list)| list.as_slice())
    }

    /// Profiles of nodes: bus (all if none), node-ID, profile; what holds everywhere first.
    pub fn devices(&self) -> impl Iterator<Item = (Option<&str>, NodeId, &Written)> {
        self.placed(|settings| &settings.devices)
    }

    /// Numbers of the rules of devices: profile, rule, key, value.
    pub fn device_tolerances(&self) -> impl Iterator<Item = (&str, &str, &str, f64)> {
        let rules = self.judgement.rules.iter();
        let rules = rules.filter_map(|one| Some((one.rule.split_once(':')?, &one.tolerances)));
        rules.flat_map(|((profile, rule), all)| {
            all.iter().map(move |(key, _, value)| (profile, rule, key.as_str(), *value))
        })
    }

    /// EDS, DCF and XDD files of nodes, alike.
    pub fn device_files(&self) -> impl Iterator<Item = (Option<&str>, NodeId, &str)> {
        let all = self.placed(|settings| &settings.device_files);
        all.map(|(bus, node, file)| (bus, node, file.as_str()))
    }

    fn placed<'a, T: 'a>(
        &'a self,
        list: impl Fn(&'a Settings) -> &'a Vec<(NodeId, T)>,
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
    use crate::wire::canopen::sdo::Side;

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
        assert_eq!(error.message, "the name of a file, or a list of names");
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
        assert_eq!(owners[0], (CanId::standard(0x1A0), Owner::Pdo(TPDO1, 5)));
        assert_eq!(owners[1], (CanId::extended(0x1A1), Owner::Sdo(Side::Client, 5)));
        assert_eq!(owners[2], (CanId::extended(0x80), Owner::Sync));
        assert_eq!(owners[3], (CanId::standard(0x7E5), Owner::Unclassified));
        let objects: Vec<_> = file.objects("can0").collect();
        assert_eq!(
            *objects[0],
            (NODE, ObjectAddress::new(0x1A00, 1), ObjectValue::Bytes(vec![0x10, 0, 0x41, 0x60]))
        );
        assert_eq!(*objects[1], (NODE, ObjectAddress::new(0x2000, 1), ObjectValue::Bytes(vec![1, 2, 3])));
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
        let area = file.area("can0", PUMP, "tx_area").unwrap();
        assert_eq!(area[1], AreaEntry { object: ObjectAddress::new(0x2C74, 0), bytes: 2 });
        assert_eq!(file.units("can0").next().unwrap().2, "mm");
        fails("[node.5]\ntx_area = [\"2F10\"]", "2:12: an entry of an area is written 2F10/4");
        fails("[node.5]\nunit = { \"63\" = \"bar\", \"x\" = \"bar\" }", "an object is written 1018:01");
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
        fails("[node.5]\nspn_conversion = 1", "2:18: spn_conversion is for a J1939 address");
    }

    #[track_caller]
    fn fails(text: &str, message: &str) {
        let error = BusFile::parse(text).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }

    #[test]
    fn errors_have_a_place_and_a_caret() {
        let error = BusFile::parse("[node.5]\nnmae = \"pump\"\n").unwrap_err();
        let expected = "b.toml:2:1: unknown field `nmae`, expected one of `name`, `object`, `device`, `dcf`, `eds`, `unit`, `tx_area`, `rx_area`, `spn_conversion`\n  2 | nmae = \"pump\"\n    | ^^^^";
        assert_eq!(error.show("b.toml"), expected);
        let error = BusFile::parse("[[id]]\nid = 0x1A0\nservice = \"tpd1\"\n").unwrap_err();
        let shown = error.show("b.toml");
        assert!(shown.starts_with("b.toml:3:11: 'tpd1' is no service"), "{shown}");
        assert!(shown.ends_with("\n  3 | service = \"tpd1\"\n    |           ^^^^^^"), "{shown}");
    }

    #[test]
    fn values_out_of_range_are_refused() {
        fails("[node.128]\nname = \"x\"", "1:7: a node-ID is 1 to 127");
        fails("[node.pump]\nname = \"x\"", "a node-ID is 1 to 127");
        fails("[node.2]\nname = \"x\"\n[node.0x02]\nname = \"y\"", "3:7: node 2/02 is given twice");
        fails("[bus.can0.node.0x02]\n[bus.can0.node.2]", "2:16: node 2/02 is given twice");
        fails("[bus.can0]\nbitrate = 250", "in bit/s: 250 kbit/s is 250000");
        fails("[[id]]\nid = 0x20000000\nservice = \"sync\"", "2:6: an identifier has 11 or 29 bits");
        fails("[[id]]\nid = \"1FFG\"\nservice = \"sync\"", "an identifier");
        fails("[[id]]\nid = 1\nservice = \"emcy\"", "needs a node");
        fails("[[id]]\nid = 1\nservice = \"sync\"\nnode = 5", "4:8: sync belongs to no node");
        fails("[[id]]\nid = 1\nservice = \"tpdo513\"\nnode = 5", "is no service");
        fails("[[id]]\nid = 1\nservice = \"emcy\"\nnode = 0", "4:8: a node-ID is 1 to 127");
        fails(
            "[[id]]\nid = 1\nservice = \"sync\"\n[[id]]\nid = \"001\"\nservice = \"time\"",
            "5:6: 001 is given twice",
        );
    }

    #[test]
    fn values_must_fit_their_objects() {
        let object = |rest: &str| format!("[[node.5.object]]\nobject = \"1017:00\"\n{rest}");
        let value =
            |rest: &str| BusFile::parse(&object(rest)).map(|file| file.everywhere.objects[0].2.clone());
        assert_eq!(value("value = 1000"), Ok(ObjectValue::Bytes(vec![0xE8, 3])));
        fails(&object("value = 65536"), "3:9: 65536 does not fit UNSIGNED16");
        fails(&object("value = -1"), "does not fit");
        fails(&object(""), "give value or data");
        fails(&object("data = \"1\""), "hex pairs");
        fails("[[node.5.object]]\nobject = \"10170\"\nvalue = 1", "2:10: an object is written 1018:01");
        fails("[[node.5.object]]\nobject = \"1010:01\"\nvalue = \"save\"\ndata = \"00\"", "not both");
    }
}
