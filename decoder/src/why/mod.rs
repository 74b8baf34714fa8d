//! Why: the first fault of a capture, the changes before it, the gates closed then, what to check.
//!
//! ```text
//! Event ─Why::event─▶ a ring of changes a node, one open moment a bus ─Why::report─▶ Report ─text─▶ lines
//! ```
//!
//! Everything kept is bounded. Faults of one moment are one; a lesser one (a set point that does not act, a
//! refused write) counts only where there is no graver one.

mod cadence;
mod change;
mod check;
mod fault;
mod moment;
mod state;
mod suggest;
pub mod text;
mod watch;

pub use cadence::{Quiet, Rhythm};
pub use change::SHOWN;
pub use check::Check;
pub use fault::{FaultKind, Grade};
pub use moment::Moment;
pub use state::{NodeState, PointState};
pub use suggest::Suggestion;

use crate::event::Event;
use crate::frame::BusIndex;
use crate::profile::Catalogue;
use crate::session::{Bus, Buses, Node, Observer};
use crate::wire::NodeId;
use check::Ground;
use watch::BusWatch;

/// Nodes without profile for which one is suggested.
const SUGGESTED: usize = 5;

/// What is asked.
#[derive(Debug, Clone, Default)]
pub struct Question {
    /// The only node that counts.
    pub chosen: Option<Chosen>,
    /// The latest fault instead of the first: the capture ends at the moment asked for.
    pub latest: bool,
}

/// A node, of one bus or of any.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chosen {
    /// Name of the bus.
    pub bus: Option<String>,
    /// Node-ID.
    pub node: NodeId,
}

impl Chosen {
    fn is_on(&self, bus: &Bus) -> bool {
        self.bus.as_deref().is_none_or(|name| name == bus.name())
    }
}

/// Watches the events of one capture.
#[derive(Debug, Clone, Default)]
pub struct Why {
    question: Question,
    buses: Vec<BusWatch>,
    is_done: bool,
}

/// The answer.
#[derive(Debug, Clone)]
pub struct Report {
    /// What was asked.
    pub question: Question,
    /// When something went wrong, if ever.
    pub moment: Option<Moment>,
    /// Its bus shows no sign of CANopen, or J1939: it is a fault only if that is what it speaks.
    pub is_presumed: bool,
    /// The last changes behind that moment, or of the node asked for if there is none; oldest first.
    pub since: Vec<Event>,
    /// How nodes stand: at the fault, at the moment asked for, or at the end.
    pub nodes: Vec<NodeState>,
    /// What had come with a beat and was silent.
    pub quiet: Vec<Quiet>,
    /// What to check, likeliest first.
    pub checks: Vec<Check>,
    /// The manual their sections are of.
    pub document: String,
    /// Profiles that nodes without one may have.
    pub suggestions: Vec<Suggestion>,
    /// Buses that are not taken for CANopen, and why.
    pub doubts: Vec<(BusIndex, String)>,
    /// Node-IDs heard of, where the node asked for is not among them.
    pub others: Option<Vec<NodeId>>,
}

impl Observer for Why {
    fn event(&mut self, event: &Event, bus: &Bus) {
        let chosen = self.question.chosen.as_ref();
        if self.is_done || chosen.is_some_and(|chosen| !chosen.is_on(bus)) {
            return;
        }
        if !self.buses.iter().any(|watch| watch.index() == bus.index()) {
            let node = chosen.map(|chosen| chosen.node);
            self.buses.push(BusWatch::new(bus.index(), self.question.latest, node));
        }
        if let Some(watch) = self.buses.iter_mut().find(|watch| watch.index() == bus.index()) {
            watch.event(event, bus);
            self.is_done = watch.is_settled();
        }
    }
}

impl Why {
    /// Nothing seen yet.
    pub fn new(question: Question) -> Self {
        Self { question, ..Self::default() }
    }

    /// Whether further events change nothing.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// The answer; `buses` are those of the decoder behind the last event.
    pub fn report(mut self, buses: Buses<'_>, catalogue: &Catalogue) -> Report {
        let moment = self.moment(buses);
        let (since, nodes, quiet) = match &moment {
            Some(moment) if !self.question.latest => {
                (Vec::new(), moment.state.clone().into_iter().collect(), moment.quiet.clone())
            }
            Some(moment) => self.now(buses, moment.bus, moment.node, moment.sequence),
            None => self.no_fault(buses),
        };
        let (checks, document) = self.checks(buses, moment.as_ref(), nodes.first());
        let is_of_bus =
            |bus: &Bus| moment.as_ref().is_some_and(|it| it.node.is_some() && it.bus == bus.index());
        let doubts = buses.iter().filter(|bus| !is_of_bus(bus));
        Report {
            is_presumed: buses.iter().any(|bus| is_of_bus(bus) && !is_believed(bus, moment.as_ref())),
            doubts: doubts.filter_map(|bus| Some((bus.index(), doubt(bus)?))).collect(),
            suggestions: self.suggestions(buses, moment.as_ref().and_then(|moment| moment.node), catalogue),
            // Where reading ended early the node may come later.
            others: self.others(buses).filter(|_| !self.is_done),
            question: self.question,
            moment,
            since,
            nodes,
            quiet,
            checks,
            document,
        }
    }

