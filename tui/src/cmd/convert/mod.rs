//! `cobscope convert`: converts captures.
//!
//! ```text
//! captures ─▶ merged by time ─▶ selection: times, nodes, filter ─▶ output: one file, or several
//! ```
//! Frames are decoded only if necessary: for a filter, a node, an event or comments.

mod arguments;
mod choice;
mod input;
mod notes;
mod output;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use cobscope_decoder::capture::{BatchItem, Notice, WRITABLE, WritableFormat};
use cobscope_decoder::event::KindSet;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::escape;

use crate::exit_code::ExitStatus;
use crate::output_file::{self, ExistingFile};
use crate::path_text::path_text;
use crate::record::format;
use crate::run::cut;
use crate::run::input::{read_options, session_options, unknown_buses};
use crate::run::messages::{print_error, print_note};
use crate::run::output::{creation_error, ensure_folder, ensure_not_read, files_known};
use crate::select::ensure_order;
use crate::source::time_span;
use crate::words::unknown_bus;
pub use arguments::ConvertArgs;
use choice::FrameChoice;
use cobscope_decoder::answers::statistics::phrases::unreadable_text;
use input::ConversionInput;
use notes::{CaptureNotes, common_name};
use output::ConversionOutput;

/// Maximum number of unreadable lines reported individually.
const NAMED: u64 = 10;

/// Maximum length of the text about unreadable lines in one comment, in bytes; further lines are only counted.
const MAX_UNWRITTEN: usize = 2_000;

/// Runs the command.
pub fn run(arguments: &ConvertArgs) -> ExitStatus {
    let ConversionPlan { captures, out, format } = match plan_conversion(arguments) {
        Ok(plan) => plan,
        Err(error) => return print_refusal(&error, ExitStatus::Usage),
    };
    let options = match session_options(&arguments.input) {
        Ok(options) => options,
        Err(error) => return print_refusal(&error, ExitStatus::Profile),
    };
    let choice = FrameChoice::new(arguments, options.clone());
    let input = match ConversionInput::open(captures, &arguments.input, arguments.align) {
        Ok(input) => input,
        Err(error) => return print_refusal(&error, ExitStatus::Capture),
    };
    let output = match open_outputs(captures, out, format, arguments) {
        Ok(output) => output,
        Err(error) => return print_refusal(&error, ExitStatus::Usage),
    };
    let (unreadable_in, assumed) = (BTreeSet::new(), CaptureNotes::default());
    CaptureConversion {
        arguments,
        options,
        choice,
        output,
        unreadable: 0,
        unreadable_in,
        assumed,
        is_first: true,
        unwritten: String::new(),
        exit: ExitStatus::Clean,
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
) -> anyhow::Result<ConversionOutput> {
    if let Some(path) = &arguments.bus_file {
        let shown = path_text(path);
        ensure!(path.as_path() != out, "--bus-file {shown}: is also the output; choose another file");
        let read: Vec<PathBuf> = captures.iter().cloned().chain(files_known(&arguments.input)).collect();
        ensure_not_read(path, &read)?;
        ensure_folder(path)?;
        let is_free = arguments.force || path.symlink_metadata().is_err();
        ensure!(is_free, "{shown}: file exists; use --force to overwrite it");
    }
    ConversionOutput::open(captures, out, format, arguments)
}

fn print_refusal(error: &anyhow::Error, exit: ExitStatus) -> ExitStatus {
    print_error(error);
    exit
}

/// Input and output of the conversion.
struct ConversionPlan<'a> {
    captures: &'a [PathBuf],
    out: &'a Path,
    format: &'static WritableFormat,
}

/// # Errors
/// If the command line is inconsistent.
fn plan_conversion(arguments: &ConvertArgs) -> anyhow::Result<ConversionPlan<'_>> {
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
    Ok(ConversionPlan { captures, out, format })
}

fn format_of(arguments: &ConvertArgs, out: &Path) -> anyhow::Result<&'static WritableFormat> {
    let Some(name) = &arguments.format else {
        let found = format::format_of(out);
        let shown = path_text(out);
        return found.with_context(|| {
            let known = format::unknown_suffix(format::all_suffixes());
            format!("{shown}: {known}; or use -f")
        });
    };
    // clap has already rejected other names.
    WRITABLE.iter().find(|format| format.name == name.as_str()).context("-f: unknown format")
}

struct CaptureConversion<'a> {
    arguments: &'a ConvertArgs,
    options: SessionOptions,
    choice: FrameChoice,
    output: ConversionOutput,
    unreadable: u64,
    /// Captures with unreadable lines or records.
    unreadable_in: BTreeSet<usize>,
    /// Assumptions about captures; printed at the end if there are several captures.
    assumed: CaptureNotes,
    is_first: bool,
    /// Unreadable lines since the last written frame, for its comment.
    unwritten: String,
    exit: ExitStatus,
}

