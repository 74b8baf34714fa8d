//! Printing of events: rules, selection, output format.

mod arguments;

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::reading::{FrameDemand, ReadingPart};
use cobscope_decoder::session::{Bus, MessagePreview};
use cobscope_decoder::sink::text::{self, PdoLines, TextOptions};
use cobscope_decoder::sink::{EventContent, EventFormat, EventSink, SinkOptions};

use super::messages::print_note;
use super::output::{FinalNames, NamePolicy, SinkFiles, is_colored};
use crate::output_file::ExistingFile;
use crate::run::arguments::{InputArgs, SelectArgs};
use crate::select::{Selection, Span};
pub use arguments::{McapCompression, PdoOption, PrintArgs, TimeColumnChoice};

/// Whether rules run: not if findings are not printed.
pub fn prints_findings(arguments: &PrintArgs) -> bool {
    !arguments.no_findings && arguments.format.0.is_some()
}

/// Prints events in the selected format.
pub struct EventPrinter {
    /// `None` if events are only decoded.
    output: Option<OpenSink>,
    selection: Selection,
    choice: PdoChoice,
    on_terminal: bool,
    shown: PrintedEvents,
}

/// An open sink with its format.
struct OpenSink {
    format: &'static EventFormat,
    sink: Box<dyn EventSink + Send>,
    names: FinalNames,
    /// Time of the last flush, for binary formats.
    flushed: Instant,
}

/// Selection of PDOs and frames, for formats without their own selection.
struct PdoChoice {
    pdo: PdoOption,
    frames: bool,
}

/// Numbers of printed and hidden events among those that match the filter.
#[derive(Default)]
struct PrintedEvents {
    is_any: bool,
    /// Number of events printed only with `--all`.
    all: u64,
    frames: u64,
    pdos: u64,
}

impl PrintedEvents {
    fn see(&mut self, event: &Event, is_shown: bool) {
        self.is_any |= is_shown;
        let hidden = match &event.kind {
            _ if is_shown => return,
            EventKind::Pdo(_) | EventKind::J1939Message(_) => &mut self.pdos,
            EventKind::Frame(undecoded) if undecoded.message.is_some() => &mut self.pdos,
            EventKind::Frame(_) => &mut self.frames,
            _ => &mut self.all,
        };
        *hidden += 1;
    }

    /// Message if no event was printed, with the options that print the hidden ones.
    fn hidden(&self) -> String {
        let hidden = [("--all", self.all), ("--frames", self.frames), ("--pdo all", self.pdos)];
        let hidden: Vec<_> = hidden
            .iter()
            .filter(|(_, count)| *count > 0)
            .map(|(option, count)| format!("{option} ({count})"))
            .collect();
        if hidden.is_empty() {
            return "no event matches the filter".to_owned();
        }
        format!("no printed event matches the filter; hidden ones do, print them with {}", hidden.join(", "))
    }
}

/// Minimum time between flushes of a binary format; larger chunks compress better.
const FLUSH_EVERY: Duration = Duration::from_secs(1);

impl PdoChoice {
    /// Whether the event of a PDO or J1939 message may be printed; it is routine if no bit has changed.
    #[inline]
    fn needs(&self, preview: &MessagePreview) -> bool {
        match self.pdo {
            PdoOption::All => true,
            PdoOption::Change => preview.change != 0,
            PdoOption::None => false,
        }
    }

    #[inline]
    fn admits(&self, event: &Event) -> bool {
        match (&event.kind, self.pdo) {
            (EventKind::Frame(_), _) if self.frames => true,
            (EventKind::Frame(undecoded), PdoOption::All) => undecoded.message.is_some(),
            // Without a database, frames are routine events.
            (EventKind::Pdo(_) | EventKind::J1939Message(_) | EventKind::Frame(_), PdoOption::Change) => {
                !event.routine
            }
            (EventKind::Pdo(_) | EventKind::J1939Message(_) | EventKind::Frame(_), PdoOption::None) => false,
            _ => true,
        }
    }
}

