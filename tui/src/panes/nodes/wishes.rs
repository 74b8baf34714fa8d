//! Requests to other panes: events and signals of a node.

use cobscope_decoder::profile::{ObjectRole as FieldRole, PdoDirection};
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::session::Buses;
use cobscope_decoder::wire::NodeId;

use super::line::NodeRowKey;
use super::node::ShownNode;
use super::values;
use crate::panes::PaneRequest;
use crate::state::{NodeKey, UiState};
use crate::timeline::SignalKey;

pub(super) fn shown_node(core: &UiState, (index, id): NodeKey) -> Option<ShownNode<'_>> {
    let world = core.bus_state()?;
    let bus = world.buses().iter().find(|bus| bus.index() == index)?;
    Some(ShownNode::new(world, bus, bus.node(id)?, core.cursor_time()))
}

/// A filter for the node; it names the bus if there are several.
pub(super) fn filter_of(core: &UiState, (index, id): NodeKey) -> String {
    let node = match id {
        NodeId::Canopen(id) => format!("node == {id}"),
        NodeId::J1939(address) => format!("source_address == 0x{address:02X}"),
    };
    let buses = core.bus_state().map_or_else(Buses::default, ReplayState::buses);
    match buses.iter().find(|bus| bus.index() == index).filter(|_| buses.len() > 1) {
        Some(bus) => format!("{node} && bus == {:?}", bus.name()),
        None => node,
    }
}

/// Shows the events that match `filter`; a filter set by the user stays.
pub(super) fn to_events(core: &UiState, node: Option<NodeKey>, filter: String) -> Vec<PaneRequest> {
    let mut effects: Vec<PaneRequest> = node.map(PaneRequest::Node).into_iter().collect();
    effects.push(PaneRequest::ShowEvents);
    if core.filter.is_empty() {
        effects.push(PaneRequest::Say(format!("filter {filter}; c clears it")));
        effects.push(PaneRequest::Filter(filter));
    }
    effects
}

/// Set points and actual values of a row, for the plot.
pub(super) fn row_signals(core: &UiState, key: NodeRowKey) -> Vec<SignalKey> {
    let Some(subject) = key.node().and_then(|node| shown_node(core, node)) else { return Vec::new() };
    let roles = [(FieldRole::SetPoint, PdoDirection::Receive), (FieldRole::Actual, PdoDirection::Transmit)];
    let mut signals = Vec::new();
    for (role, direction) in roles {
        for (row, place, _) in values::role_fields(&subject.rows, role, direction) {
            let Some(layout) = &row.layout else { continue };
            let meaning = layout.fields.get(place).and_then(|field| field.meaning.as_deref());
            let Some(meaning) = meaning else { continue };
            if key.channel().is_some() && meaning.channel.is_some() && meaning.channel != key.channel() {
                continue;
            }
            signals.extend(SignalKey::new(row.bus, row.id, layout, place));
        }
    }
    signals
}
