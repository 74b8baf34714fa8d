//! Why: the diagnosis of a capture, with the changes before a story and the gates closed at that time.
//!
//! ```text
//! Event ─Why::event─▶ changes per node, moments of findings ─┐
//! Findings ─diagnosis─▶ stories ─────────────────────────────┴─Why::report─▶ Report ─text─▶ lines, answers
//! ```
//!
//! All state is bounded. Without a story, faults that no rule judges are reported: simultaneous ones are one
//! moment; one of a lower grade (set point without effect, rejected write) only if there is none of a higher
//! grade.

mod cadence;
mod change;
mod check;
mod fault;
mod followed;
mod moment;
mod node_watch;
mod scope;
mod state;
mod watch;

pub use crate::suggestion::Suggestion;
pub use cadence::{MessageRhythm, StoppedMessage};
pub use change::SHOWN;
pub use fault::{FaultGrade, FaultKind};
pub use moment::WhyMoment;
pub use scope::FaultScope;
pub use state::{NodeState, PointState};

use crate::diagnosis::{Diagnosis, Story};
use crate::event::Event;
use crate::finding::Advice;
use crate::frame::BusIndex;
use crate::profile::Catalogue;
use crate::session::{Bus, Buses, MessagePreview, Node, SdoPairHint};
use crate::statistics::ReactionTime;
use crate::suggestion::suggest_profiles;
use crate::wire::NodeId;
use check::FaultContext;
use watch::BusWatch;

/// Maximum number of reaction times in the report.
const SHOWN_REACTIONS: usize = 4;

/// Scope of the report.
#[derive(Debug, Clone, Default)]
pub struct WhyScope {
    /// Restricts the report to one node.
    pub chosen: Option<NodeChoice>,
    /// Report the latest fault instead of the first; the capture ends at the requested moment.
    pub latest: bool,
    /// Number of the story to report, from 1.
    pub story: usize,
}

/// A node on one bus or on any bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeChoice {
    /// Name of the bus; `None` for any bus.
    pub bus: Option<String>,
    /// Node-ID or J1939 address.
    pub node: NodeId,
}

impl NodeChoice {
    fn is_on(&self, bus: &Bus) -> bool {
        self.bus.as_deref().is_none_or(|name| name == bus.name())
    }
}

/// Observer that collects faults and changes of one capture.
#[derive(Debug, Clone, Default)]
pub struct WhyObserver {
    question: WhyScope,
    buses: Vec<BusWatch>,
    /// A bus has a moment that is still collecting events, or a set point without effect.
    is_watching: bool,
}

/// Reaction time of the controller to one TPDO of a node.
#[derive(Debug, Clone)]
pub struct ControllerReaction {
    /// Bus of the node.
    pub bus: BusIndex,
    /// Node that sends the TPDO and receives the RPDO.
    pub node: NodeId,
    /// Times from a changed TPDO to the next changed RPDO.
    pub time: ReactionTime,
}

/// Result of the analysis.
#[derive(Debug, Clone)]
pub struct WhyReport {
    /// Scope of the report.
    pub question: WhyScope,
    /// Stories within the scope, the selected one first.
    pub diagnosis: Diagnosis,
    /// Number of the selected story.
    pub story: usize,
    /// The moment of the selected story, else of a fault that no rule judges.
    pub moment: Option<WhyMoment>,
    /// Whether the protocol of the faulty bus is unconfirmed: there is a fault only if the bus is CANopen or
    /// J1939.
    pub is_presumed: bool,
    /// Last changes after the fault, or of the chosen node without a fault; oldest first.
    pub since: Vec<Event>,
    /// State of nodes at the fault, at the requested moment, or at the end.
    pub nodes: Vec<NodeState>,
    /// Periodic messages that had stopped.
    pub quiet: Vec<StoppedMessage>,
    /// Things to check, most likely cause first.
    pub checks: Vec<Advice>,
    /// Manual that the sections in `checks` refer to.
    pub document: String,
    /// Reaction times of the controller: of the faulty or chosen node, else the longest ones.
    pub reactions: Vec<ControllerReaction>,
    /// Possible profiles for nodes without one.
    pub suggestions: Vec<Suggestion>,
    /// SDO dialogues on identifiers that no channel explains.
    pub dialogues: Vec<(BusIndex, SdoPairHint)>,
    /// Buses not detected as CANopen, with the reason.
    pub doubts: Vec<(BusIndex, String)>,
    /// Nodes that sent a frame, if the chosen node did not; `None` also if its bus is unknown.
    pub others: Option<Vec<(BusIndex, NodeId)>>,
}

