//! A report in preparation: what the second reading of the capture collects.

use super::assumptions::{self, ReportBasis};
use super::citations::{Citations, number_lines};
use super::claims::{SHOWN_CLAIMS, assigned_by, build_claim, describe_node, sources_of, story_groups};
use super::clock;
use super::curves::ClaimCurves;
use super::excerpt::CommentedExcerpt;
use super::model::{
    CaptureFacts, CaptureReport, EvidenceFrame, NodeValues, PlotMark, Provenance, ReportClaim,
};
use super::quality;
use super::values::node_values;
use super::window::ClaimWindow;
use crate::answers::stories::text;
use crate::capture::BusNames;
use crate::diagnosis::{Diagnosis, Story};
use crate::event::Event;
use crate::figures::format_time;
use crate::finding::{CaptureFindings, FindingSubject};
use crate::frame::{BusIndex, Frame, FrameFlags, Timestamp};
use crate::reading::{FrameDemand, ReadingPart};
use crate::session::{Bus, Buses, MessagePreview};
use crate::sink::text::EventLine;
use crate::statistics::Statistics;
use crate::why::{FaultGrade, FaultScope, WhyMoment, WhyReport};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Maximum number of events described per frame.
const MOST_EVENTS: usize = 3;

/// Maximum number of nodes per claim with object values.
const MOST_NODES: usize = 2;

/// Results of the first reading of a capture.
#[derive(Debug, Clone, Copy)]
pub struct ReportGround<'a> {
    /// The answer of `why`, with the selected stories.
    pub answer: &'a WhyReport,
    /// All findings.
    pub findings: &'a CaptureFindings,
    /// Statistics of the capture.
    pub statistics: &'a Statistics,
    /// Buses in the state after the last frame.
    pub buses: Buses<'a>,
    /// Timestamp of the first frame.
    pub first: Option<Timestamp>,
    /// Name of the capture.
    pub capture: &'a str,
    /// Title of its format.
    pub format: &'a str,
    /// Why the capture was not read to its end.
    pub failure: Option<&'a str>,
    /// Part of the capture that the stories are selected from.
    pub scope: &'a FaultScope,
}

impl ReportGround<'_> {
    fn stories(&self) -> &[Story] {
        &self.answer.diagnosis.stories
    }

    /// Stories with a claim: the selected one, or the first ones.
    fn claimed_stories(&self) -> impl Iterator<Item = &Story> {
        let (from, count) = match self.answer.question.story {
            0 => (0, SHOWN_CLAIMS),
            story => (story.saturating_sub(1), 1),
        };
        self.stories().iter().skip(from).take(count)
    }
}

/// A report in preparation. It observes a second reading of the same capture, with the same options.
#[derive(Debug, Clone)]
pub struct ReportDraft {
    report: CaptureReport,
    plans: Vec<ClaimPlan>,
    excerpt: CommentedExcerpt,
    zero: Option<Timestamp>,
}

/// What to collect for one claim.
#[derive(Debug, Clone)]
struct ClaimPlan {
    claim: ReportClaim,
    cited: Citations,
    window: ClaimWindow,
    curves: ClaimCurves,
    marks: Vec<PlotMark>,
    bus: BusIndex,
    nodes: Vec<NodeId>,
    subjects: Vec<ObjectAddress>,
    /// Frame after which the object values are taken.
    at: u64,
    values: Option<Vec<NodeValues>>,
}

