//! Text on a node and on an entry of its object store.

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::session::{Bus, Node, StoredObject};
use cobscope_decoder::sink::escape;

/// `node 2/02 pump on can0`.
pub(super) fn node_label(bus: &Bus, node: &Node) -> String {
    let name = node.name().map_or(String::new(), |name| format!(" {}", escape(name)));
    format!("{}{name} on {}", node.id().sentence_label(), escape(bus.name()))
}

/// ` {88} 1.234 s`: frame and time of a value; empty for a value from a file.
pub(super) fn value_place(entry: &StoredObject, first: Option<Timestamp>) -> String {
    let place = entry.origin.origin_place();
    let time = entry.origin.time.zip(first).map_or(String::new(), |(time, first)| {
        let milliseconds = time.since(first) / 1_000_000;
        format!(" {}.{:03} s", milliseconds / 1000, milliseconds.unsigned_abs() % 1000)
    });
    format!("{place}{time}")
}