    /// What to check, and the manual its sections are of.
    fn checks(
        &self,
        buses: Buses<'_>,
        moment: Option<&Moment>,
        state: Option<&NodeState>,
    ) -> (Vec<Check>, String) {
        let kinds = match (moment, state) {
            (Some(moment), _) => moment.kinds.clone(),
            (None, Some(state)) if state.has_closed_gate() => vec![FaultKind::SetPoint],
            (None, _) => Vec::new(),
        };
        let node = state.and_then(|state| find(buses, state.bus)?.node(state.node));
        let device = node.filter(|node| node.assigned().is_some()).map(Node::device);
        let checks = check::checks(&Ground {
            kinds: &kinds,
            device: device.map(|device| &**device),
            lost_settings: moment.is_some_and(Moment::lost_settings),
            state,
            gates_first: self.question.latest,
        });
        (checks, device.map_or_else(String::new, |device| device.source.clone()))
    }

    /// The gravest moment of all buses; of several the first, or the latest if that is asked for.
    fn moment(&mut self, buses: Buses<'_>) -> Option<Moment> {
        let latest = self.question.latest;
        let found = self.buses.iter_mut().filter_map(|watch| {
            let bus = find(buses, watch.index()).filter(|bus| bus.doubt().is_none() || bus.is_j1939())?;
            watch.finish(bus)
        });
        found.reduce(|best, other| {
            let earlier = other.order() < best.order();
            match other.grade().cmp(&best.grade()) {
                std::cmp::Ordering::Greater => other,
                std::cmp::Ordering::Equal if earlier != latest => other,
                _ => best,
            }
        })
    }

    /// How a node stands now, and what happened to it behind an event.
    fn now(
        &self,
        buses: Buses<'_>,
        index: BusIndex,
        node: Option<NodeId>,
        behind: u64,
    ) -> (Vec<Event>, Vec<NodeState>, Vec<Quiet>) {
        let node = node.or(self.question.chosen.as_ref().map(|chosen| chosen.node));
        let watch = self.buses.iter().find(|watch| watch.index() == index);
        let (Some(watch), Some(bus)) = (watch, find(buses, index)) else {
            return (Vec::new(), Vec::new(), Vec::new());
        };
        let state = node.filter(|id| bus.node(*id).is_some()).map(|id| watch.state(bus, id));
        (watch.changes_of(node, behind), state.into_iter().collect(), watch.quiet(node, watch.time()))
    }

    /// Without a fault: the node asked for, or all with a set point that does not act.
    fn no_fault(&self, buses: Buses<'_>) -> (Vec<Event>, Vec<NodeState>, Vec<Quiet>) {
        if let Some(chosen) = &self.question.chosen {
            let place = buses.iter().find(|bus| chosen.is_on(bus) && bus.node(chosen.node).is_some());
            let Some(bus) = place else { return (Vec::new(), Vec::new(), Vec::new()) };
            return self.now(buses, bus.index(), Some(chosen.node), 0);
        }
        let mut nodes = Vec::new();
        for watch in &self.buses {
            let Some(bus) = find(buses, watch.index()) else { continue };
            let states = watch.nodes().map(|(id, _)| watch.state(bus, id));
            nodes.extend(states.filter(NodeState::has_closed_gate));
        }
        (Vec::new(), nodes, Vec::new())
    }

    /// Of the node at fault or asked for, else of all without a profile.
    fn suggestions(&self, buses: Buses<'_>, node: Option<NodeId>, catalogue: &Catalogue) -> Vec<Suggestion> {
        let wanted = node.or(self.question.chosen.as_ref().map(|chosen| chosen.node));
        let mut found = Vec::new();
        let mut asked = 0;
        for watch in &self.buses {
            let Some(bus) = find(buses, watch.index()).filter(|bus| bus.doubt().is_none()) else { continue };
            for (id, node) in watch.nodes().filter(|(id, _)| wanted.is_none_or(|wanted| wanted == *id)) {
                let unknown = bus.node(id).filter(|node| node.assigned().is_none() && asked < SUGGESTED);
                if let Some(unknown) = unknown {
                    asked += 1;
                    found.extend(node.signs.suggestions(watch.index(), unknown, catalogue));
                }
            }
        }
        found
    }

    /// The nodes there are, where the one asked for is not among them.
    fn others(&self, buses: Buses<'_>) -> Option<Vec<NodeId>> {
        let chosen = self.question.chosen.as_ref()?;
        let there = || buses.iter().filter(|bus| chosen.is_on(bus));
        let is_there = there().any(|bus| bus.node(chosen.node).is_some_and(|node| node.last_seen().0 > 0));
        (!is_there)
            .then(|| there().flat_map(Bus::nodes).map(Node::id).filter(|id| *id != chosen.node).collect())
    }
}

/// Why a bus is not taken for CANopen; `None` too where it is J1939 or UDS.
fn doubt(bus: &Bus) -> Option<String> {
    let is_other = !bus.is_canopen() && !bus.is_j1939() && !bus.is_uds();
    let doubt = is_other.then(|| bus.doubt().unwrap_or_else(|| "no sign of it".to_owned()))?;
    Some(match bus.unnamed_uds() {
        Some(hint) => format!("{doubt}; {hint}"),
        None => doubt,
    })
}

/// Whether the protocol that tells of a fault is believed.
fn is_believed(bus: &Bus, moment: Option<&Moment>) -> bool {
    match moment.and_then(|moment| moment.node) {
        Some(NodeId::J1939(_)) => bus.is_j1939(),
        _ => bus.is_canopen(),
    }
}

fn find(buses: Buses<'_>, index: BusIndex) -> Option<&Bus> {
    buses.iter().find(|bus| bus.index() == index)
}