impl ReportDraft {
    /// Starts the second reading.
    pub fn new(ground: &ReportGround<'_>) -> Self {
        let plans: Vec<_> =
            (1..).zip(ground.claimed_stories()).map(|one| ClaimPlan::new(one, ground)).collect();
        let mut report = first_facts(ground);
        if plans.is_empty() {
            let mut account = String::new();
            let setting = text::WhyTextContext::new(ground.buses, ground.first, ground.scope);
            text::write_report(ground.answer, &setting, &mut account);
            report.account = account.lines().map(str::to_owned).collect();
            let is_fault = |it: &WhyMoment| it.highest_grade() == FaultGrade::Fault && it.time.is_some();
            report.has_unjudged_fault = ground.answer.moment.as_ref().is_some_and(is_fault);
        }
        let mut draft = Self { report, plans, excerpt: CommentedExcerpt::default(), zero: ground.first };
        if let Some(plan) = draft.plans.first_mut() {
            let mut context = String::new();
            let setting = text::WhyTextContext::new(ground.buses, ground.first, ground.scope);
            text::write_context(ground.answer, &setting, &mut context);
            plan.claim.context = context.lines().map(str::to_owned).collect();
        }
        draft.add_comments();
        draft
    }

    /// Comments of the cut-out capture.
    fn add_comments(&mut self) {
        for plan in &self.plans {
            for (frame, marks) in plan.cited.iter() {
                let facts =
                    plan.claim.lines.iter().filter(|it| it.mark.is_some_and(|it| marks.contains(&it)));
                let facts: Vec<_> = facts.map(|line| line.text.as_str()).collect();
                let text = match facts.as_slice() {
                    [] => format!("claim {}: {}", plan.claim.number, plan.claim.title),
                    facts => format!("claim {}: {}", plan.claim.number, facts.join("; ")),
                };
                let known = self.excerpt.comments.entry(frame).or_default();
                if !known.is_empty() {
                    known.push('\n');
                }
                known.push_str(&text);
            }
        }
    }

    /// Takes a frame, before its events; `bus` is the name of its bus.
    pub fn take_frame(&mut self, frame: &Frame, bus: &str) {
        let mut is_near = false;
        for plan in &mut self.plans {
            let is_cited = plan.cited.contains(frame.number);
            is_near |= is_cited || plan.window.contains(frame.time, frame.number);
            if is_cited {
                plan.claim.evidence.push(evidence_frame(frame, bus, self.zero));
            }
        }
        if is_near {
            self.excerpt.add_frame(frame, bus);
        }
    }

    /// Takes a frame, after its events; `bus` is in the state after the frame.
    pub fn frame_decoded(&mut self, frame: &Frame, bus: &Bus) {
        for plan in &mut self.plans {
            if plan.values.is_none() && plan.bus == bus.index() && frame.number >= plan.at {
                plan.take_values(bus, frame.number);
            }
        }
    }

    /// The report, and the frames around its claims. `buses` are in the state after the last frame.
    pub fn finish_report(
        self,
        buses: Buses<'_>,
        provenance: Provenance,
    ) -> (CaptureReport, CommentedExcerpt) {
        let Self { mut report, plans, excerpt, .. } = self;
        for mut plan in plans {
            if plan.values.is_none()
                && let Some(bus) = buses.iter().find(|bus| bus.index() == plan.bus)
            {
                plan.take_values(bus, bus.last_frame());
            }
            let claim = plan.finish_claim();
            for text in assumptions::of_claim(&claim) {
                if !report.assumptions.contains(&text) {
                    report.assumptions.push(text);
                }
            }
            report.claims.push(claim);
        }
        report.provenance = provenance;
        (report, excerpt)
    }
}

impl ReportDraft {
    /// Takes an event of the capture; `bus` is in the state after the event.
    pub fn event(&mut self, event: &Event, bus: &Bus) {
        for plan in &mut self.plans {
            plan.take_event(event, bus);
        }
    }

    /// Whether the event of a frame is needed: a claim cites it, or its values are in a curve.
    pub fn needs(&self, preview: &MessagePreview) -> bool {
        let is_near = |plan: &ClaimPlan| {
            plan.cited.contains(preview.frame) || plan.window.contains(Some(preview.time), preview.frame)
        };
        self.plans.iter().any(is_near)
    }
}

