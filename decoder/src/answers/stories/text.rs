//! The report as text; events are printed as by `decode`.

use std::fmt::Write as _;

use crate::diagnosis::{LineLabel, story_count};
use crate::escape::escape;
use crate::event::{EffectiveState, Event, SetPoint, StateCertainty};
use crate::figures::{format_seconds, format_time, seconds_to};
use crate::frame::{BusIndex, Timestamp};
use crate::session::{Bus, Buses, GateState, GateStatus, Node};
use crate::sink::EventSink as _;
use crate::sink::text::{PdoLines, TextOptions, TextSink};
use crate::why::{
    ControllerReaction, FaultGrade, FaultKind, FaultScope, MessageRhythm, NodeState, PointState,
    StoppedMessage, Suggestion, WhyMoment, WhyReport,
};
use crate::wire::NodeId;
use crate::words::count_noun;

/// Maximum number of stories in one report.
const SHOWN_STORIES: usize = 3;

/// Maximum number of notes in one report.
const SHOWN_NOTES: usize = 3;

/// Context for the text.
#[derive(Debug, Clone, Copy)]
pub struct WhyTextContext<'a> {
    /// Buses of the decoder.
    pub buses: Buses<'a>,
    /// Timestamp of the first frame.
    pub first: Option<Timestamp>,
    /// Requested moment: the report is about the state at that time.
    pub at: Option<&'a str>,
    /// End of the range of faults, after which nothing was decoded.
    pub to: Option<&'a str>,
    /// Part of the capture that the faults are selected from.
    pub scope: &'a FaultScope,
}

impl<'a> WhyTextContext<'a> {
    /// Setting for a report about a capture that was decoded to its end.
    pub const fn new(buses: Buses<'a>, first: Option<Timestamp>, scope: &'a FaultScope) -> Self {
        Self { buses, first, at: None, to: None, scope }
    }
}

/// Writes the report.
pub fn write_report(report: &WhyReport, setting: &WhyTextContext<'_>, output: &mut String) {
    let mut page = WhyPage { setting, output };
    for (bus, reason) in &report.doubts {
        page.write_line(0, &format!("bus {} not detected as CANopen: {reason}", page.bus_name(*bus)));
    }
    page.write_absent(report);
    if report.diagnosis.stories.is_empty() {
        page.write_headline(report);
        page.write_notes(report);
        if let Some(moment) = &report.moment {
            page.write_events(&moment.events);
            page.write_more(moment.more);
        }
    }
    page.write_stories(report);
    if let Some(moment) = &report.moment {
        page.write_before(moment);
    }
    page.write_quiet(report);
    if !report.since.is_empty() {
        page.write_line(0, if report.moment.is_some() { "changes after" } else { "last changes" });
        page.write_events(&report.since);
    }
    page.write_states(report);
    page.write_reactions(report);
    if report.diagnosis.stories.is_empty() {
        page.write_checks(report);
    }
    page.write_suggestions(&report.suggestions);
    page.write_dialogues(report);
}

/// Writes the changes before the fault, messages that had stopped, and the states and gates at that time.
pub fn write_context(report: &WhyReport, setting: &WhyTextContext<'_>, output: &mut String) {
    let mut page = WhyPage { setting, output };
    if let Some(moment) = &report.moment {
        page.write_before(moment);
    }
    page.write_quiet(report);
    page.write_states(report);
}

struct WhyPage<'a> {
    setting: &'a WhyTextContext<'a>,
    output: &'a mut String,
}