impl CaptureConversion<'_> {
    fn run(mut self, mut input: ConversionInput) -> ExitStatus {
        let mut has_frames = false;
        loop {
            match input.read() {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    print_error(&error);
                    self.exit = ExitStatus::Capture;
                    continue;
                }
            }
            has_frames |= !input.batch.frames().is_empty();
            if let Err(error) = self.take_batch(&input) {
                return output_exit(&error);
            }
            if self.choice.is_over() {
                break;
            }
            input.update_progress();
        }
        input.finish_progress();
        self.report_unknown_buses(&input);
        self.assumed.print_all(input.names());
        if self.unreadable > NAMED {
            let captures = common_name(input.names(), &self.unreadable_in);
            print_note(&format!("{captures}: {} unreadable", unreadable_text(self.unreadable)));
        }
        if !has_frames {
            print_error(&anyhow::anyhow!("{}: contains no frames", input.common_name()));
            self.exit = ExitStatus::Capture;
        }
        if let Err(error) = self.write_bus_file(&input) {
            return output_exit(&error);
        }
        match self.output.finish(input.buses(), has_frames) {
            Ok(notes) => notes.iter().for_each(|text| print_note(text)),
            Err(error) => return output_exit(&error),
        }
        self.exit
    }

    /// Writes the bus file with the state before the first frame of the range.
    fn write_bus_file(&mut self, input: &ConversionInput) -> anyhow::Result<()> {
        let Some(path) = &self.arguments.bus_file else { return Ok(()) };
        // Without a frame in the range there is no capture that it could belong to.
        let Some(state) = self.choice.take_start() else { return Ok(()) };
        let title = format!("State before the first frame of a part of {}", escape(&input.common_name()));
        let text = cut::snapshot_text(state, &self.arguments.input, path, &title)?;
        let existing = if self.arguments.force { ExistingFile::Replace } else { ExistingFile::Keep };
        output_file::write_file(path, existing, text.as_bytes()).map_err(|error| creation_error(path, &error))
    }

    /// After an incomplete read not all buses are known.
    fn report_unknown_buses(&self, input: &ConversionInput) {
        if self.choice.is_over() {
            return;
        }
        let name = input.common_name();
        let names: Vec<&str> = input.buses().names().iter().map(String::as_str).collect();
        let chosen = self.arguments.only_node.iter().filter_map(|node| node.bus.as_deref());
        let chosen = chosen.filter_map(|bus| unknown_bus(&name, bus, "--only-node", &names));
        let known = unknown_buses(&name, &self.arguments.input, &self.options, input.buses());
        known.into_iter().chain(chosen).for_each(|text| print_note(&text));
    }

    fn take_batch(&mut self, input: &ConversionInput) -> anyhow::Result<()> {
        let names = input.buses();
        if let Some(first) = input.batch.frames().first().filter(|_| self.is_first) {
            let mut span = || time_span(input.paths(), &read_options(&self.arguments.input));
            self.choice.begin(first, &mut span).with_context(|| input.common_name())?;
            self.is_first = false;
        }
        let mut notices = 0;
        for item in input.batch.items() {
            match item {
                BatchItem::Frame(frame) => {
                    let verdict = self.choice.judge_frame(frame, names);
                    if verdict.splits {
                        self.output.split_output();
                    }
                    if verdict.takes {
                        let bus = names.name_of(frame.bus);
                        self.output.write_frame(
                            frame,
                            bus,
                            frame_comment(&mut self.unwritten, self.choice.frame_comment()),
                        )?;
                        self.unwritten.clear();
                    }
                }
                BatchItem::Notice(notice) => {
                    self.on_notice(notice, input.notice_capture(notices), input)?;
                    notices += 1;
                }
            }
        }
        Ok(())
    }

    /// Processes a notice of a capture.
    fn on_notice(&mut self, notice: &Notice, capture: usize, input: &ConversionInput) -> anyhow::Result<()> {
        let (names, name) = (input.buses(), input.name(capture));
        match notice {
            Notice::Unreadable { .. } => {
                self.unreadable += 1;
                self.unreadable_in.insert(capture);
                // The output lacks a frame that the capture has.
                if notice.is_unsupported_frame() {
                    self.exit = ExitStatus::Capture;
                }
                if self.unreadable <= NAMED {
                    print_note(&format!("{name}: {notice}"));
                }
                if self.output.holds_comments() && self.unwritten.len() < MAX_UNWRITTEN {
                    let _ = writeln!(self.unwritten, "unreadable in {name}: {notice}");
                }
                Ok(())
            }
            Notice::CutOff { .. } => {
                // If later frames are not needed, a truncated end is irrelevant.
                if !self.choice.is_over() {
                    print_note(&format!("{name}: {notice}"));
                    self.exit = ExitStatus::Capture;
                }
                Ok(())
            }
            Notice::Assumption(text) => {
                if let Some(series) = input.series() {
                    print_note(&format!("{series}: {text}"));
                } else if input.names().len() > 1 {
                    self.assumed.add_note(text, capture);
                } else {
                    print_note(&format!("{name}: {text}"));
                }
                Ok(())
            }
            _ => {
                self.choice.on_notice(notice, names);
                self.output.write_notice(notice, names.name_of(notice.bus()))
            }
        }
    }
}

/// Comment on a frame: unreadable lines before it, and its meaning.
fn frame_comment<'a>(unwritten: &'a mut String, meaning: &'a str) -> &'a str {
    if unwritten.is_empty() {
        return meaning;
    }
    unwritten.push_str(meaning);
    unwritten.trim_end_matches('\n')
}

/// Exit status for an output error; a closed pipe is not an error.
fn output_exit(error: &anyhow::Error) -> ExitStatus {
    let cause = error.downcast_ref::<std::io::Error>();
    if cause.is_some_and(|cause| cause.kind() == ErrorKind::BrokenPipe) {
        return ExitStatus::Clean;
    }
    print_refusal(error, ExitStatus::Capture)
}
