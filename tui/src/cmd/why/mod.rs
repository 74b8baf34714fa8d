//! `cobscope why`: the first fault, the changes before it, the gates closed then, what to check.

mod json;

use std::fmt::Write as _;

use anyhow::ensure;
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::session::{Bus, Observer};
use cobscope_decoder::sink::escape;
use cobscope_decoder::why::text::{self, Setting};
use cobscope_decoder::why::{Chosen, Question, Why};

use super::decoding::{Watcher, decode_capture, report};
use crate::cli::{ReportFormat, WhyArgs};
use crate::exit_code::Exit;
use crate::select::Bound;

/// Runs the command.
pub fn run(arguments: &WhyArgs) -> Exit {
    let several = arguments.input.captures.len() > 1;
    report(&arguments.input, |path, options, output| {
        let mut watch = Watch { why: Why::new(question(arguments)), at: arguments.at, first: None };
        let decoded = decode_capture(path, &arguments.input, options, &mut watch)?;
        decoded.tell_unreadable(path);
        let buses = decoded.decoder.buses();
        let name = path.display().to_string();
        let Watch { why, at, first } = watch;
        let at = at.map(|at| moment(at, first));
        let answer = why.report(buses, &options.catalogue);
        match arguments.format {
            ReportFormat::Text => {
                if several {
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

/// A node without profile is the one that is asked for.
fn question(arguments: &WhyArgs) -> Question {
    let chosen = arguments.input.node.iter().find(|node| node.profile.is_none());
    let chosen = chosen.map(|node| Chosen { bus: node.bus.clone(), node: node.id });
    Question { chosen, latest: arguments.at.is_some() }
}

/// A moment as people read it.
fn moment(at: Bound, first: Option<Timestamp>) -> String {
    let nanoseconds = match (at, first) {
        (Bound::Frame(number), _) => return format!("frame {number}"),
        (Bound::Offset(offset), _) => offset,
        (Bound::Moment(moment), first) => moment.since(first.unwrap_or(moment)),
    };
    let sign = if nanoseconds < 0 { "-" } else { "" };
    let milliseconds = nanoseconds.unsigned_abs() / 1_000_000;
    format!("{sign}{}.{:03} s", milliseconds / 1_000, milliseconds % 1_000)
}

/// Watches a capture up to the moment asked for.
struct Watch {
    why: Why,
    at: Option<Bound>,
    first: Option<Timestamp>,
}

impl Observer for Watch {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.why.event(event, bus);
    }
}

impl Watcher for Watch {
    fn is_done(&self) -> bool {
        self.why.is_done()
    }

    fn begin(&mut self, first: &Frame) -> anyhow::Result<()> {
        self.first = first.time;
        let wants_time = matches!(self.at, Some(Bound::Offset(_) | Bound::Moment(_)));
        ensure!(first.time.is_some() || !wants_time, "has no times; give a frame as --at #1234");
        Ok(())
    }

    fn wants_frames(&self) -> bool {
        self.at.is_some()
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) -> bool {
        !self.at.is_some_and(|at| at.is_before(frame, self.first))
    }
}