impl WhyObserver {
    /// Creates an observer.
    pub fn new(question: WhyScope) -> Self {
        Self { question, ..Self::default() }
    }

    /// Takes an event; it can be the reported fault only if `may_report`. All events count as changes.
    pub fn observe_event(&mut self, event: &Event, bus: &Bus, may_report: bool) {
        let chosen = self.question.chosen.as_ref();
        if chosen.is_some_and(|chosen| !chosen.is_on(bus)) {
            return;
        }
        let place = self.buses.iter().position(|watch| watch.index() == bus.index());
        let place = place.unwrap_or_else(|| {
            let node = chosen.map(|chosen| chosen.node);
            self.buses.push(BusWatch::new(bus.index(), self.question.latest, node));
            self.buses.len() - 1
        });
        let Some(watch) = self.buses.get_mut(place) else { return };
        watch.observe_event(event, bus, may_report);
        self.is_watching =
            watch.is_watching() || self.buses.len() > 1 && self.buses.iter().any(BusWatch::is_watching);
    }

    /// Whether the event of a frame is needed; see [`Observer::needs_event`](crate::session::Observer::needs_event).
    #[inline]
    pub fn needs_event(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.is_watching && self.watch_of(bus).is_some_and(|watch| watch.needs_event(preview, bus))
    }

    fn watch_of(&self, bus: &Bus) -> Option<&BusWatch> {
        self.buses.iter().find(|watch| watch.index() == bus.index())
    }

    /// Whether a frame without an event may change anything.
    #[inline]
    pub fn changes_state(&self, preview: &MessagePreview) -> bool {
        preview.change != 0 || self.is_watching
    }

    /// Counts a frame whose event is not needed; see [`Observer::skip_event`](crate::session::Observer::skip_event).
    #[inline]
    pub fn skip_event(&mut self, preview: &MessagePreview, bus: &Bus) {
        if self.is_watching {
            return self.watch_preview(preview, bus);
        }
        if preview.change != 0 {
            // Most captures have one bus.
            match self.buses.first_mut() {
                Some(first) if first.index() == bus.index() => first.skip_event(preview),
                _ => self.watch_preview(preview, bus),
            }
        }
    }

    #[cold]
    fn watch_preview(&mut self, preview: &MessagePreview, bus: &Bus) {
        if let Some(watch) = self.buses.iter_mut().find(|watch| watch.index() == bus.index()) {
            watch.watch_preview(preview);
            watch.skip_event(preview);
        }
        self.is_watching = self.buses.iter().any(BusWatch::is_watching);
    }

    /// Creates the report; `buses` are in the state after the last event.
    pub fn build_report(
        mut self,
        diagnosis: Diagnosis,
        buses: Buses<'_>,
        catalogue: &Catalogue,
    ) -> WhyReport {
        let story = self.question.story.saturating_sub(1);
        let moment = match diagnosis.stories.get(story) {
            Some(story) => self.of_story(story),
            None => self.best_moment(buses),
        };
        let (since, nodes, quiet) = match &moment {
            Some(moment) if !self.question.latest => {
                (Vec::new(), moment.state.clone().into_iter().collect(), moment.quiet.clone())
            }
            Some(moment) => self.current_state(buses, moment.bus, moment.node, moment.sequence),
            None => self.no_fault(buses),
        };
        let reactions = self.longest_reactions(buses, moment.as_ref());
        let (checks, document) = self.collect_checks(buses, moment.as_ref(), nodes.first());
        let is_of_bus =
            |bus: &Bus| moment.as_ref().is_some_and(|it| it.node.is_some() && it.bus == bus.index());
        let doubts = buses.iter().filter(|bus| !is_of_bus(bus));
        WhyReport {
            is_presumed: buses.iter().any(|bus| is_of_bus(bus) && !is_believed(bus, moment.as_ref())),
            doubts: doubts.filter_map(|bus| Some((bus.index(), detection_doubt(bus)?))).collect(),
            suggestions: self.profile_suggestions(
                buses,
                moment.as_ref().and_then(|moment| moment.node),
                catalogue,
            ),
            dialogues: buses
                .iter()
                .flat_map(|bus| bus.hints().sdo_dialogues().into_iter().map(|pair| (bus.index(), pair)))
                .collect(),
            others: self.other_nodes(buses),
            question: self.question,
            story,
            diagnosis,
            moment,
            since,
            nodes,
            quiet,
            reactions,
            checks,
            document,
        }
    }

