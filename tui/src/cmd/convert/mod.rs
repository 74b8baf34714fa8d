//! `cobscope convert`: converts captures.
//!
//! ```text
//! captures ─▶ merged by time ─▶ selection: times, nodes, filter ─▶ output: one file, or several
//! ```
//! Frames are decoded only if necessary: for a filter, a node, an event or comments.

mod choice;
mod input;
mod output;
mod said;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use cobscope_decoder::capture::{BusNames, Item, Notice, WRITABLE, WritableFormat};
use cobscope_decoder::event::KindSet;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::escape;

use super::cut;
use super::input::{read_options, session_options, unknown_buses};
use super::messages::{complain, note};
use super::output::{ensure_folder, ensure_not_read, files_known, refused};
use crate::cli::ConvertArgs;
use crate::exit_code::Exit;
use crate::output_file::{self, Existing};
use crate::path_text::shown;
use crate::record::format;
use crate::select::ensure_order;
use crate::source::time_span;
use crate::words::{unknown_bus, unreadable};
use choice::Choice;
use input::Input;
use output::Output;
use said::{CaptureNotes, called};

/// Maximum number of unreadable lines reported individually.
const NAMED: u64 = 10;

/// Maximum length of the text about unreadable lines in one comment, in bytes; further lines are only counted.
const MAX_UNWRITTEN: usize = 2_000;

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
    let output = match open_outputs(captures, out, format, arguments) {
        Ok(output) => output,
        Err(error) => return refuse(&error, Exit::Usage),
    };
    let (unreadable_in, assumed) = (BTreeSet::new(), CaptureNotes::default());
    Conversion {
        arguments,
        options,
        choice,
        output,
        unreadable: 0,
        unreadable_in,
        assumed,
        is_first: true,
        unwritten: String::new(),
        exit: Exit::Clean,
    }
    .run(input)
}

/// # Errors
/// If one of the output files cannot be written.
fn open_outputs(
    captures: &[PathBuf],
    out: &Path,
    format: &'static WritableFormat,
    arguments: &ConvertArgs,
) -> anyhow::Result<Output> {
    if let Some(path) = &arguments.bus_file {
        let shown = shown(path);
        ensure!(path.as_path() != out, "--bus-file {shown}: is also the output; choose another file");
        let read: Vec<PathBuf> = captures.iter().cloned().chain(files_known(&arguments.input)).collect();
        ensure_not_read(path, &read)?;
        ensure_folder(path)?;
        let is_free = arguments.force || path.symlink_metadata().is_err();
        ensure!(is_free, "{shown}: file exists; use --force to overwrite it");
    }
    Output::open(captures, out, format, arguments)
}

fn refuse(error: &anyhow::Error, exit: Exit) -> Exit {
    complain(error);
    exit
}

/// Input and output of the conversion.
struct Plan<'a> {
    captures: &'a [PathBuf],
    out: &'a Path,
    format: &'static WritableFormat,
}

/// # Errors
/// If the command line is inconsistent.
fn plan(arguments: &ConvertArgs) -> anyhow::Result<Plan<'_>> {
    let named = arguments.input.captures.as_slice();
    let ends = match &arguments.output {
        Some(out) => Some((out, named)),
        None => named.split_last(),
    };
    let Some((out, captures)) = ends.filter(|(_, captures)| !captures.is_empty()) else {
        bail!("captures or output file missing; expected both, as in convert run.log run.pcapng");
    };
    for node in &arguments.only_node {
        ensure!(node.profile.is_none(), "--only-node selects a node; use --node to assign its profile");
    }
    ensure_order(arguments.from, arguments.to)?;
    let format = format_of(arguments, out)?;
    if arguments.comments && !format.holds.comments {
        let with = WRITABLE.iter().filter(|format| format.holds.comments).map(|format| format.title);
        let with: Vec<_> = with.collect();
        bail!("{} cannot store comments; formats that can: {}", format.title, with.join(", "));
    }
    if let Some(filter) = &arguments.filter {
        let possible = filter.kinds().and(KindSet::of_frames());
        ensure!(
            possible != KindSet::NONE,
            "--filter '{filter}': never true for a single frame; kinds of single frames: {}",
            KindSet::of_frames().names().collect::<Vec<_>>().join(", ")
        );
    }
    let is_stdout = out.as_os_str() == "-";
    let splits = arguments.split_size.is_some() || arguments.split_at.is_some();
    ensure!(!(is_stdout && splits), "stdout cannot be split; give a file");
    Ok(Plan { captures, out, format })
}

fn format_of(arguments: &ConvertArgs, out: &Path) -> anyhow::Result<&'static WritableFormat> {
    let Some(name) = &arguments.format else {
        let found = format::of(out);
        let shown = shown(out);
        return found.with_context(|| {
            let known = format::unknown(format::suffixes());
            format!("{shown}: {known}; or use -f")
        });
    };
    // clap has already rejected other names.
    WRITABLE.iter().find(|format| format.name == name.as_str()).context("-f: unknown format")
}

