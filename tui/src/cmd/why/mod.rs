//! `cobscope why`: the diagnosis as stories, the changes before the first one, and the gates closed at that
//! time.

mod json;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::diagnosis::{self, Diagnosis};
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::Findings;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::rules::{Engine, Judge};
use cobscope_decoder::session::{Bus, Buses, Observer, Preview};
use cobscope_decoder::sink::escape;
use cobscope_decoder::why::text::{self, Setting};
use cobscope_decoder::why::{NodeChoice, Question, Why};

use super::decoding::{CaptureObserver, decode_capture, report};
use super::input::setup;
use super::messages::complain;
use super::selected_findings::SelectedFindings;
use crate::cli::{ReportFormat, WhyArgs};
use crate::exit_code::Exit;
use crate::select::{Bound, BoundSide, Selection, Span};

/// Runs the command.
pub fn run(arguments: &WhyArgs) -> Exit {
    if let Err(error) = arguments.select.selection() {
        complain(&error);
        return Exit::Usage;
    }
    let several = arguments.input.captures.len() > 1;
    report(&arguments.input, |series, options, output| {
        let setup = Arc::new(setup(&arguments.input, &options.catalogue, None)?);
        let mut watch = Watch {
            engine: Engine::new(setup),
            facts: Facts {
                why: Why::new(question(arguments)),
                selection: arguments.select.selection()?,
                is_limited: true,
                findings: SelectedFindings::new(arguments.select.selection()?),
            },
            at: arguments.at,
            first: None,
        };
        let decoded = decode_capture(series, &arguments.input, options, &mut watch)?;
        let name = series.name();
        decoded.report_unreadable(&name);
        let buses = decoded.decoder.buses();
        let Watch { engine, mut facts, at, first } = watch;
        let findings = engine.finish(buses, &mut facts);
        let Facts { why, selection, findings: selected, .. } = facts;
        if let Some(missed) = selection.missed(decoded.decoder.frames(), decoded.decoder.last_time()) {
            complain(&anyhow::anyhow!("{name}: {missed}"));
        }
        let at = at.map(|at| moment(at, first));
        let last = decoded.decoder.last_time();
        let selected = selected.numbers(&findings.groups);
        let diagnosis = diagnosis(&findings, &selected, (first, last), (arguments, buses));
        let answer = why.report(diagnosis, buses, &options.catalogue);
        match arguments.format {
            ReportFormat::Text => {
                if several && !series.is_joined_from(&arguments.input.captures) {
                    let _ = writeln!(output, "== {}", escape(&name));
                }
                text::write(&answer, &Setting { buses, first, at: at.as_deref() }, output);
            }
            ReportFormat::Json => {
                output.push_str(&json::line(&answer, buses, first, at.as_deref(), &name));
                output.push('\n');
            }
        }
        Ok(decoded.failure)
    })
}

/// Stories with a selected finding, about the chosen node.
fn diagnosis(
    findings: &Findings,
    selected: &BTreeSet<u64>,
    (zero, end): (Option<Timestamp>, Option<Timestamp>),
    (arguments, buses): (&WhyArgs, Buses<'_>),
) -> Diagnosis {
    let setting = diagnosis::Setting { zero, end: end.filter(|_| arguments.at.is_some()), is_growing: false };
    let mut diagnosis = Diagnosis::of(findings, findings.counting(), setting);
    diagnosis.stories.retain(|story| story.findings.iter().any(|id| selected.contains(id)));
    if let Some(chosen) = question(arguments).chosen {
        diagnosis.keep_node(|index, node| {
            let bus = buses.iter().find(|bus| bus.index() == index);
            node == chosen.node
                && chosen.bus.as_deref().is_none_or(|name| bus.is_some_and(|bus| bus.name() == name))
        });
    }
    diagnosis
}

/// A node without a profile is the chosen node.
fn question(arguments: &WhyArgs) -> Question {
    let chosen = arguments.input.node.iter().find(|node| node.profile.is_none());
    let only = match arguments.select.only_node.as_slice() {
        [node] => Some(node),
        _ => None,
    };
    let chosen = chosen.or(only).map(|node| NodeChoice { bus: node.bus.clone(), node: node.id });
    let story = arguments.story.map_or(0, usize::from);
    Question { chosen, latest: arguments.at.is_some(), story }
}

/// A moment as text.
fn moment(at: Bound, first: Option<Timestamp>) -> String {
    let nanoseconds = match (at, first) {
        (Bound::Frame(number), _) => return format!("frame {number}"),
        (Bound::Offset(offset), _) => offset,
        (Bound::Clock(_), _) => 0,
        (Bound::Moment(moment), first) => moment.since(first.unwrap_or(moment)),
    };
    let sign = if nanoseconds < 0 { "-" } else { "" };
    let milliseconds = nanoseconds.unsigned_abs() / 1_000_000;
    format!("{sign}{}.{:03} s", milliseconds / 1_000, milliseconds % 1_000)
}

/// Facts of the capture, and findings within the selection.
struct Facts {
    why: Why,
    selection: Selection,
    /// The selection has a limit.
    is_limited: bool,
    findings: SelectedFindings,
}

impl Observer for Facts {
    fn event(&mut self, event: &Event, bus: &Bus) {
        if matches!(event.kind, EventKind::FindingOpened(_) | EventKind::FindingClosed(_)) {
            self.findings.see(event, bus);
            self.why.observe(event, bus, true);
        } else {
            let may_report = self.selection.admits(event, bus);
            self.why.observe(event, bus, may_report);
        }
    }

    fn needs(&self, preview: &Preview, bus: &Bus) -> bool {
        self.is_limited || self.why.needs(preview, bus)
    }

    fn skip(&mut self, preview: &Preview, bus: &Bus) -> bool {
        let is_skipped = !self.needs(preview, bus);
        if is_skipped {
            self.why.skip(preview, bus);
        }
        is_skipped
    }
}

/// Observer that ends the capture at `--at`.
struct Watch {
    engine: Engine,
    facts: Facts,
    at: Option<Bound>,
    first: Option<Timestamp>,
}

impl Observer for Watch {
    fn event(&mut self, event: &Event, bus: &Bus) {
        Judge { engine: &mut self.engine, out: &mut self.facts }.event(event, bus);
    }

    fn needs(&self, preview: &Preview, bus: &Bus) -> bool {
        self.facts.needs(preview, bus) || self.engine.needs(preview, bus)
    }

    fn skip(&mut self, preview: &Preview, bus: &Bus) -> bool {
        let is_skipped = !self.facts.needs(preview, bus) && self.engine.skip(preview, bus);
        if is_skipped {
            self.facts.why.skip(preview, bus);
        }
        is_skipped
    }
}

impl CaptureObserver for Watch {
    fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.first = first.time;
        self.at = self.at.map(|at| at.resolve(BoundSide::At, first, span)).transpose()?;
        self.facts.selection.begin(first, span)?;
        self.facts.is_limited = self.facts.selection.is_limited();
        self.facts.findings.begin(first, span)
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) -> bool {
        if self.at.is_some_and(|at| at.is_before(frame, self.first)) {
            return false;
        }
        self.engine.frame(frame);
        true
    }
}