    /// Things to check, and the manual that they refer to.
    fn collect_checks(
        &self,
        buses: Buses<'_>,
        moment: Option<&WhyMoment>,
        state: Option<&NodeState>,
    ) -> (Vec<Advice>, String) {
        let kinds = match (moment, state) {
            (Some(moment), _) => moment.kinds.clone(),
            (None, Some(state)) if state.has_closed_gate() => vec![FaultKind::SetPoint],
            (None, _) => Vec::new(),
        };
        let node =
            state.and_then(|state| find_bus(buses, state.bus)?.node_table().present_or_former(state.node));
        let device = node.filter(|node| node.assigned_by().is_some()).map(Node::device);
        let checks = check::propose_checks(&FaultContext {
            kinds: &kinds,
            device: device.map(|device| &**device),
            lost_settings: moment.is_some_and(WhyMoment::lost_settings),
            state,
            gates_first: self.question.latest,
        });
        (checks, device.map_or_else(String::new, |device| device.source.clone()))
    }

    /// Moment at which the cause of a story began, else its first finding with a moment.
    fn of_story(&mut self, story: &Story) -> Option<WhyMoment> {
        for watch in &mut self.buses {
            watch.finish_watch();
        }
        let watches = || self.buses.iter().filter(|watch| watch.index() == story.bus);
        story.findings.iter().find_map(|id| watches().find_map(|watch| watch.of_finding(*id))).cloned()
    }

    /// Moment with the highest grade of all buses; among equals the first, or the latest if requested.
    fn best_moment(&mut self, buses: Buses<'_>) -> Option<WhyMoment> {
        let latest = self.question.latest;
        let found = self.buses.iter_mut().filter_map(|watch| {
            find_bus(buses, watch.index())
                .filter(|bus| bus.protocols().detection_doubt().is_none() || bus.protocols().is_j1939())?;
            watch.finish_watch()
        });
        found.reduce(|best, other| {
            let earlier = other.sort_key() < best.sort_key();
            match other.highest_grade().cmp(&best.highest_grade()) {
                std::cmp::Ordering::Greater => other,
                std::cmp::Ordering::Equal if earlier != latest => other,
                _ => best,
            }
        })
    }

    /// Current state of a node, and its changes after event number `after`.
    fn current_state(
        &self,
        buses: Buses<'_>,
        index: BusIndex,
        node: Option<NodeId>,
        after: u64,
    ) -> (Vec<Event>, Vec<NodeState>, Vec<StoppedMessage>) {
        let node = node.or(self.question.chosen.as_ref().map(|chosen| chosen.node));
        let watch = self.buses.iter().find(|watch| watch.index() == index);
        let (Some(watch), Some(bus)) = (watch, find_bus(buses, index)) else {
            return (Vec::new(), Vec::new(), Vec::new());
        };
        let state = node.filter(|id| bus.node(*id).is_some()).map(|id| watch.node_state(bus, id));
        // Frames without news are not counted by the watch.
        let now = watch.time().max(bus.last_time());
        (watch.changes_of(node, after), state.into_iter().collect(), watch.overdue_messages(node, now, bus))
    }

    /// Without a fault: the chosen node, or all nodes with a set point without effect.
    fn no_fault(&self, buses: Buses<'_>) -> (Vec<Event>, Vec<NodeState>, Vec<StoppedMessage>) {
        if let Some(chosen) = &self.question.chosen {
            let place = buses.iter().find(|bus| chosen.is_on(bus) && bus.node(chosen.node).is_some());
            let Some(bus) = place else { return (Vec::new(), Vec::new(), Vec::new()) };
            return self.current_state(buses, bus.index(), Some(chosen.node), 0);
        }
        let mut nodes = Vec::new();
        for watch in &self.buses {
            let Some(bus) = find_bus(buses, watch.index()) else { continue };
            let states = watch.nodes().map(|(id, _)| watch.node_state(bus, id));
            nodes.extend(states.filter(NodeState::has_closed_gate));
        }
        (Vec::new(), nodes, Vec::new())
    }

