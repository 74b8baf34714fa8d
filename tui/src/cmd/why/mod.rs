//! `cobscope why`: the first fault, the changes before it, the gates closed at that time, and things to
//! check.

mod json;

use std::fmt::Write as _;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::session::{Bus, Observer};
use cobscope_decoder::sink::escape;
use cobscope_decoder::why::text::{self, Setting};
use cobscope_decoder::why::{NodeChoice, Question, Why};

use super::decoding::{CaptureObserver, decode_capture, report};
use super::messages::complain;
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
        let selection = arguments.select.selection()?;
        let mut watch =
            Watch { why: Why::new(question(arguments)), selection, at: arguments.at, first: None };
        let decoded = decode_capture(series, &arguments.input, options, &mut watch)?;
        let name = series.name();
        decoded.report_unreadable(&name);
        let buses = decoded.decoder.buses();
        let Watch { why, selection, at, first } = watch;
        if let Some(missed) = selection.missed(decoded.decoder.frames(), decoded.decoder.last_time()) {
            complain(&anyhow::anyhow!("{name}: {missed}"));
        }
        let at = at.map(|at| moment(at, first));
        let answer = why.report(buses, &options.catalogue);
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

/// A node without a profile is the chosen node.
fn question(arguments: &WhyArgs) -> Question {
    let chosen = arguments.input.node.iter().find(|node| node.profile.is_none());
    let only = match arguments.select.only_node.as_slice() {
        [node] => Some(node),
        _ => None,
    };
    let chosen = chosen.or(only).map(|node| NodeChoice { bus: node.bus.clone(), node: node.id });
    Question { chosen, latest: arguments.at.is_some() }
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
    why: Why,
    selection: Selection,
    at: Option<Bound>,
    first: Option<Timestamp>,
}

impl Observer for Watch {
    fn event(&mut self, event: &Event, bus: &Bus) {
        let may_report = self.selection.admits(event, bus);
        self.why.observe(event, bus, may_report);
    }
}

impl CaptureObserver for Watch {
    fn is_done(&self) -> bool {
        self.why.is_done()
    }

    fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.first = first.time;
        self.at = self.at.map(|at| at.resolve(BoundSide::At, first, span)).transpose()?;
        self.selection.begin(first, span)
    }

    fn wants_frames(&self) -> bool {
        self.at.is_some()
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) -> bool {
        !self.at.is_some_and(|at| at.is_before(frame, self.first))
    }
}
