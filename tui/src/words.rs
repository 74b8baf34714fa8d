//! Text on buses and nodes that the user named.

use cobscope_decoder::session::{Bus, Buses, SessionOptions};
use cobscope_decoder::sink::escape;
use cobscope_decoder::why::NodeChoice;
use cobscope_decoder::wire::NodeId;

/// Maximum number of nodes in a list.
const LISTED: usize = 20;

/// Error for a bus name in `by` that occurs in no capture; `None` if the name exists.
pub fn unknown_bus(captures: &str, name: &str, by: &str, names: &[&str]) -> Option<String> {
    let (has, shown) = (names.join(", "), escape(name));
    let has = escape(&has);
    (!names.contains(&name)).then(|| format!("{captures}: unknown bus {shown} in {by}; buses present: {has}"))
}

/// Note on nodes that the user named and that sent no frame, with the nodes that did.
pub fn unheard_note(capture: &str, buses: Buses<'_>, options: &SessionOptions) -> Option<String> {
    unheard_until(capture, buses, options, None)
}

/// As [`unheard_note`], for a capture of which only the part up to `end` was read.
pub fn unheard_until(
    capture: &str,
    buses: Buses<'_>,
    options: &SessionOptions,
    end: Option<&str>,
) -> Option<String> {
    let mut missing: Vec<NodeId> = Vec::new();
    for bus in buses.iter() {
        for (node, is_own) in options.named_nodes(bus.name()) {
            let is_present =
                if is_own { has_sent(bus, node) } else { buses.iter().any(|bus| has_sent(bus, node)) };
            if !is_present && !missing.contains(&node) {
                missing.push(node);
            }
        }
    }
    let end = end.map_or_else(String::new, |end| format!(" up to {end}"));
    no_frame_of(capture, buses, &missing, &end)
}

/// Notes on nodes of `--only-node` that sent no frame, and on their buses that do not exist; empty if each node sent one.
pub fn absent_choices(capture: &str, buses: Buses<'_>, choices: &[NodeChoice]) -> Vec<String> {
    let names: Vec<&str> = buses.iter().map(Bus::name).collect();
    let (mut notes, mut missing) = (Vec::new(), Vec::new());
    for choice in choices {
        let wanted = choice.bus.as_deref();
        if let Some(note) = wanted.and_then(|name| unknown_bus(capture, name, "--only-node", &names)) {
            if !notes.contains(&note) {
                notes.push(note);
            }
            continue;
        }
        let is_on = |bus: &Bus| wanted.is_none_or(|name| name == bus.name());
        let is_present = buses.iter().any(|bus| is_on(bus) && has_sent(bus, choice.node));
        if !is_present && !missing.contains(&choice.node) {
            missing.push(choice.node);
        }
    }
    notes.extend(no_frame_of(capture, buses, &missing, ""));
    notes
}

/// Note on `missing` nodes; `None` if there are none.
fn no_frame_of(capture: &str, buses: Buses<'_>, missing: &[NodeId], end: &str) -> Option<String> {
    let first = missing.first()?;
    let (subject, others) = match missing {
        [_] => (first.sentence_label(), String::new()),
        several => ("named nodes".to_owned(), format!(" {}", node_list(several.iter().copied()))),
    };
    let present = present_nodes(buses);
    Some(format!("{capture}: {subject}{others} sent no frame{end}; nodes present: {present}"))
}

/// Labels of the nodes that sent a frame, with their buses if there are several: `can0 1/01, can1 5/05`.
pub fn present_nodes(buses: Buses<'_>) -> String {
    let mut all = Vec::new();
    for bus in buses.iter() {
        let nodes = bus.nodes().filter(|node| node.last_seen().0 > 0).map(|node| node.id().label());
        if buses.len() > 1 {
            all.extend(nodes.map(|node| format!("{} {node}", escape(bus.name()))));
        } else {
            all.extend(nodes);
        }
    }
    if all.is_empty() { "none".to_owned() } else { shorten_labels(all) }
}

/// Whether a node sent a frame, also under a later node-ID, or was present before the capture.
fn has_sent(bus: &Bus, node: NodeId) -> bool {
    bus.node_table().present_or_former(node).is_some_and(|node| node.last_seen().0 > 0 || node.was_present())
}

fn node_list(nodes: impl Iterator<Item = NodeId>) -> String {
    shorten_labels(nodes.map(NodeId::label).collect())
}

/// Labels separated by commas, of many only the first.
fn shorten_labels(labels: Vec<String>) -> String {
    let more = if labels.len() > LISTED { ", …" } else { "" };
    let shown: Vec<String> = labels.into_iter().take(LISTED).collect();
    format!("{}{more}", shown.join(", "))
}
