//! Events on their way to lines: judged, chosen, printed.

use std::io::{IsTerminal as _, Write};
use std::sync::Arc;

use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::rules::{Engine, Judge, Setup};
use cobscope_decoder::session::{Bus, Observer};
use cobscope_decoder::sink::jsonl::Jsonl;
use cobscope_decoder::sink::text::{self, PdoLines, Text, TextOptions};

use super::{Watcher, is_colored, output};
use crate::cli::{Format, Pdo, PrintArgs, SelectArgs, TimeColumn};
use crate::select::Selection;

/// What judges, where somebody reads it.
pub(super) fn engine(arguments: &PrintArgs, setup: &Arc<Setup>) -> Option<Engine> {
    let is_wanted = !arguments.no_findings && arguments.format != Format::None;
    is_wanted.then(|| Engine::new(Arc::clone(setup)))
}

/// Judges events on their way to the printer: findings come right behind what shows them.
pub(super) struct Judging<'a> {
    pub(super) engine: Option<Engine>,
    pub(super) printer: &'a mut Printer,
}

impl Judging<'_> {
    pub(super) fn finish(self, buses: &[Bus]) {
        if let Some(engine) = self.engine
            && !self.printer.is_done()
        {
            engine.finish(buses, self.printer);
        }
    }
}

impl Observer for Judging<'_> {
    fn event(&mut self, event: &Event, bus: &Bus) {
        match &mut self.engine {
            Some(engine) => Judge { engine, out: self.printer }.event(event, bus),
            None => self.printer.event(event, bus),
        }
    }
}

impl Watcher for Judging<'_> {
    fn is_on_terminal(&self) -> bool {
        self.printer.on_terminal
    }

    fn is_done(&self) -> bool {
        self.printer.is_done()
    }

    fn begin(&mut self, first: &Frame) -> anyhow::Result<()> {
        self.printer.begin(first)
    }

    fn wants_frames(&self) -> bool {
        self.engine.is_some()
    }

    fn frame(&mut self, frame: &Frame) -> bool {
        if let Some(engine) = &mut self.engine {
            engine.frame(frame);
        }
        true
    }
}

/// Prints events in the format asked for.
pub(super) struct Printer {
    sink: Sink,
    selection: Selection,
    pdo: Pdo,
    frames: bool,
    on_terminal: bool,
}

enum Sink {
    Text(Text<Box<dyn Write>>),
    Jsonl(Jsonl<Box<dyn Write>>),
    None,
}

impl Printer {
    pub(super) fn new(arguments: &PrintArgs, select: &SelectArgs) -> anyhow::Result<Self> {
        let default_pdo = if arguments.format == Format::Text { Pdo::Change } else { Pdo::All };
        let pdo = arguments.pdo.unwrap_or(default_pdo);
        let to = arguments.output.as_deref();
        let sink = match arguments.format {
            Format::None => Sink::None,
            Format::Text => Sink::Text(Text::new(output(to)?, text_options(arguments, pdo))),
            Format::Jsonl => Sink::Jsonl(Jsonl::new(output(to)?)),
        };
        let selection = Selection::new(select);
        let prints = arguments.output.is_none() && arguments.format != Format::None;
        let on_terminal = prints && std::io::stdout().is_terminal();
        Ok(Self { sink, selection, pdo, frames: arguments.frames, on_terminal })
    }

    pub(super) fn is_done(&self) -> bool {
        match &self.sink {
            Sink::Text(text) => text.has_failed(),
            Sink::Jsonl(jsonl) => jsonl.has_failed(),
            Sink::None => false,
        }
    }

    pub(super) fn begin(&mut self, first: &Frame) -> anyhow::Result<()> {
        if let Sink::Text(text) = &mut self.sink {
            text.see(first.time);
        }
        self.selection.begin(first)
    }

    pub(super) fn begin_capture(&mut self, name: &str) {
        self.selection.set_capture(name);
        match &mut self.sink {
            Sink::Text(text) => text.heading(&format!("== {name}")),
            Sink::Jsonl(jsonl) => jsonl.set_capture(Some(name.to_owned())),
            Sink::None => {}
        }
    }

    pub(super) fn flush(&mut self) -> std::io::Result<()> {
        match &mut self.sink {
            Sink::Text(text) => text.finish(),
            Sink::Jsonl(jsonl) => jsonl.finish(),
            Sink::None => Ok(()),
        }
    }

    fn is_wanted(&self, event: &Event) -> bool {
        match &event.kind {
            EventKind::Pdo(_) | EventKind::J1939Message(_) => match self.pdo {
                Pdo::All => true,
                Pdo::Change => !event.routine,
                Pdo::None => false,
            },
            EventKind::Frame(_) if self.frames => true,
            EventKind::Frame(undecoded) => match self.pdo {
                Pdo::All => undecoded.message.is_some(),
                // Without a database they are routine.
                Pdo::Change => !event.routine,
                Pdo::None => false,
            },
            _ => true,
        }
    }
}

impl Observer for Printer {
    fn event(&mut self, event: &Event, bus: &Bus) {
        if matches!(self.sink, Sink::None) || !self.selection.admits(event, bus) {
            return;
        }
        match &mut self.sink {
            Sink::Text(text) => text.write(event, bus),
            Sink::None => {}
            Sink::Jsonl(_) => {
                if self.is_wanted(event)
                    && let Sink::Jsonl(jsonl) = &mut self.sink
                {
                    jsonl.write(event, bus);
                }
            }
        }
    }
}

fn text_options(arguments: &PrintArgs, pdo: Pdo) -> TextOptions {
    TextOptions {
        time: match arguments.time_column {
            TimeColumn::Absolute => text::TimeColumn::Absolute,
            TimeColumn::Delta => text::TimeColumn::Delta,
            TimeColumn::Zero => text::TimeColumn::Zero,
            TimeColumn::Date => text::TimeColumn::Date,
        },
        pdo: match pdo {
            Pdo::Change => PdoLines::Change,
            Pdo::All => PdoLines::All,
            Pdo::None => PdoLines::None,
        },
        all: arguments.all,
        frames: arguments.frames,
        verbose: arguments.verbose,
        color: is_colored(arguments.color, arguments.output.is_some()),
    }
}
