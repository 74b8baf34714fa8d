//! State of nodes, identifiers, signals and objects at a position.

use cobscope_decoder::answers::identifiers::IdentifierState;
use cobscope_decoder::answers::nodes::NodeOverview;
use cobscope_decoder::answers::objects::ShownObject;
use cobscope_decoder::answers::seconds_after;
use cobscope_decoder::answers::signals::SignalState;
use cobscope_decoder::replay::{LatestOfNode, ReplayState};
use cobscope_decoder::session::{Bus, Node};
use cobscope_decoder::wire::NodeId;
use serde::Serialize;

/// Nodes, identifiers and signals at a position.
#[derive(Serialize)]
pub struct PositionState {
    frame: u64,
    frames: Vec<IdentifierState>,
    nodes: Vec<NodeOverview>,
    signals: Vec<SignalState>,
    time: Option<f64>,
}

impl PositionState {
    /// The state after a frame.
    pub fn new(world: &ReplayState) -> Self {
        let buses = world.buses();
        let nodes = buses.iter().flat_map(|bus| bus.nodes().map(move |node| (bus, node)));
        let nodes = nodes.filter(|(_, node)| node.last_seen().0 > 0 || node.was_present());
        let rows = || world.identifiers().rows().iter().map(|row| (buses.get(usize::from(row.bus.0)), row));
        Self {
            frame: world.frames(),
            frames: rows().map(|(bus, row)| IdentifierState::new(bus, row, world.last_time())).collect(),
            nodes: nodes.map(|(bus, own)| node_state(world, bus, own)).collect(),
            signals: rows()
                .filter_map(|(bus, row)| Some(SignalState::signals_of(bus?, row)))
                .flatten()
                .collect(),
            time: seconds_after(world.last_time(), world.first_time()),
        }
    }
}

fn node_state(world: &ReplayState, bus: &Bus, node: &Node) -> NodeOverview {
    let start = world.latest().latest_of(bus.index(), node.id()).and_then(LatestOfNode::last_boot);
    NodeOverview::new(bus, node, world.last_time(), start.map(|start| start.frame))
}

/// Known objects of a node.
pub fn known_objects(world: &ReplayState, bus: u8, node: NodeId) -> Vec<ShownObject> {
    let buses = world.buses();
    let Some(node) = buses.get(usize::from(bus)).and_then(|bus| bus.node(node)) else { return Vec::new() };
    let sorted = node.store().sorted().into_iter();
    sorted.map(|object| ShownObject::new(node, object, world.first_time())).collect()
}