impl OpenSink {
    /// Opens the output, which must not be one of the files `read`.
    fn open(
        format: &'static EventFormat,
        arguments: &PrintArgs,
        (pdo, is_followed): (PdoOption, bool),
        read: &[PathBuf],
    ) -> anyhow::Result<Self> {
        let existing = if arguments.force { ExistingFile::Replace } else { ExistingFile::Keep };
        let naming = NamePolicy { existing, is_at_once: is_followed };
        let options = SinkOptions { text: text_options(arguments, pdo), packing: arguments.packing.into() };
        let mut files = SinkFiles::new(format, arguments.output.as_deref(), naming, read);
        let sink = (format.sink)(&mut files, &options)?;
        files.report_parts();
        Ok(Self { format, sink, names: files.into_names(), flushed: Instant::now() })
    }

    fn flush(&mut self) -> std::io::Result<()> {
        if self.format.is_binary {
            if self.flushed.elapsed() < FLUSH_EVERY {
                return Ok(());
            }
            self.flushed = Instant::now();
        }
        self.sink.flush()
    }

    /// Attaches the bus file, device files and databases, and the program version.
    fn describe(&mut self, input: &InputArgs) {
        const TOML: &str = "application/toml";
        const TEXT: &str = "text/plain";
        let files = input.bus.iter().map(|path| (path, TOML));
        let files = files.chain(input.dbc.iter().map(|path| (path, TEXT)));
        for (path, media_type) in files.chain(input.eds.iter().map(|arg| (&arg.file, TEXT))) {
            // Unreadable files were already rejected.
            if let (Ok(bytes), Some(name)) = (std::fs::read(path), path.file_name()) {
                self.sink.attach_file(&name.to_string_lossy(), media_type, &bytes);
            }
        }
        let version = ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned());
        self.sink.write_metadata("cobscope", std::collections::BTreeMap::from([version]));
    }
}

impl EventPrinter {
    /// Opens the output, which must not be one of the files `read`. Others may read it while it grows if it
    /// `is_followed`.
    pub fn new(
        arguments: &PrintArgs,
        select: &SelectArgs,
        is_followed: bool,
        read: &[PathBuf],
    ) -> anyhow::Result<Self> {
        let format = arguments.format.0;
        let is_news = format.is_some_and(|format| format.content == EventContent::News);
        let pdo = arguments.pdo.unwrap_or(if is_news { PdoOption::Change } else { PdoOption::All });
        let output =
            format.map(|format| OpenSink::open(format, arguments, (pdo, is_followed), read)).transpose()?;
        let selection = select.selection()?;
        let prints = arguments.output.is_none() && output.is_some();
        Ok(Self {
            output,
            selection,
            choice: PdoChoice { pdo, frames: arguments.frames },
            on_terminal: prints && std::io::stdout().is_terminal(),
            shown: PrintedEvents::default(),
        })
    }

    /// Whether events are printed to the terminal.
    pub fn is_on_terminal(&self) -> bool {
        self.on_terminal
    }