impl WhyPage<'_> {
    /// Writes a line with two blanks of indentation per level.
    fn write_line(&mut self, level: usize, text: &str) {
        let _ = writeln!(self.output, "{}{}", "  ".repeat(level), escape(text));
    }

    fn find_bus(&self, index: BusIndex) -> Option<&Bus> {
        self.setting.buses.iter().find(|bus| bus.index() == index)
    }

    fn bus_name(&self, index: BusIndex) -> String {
        self.find_bus(index).map_or_else(|| index.0.to_string(), |bus| bus.name().to_owned())
    }

    /// `node 32/20 boom (PVEA, danfoss-pve-ci)`.
    fn node_text(&self, index: BusIndex, id: NodeId) -> String {
        let node = self.find_bus(index).and_then(|bus| bus.node_table().present_or_former(id));
        let mut text = id.sentence_label();
        if let Some(now) = node.map(Node::id).filter(|now| *now != id) {
            let _ = write!(text, ", later {}", now.label());
        }
        if let Some(name) = node.and_then(|node| node.name()) {
            let _ = write!(text, " {name}");
        }
        if let Some((title, device)) = node.and_then(|node| node.device_title().zip(node.device_id())) {
            let _ = write!(text, " ({title}, {device})");
        }
        if self.setting.buses.len() > 1 {
            let _ = write!(text, " on {}", self.bus_name(index));
        }
        text
    }

    /// `371.204 s`, or `frame 12` in a capture without timestamps.
    fn moment_time(&self, moment: &WhyMoment) -> String {
        match moment.time.zip(self.setting.first) {
            Some((time, first)) => format_time(time.since(first)),
            None => format!("frame {}", moment.frame),
        }
    }

    /// Range of faults: `in this capture`, `up to 12.500 s`, `that matches --filter`.
    fn range_text(&self) -> String {
        self.setting.scope.range_text(self.setting.at.or(self.setting.to))
    }

    /// Writes which nodes are present, if the chosen one is not.
    fn write_absent(&mut self, report: &WhyReport) {
        if let (Some(others), Some(chosen)) = (&report.others, &report.question.chosen) {
            let has_several_buses = self.setting.buses.len() > 1;
            let name = |(bus, node): &(BusIndex, NodeId)| {
                if has_several_buses {
                    format!("{} {}", self.bus_name(*bus), node.label())
                } else {
                    node.label()
                }
            };
            let others: Vec<_> = others.iter().map(name).collect();
            let others = if others.is_empty() { "none".into() } else { others.join(", ") };
            // Frames before the range of faults were decoded, too.
            let end = self.setting.at.or(self.setting.to);
            let end = end.map_or_else(|| "in this capture".to_owned(), |end| format!("up to {end}"));
            self.write_line(
                0,
                &format!("{} not present {end}; nodes present: {others}", chosen.node.sentence_label()),
            );
        }
    }

    /// Writes all stories, the selected one first.
    fn write_stories(&mut self, report: &WhyReport) {
        let all = &report.diagnosis.stories;
        let selected = all.iter().enumerate().skip(report.story);
        let shown = if report.question.story > 0 { 1 } else { SHOWN_STORIES };
        let mut unjudged = String::new();
        for (place, story) in selected.clone().take(shown) {
            if place > 0 {
                self.write_line(0, "");
                self.write_line(0, &format!("story {} of {}", place.saturating_add(1), all.len()));
            }
            for line in &story.lines {
                if line.label == LineLabel::Unjudged
                    && std::mem::replace(&mut unjudged, line.text.clone()) == line.text
                {
                    continue;
                }
                self.write_line(0, format!("{:14} {}", line.label.label_word(), line.text).trim_end());
            }
        }
        let rest = selected.count().saturating_sub(shown);
        if rest > 0 && shown > 1 {
            self.write_line(0, &format!("and {} more; --story N prints one", story_count(rest)));
        }
    }

    /// Writes findings that are notes only.
    fn write_notes(&mut self, report: &WhyReport) {
        let notes = &report.diagnosis.notes;
        for line in notes.iter().take(SHOWN_NOTES).map(|note| &note.line) {
            self.write_line(0, &format!("{:14} {}", line.label.label_word(), line.text));
        }
        let rest = notes.len().saturating_sub(SHOWN_NOTES);
        if rest > 0 {
            self.write_line(0, &format!("and {}", count_noun(rest, "further note")));
        }
    }

    fn write_headline(&mut self, report: &WhyReport) {
        let end = self.range_text();
        let Some(moment) = &report.moment else {
            let of = report
                .question
                .chosen
                .as_ref()
                .map_or(String::new(), |it| format!(" of {}", it.node.sentence_label()));
            return self.write_line(0, &format!("no fault{of} {end}{}", self.setting.scope.rest_text()));
        };
        let which = if report.question.latest { "last" } else { "first" };
        let kind = moment.kinds.iter().max_by_key(|kind| kind.fault_grade());
        let fault = match moment.highest_grade() {
            FaultGrade::Fault if report.question.latest => format!("last fault {end}:"),
            FaultGrade::Fault => format!("{which} fault"),
            _ => format!("no fault {end}; {which} {}", kind.map_or("fault", |kind| FaultKind::title(*kind))),
        };
        let place = match moment.node {
            Some(id) => self.node_text(moment.bus, id),
            None => format!("bus {}", self.bus_name(moment.bus)),
        };
        let when = self.moment_time(moment);
        let presumed = match moment.node {
            Some(NodeId::J1939(_)) if report.is_presumed => ", if the bus is J1939",
            _ if report.is_presumed => ", if the bus is CANopen",
            _ => "",
        };
        let at = if moment.time.is_some() && self.setting.first.is_some() { "at" } else { "in" };
        self.write_line(0, &format!("{fault} {at} {when}, {place}{presumed}"));
    }

    fn write_more(&mut self, more: u64) {
        if more > 0 {
            self.write_line(1, &format!("and {more} more"));
        }
    }

    fn write_before(&mut self, moment: &WhyMoment) {
        self.write_line(0, "changes before");
        if moment.before.is_empty() {
            self.write_line(1, "none");
        }
        self.write_events(&moment.before);
    }

    /// Writes events as `decode` prints them.
    fn write_events(&mut self, events: &[Event]) {
        for event in events {
            let Some(bus) = self.find_bus(event.bus) else { continue };
            let mut line = Vec::new();
            let options = TextOptions { all: true, pdo: PdoLines::All, ..TextOptions::default() };
            let mut text = TextSink::new(&mut line, options);
            text.observe_time(self.setting.first);
            text.write_event(event, bus);
            // Writing to memory cannot fail.
            let _ = text.finish_output();
            drop(text);
            let line = String::from_utf8_lossy(&line).into_owned();
            self.write_line(1, line.trim_end());
        }
    }

    fn write_quiet(&mut self, report: &WhyReport) {
        if report.quiet.is_empty() {
            return;
        }
        let end = self.setting.to.filter(|_| report.moment.is_none());
        match self.setting.at.or(end) {
            Some(at) => self.write_line(0, &format!("silent at {at}")),
            None => self.write_line(0, "silent at that time"),
        }
        for StoppedMessage { what, gap, usual, last_frame } in &report.quiet {
            let what = match what {
                MessageRhythm::Sync => "SYNC".to_owned(),
                MessageRhythm::Guarding => "guarding requests".to_owned(),
                MessageRhythm::Rpdo(name) => name.to_string(),
            };
            let (gap, usual) = (format_seconds(*gap), format_seconds(*usual));
            self.write_line(1, &format!("{what} for {gap} s (usual interval {usual} s) {{{last_frame}}}"));
        }
    }

    fn write_states(&mut self, report: &WhyReport) {
        let when = match (self.setting.at, &report.moment, self.setting.to) {
            (Some(at), ..) | (None, None, Some(at)) => format!("at {at}"),
            (None, Some(_), _) => "at that time".to_owned(),
            (None, None, None) => "at the end".to_owned(),
        };
        for state in &report.nodes {
            let is_of_fault = report.moment.as_ref().is_some_and(|moment| moment.node == Some(state.node));
            let of = if is_of_fault {
                String::new()
            } else {
                format!(", {}", self.node_text(state.bus, state.node))
            };
            self.write_line(0, &format!("set points and gates {when}{of}"));
            self.write_line(1, &state_text(state));
            let node =
                self.find_bus(state.bus).and_then(|bus| bus.node_table().present_or_former(state.node));
            let has_profile = node.is_some_and(|node| node.assigned_by().is_some());
            if !has_profile {
                self.write_line(1, "set points unknown: no profile assigned (--node ID=PROFILE)");
            } else if state.set_points.is_empty() {
                self.write_line(1, "no set point received yet");
            }
            self.write_points(&state.set_points);
        }
    }

    /// Writes set points; those with equal gates share one block.
    fn write_points(&mut self, points: &[PointState]) {
        let mut printed = Vec::new();
        for (place, point) in points.iter().enumerate() {
            if printed.contains(&place) {
                continue;
            }
            let alike =
                points.iter().enumerate().skip(place).filter(|(_, other)| other.has_equal_gates(point));
            let alike: Vec<usize> = alike.map(|(place, _)| place).collect();
            let words: Vec<_> =
                alike.iter().filter_map(|place| points.get(*place)).map(|it| value_text(&it.point)).collect();
            let effective = match point.effective {
                EffectiveState::Yes => "effective",
                EffectiveState::No => "NOT effective",
                EffectiveState::Unknown => "effect unknown",
            };
            self.write_line(1, &format!("{}: {effective}", words.join(", ")));
            self.write_gates(&point.gates);
            printed.extend(alike);
        }
    }

    /// Writes gates: one line per closed or unknown gate, one line for all open ones.
    fn write_gates(&mut self, gates: &[GateState]) {
        let names = |status| {
            let names = gates.iter().filter(|gate| gate.status == status).map(|gate| gate.gate.as_str());
            names.collect::<Vec<_>>().join(", ")
        };
        let detail = |gate: &GateState, before: &str, after: &str| match gate.detail.as_str() {
            "" => String::new(),
            detail => format!("{before}{detail}{after}"),
        };
        for gate in gates.iter().filter(|gate| gate.status == GateStatus::Closed) {
            self.write_line(2, &format!("closed   {}{}", gate.gate, detail(gate, ": ", "")));
        }
        let (open, invisible) = (names(GateStatus::Open), names(GateStatus::Invisible));
        if !open.is_empty() {
            self.write_line(2, &format!("open     {open}"));
        }
        for gate in gates.iter().filter(|gate| gate.status == GateStatus::Unknown) {
            self.write_line(2, &format!("unknown  {}{}", gate.gate, detail(gate, " (", ")")));
        }
        if !invisible.is_empty() {
            self.write_line(2, &format!("unknown  {invisible} (not visible on the bus)"));
        }
    }

    fn write_checks(&mut self, report: &WhyReport) {
        let has_section = report.checks.iter().any(|check| !check.section.is_empty());
        if has_section && !report.document.is_empty() {
            self.write_line(0, &format!("steps ({})", report.document));
        } else if !report.checks.is_empty() {
            self.write_line(0, "steps");
        }
        for (number, check) in (1..).zip(&report.checks) {
            let section =
                if check.section.is_empty() { String::new() } else { format!(" ({})", check.section) };
            self.write_line(1, &format!("{number}. {}{section}", check.text));
        }
    }

    /// Writes reaction times of the controller.
    fn write_reactions(&mut self, report: &WhyReport) {
        if !report.reactions.is_empty() {
            self.write_line(0, "reaction of the controller, from a changed TPDO to a changed RPDO");
        }
        for ControllerReaction { bus, node, time } in &report.reactions {
            let name = self.node_text(*bus, *node);
            let part = |part| time.times.percentile(part).map_or_else(String::new, milliseconds_text);
            let (at, frame) = time.longest_at;
            let at = self.setting.first.map_or(0, |first| at.saturating_sub(first.0));
            let (median, most) = (part(50), part(99));
            let max = milliseconds_text(time.times.longest());
            self.write_line(
                1,
                &format!(
                    "{name}: {} → {} median {median}, 99 % {most}, max {max} at {} s {{{frame}}}; {}",
                    time.tpdo,
                    time.rpdo,
                    format_seconds(at),
                    count_noun(time.times.duration_count(), "reaction")
                ),
            );
        }
    }

    fn write_dialogues(&mut self, report: &WhyReport) {
        for (bus, pair) in &report.dialogues {
            let place = if self.setting.buses.len() > 1 {
                format!("bus {}: ", self.bus_name(*bus))
            } else {
                String::new()
            };
            self.write_line(0, &format!("{place}{pair}"));
            for line in pair.bus_file().lines() {
                self.write_line(1, line);
            }
        }
    }

    fn write_suggestions(&mut self, suggestions: &[Suggestion]) {
        if !suggestions.is_empty() {
            self.write_line(0, "possible profiles (based on behaviour only)");
        }
        for Suggestion { bus, node, profile, title, because, .. } in suggestions {
            let place = if self.setting.buses.len() > 1 {
                format!("{}:", self.bus_name(*bus))
            } else {
                String::new()
            };
            let because = because.join("; ");
            self.write_line(
                1,
                &format!(
                    "{} behaves like {title}: --node {place}{node}={profile} ({because})",
                    node.sentence_label()
                ),
            );
        }
    }
}

