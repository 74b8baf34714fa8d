//! `cobscope decode`: captures to events.

use std::fs::File;
use std::io::{BufWriter, ErrorKind, IsTerminal as _, Write};

use anyhow::Context as _;
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Bus, Observer};
use cobscope_decoder::sink::jsonl::Jsonl;
use cobscope_decoder::sink::text::{self, PdoLines, Text, TextOptions};

use super::input::{captures, session_options};
use super::{Watcher, complain, decode_capture};
use crate::cli::{Color, DecodeArgs, Format, Pdo, TimeColumn};
use crate::exit_code::Exit;
use crate::select::Selection;

/// Bytes gathered before they are written.
const OUTPUT_BUFFER: usize = 64 * 1024;

/// Runs the command.
pub fn run(arguments: &DecodeArgs) -> Exit {
    let mut printer = match Printer::new(arguments) {
        Ok(printer) => printer,
        Err(error) => {
            complain(&error);
            return Exit::Usage;
        }
    };
    let options = match session_options(&arguments.input) {
        Ok(options) => options,
        Err(error) => {
            complain(&error);
            return Exit::Profile;
        }
    };
    let captures = captures(&arguments.input);
    let several = captures.len() > 1;
    let mut exit = Exit::Clean;
    for path in &captures {
        if several {
            printer.begin_capture(&path.display().to_string());
        }
        let failure = match decode_capture(path, &arguments.input, &options, &mut printer) {
            Ok(decoded) => decoded.failure,
            Err(error) => Some(error),
        };
        if let Some(error) = failure {
            // What was decoded stands before what went wrong.
            let _ = printer.flush();
            complain(&error);
            exit = exit.max(Exit::Capture);
        }
        if printer.is_done() {
            break;
        }
    }
    match printer.flush() {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            complain(&anyhow::Error::from(error).context("writing failed"));
            exit.max(Exit::Capture)
        }
        _ => exit,
    }
}

/// Prints events in the format asked for.
struct Printer {
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
    fn new(arguments: &DecodeArgs) -> anyhow::Result<Self> {
        let default_pdo = if arguments.format == Format::Text { Pdo::Change } else { Pdo::All };
        let pdo = arguments.pdo.unwrap_or(default_pdo);
        let sink = match arguments.format {
            Format::None => Sink::None,
            Format::Text => Sink::Text(Text::new(output(arguments)?, text_options(arguments, pdo))),
            Format::Jsonl => Sink::Jsonl(Jsonl::new(output(arguments)?)),
        };
        let selection = Selection::new(&arguments.select);
        let prints = arguments.output.is_none() && arguments.format != Format::None;
        let on_terminal = prints && std::io::stdout().is_terminal();
        Ok(Self { sink, selection, pdo, frames: arguments.frames, on_terminal })
    }

    fn begin_capture(&mut self, name: &str) {
        self.selection.set_capture(name);
        match &mut self.sink {
            Sink::Text(text) => text.heading(&format!("== {name}")),
            Sink::Jsonl(jsonl) => jsonl.set_capture(Some(name.to_owned())),
            Sink::None => {}
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
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

impl Watcher for Printer {
    fn is_on_terminal(&self) -> bool {
        self.on_terminal
    }

    fn is_done(&self) -> bool {
        match &self.sink {
            Sink::Text(text) => text.has_failed(),
            Sink::Jsonl(jsonl) => jsonl.has_failed(),
            Sink::None => false,
        }
    }

    fn begin(&mut self, first: &Frame) -> anyhow::Result<()> {
        if let Sink::Text(text) = &mut self.sink {
            text.see(first.time);
        }
        self.selection.begin(first)
    }
}

fn output(arguments: &DecodeArgs) -> anyhow::Result<Box<dyn Write>> {
    Ok(match &arguments.output {
        Some(path) => {
            let file =
                File::create(path).with_context(|| format!("{}: cannot be written", path.display()))?;
            Box::new(BufWriter::with_capacity(OUTPUT_BUFFER, file))
        }
        // A pipe or a file takes large pieces; on a terminal each line shows at once.
        None if std::io::stdout().is_terminal() => Box::new(std::io::stdout()),
        None => Box::new(BufWriter::with_capacity(OUTPUT_BUFFER, std::io::stdout().lock())),
    })
}

fn text_options(arguments: &DecodeArgs, pdo: Pdo) -> TextOptions {
    let color = match arguments.color {
        Color::Always => true,
        Color::Never => false,
        Color::Auto => {
            let wanted = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
            wanted && arguments.output.is_none() && std::io::stdout().is_terminal()
        }
    };
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
        color,
    }
}
