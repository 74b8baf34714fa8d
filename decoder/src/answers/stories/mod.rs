//! Causes with their effects, as `cobscope why -f json` prints them; events have the form of `decode -f jsonl`.

mod ground;
mod situation;
pub mod text;

use serde::Serialize;

use super::events::EventObject;
use super::statistics::SdoDialogue;
use crate::diagnosis::{Story, StoryLine};
use crate::finding::{Advice, Occurrence};
use crate::frame::Timestamp;
use crate::session::Buses;
use crate::sink::exact_json::ExactNumber;
use crate::suggestion::Suggestion;
use crate::why::{FaultGrade, WhyMoment, WhyReport};
use crate::wire::NodeId;
use ground::AnswerGround;
pub use situation::{
    DeviceStateName, GateSituation, NodeSituation, ReactionSummary, SetPointSituation, SilentMessage,
};

/// Stories of a capture, the moment of the selected one, and what the capture shows about it.
#[derive(Debug, Clone, Serialize)]
pub struct StoriesAnswer {
    /// Name of the capture.
    pub capture: String,
    /// Chosen node (--node, --only-node).
    pub node: Option<u8>,
    /// Requested moment (--at).
    pub at: Option<String>,
    /// Causes with their effects, most important first.
    pub stories: Vec<StoryAnswer>,
    /// Findings that are notes only.
    pub notes: Vec<StoryText>,
    /// Moment of the selected story, else of a fault that no rule judges.
    pub fault: Option<FaultMoment>,
    /// The protocol is unconfirmed.
    pub presumed: bool,
    /// Last changes before the moment.
    pub before: Vec<EventObject>,
    /// Changes after the moment, with --at.
    pub since: Vec<EventObject>,
    /// Periodic messages that had stopped.
    pub silent: Vec<SilentMessage>,
    /// State of nodes at the moment.
    pub nodes: Vec<NodeSituation>,
    /// Reaction times of the controller.
    pub reactions: Vec<ReactionSummary>,
    /// Steps of the selected story.
    pub checks: Vec<CheckStep>,
    /// Manual that the sections refer to.
    pub document: String,
    /// Possible profiles.
    pub suggestions: Vec<SuggestionOnBus>,
    /// Buses not detected as CANopen.
    pub not_canopen: Vec<BusDoubt>,
    /// SDO dialogues on identifiers without a channel.
    pub sdo_dialogues: Vec<DialogueOnBus>,
}

/// A cause with its effects.
#[derive(Debug, Clone, Serialize)]
pub struct StoryAnswer {
    /// Bus of the cause.
    pub bus: Option<String>,
    /// Whether the capture shows the cause.
    pub cause_visible: bool,
    /// Part of the machine that fails; null if only rules judged.
    pub component: Option<&'static str>,
    /// Numbers of all findings, as in decode and check.
    pub findings: Vec<u64>,
    /// First and last frame.
    pub frames: Option<[u64; 2]>,
    /// The lines of the text.
    pub lines: Vec<StoryText>,
    /// How the part of the machine fails.
    pub mode: Option<&'static str>,
    /// Node-ID or J1939 address of the cause; null for the bus.
    pub node: Option<u8>,
    /// Node-IDs or J1939 addresses of all nodes that the story concerns.
    pub nodes: Vec<u8>,
    /// Rules of the printed findings, cause first.
    pub rules: Vec<String>,
    /// Begin of the cause, from the first frame.
    pub seconds: Option<f64>,
    /// Highest severity of its findings.
    pub severity: &'static str,
    /// Number for --story.
    pub story: usize,
    /// The cause, or the first effect of a cause that is not visible.
    pub title: String,
}

/// A line of a story.
#[derive(Debug, Clone, Serialize)]
pub struct StoryText {
    /// First and last frame.
    pub frames: Option<[u64; 2]>,
    /// Meaning of the line.
    pub label: &'static str,
    /// Time from the first frame.
    pub seconds: Option<f64>,
    /// Text as printed, without the label.
    pub text: String,
}

/// A fault with its immediate consequences.
#[derive(Debug, Clone, Serialize)]
pub struct FaultMoment {
    /// Kinds of fault; empty if a rule found it.
    pub kinds: Vec<&'static str>,
    /// Highest grade of the kinds.
    pub grade: &'static str,
    /// Timestamp in seconds.
    pub t: Option<ExactNumber>,
    /// Time from the first frame.
    pub seconds: Option<ExactNumber>,
    /// Frame.
    pub frame: u64,
    /// Bus.
    pub bus: Option<String>,
    /// Node.
    pub node: Option<u8>,
    /// Fault and immediate consequences.
    pub events: Vec<EventObject>,
    /// Further events, not stored.
    pub more: u64,
}

/// A step to take.
#[derive(Debug, Clone, Serialize)]
pub struct CheckStep {
    /// emcy, dtc, gate, state, code, rule or general.
    pub by: &'static str,
    /// Section of the manual; empty if none.
    pub section: String,
    /// Step.
    pub text: String,
}

/// A profile that the behaviour of a node suggests.
#[derive(Debug, Clone, Serialize)]
pub struct SuggestionOnBus {
    /// Signs.
    pub because: Vec<String>,
    /// Bus.
    pub bus: Option<String>,
    /// Node.
    pub node: u8,
    /// Profile.
    pub profile: String,
    /// Title of the profile.
    pub title: String,
}