struct Conversion<'a> {
    arguments: &'a ConvertArgs,
    options: SessionOptions,
    choice: Choice,
    output: Output,
    unreadable: u64,
    /// Captures with unreadable lines or records.
    unreadable_in: BTreeSet<usize>,
    /// Assumptions about captures; printed at the end if there are several captures.
    assumed: CaptureNotes,
    is_first: bool,
    /// Unreadable lines since the last written frame, for its comment.
    unwritten: String,
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
            input.tick();
        }
        input.finish_progress();
        self.report_unknown_buses(&input);
        self.assumed.print_all(input.names());
        if self.unreadable > NAMED {
            let captures = called(input.names(), &self.unreadable_in);
            note(&format!("{captures}: {} unreadable", unreadable(self.unreadable)));
        }
        if !has_frames {
            complain(&anyhow::anyhow!("{}: contains no frames", input.called()));
            self.exit = Exit::Capture;
        }
        if let Err(error) = self.write_bus_file(&input) {
            return end(&error);
        }
        match self.output.finish(input.buses(), has_frames) {
            Ok(notes) => notes.iter().for_each(|text| note(text)),
            Err(error) => return end(&error),
        }
        self.exit
    }

    /// Writes the bus file with the state before the first frame of the range.
    fn write_bus_file(&mut self, input: &Input) -> anyhow::Result<()> {
        let Some(path) = &self.arguments.bus_file else { return Ok(()) };
        // Without a frame in the range there is no capture that it could belong to.
        let Some(state) = self.choice.take_start() else { return Ok(()) };
        let title = format!("State before the first frame of a part of {}", escape(&input.called()));
        let text = cut::text(state, &self.arguments.input, path, &title)?;
        let existing = if self.arguments.force { Existing::Replace } else { Existing::Keep };
        output_file::write(path, existing, text.as_bytes()).map_err(|error| refused(path, &error))
    }

    /// After an incomplete read not all buses are known.
    fn report_unknown_buses(&self, input: &Input) {
        if self.choice.is_over() {
            return;
        }
        let name = input.called();
        let names: Vec<&str> = input.buses().names().iter().map(String::as_str).collect();
        let chosen = self.arguments.only_node.iter().filter_map(|node| node.bus.as_deref());
        let chosen = chosen.filter_map(|bus| unknown_bus(&name, bus, "--only-node", &names));
        let known = unknown_buses(&name, &self.arguments.input, &self.options, input.buses());
        known.into_iter().chain(chosen).for_each(|text| note(&text));
    }

    fn take(&mut self, input: &Input) -> anyhow::Result<()> {
        let names = input.buses();
        if let Some(first) = input.batch.frames().first().filter(|_| self.is_first) {
            let mut span = || time_span(input.paths(), &read_options(&self.arguments.input));
            self.choice.begin(first, &mut span).with_context(|| input.called())?;
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
                        self.output.write(frame, bus, comment(&mut self.unwritten, self.choice.comment()))?;
                        self.unwritten.clear();
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

    /// Processes a notice of a capture.
    fn notice(&mut self, notice: &Notice, capture: usize, input: &Input) -> anyhow::Result<()> {
        let (names, name) = (input.buses(), input.name(capture));
        match notice {
            Notice::Unreadable { .. } => {
                self.unreadable += 1;
                self.unreadable_in.insert(capture);
                if self.unreadable <= NAMED {
                    note(&format!("{name}: {notice}"));
                }
                if self.output.holds_comments() && self.unwritten.len() < MAX_UNWRITTEN {
                    let _ = writeln!(self.unwritten, "unreadable in {name}: {notice}");
                }
                Ok(())
            }
            Notice::CutOff { .. } => {
                // If later frames are not needed, a truncated end is irrelevant.
                if !self.choice.is_over() {
                    note(&format!("{name}: {notice}"));
                    self.exit = Exit::Capture;
                }
                Ok(())
            }
            Notice::Assumption(text) => {
                if let Some(series) = input.series() {
                    note(&format!("{series}: {text}"));
                } else if input.names().len() > 1 {
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

/// Comment on a frame: unreadable lines before it, and its meaning.
fn comment<'a>(unwritten: &'a mut String, meaning: &'a str) -> &'a str {
    if unwritten.is_empty() {
        return meaning;
    }
    unwritten.push_str(meaning);
    unwritten.trim_end_matches('\n')
}

/// Name of a bus; empty if unknown.
fn name_of(names: &BusNames, bus: u8) -> &str {
    names.names().get(usize::from(bus)).map_or("", String::as_str)
}

/// Exit status for an output error; a closed pipe is not an error.
fn end(error: &anyhow::Error) -> Exit {
    let cause = error.downcast_ref::<std::io::Error>();
    if cause.is_some_and(|cause| cause.kind() == ErrorKind::BrokenPipe) {
        return Exit::Clean;
    }
    refuse(error, Exit::Capture)
}