/// `operational, FAULT HOLD, error 8305`, `SPN 298985 FMI 19`.
fn state_text(state: &NodeState) -> String {
    let mut words = Vec::new();
    match state.nmt {
        Some(nmt) if nmt.certainty == StateCertainty::Confirmed => words.push(nmt.state.name().to_owned()),
        Some(nmt) => words.push(format!("{}?", nmt.state.name())),
        None if state.node.canopen().is_some() => words.push("NMT state unknown".to_owned()),
        None => {}
    }
    if state.lost {
        words.push("silent".into());
    }
    for (channel, name) in &state.states {
        let channel = channel.map_or(String::new(), |channel| format!("c{channel} "));
        words.push(format!("{channel}{name}"));
    }
    words.extend(state.errors.iter().map(|code| format!("error {code:04X}")));
    words.extend(state.dtcs.iter().map(|(spn, fmi)| format!("SPN {spn} FMI {fmi}")));
    if words.is_empty() {
        words.push("no fault reported".into());
    }
    words.join(", ")
}

/// `c2 position +37.5 %`.
fn value_text(point: &SetPoint) -> String {
    let channel = point.channel.map_or(String::new(), |channel| format!("c{channel} "));
    let doubt = if point.assumed { "?" } else { "" };
    format!("{channel}{} {}{doubt}", point.signal, point.to.text)
}

/// A reaction time: `67.948 ms`.
fn milliseconds_text(nanoseconds: i64) -> String {
    format!("{} ms", seconds_to(nanoseconds.saturating_mul(1_000), 3))
}