/// A bus without detected CANopen.
#[derive(Debug, Clone, Serialize)]
pub struct BusDoubt {
    /// Bus.
    pub bus: Option<String>,
    /// Reason.
    pub reason: String,
}

/// An SDO dialogue on a bus.
#[derive(Debug, Clone, Serialize)]
pub struct DialogueOnBus {
    /// Bus.
    pub bus: Option<String>,
    /// The dialogue.
    #[serde(flatten)]
    pub dialogue: SdoDialogue,
}

impl StoriesAnswer {
    /// The answer of a report; `at` is the requested moment.
    pub fn new(
        report: &WhyReport,
        buses: Buses<'_>,
        first: Option<Timestamp>,
        at: Option<&str>,
        capture: &str,
    ) -> Self {
        let ground = &AnswerGround { buses, first };
        let (diagnosis, moment) = (&report.diagnosis, report.moment.as_ref());
        let stories = (1..).zip(&diagnosis.stories);
        let steps = diagnosis.stories.get(report.story).map(|story| story.steps.as_slice());
        let checks = if diagnosis.stories.is_empty() { report.checks.as_slice() } else { &[] };
        let doubts = report.doubts.iter();
        let doubts =
            doubts.map(|(bus, reason)| BusDoubt { bus: ground.bus_name(*bus), reason: reason.clone() });
        let dialogues = report.dialogues.iter().map(|(bus, hint)| DialogueOnBus {
            bus: ground.bus_name(*bus),
            dialogue: SdoDialogue::new(hint),
        });
        Self {
            capture: capture.to_owned(),
            node: report.question.chosen.as_ref().map(|chosen| chosen.node.number()),
            at: at.map(str::to_owned),
            stories: stories.map(|(number, story)| StoryAnswer::new(number, story, ground)).collect(),
            notes: diagnosis.notes.iter().map(|note| StoryText::new(&note.line, ground)).collect(),
            fault: moment.map(|moment| FaultMoment::new(moment, ground)),
            presumed: report.is_presumed,
            before: ground.events(moment.map_or(&[], |moment| &moment.before)),
            since: ground.events(&report.since),
            silent: report.quiet.iter().map(SilentMessage::new).collect(),
            nodes: report.nodes.iter().map(|state| NodeSituation::new(state, ground)).collect(),
            reactions: report.reactions.iter().map(|it| ReactionSummary::new(it, ground)).collect(),
            checks: steps.unwrap_or_default().iter().chain(checks).map(CheckStep::new).collect(),
            document: report.document.clone(),
            suggestions: report.suggestions.iter().map(|it| SuggestionOnBus::new(it, ground)).collect(),
            not_canopen: doubts.collect(),
            sdo_dialogues: dialogues.collect(),
        }
    }
}

impl StoryAnswer {
    fn new(number: usize, story: &Story, ground: &AnswerGround<'_>) -> Self {
        Self {
            bus: ground.bus_name(story.bus),
            cause_visible: story.is_cause_visible,
            component: story.failure.map(|failure| failure.component),
            findings: story.findings.clone(),
            frames: frames(story.began),
            lines: story.lines.iter().map(|line| StoryText::new(line, ground)).collect(),
            mode: story.failure.map(|failure| failure.mode),
            node: story.node.map(NodeId::number),
            nodes: story.nodes.iter().map(|(_, node)| node.number()).collect(),
            rules: story.rules.iter().map(ToString::to_string).collect(),
            seconds: ground.seconds(story.began),
            severity: story.severity.name(),
            story: number,
            title: story.title.clone(),
        }
    }
}

impl StoryText {
    fn new(line: &StoryLine, ground: &AnswerGround<'_>) -> Self {
        Self {
            frames: frames(line.at),
            label: line.label.json_key(),
            seconds: ground.seconds(line.at),
            text: line.text.clone(),
        }
    }
}

impl FaultMoment {
    fn new(moment: &WhyMoment, ground: &AnswerGround<'_>) -> Self {
        let seconds = moment.time.zip(ground.first).map(|(time, first)| Timestamp(time.since(first)));
        Self {
            kinds: moment.kinds.iter().map(|kind| kind.name()).collect(),
            grade: match moment.highest_grade() {
                FaultGrade::Fault => "fault",
                FaultGrade::Minor => "minor",
                FaultGrade::Refused => "refused",
            },
            t: moment.time.and_then(ExactNumber::of_time),
            seconds: seconds.and_then(ExactNumber::of_time),
            frame: moment.frame,
            bus: ground.bus_name(moment.bus),
            node: moment.node.map(NodeId::number),
            events: ground.events(&moment.events),
            more: moment.more,
        }
    }
}

impl SuggestionOnBus {
    fn new(suggestion: &Suggestion, ground: &AnswerGround<'_>) -> Self {
        let Suggestion { bus, node, profile, title, because, .. } = suggestion.clone();
        Self { because, bus: ground.bus_name(bus), node: node.number(), profile, title }
    }
}

impl CheckStep {
    fn new(advice: &Advice) -> Self {
        Self { by: advice.by.name(), section: advice.section.clone(), text: advice.text.clone() }
    }
}

/// First and last frame; `None` without a frame.
fn frames(at: Occurrence) -> Option<[u64; 2]> {
    (at.frames.last > 0).then_some([at.frames.first, at.frames.last])
}
