//! `cobscope convert`: captures to captures.
//!
//! ```text
//! captures ─▶ one line of time ─▶ choice: times, nodes, filter ─▶ output: one file, or several
//! ```
//! Frames are understood only where something asks for it: a filter, a node, an event, comments.

mod choice;
mod input;
mod output;
mod said;

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use cobscope_decoder::capture::{BusNames, Item, Notice, WRITABLE, WritableFormat};
use cobscope_decoder::query::KindSet;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::escape;

use super::input::session_options;
use super::input::unknown_buses;
use super::messages::{complain, note};
use crate::cli::ConvertArgs;
use crate::exit_code::Exit;
use crate::record::format;
use crate::select::ensure_order;
use crate::words::{unknown_bus, unreadable};
use choice::Choice;
use input::Input;
use output::Output;
use said::{Said, called};

/// Lines of a capture that are named when they cannot be read.
const NAMED: u64 = 10;

/// Runs the command.
pub fn run(arguments: &ConvertArgs) -> Exit {
    let Plan { captures, out, format } = match plan(arguments) {
        Ok(plan) => plan,
        Err(error) => return refuse(&error, Exit::Usage),
    };
    let options = match session_options(&arguments.input) {
        Ok(options) => options,
        Err(error) => return refuse(&error, Exit::Profile),
    };
    let choice = Choice::new(arguments, options.clone());
    let input = match Input::open(captures, &arguments.input, arguments.align) {
        Ok(input) => input,
        Err(error) => return refuse(&error, Exit::Capture),
    };
    let output = match Output::open(captures, out, format, arguments) {
        Ok(output) => output,
        Err(error) => return refuse(&error, Exit::Usage),
    };
    let (unreadable_in, assumed) = (BTreeSet::new(), Said::default());
    Conversion {
        arguments,
        options,
        choice,
        output,
        unreadable: 0,
        unreadable_in,
        assumed,
        is_first: true,
        exit: Exit::Clean,
    }
    .run(input)
}

fn refuse(error: &anyhow::Error, exit: Exit) -> Exit {
    complain(error);
    exit
}

/// What is read, and what is written.
struct Plan<'a> {
    captures: &'a [PathBuf],
    out: &'a Path,
    format: &'static WritableFormat,
}

/// # Errors
/// What on the command line cannot be done.
fn plan(arguments: &ConvertArgs) -> anyhow::Result<Plan<'_>> {
    let named = arguments.input.captures.as_slice();
    let ends = match &arguments.output {
        Some(out) => Some((out, named)),
        None => named.split_last(),
    };
    let Some((out, captures)) = ends.filter(|(_, captures)| !captures.is_empty()) else {
        bail!("give the captures to read and then the file to write, as convert run.log run.pcapng");
    };
    for node in &arguments.only_node {
        ensure!(node.profile.is_none(), "--only-node chooses a node; --node tells what it is");
    }
    ensure_order(arguments.from, arguments.to)?;
    let format = format_of(arguments, out)?;
    if arguments.comments && !format.holds.comments {
        let with = WRITABLE.iter().filter(|format| format.holds.comments).map(|format| format.title);
        let with: Vec<_> = with.collect();
        bail!("{} has no place for comments; these have: {}", format.title, with.join(", "));
    }
    if let Some(filter) = &arguments.filter {
        let told = filter.kinds().and(KindSet::of_frames());
        ensure!(
            told != KindSet::NONE,
            "--filter '{filter}': no single frame tells that; frames are taken by their own message, of these kinds: {}",
            KindSet::of_frames().names().collect::<Vec<_>>().join(", ")
        );
    }
    let is_stdout = out.as_os_str() == "-";
    let splits = arguments.split_size.is_some() || arguments.split_at.is_some();
    ensure!(!(is_stdout && splits), "standard output cannot be split; give a file");
    Ok(Plan { captures, out, format })
}

fn format_of(arguments: &ConvertArgs, out: &Path) -> anyhow::Result<&'static WritableFormat> {
    let Some(name) = &arguments.format else {
        let found = format::of(out);
        let shown = out.display().to_string();
        return found.with_context(|| {
            let known = format::unknown(format::suffixes());
            format!("{}: {known}; or say it with -f", escape(&shown))
        });
    };
    // The command line takes no other name.
    WRITABLE.iter().find(|format| format.name == name.as_str()).context("-f: there is no such format")
}