impl ClaimPlan {
    fn new((number, story): (usize, &Story), ground: &ReportGround<'_>) -> Self {
        let lines = number_lines(story);
        let cited = Citations::citations_of(story, &lines, ground.findings);
        let window = ClaimWindow::window_of(story);
        let abouts = story_groups(story, ground.findings).map(|group| &group.key.about);
        let subjects: Vec<_> = abouts
            .filter_map(|about| match about {
                FindingSubject::Object(object) => Some(*object),
                _ => None,
            })
            .collect();
        let mut nodes: Vec<_> =
            story.nodes.iter().filter(|(bus, _)| *bus == story.bus).map(|(_, node)| *node).collect();
        nodes.extend(story.node.filter(|node| !nodes.contains(node)));
        let text = lines.iter().map(|line| line.text.as_str()).collect::<Vec<_>>().join("\n");
        let names = subjects.iter().map(ToString::to_string).collect();
        let curves = ClaimCurves::new(
            (window, ground.first),
            axis_range(window, ground),
            (story.bus, nodes.clone()),
            (names, text),
        );
        let marks = lines.iter().zip(&story.lines).filter_map(|(line, fact)| {
            let at = window.axis_position(fact.at.time, fact.at.frames.last, ground.first)?;
            Some(PlotMark { number: line.mark?, at })
        });
        let at = story.began.frames.last.max(story.began.frames.first);
        Self {
            marks: marks.collect(),
            claim: build_claim((number, story), lines, ground.findings, (ground.buses, ground.first)),
            cited,
            window,
            curves,
            bus: story.bus,
            nodes,
            subjects,
            at: if at == 0 { u64::MAX } else { at },
            values: None,
        }
    }

    fn take_event(&mut self, event: &Event, bus: &Bus) {
        self.curves.take_event(event);
        let (first, last) = (event.frames.first, event.frames.last);
        for frame in &mut self.claim.evidence {
            let is_of_frame = frame.number == last || frame.number == first;
            if is_of_frame && frame.meaning.len() < MOST_EVENTS {
                let line = EventLine::describe_event(event, bus);
                frame.meaning.push(format!("{}  {}  {}", line.who, line.kind, line.what));
                frame.is_presumed |= event.presumed;
            }
        }
    }

    fn take_values(&mut self, bus: &Bus, frame: u64) {
        let nodes = self.nodes.iter().take(MOST_NODES);
        self.values = Some(nodes.filter_map(|id| node_values(bus, *id, &self.subjects, frame)).collect());
    }

    fn finish_claim(self) -> ReportClaim {
        let Self { mut claim, cited, curves, marks, values, .. } = self;
        for (number, facts) in cited.iter() {
            if let Some(frame) = claim.evidence.iter_mut().find(|frame| frame.number == number) {
                frame.marks = facts.to_vec();
            }
        }
        claim.omitted = cited.omitted;
        claim.plots = curves.build_plots(&marks);
        claim.values = values.unwrap_or_default();
        claim
    }
}

/// All parts of the report that the first reading provides.
fn first_facts(ground: &ReportGround<'_>) -> CaptureReport {
    let ReportGround { answer, findings, statistics, buses, .. } = *ground;
    let quality = &statistics.quality;
    let capture = CaptureFacts {
        name: ground.capture.to_owned(),
        format: ground.format.to_owned(),
        frames: quality.frames,
        duration: quality.duration().map(format_time),
        failure: ground.failure.map(str::to_owned),
    };
    let shown: Vec<_> = ground.claimed_stories().collect();
    let is_shown = |story: &Story| shown.iter().any(|known| known.findings == story.findings);
    let mut sources = Vec::new();
    for source in shown.iter().flat_map(|story| sources_of(story, findings)) {
        if !sources.contains(&source) {
            sources.push(source);
        }
    }
    let basis = ReportBasis { stories: &shown, findings, buses, is_presumed: answer.is_presumed };
    CaptureReport {
        further: ground.stories().iter().filter(|it| !is_shown(it)).map(|it| it.title.clone()).collect(),
        notes: note_texts(&answer.diagnosis),
        coverage: quality::verdict_coverage(findings),
        sources,
        quality: quality::quality_facts(&capture, statistics, findings),
        blind: quality::blind_spots(&shown, statistics, findings),
        assumptions: assumptions::of_capture(&basis),
        clock: clock::clock_statements(&capture, quality),
        devices: device_texts(buses),
        scope: ground.scope.scope_text(&answer.question),
        capture,
        ..CaptureReport::default()
    }
}

