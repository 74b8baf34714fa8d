//! `cobscope why`: the diagnosis as stories, the changes before the first one, and the gates closed at that
//! time.

use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::answers::format_line;
use cobscope_decoder::answers::stories::StoriesAnswer;
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::diagnosis;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::rules::{Engine, Judge, Setup};
use cobscope_decoder::session::{Bus, Observer, Preview, SessionOptions};
use cobscope_decoder::sink::escape;
use cobscope_decoder::why::Question;
use cobscope_decoder::why::text::{self, Setting};

use super::decoding::{CaptureObserver, decode_capture, report_with};
use super::facts::{Facts, diagnosis, ensure_story, question, unknown_buses};
use super::input::{check_rules_of, session_options, setup};
use super::messages::{Refusal, complain, warn};
use crate::cli::{ReportFormat, WhyArgs};
use crate::exit_code::Exit;
use crate::select::{Span, TimeLimit};

/// Runs the command.
pub fn run(arguments: &WhyArgs) -> Exit {
    let (options, setup) = match ready(arguments) {
        Ok(ready) => ready,
        Err((exit, error)) => {
            complain(&error);
            return exit;
        }
    };
    let several = arguments.input.captures.len() > 1;
    report_with(&arguments.input, &options, |series, options, output| {
        let question = question(&arguments.input, &arguments.select, arguments.story);
        let question = Question { latest: arguments.at.is_some(), ..question };
        let mut watch = Watch {
            engine: Engine::new(Arc::clone(&setup)),
            facts: Facts::new(question.clone(), &arguments.select)?,
            limit: TimeLimit::new(arguments.at, arguments.select.to),
        };
        let decoded = decode_capture(series, &arguments.input, options, &mut watch)?;
        let name = series.name();
        decoded.report_unreadable(&name);
        let buses = decoded.decoder.buses();
        let Watch { engine, mut facts, limit } = watch;
        let first = limit.first();
        let findings = engine.finish(buses, &mut facts);
        let last = decoded.decoder.last_time();
        if let Some(missed) = facts.missed(decoded.decoder.frames(), last) {
            complain(&anyhow::anyhow!("{name}: {missed}"));
        }
        for unknown in unknown_buses(&name, &arguments.select, buses) {
            warn(&unknown);
        }
        let is_of_moment = question.latest;
        let end = limit.text();
        let (at, to) = if is_of_moment { (end.as_deref(), None) } else { (None, end.as_deref()) };
        let setting = diagnosis::Setting {
            zero: first,
            end: last.filter(|_| is_of_moment),
            is_growing: limit.passed().is_some(),
        };
        let (why, selected, scope) = facts.results(&findings, first);
        let diagnosis = diagnosis(&findings, &selected, setting, (&question, buses));
        ensure_story(&name, question.story, &diagnosis, decoded.failure.as_ref())?;
        let answer = why.report(diagnosis, buses, &options.catalogue);
        match arguments.format {
            ReportFormat::Text => {
                if several && !series.is_joined_from(&arguments.input.captures) {
                    let _ = writeln!(output, "== {}", escape(&name));
                }
                text::write(&answer, &Setting { buses, first, at, to, scope: &scope }, output);
            }
            ReportFormat::Json => {
                output.push_str(&format_line(&StoriesAnswer::new(&answer, buses, first, at, &name)));
            }
        }
        Ok(decoded.failure)
    })
}

/// Options for decoding, and rules.
///
/// # Errors
/// If an option, the bus file or a profile is not valid.
fn ready(arguments: &WhyArgs) -> Result<(SessionOptions, Arc<Setup>), Refusal> {
    let (usage, profile) = (|error| (Exit::Usage, error), |error| (Exit::Profile, error));
    arguments.select.selection().map_err(usage)?;
    let options = session_options(&arguments.input).map_err(profile)?;
    let setup = setup(&arguments.input, &options.catalogue, None).map_err(profile)?;
    check_rules_of(arguments.select.filter.as_ref(), &setup).map_err(usage)?;
    Ok((options, Arc::new(setup)))
}

/// Observer that ends the capture at `--at` or `--to`.
struct Watch {
    engine: Engine,
    facts: Facts,
    limit: TimeLimit,
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
        self.limit.begin(first, span)?;
        self.facts.begin(first, span)
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) -> bool {
        if self.limit.ends_before(frame) {
            return false;
        }
        self.engine.frame(frame);
        true
    }

    fn frames(&mut self, frames: &[Frame], names: &BusNames) -> usize {
        if self.limit.is_limited() {
            usize::from(frames.first().is_some_and(|frame| self.frame(frame, names)))
        } else {
            self.engine.frames(frames)
        }
    }

    fn early_end(&self) -> Option<String> {
        self.limit.passed()
    }
}
