//! `cobscope why`: the diagnosis as stories, the changes before the first one, and the gates closed at that
//! time.

use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::diagnosis;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::rules::{Engine, Judge};
use cobscope_decoder::session::{Bus, Buses, Observer, Preview};
use cobscope_decoder::sink::escape;
use cobscope_decoder::why::text::{self, Setting};
use cobscope_decoder::why::{Question, json};

use super::decoding::{CaptureObserver, decode_capture, report};
use super::facts::{Facts, diagnosis, question};
use super::input::setup;
use super::messages::complain;
use crate::cli::{ReportFormat, WhyArgs};
use crate::exit_code::Exit;
use crate::select::{Bound, BoundSide, Span};

/// Runs the command.
pub fn run(arguments: &WhyArgs) -> Exit {
    if let Err(error) = arguments.select.selection() {
        complain(&error);
        return Exit::Usage;
    }
    let several = arguments.input.captures.len() > 1;
    report(&arguments.input, |series, options, output| {
        let question = question(&arguments.input, &arguments.select, arguments.story);
        let question = Question { latest: arguments.at.is_some(), ..question };
        let setup = Arc::new(setup(&arguments.input, &options.catalogue, None)?);
        let mut watch = Watch {
            engine: Engine::new(setup),
            facts: Facts::new(question.clone(), &arguments.select)?,
            at: arguments.at,
            first: None,
        };
        let decoded = decode_capture(series, &arguments.input, options, &mut watch)?;
        let name = series.name();
        decoded.report_unreadable(&name);
        let buses = decoded.decoder.buses();
        let Watch { engine, mut facts, at, first } = watch;
        let findings = engine.finish(buses, &mut facts);
        let last = decoded.decoder.last_time();
        if let Some(missed) = facts.missed(decoded.decoder.frames(), last) {
            complain(&anyhow::anyhow!("{name}: {missed}"));
        }
        let end = last.filter(|_| at.is_some());
        let at = at.map(|at| moment(at, first));
        let setting = diagnosis::Setting { zero: first, end, is_growing: false };
        let (why, selected) = facts.results(&findings);
        let diagnosis = diagnosis(&findings, &selected, setting, (&question, buses));
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

/// The object of `-f json`, about the whole capture.
pub(super) fn line(
    answer: &cobscope_decoder::why::Report,
    buses: Buses<'_>,
    first: Option<Timestamp>,
    name: &str,
) -> String {
    json::line(answer, buses, first, None, name)
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
        if self.facts.concerns(preview) {
            self.skip_with_facts(preview, bus)
        } else {
            self.engine.skip(preview, bus)
        }
    }

    fn is_selective(&self, preview: &Preview, bus: &Bus) -> bool {
        self.engine.is_selective(preview, bus)
    }
}

impl Watch {
    #[inline(never)]
    fn skip_with_facts(&mut self, preview: &Preview, bus: &Bus) -> bool {
        let is_skipped = !self.facts.needs(preview, bus) && self.engine.skip(preview, bus);
        if is_skipped {
            self.facts.count_skipped(preview, bus);
        }
        is_skipped
    }
}

impl CaptureObserver for Watch {
    fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.first = first.time;
        self.at = self.at.map(|at| at.resolve(BoundSide::At, first, span)).transpose()?;
        self.facts.begin(first, span)
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

    fn frames(&mut self, frames: &[Frame], names: &BusNames) -> usize {
        match (self.at, frames.first()) {
            (None, _) => self.engine.frames(frames),
            (Some(_), first) => usize::from(first.is_some_and(|frame| self.frame(frame, names))),
        }
    }
}