fn note_texts(diagnosis: &Diagnosis) -> Vec<String> {
    diagnosis.notes.iter().map(|note| note.line.text.clone()).collect()
}

/// Nodes with a profile, and its source.
fn device_texts(buses: Buses<'_>) -> Vec<String> {
    let of_bus = |bus: &'_ Bus| {
        let nodes =
            bus.nodes().filter(|it| it.last_seen().0 > 0).filter_map(|it| Some((it, it.assigned_by()?)));
        let described = nodes.map(|(it, by)| {
            let manual = it.device().source.as_str();
            let manual = if manual.is_empty() { String::new() } else { format!("; manual: {manual}") };
            format!("{} on {}: {}{manual}", describe_node(bus, it.id()), bus.name(), assigned_by(by))
        });
        described.collect::<Vec<_>>()
    };
    buses.iter().flat_map(of_bus).collect()
}

/// Part of the horizontal axis to draw: the window within the capture.
fn axis_range(window: ClaimWindow, ground: &ReportGround<'_>) -> (f64, f64) {
    let quality = &ground.statistics.quality;
    #[expect(clippy::cast_precision_loss, reason = "drawn with a few digits")]
    let of = |at: Timestamp| ground.first.map_or(0.0, |first| at.since(first) as f64 / 1e9);
    match window {
        ClaimWindow::Times(from, to) => {
            let last = quality.last.map_or(to, |last| to.min(Timestamp(last)));
            let first = quality.first.map_or(from, |first| from.max(Timestamp(first)));
            (of(first), of(last.max(first)))
        }
        #[expect(clippy::cast_precision_loss, reason = "drawn with a few digits")]
        ClaimWindow::Frames(from, to) => (from.max(1) as f64, to.min(quality.frames) as f64),
    }
}

/// A frame as evidence, without its meaning.
fn evidence_frame(frame: &Frame, bus: &str, zero: Option<Timestamp>) -> EvidenceFrame {
    let kind = match () {
        () if frame.flags.contains(FrameFlags::ERROR) => " error",
        () if frame.flags.contains(FrameFlags::REMOTE) => " remote",
        () if frame.flags.contains(FrameFlags::FD) => " FD",
        () => "",
    };
    let bytes: Vec<_> = frame.data().iter().map(|byte| format!("{byte:02X}")).collect();
    let time = frame.time.zip(zero).map(|(time, zero)| format_time(time.since(zero)));
    EvidenceFrame {
        number: frame.number,
        time: time.unwrap_or_default(),
        bus: bus.to_owned(),
        id: format!("{}{kind}", frame.id),
        bytes: bytes.join(" "),
        ..EvidenceFrame::default()
    }
}

impl ReadingPart for ReportDraft {
    fn event(&mut self, event: &Event, bus: &Bus) {
        Self::event(self, event, bus);
    }

    fn finding(&mut self, _event: &Event, _bus: &Bus) {}

    fn need(&self, preview: &MessagePreview, _bus: &Bus) -> bool {
        self.needs(preview)
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Decoded
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) {
        Self::take_frame(self, frame, names.name_of(frame.bus));
    }

    fn frame_decoded(&mut self, frame: &Frame, bus: &Bus) {
        Self::frame_decoded(self, frame, bus);
    }
}
