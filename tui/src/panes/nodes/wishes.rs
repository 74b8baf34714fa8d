//! Requests to other panes: events and signals of a node.

use cobscope_decoder::profile::{PdoDirection, Role as FieldRole};
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::session::Buses;
use cobscope_decoder::wire::NodeId;

use super::line::Key;
use super::node::Subject;
use super::values;
use crate::panes::Effect;
use crate::state::{Core, NodeKey};
use crate::timeline::SignalKey;

pub(super) fn subject(core: &Core, (index, id): NodeKey) -> Option<Subject<'_>> {
    let world = core.world()?;
    let bus = world.buses().iter().find(|bus| bus.index() == index)?;
    Some(Subject::new(world, bus, bus.node(id)?, core.time()))
}

/// A filter for the node; it names the bus if there are several.
pub(super) fn filter_of(core: &Core, (index, id): NodeKey) -> String {
    let node = match id {
        NodeId::Canopen(id) => format!("node == {id}"),
        NodeId::J1939(address) => format!("source_address == 0x{address:02X}"),
    };
    let buses = core.world().map_or_else(Buses::default, ReplayState::buses);
    match buses.iter().find(|bus| bus.index() == index).filter(|_| buses.len() > 1) {
        Some(bus) => format!("{node} && bus == {:?}", bus.name()),
        None => node,
    }
}

/// Shows the events that match `filter`; a filter set by the user stays.
pub(super) fn to_events(core: &Core, node: Option<NodeKey>, filter: String) -> Vec<Effect> {
    let mut effects: Vec<Effect> = node.map(Effect::Node).into_iter().collect();
    effects.push(Effect::ShowEvents);
    if core.filter.is_empty() {
        effects.push(Effect::Say(format!("filter {filter}; c clears it")));
        effects.push(Effect::Filter(filter));
    }
    effects
}

/// Set points and actual values of a row, for the plot.
pub(super) fn signals(core: &Core, key: Key) -> Vec<SignalKey> {
    let Some(subject) = key.node().and_then(|node| subject(core, node)) else { return Vec::new() };
    let roles = [(FieldRole::SetPoint, PdoDirection::Receive), (FieldRole::Actual, PdoDirection::Transmit)];
    let mut signals = Vec::new();
    for (role, direction) in roles {
        for (row, place, _) in values::fields(&subject.rows, role, direction) {
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
