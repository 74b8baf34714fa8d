//! State of nodes, identifiers, signals and objects at a position.

use cobscope_decoder::answers::nodes::NodeOverview;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::Persistence;
use cobscope_decoder::replay::{LatestOfNode, ReplayState, signal};
use cobscope_decoder::session::{Bus, Node};
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::IdentifierRow;
use cobscope_decoder::wire::NodeId;
use serde_json::{Value, json};

use crate::rows::seconds_since;

/// Maximum number of bytes shown per payload or value.
const SHOWN_BYTES: usize = 64;

/// Nodes, identifiers and signals.
pub fn state_value(world: &ReplayState) -> Value {
    let buses = world.buses();
    let nodes = buses.iter().flat_map(|bus| bus.nodes().map(move |node| (bus, node)));
    let nodes = nodes.filter(|(_, node)| node.last_seen().0 > 0 || node.was_present());
    let rows = world.identifiers().rows();
    let zero = world.first_time();
    let name = |row: &IdentifierRow| {
        let bus = buses.get(usize::from(row.bus.0));
        (
            bus.map_or(String::new(), |bus| escape(bus.name()).into_owned()),
            bus.map_or(String::new(), |bus| escape(&bus.describe_id(row.id)).into_owned()),
        )
    };
    let frames = rows.iter().map(|row| {
        let (bus, message) = name(row);
        identifier_value(row, (&bus, &message), world.last_time())
    });
    let signals = rows.iter().filter(|row| !row.is_remote).filter_map(|row| {
        let bus = buses.get(usize::from(row.bus.0))?;
        Some(signal_values(bus, row))
    });
    json!({
        "frame": world.frames(),
        "time": seconds_since(world.last_time(), zero),
        "nodes": nodes.map(|(bus, own)| node_value(world, bus, own)).collect::<Vec<_>>(),
        "frames": frames.collect::<Vec<_>>(),
        "signals": signals.flatten().collect::<Vec<_>>(),
    })
}

fn node_value(world: &ReplayState, bus: &Bus, node: &Node) -> NodeOverview {
    let start = world.latest().latest_of(bus.index(), node.id()).and_then(LatestOfNode::last_boot);
    NodeOverview::new(bus, node, world.last_time(), start.map(|start| start.frame))
}

fn hex_text(bytes: &[u8]) -> String {
    let shown = bytes.iter().take(SHOWN_BYTES).map(|byte| format!("{byte:02X}"));
    let more = if bytes.len() > SHOWN_BYTES { " …" } else { "" };
    format!("{}{more}", shown.collect::<Vec<_>>().join(" "))
}

#[expect(clippy::cast_precision_loss, reason = "for display")]
fn identifier_value(row: &IdentifierRow, (bus, message): (&str, &str), now: Option<Timestamp>) -> Value {
    let millis = |nanoseconds: i64| nanoseconds as f64 / 1e6;
    json!({
        "bus": bus,
        "id": row.id.to_string(),
        "remote": row.is_remote,
        "message": message,
        "count": row.count,
        "mean": row.intervals.mean().map(millis),
        "jitter": row.intervals.jitter().map(millis),
        "age": now.zip(row.last_time).map(|(now, last)| millis(now.since(last)) / 1e3),
        "data": hex_text(row.payload()),
    })
}

fn signal_values(bus: &Bus, row: &IdentifierRow) -> Vec<Value> {
    let Some(layout) = &row.layout else { return Vec::new() };
    let all = signal::SignalKey::signals_of(row.bus, row.id, layout);
    let one = |key: signal::SignalKey| {
        let value = layout.decode_signal(key.field, row.payload());
        let field = layout.fields.get(key.field)?;
        let shown = value.as_ref().map(|value| signal::value_text(layout, field, &value.value));
        Some(json!({
            "bus": row.bus.0,
            "bus_name": escape(bus.name()),
            "id": row.id.to_string(),
            "from": escape(&bus.describe_id(row.id)),
            "node": row.node.map(NodeId::label),
            "field": key.field,
            "name": key.name,
            "unit": key.unit,
            "value": shown,
        }))
    };
    all.filter_map(one).collect()
}

/// Known objects of a node.
pub fn object_values(world: &ReplayState, bus: u8, node: NodeId) -> Value {
    let buses = world.buses();
    let Some(node) = buses.get(usize::from(bus)).and_then(|bus| bus.node(node)) else { return json!([]) };
    let zero = world.first_time();
    let one = |(address, entry): &(_, &cobscope_decoder::session::StoredObject)| {
        let meaning = node.meaning(*address);
        let value = meaning.as_ref().map(|meaning| meaning.format_value(&meaning.decode(&entry.value)));
        let waiting = node.store().waiting_value(*address);
        json!({
            "object": address.to_string(),
            "name": meaning.as_ref().map(|meaning| escape(&meaning.name).into_owned()),
            "value": value.map(|value| format!("{}{}", escape(&value), if entry.stale { "?" } else { "" })),
            "raw": hex_text(&entry.value),
            "origin": entry.origin.kind.origin_text(),
            "frame": entry.origin.frame,
            "time": seconds_since(entry.origin.time, zero),
            "persists": node.persistence_text(*address).map(Persistence::name),
            "pending": waiting.map(|pending| hex_text(&pending.value)),
        })
    };
    Value::Array(node.store().sorted().iter().map(one).collect())
}