    pub fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        if let Some(output) = &mut self.output {
            output.sink.observe_time(first.time);
        }
        self.selection.begin_capture(first, span)
    }

    pub fn begin_capture(&mut self, name: &str) {
        self.selection.set_capture(name);
        self.shown = PrintedEvents::default();
        if let Some(output) = &mut self.output {
            output.sink.begin_capture(name);
        }
    }

    /// Whether the output has no notes, or they are not readable as text.
    pub fn hides_notes(&self) -> bool {
        let is_hidden = |format: &EventFormat| format.content == EventContent::Values || format.is_binary;
        self.output.as_ref().is_some_and(|output| is_hidden(output.format))
    }

    /// Message for a capture of which nothing was printed; `frame` and `last` are number and time of its last
    /// frame.
    pub fn missed(&self, frame: u64, last: Option<Timestamp>) -> Option<String> {
        self.output.as_ref()?;
        self.selection.missed_text(frame, last).or_else(|| {
            let is_empty = self.selection.has_filter() && !self.shown.is_any;
            is_empty.then(|| self.shown.hidden())
        })
    }

    /// Writes buffered events.
    pub fn flush(&mut self) -> std::io::Result<()> {
        self.output.as_mut().map_or(Ok(()), OpenSink::flush)
    }

    /// Ends the output and prints a remark on missing data.
    pub fn finish(&mut self) -> std::io::Result<()> {
        let Some(OpenSink { sink, names, .. }) = &mut self.output else { return Ok(()) };
        sink.finish_output()?;
        std::mem::take(names).finish()?;
        if let Some(remark) = sink.omission_note() {
            print_note(&remark);
        }
        Ok(())
    }

    /// The output, if its format also contains frames and notices.
    fn capture(&mut self) -> Option<&mut OpenSink> {
        self.output.as_mut().filter(|output| output.format.content == EventContent::Capture)
    }

    /// Attaches the files that describe the buses, if the format allows it.
    pub fn describe(&mut self, input: &InputArgs) {
        if let Some(output) = self.capture() {
            output.describe(input);
        }
    }
}

impl ReadingPart for EventPrinter {
    fn event(&mut self, event: &Event, bus: &Bus) {
        let Some(OpenSink { format, sink, .. }) = &mut self.output else { return };
        if !self.selection.admits_event(event, bus) {
            return;
        }
        let is_wanted = format.content == EventContent::News || self.choice.admits(event);
        let is_shown = is_wanted && sink.write_event(event, bus);
        self.shown.see(event, is_shown);
    }

    #[inline]
    fn need(&self, preview: &MessagePreview, _bus: &Bus) -> bool {
        self.output.is_some() && (self.selection.is_limited() || self.choice.needs(preview))
    }

    fn demand(&self) -> FrameDemand {
        let is_capture = |output: &OpenSink| output.format.content == EventContent::Capture;
        if self.output.as_ref().is_some_and(is_capture) { FrameDemand::Each } else { FrameDemand::None }
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) {
        if let Some(output) = self.capture() {
            output.sink.write_frame(frame, names.name_of(frame.bus));
        }
    }

    fn notice(&mut self, notice: &Notice, names: &BusNames) {
        if let Some(output) = self.capture() {
            output.sink.write_notice(notice, names.name_of(notice.bus()));
        }
    }

    fn is_done(&self) -> bool {
        self.output.as_ref().is_some_and(|output| output.sink.has_failed())
    }
}

fn text_options(arguments: &PrintArgs, pdo: PdoOption) -> TextOptions {
    TextOptions {
        time: match arguments.time_column {
            TimeColumnChoice::Absolute => text::TimeColumn::Absolute,
            TimeColumnChoice::Delta => text::TimeColumn::Delta,
            TimeColumnChoice::Zero => text::TimeColumn::Zero,
            TimeColumnChoice::Date => text::TimeColumn::Date,
        },
        pdo: match pdo {
            PdoOption::Change => PdoLines::Change,
            PdoOption::All => PdoLines::All,
            PdoOption::None => PdoLines::None,
        },
        all: arguments.all,
        frames: arguments.frames,
        verbose: arguments.verbose,
        color: is_colored(arguments.color, arguments.output.is_some()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unchanged_messages_are_needed_only_if_all_are_printed() {
        let needs = |pdo, change| {
            let preview =
                MessagePreview { identifier: 0, frame: 2, time: Timestamp(0), now: 0, payload: 1, change };
            PdoChoice { pdo, frames: false }.needs(&preview)
        };
        assert_eq!([needs(PdoOption::All, 0), needs(PdoOption::All, 1)], [true, true]);
        assert_eq!([needs(PdoOption::Change, 0), needs(PdoOption::Change, 1)], [false, true]);
        assert_eq!([needs(PdoOption::None, 0), needs(PdoOption::None, 1)], [false, false]);
    }
}
