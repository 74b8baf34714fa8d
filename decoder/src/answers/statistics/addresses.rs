//! J1939 devices in statistics: addresses, names and faults.

use crate::profile;
use crate::session::{Bus, Node};
use crate::sink::table::{CellAlignment, TextTable};
use crate::standard_tables::describe_name;
use crate::statistics::{BusStatistics, DeviceProduct};
use crate::wire::NodeId;
use crate::wire::j1939::{J1939Name, NameFields};

/// Writes one row per source address, with the state at the end of the capture.
pub(super) fn push_table(bus: &Bus, statistics: &BusStatistics, text: &mut String) {
    if !bus.protocols().is_j1939() {
        return;
    }
    let mut table = TextTable::new(&[
        ("SA", CellAlignment::Right),
        ("name", CellAlignment::Left),
        ("NAME", CellAlignment::Left),
        ("manufacturer", CellAlignment::Right),
        ("function", CellAlignment::Right),
        ("industry", CellAlignment::Left),
        ("device", CellAlignment::Left),
        ("claims", CellAlignment::Right),
        ("groups", CellAlignment::Right),
        ("frames", CellAlignment::Right),
        ("faults", CellAlignment::Right),
        ("active", CellAlignment::Right),
    ]);
    for (address, figures) in statistics.addresses() {
        let id = NodeId::J1939(address);
        let (known, counted) = (bus.node(id), statistics.node(id));
        let name = known.and_then(Node::j1939_name);
        let part = |part: Option<u32>| part.map_or("–".to_owned(), |part| part.to_string());
        let parts = name.map(J1939Name::fields);
        let industry = parts.map_or("", |parts| industry_name(parts.industry_group));
        table.add_row([
            id.label(),
            known.and_then(|node| node.name()).unwrap_or("").to_owned(),
            name.map_or("unknown".to_owned(), |name| format!("{:016X}", name.0)),
            part(parts.map(|parts| parts.manufacturer_code.into())),
            part(parts.map(|parts| parts.function.into())),
            industry.to_owned(),
            device_words(parts.as_ref(), counted.map(|node| &node.product)),
            counted.map_or(0, |node| node.claims).to_string(),
            figures.groups.len().to_string(),
            figures.frames.to_string(),
            counted.map_or(0, |node| node.dtcs.total_count()).to_string(),
            known.map_or(0, |node| node.active_dtcs().count()).to_string(),
        ]);
    }
    if !table.is_empty() {
        text.push_str("\n J1939 devices\n");
        table.write_table(1, text);
    }
}

/// Meaning of a trouble code: from the device manual, else from its failure mode.
pub(super) fn dtc_words(node: Option<&Node>, spn: u32, fmi: u8) -> String {
    let own = node.and_then(|node| node.device().trouble_code_entry(spn, fmi)).map(|own| own.text.clone());
    own.unwrap_or_else(|| profile::failure_modes().code_text(u32::from(fmi)).to_owned())
}

/// Function, manufacturer and product: `engine #1, Cummins, X15, software 1.2`.
fn device_words(name: Option<&NameFields>, product: Option<&DeviceProduct>) -> String {
    let product = product.map(DeviceProduct::describe).filter(|words| !words.is_empty());
    let parts = name.and_then(describe_name).into_iter().chain(product);
    parts.collect::<Vec<_>>().join(", ")
}

fn industry_name(group: u8) -> &'static str {
    profile::industry_groups().text_of(u32::from(group)).unwrap_or("reserved")
}