    /// Suggestions for the faulty or chosen node, else for all nodes without a profile.
    fn profile_suggestions(
        &self,
        buses: Buses<'_>,
        node: Option<NodeId>,
        catalogue: &Catalogue,
    ) -> Vec<Suggestion> {
        let wanted = node.or(self.question.chosen.as_ref().map(|chosen| chosen.node));
        let watched = self.buses.iter().filter_map(|watch| find_bus(buses, watch.index()));
        let believed = watched.filter(|bus| bus.protocols().detection_doubt().is_none());
        believed.flat_map(|bus| suggest_profiles(bus, catalogue, wanted)).collect()
    }

    /// The longest reaction times, of the faulty or chosen node if there is one; none from withdrawn events.
    fn longest_reactions(&self, buses: Buses<'_>, moment: Option<&WhyMoment>) -> Vec<ControllerReaction> {
        let chosen = self.question.chosen.as_ref().map(|chosen| chosen.node);
        let node = moment.and_then(|moment| moment.node).or(chosen);
        let is_of_bus = |bus| moment.is_none_or(|moment| moment.bus == bus);
        let of_bus = |watch: &BusWatch| {
            let bus = watch.index();
            let session = find_bus(buses, bus);
            let is_withdrawn =
                |node| session.is_some_and(|session| session.protocols().is_withdrawn(Some(node)));
            let all = watch.reaction_times(node).filter(|(node, _)| !is_withdrawn(*node));
            all.map(|(node, time)| ControllerReaction { bus, node, time: time.clone() }).collect::<Vec<_>>()
        };
        let watched = self.buses.iter().filter(|watch| is_of_bus(watch.index()));
        let mut all: Vec<_> = watched.flat_map(of_bus).collect();
        all.sort_by_key(|reaction| std::cmp::Reverse(reaction.time.times.longest()));
        all.truncate(SHOWN_REACTIONS);
        all
    }

    /// Nodes that sent a frame, if the chosen node did not. An unknown bus is reported elsewhere.
    fn other_nodes(&self, buses: Buses<'_>) -> Option<Vec<(BusIndex, NodeId)>> {
        let chosen = self.question.chosen.as_ref()?;
        let there = || buses.iter().filter(|bus| chosen.is_on(bus));
        let is_there = there().any(|bus| bus.node(chosen.node).is_some_and(|node| node.last_seen().0 > 0));
        let nodes = |bus: &'_ Bus| {
            // NMT commands and guarding requests also create nodes that never send.
            let present = bus.nodes().filter(|node| node.last_seen().0 > 0).map(Node::id);
            let ids = present.filter(|id| *id != chosen.node);
            ids.map(|id| (bus.index(), id)).collect::<Vec<_>>()
        };
        (!is_there && there().next().is_some()).then(|| there().flat_map(nodes).collect())
    }
}

/// Reason why a bus is not detected as CANopen; `None` for J1939 and UDS.
fn detection_doubt(bus: &Bus) -> Option<String> {
    let is_other = !bus.protocols().is_canopen() && !bus.protocols().is_j1939() && !bus.protocols().is_uds();
    let doubt = is_other
        .then(|| bus.protocols().detection_doubt().unwrap_or_else(|| "no CANopen message".to_owned()))?;
    Some(match bus.hints().unnamed_uds().first() {
        Some(hint) => format!("{doubt}; {hint}"),
        None => doubt,
    })
}

/// Whether the protocol of the fault is confirmed on its bus.
fn is_believed(bus: &Bus, moment: Option<&WhyMoment>) -> bool {
    match moment.and_then(|moment| moment.node) {
        Some(node) => bus.protocols().is_settled(Some(node)),
        None => bus.protocols().is_canopen(),
    }
}

fn find_bus(buses: Buses<'_>, index: BusIndex) -> Option<&Bus> {
    buses.iter().find(|bus| bus.index() == index)
}