struct Conversion<'a> {
    arguments: &'a ConvertArgs,
    options: SessionOptions,
    choice: Choice,
    output: Output,
    unreadable: u64,
    /// Captures of which something could not be read.
    unreadable_in: BTreeSet<usize>,
    /// What is assumed of captures: of several it is said at the end.
    assumed: Said,
    is_first: bool,
    exit: Exit,
}

impl Conversion<'_> {
    fn run(mut self, mut input: Input) -> Exit {
        let mut has_frames = false;
        loop {
            match input.read() {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    complain(&error);
                    self.exit = Exit::Capture;
                    continue;
                }
            }
            has_frames |= !input.batch.frames().is_empty();
            if let Err(error) = self.take(&input) {
                return end(&error);
            }
            if self.choice.is_over() {
                break;
            }
            input.progress.tick();
        }
        input.progress.finish();
        self.tell_unknown_buses(&input);
        self.assumed.tell(input.names());
        if self.unreadable > NAMED {
            let captures = called(input.names(), &self.unreadable_in);
            note(&format!("{captures}: {} could not be read", unreadable(self.unreadable)));
        }
        if !has_frames {
            let holds = if input.names().len() > 1 { "hold" } else { "holds" };
            complain(&anyhow::anyhow!("{}: {holds} no frame", input.called()));
            self.exit = Exit::Capture;
        }
        match self.output.finish(input.buses(), has_frames) {
            Ok(said) => said.iter().for_each(|text| note(text)),
            Err(error) => return end(&error),
        }
        self.exit
    }

    /// Of captures that were not read to their end not all buses are known.
    fn tell_unknown_buses(&self, input: &Input) {
        if self.choice.is_over() {
            return;
        }
        let name = input.called();
        let names: Vec<&str> = input.buses().names().iter().map(String::as_str).collect();
        let chosen = self.arguments.only_node.iter().filter_map(|node| node.bus.as_deref());
        let chosen = chosen.filter_map(|bus| unknown_bus(&name, bus, "--only-node", &names));
        let known = unknown_buses(Path::new(&name), &self.arguments.input, &self.options, input.buses());
        known.into_iter().chain(chosen).for_each(|said| note(&said));
    }

    fn take(&mut self, input: &Input) -> anyhow::Result<()> {
        let names = input.buses();
        if let Some(first) = input.batch.frames().first().filter(|_| self.is_first) {
            self.choice.begin(first)?;
            self.is_first = false;
        }
        let mut notices = 0;
        for item in input.batch.items() {
            match item {
                Item::Frame(frame) => {
                    let verdict = self.choice.judge(frame, names);
                    if verdict.splits {
                        self.output.split();
                    }
                    if verdict.takes {
                        let bus = name_of(names, frame.bus.0);
                        self.output.write(frame, bus, self.choice.comment())?;
                    }
                }
                Item::Notice(notice) => {
                    self.notice(notice, input.teller(notices), input)?;
                    notices += 1;
                }
            }
        }
        Ok(())
    }

    /// What a capture, by its number, has to say besides frames.
    fn notice(&mut self, notice: &Notice, capture: usize, input: &Input) -> anyhow::Result<()> {
        let (names, name) = (input.buses(), input.name(capture));
        match notice {
            Notice::Unreadable { .. } => {
                self.unreadable += 1;
                self.unreadable_in.insert(capture);
                if self.unreadable <= NAMED {
                    note(&format!("{name}: {notice}"));
                }
                Ok(())
            }
            Notice::CutOff { .. } => {
                // Who wants no more of it does not ask how it ends.
                if !self.choice.is_over() {
                    note(&format!("{name}: {notice}"));
                    self.exit = Exit::Capture;
                }
                Ok(())
            }
            Notice::Assumption(text) => {
                if input.names().len() > 1 {
                    self.assumed.add(text, capture);
                } else {
                    note(&format!("{name}: {text}"));
                }
                Ok(())
            }
            _ => {
                self.choice.notice(notice, names);
                self.output.notice(notice, name_of(names, notice.bus().0))
            }
        }
    }
}

/// A name without letters is none.
fn name_of(names: &BusNames, bus: u8) -> &str {
    names.names().get(usize::from(bus)).map_or("", String::as_str)
}

/// A closed pipe is no failure.
fn end(error: &anyhow::Error) -> Exit {
    let cause = error.downcast_ref::<std::io::Error>();
    if cause.is_some_and(|cause| cause.kind() == ErrorKind::BrokenPipe) {
        return Exit::Clean;
    }
    refuse(error, Exit::Capture)
}
