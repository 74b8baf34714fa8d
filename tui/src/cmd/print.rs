//! Events on their way to lines: judged, chosen, printed.

use std::fs::File;
use std::io::{IsTerminal as _, Write};
#[cfg(feature = "parquet")]
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;
#[cfg(feature = "mcap")]
use std::time::{Duration, Instant};

use anyhow::{Context as _, ensure};
use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::event::{Event, EventKind};
#[cfg(feature = "mcap")]
use cobscope_decoder::frame::BusIndex;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::rules::{Engine, Judge, Setup};
use cobscope_decoder::session::{Bus, Buses, Observer};
use cobscope_decoder::sink::csv::Csv;
use cobscope_decoder::sink::csv_wide::{CsvWide, MOST_COLUMNS};
use cobscope_decoder::sink::jsonl::Jsonl;
#[cfg(feature = "mcap")]
use cobscope_decoder::sink::mcap::Mcap;
#[cfg(feature = "parquet")]
use cobscope_decoder::sink::parquet::Parquet;
use cobscope_decoder::sink::text::{self, PdoLines, Text, TextOptions};

use super::decoding::Watcher;
use super::output::is_colored;
use super::output::output;
use crate::cli::{Format, InputArgs, Pdo, PrintArgs, SelectArgs, TimeColumn};
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
    pub(super) fn finish(self, buses: Buses<'_>) {
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
        self.engine.is_some() || self.printer.wants_frames()
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) -> bool {
        self.printer.frame(frame, names);
        if let Some(engine) = &mut self.engine {
            engine.frame(frame);
        }
        true
    }

    fn notice(&mut self, notice: &Notice, names: &BusNames) {
        self.printer.notice(notice, names);
    }
}

/// Prints events in the format asked for.
pub(super) struct Printer {
    sink: Sink,
    selection: Selection,
    pdo: Pdo,
    frames: bool,
    on_terminal: bool,
    shown: Shown,
    #[cfg(feature = "mcap")]
    flushed: Instant,
}

/// What became of the events that were selected.
#[derive(Default)]
struct Shown {
    is_any: bool,
    /// Only shown with `--all`, `--frames`, `--pdo all`.
    all: u64,
    frames: u64,
    pdos: u64,
}

impl Shown {
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

    /// Why nothing was shown of what a filter chooses.
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
        format!("no event that is shown matches the filter; others do with {}", hidden.join(", "))
    }
}

/// Where bytes go.
type Output = Box<dyn Write + Send>;

enum Sink {
    Text(Text<Output>),
    Jsonl(Jsonl<Output>),
    Csv(Csv<Output>),
    CsvWide(Box<CsvWide<Output, File>>),
    #[cfg(feature = "mcap")]
    Mcap(Box<Mcap<Output>>),
    #[cfg(feature = "parquet")]
    Parquet(Box<Parquet<Output>>),
    None,
}

/// Time between flushes of a format whose pieces are worth more when they are large.
#[cfg(feature = "mcap")]
const FLUSH_EVERY: Duration = Duration::from_secs(1);

impl Printer {
    /// Opens what is written, which must not be one of the files `read`.
    pub(super) fn new(arguments: &PrintArgs, select: &SelectArgs, read: &[PathBuf]) -> anyhow::Result<Self> {
        let default_pdo = if arguments.format == Format::Text { Pdo::Change } else { Pdo::All };
        let pdo = arguments.pdo.unwrap_or(default_pdo);
        let to = arguments.output.as_deref();
        ensure!(
            !arguments.format.is_binary() || to.is_some() || !std::io::stdout().is_terminal(),
            "this format is not for a terminal; give a file with -o"
        );
        let sink = match arguments.format {
            Format::None => Sink::None,
            Format::Text => Sink::Text(Text::new(output(to, read)?, text_options(arguments, pdo))),
            Format::Jsonl => Sink::Jsonl(Jsonl::new(output(to, read)?)),
            Format::Csv => Sink::Csv(Csv::new(output(to, read)?)),
            Format::CsvWide => {
                let spool = tempfile::tempfile().context("no temporary file can be made")?;
                Sink::CsvWide(Box::new(CsvWide::new(output(to, read)?, spool)))
            }
            #[cfg(feature = "mcap")]
            Format::Mcap => Sink::Mcap(Box::new(Mcap::new(output(to, read)?, arguments.packing.into()))),
            #[cfg(feature = "parquet")]
            Format::Parquet => Sink::Parquet(Box::new(parquet(to, read)?)),
        };
        let selection = Selection::new(select.filter.clone(), select.from, select.to)?;
        let prints = arguments.output.is_none() && arguments.format != Format::None;
        let on_terminal = prints && std::io::stdout().is_terminal();
        Ok(Self {
            sink,
            selection,
            pdo,
            frames: arguments.frames,
            on_terminal,
            shown: Shown::default(),
            #[cfg(feature = "mcap")]
            flushed: Instant::now(),
        })
    }

    pub(super) fn is_done(&self) -> bool {
        match &self.sink {
            Sink::Text(text) => text.has_failed(),
            Sink::Jsonl(jsonl) => jsonl.has_failed(),
            Sink::Csv(csv) => csv.has_failed(),
            Sink::CsvWide(csv) => csv.has_failed(),
            #[cfg(feature = "mcap")]
            Sink::Mcap(mcap) => mcap.has_failed(),
            #[cfg(feature = "parquet")]
            Sink::Parquet(parquet) => parquet.has_failed(),
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
        self.shown = Shown::default();
        match &mut self.sink {
            Sink::Text(text) => text.heading(&format!("== {name}")),
            Sink::Jsonl(jsonl) => jsonl.set_capture(Some(name.to_owned())),
            Sink::Csv(csv) => csv.begin_capture(),
            Sink::CsvWide(csv) => csv.begin_capture(),
            #[cfg(feature = "parquet")]
            Sink::Parquet(parquet) => parquet.set_capture(Some(name.to_owned())),
            _ => {}
        }
    }

    /// Whether events of all kinds are written, so that what could not be read stands among them.
    pub(super) fn has_events(&self) -> bool {
        !matches!(self.sink, Sink::Csv(_) | Sink::CsvWide(_) | Sink::None)
    }

    /// What is said of a capture of which nothing was printed, whose last frame has this number and stamp.
    pub(super) fn missed(&self, frame: u64, last: Option<Timestamp>) -> Option<String> {
        if matches!(self.sink, Sink::None) {
            return None;
        }
        self.selection.missed(frame, last).or_else(|| {
            let is_empty = self.selection.has_filter() && !self.shown.is_any;
            is_empty.then(|| self.shown.hidden())
        })
    }

    /// Gives what is held back to whoever reads it.
    pub(super) fn flush(&mut self) -> std::io::Result<()> {
        match &mut self.sink {
            Sink::Text(text) => text.finish(),
            Sink::Jsonl(jsonl) => jsonl.finish(),
            Sink::Csv(csv) => csv.finish(),
            #[cfg(feature = "mcap")]
            Sink::Mcap(mcap) if self.flushed.elapsed() >= FLUSH_EVERY => {
                self.flushed = Instant::now();
                mcap.flush();
                Ok(())
            }
            #[cfg(feature = "mcap")]
            Sink::Mcap(_) => Ok(()),
            // Nobody can read it before its end.
            #[cfg(feature = "parquet")]
            Sink::Parquet(_) => Ok(()),
            Sink::CsvWide(_) | Sink::None => Ok(()),
        }
    }

    /// Nothing follows.
    pub(super) fn finish(&mut self) -> std::io::Result<()> {
        match &mut self.sink {
            #[cfg(feature = "mcap")]
            Sink::Mcap(mcap) => mcap.finish(),
            #[cfg(feature = "parquet")]
            Sink::Parquet(parquet) => parquet.finish(),
            Sink::CsvWide(csv) => csv.finish().inspect(|()| tell_left_out(csv.left_out())),
            _ => self.flush(),
        }
    }

    /// Whether frames and notices are written too.
    pub(super) fn wants_frames(&self) -> bool {
        #[cfg(feature = "mcap")]
        return matches!(self.sink, Sink::Mcap(_));
        #[cfg(not(feature = "mcap"))]
        false
    }

    #[cfg_attr(not(feature = "mcap"), expect(unused_variables, reason = "no format writes frames"))]
    pub(super) fn frame(&mut self, frame: &Frame, names: &BusNames) {
        #[cfg(feature = "mcap")]
        if let Sink::Mcap(mcap) = &mut self.sink {
            mcap.frame(frame, name_of(names, frame.bus));
        }
    }

    #[cfg_attr(not(feature = "mcap"), expect(unused_variables, reason = "no format writes notices"))]
    pub(super) fn notice(&mut self, notice: &Notice, names: &BusNames) {
        #[cfg(feature = "mcap")]
        if let Sink::Mcap(mcap) = &mut self.sink {
            mcap.notice(notice, name_of(names, notice.bus()));
        }
    }

    /// Puts the files of the user beside what is written, and what wrote it, where the format has a place for that.
    #[cfg_attr(not(feature = "mcap"), expect(unused_variables, reason = "no format has a place for it"))]
    pub(super) fn describe(&mut self, input: &InputArgs) {
        #[cfg(feature = "mcap")]
        if let Sink::Mcap(mcap) = &mut self.sink {
            attach(mcap, input);
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
        if let Sink::Text(text) = &mut self.sink {
            let is_shown = text.write(event, bus);
            return self.shown.see(event, is_shown);
        }
        let is_wanted = self.is_wanted(event);
        self.shown.see(event, is_wanted);
        if !is_wanted {
            return;
        }
        match &mut self.sink {
            Sink::Jsonl(jsonl) => jsonl.write(event, bus),
            Sink::Csv(csv) => csv.write(event, bus),
            Sink::CsvWide(csv) => csv.write(event, bus),
            #[cfg(feature = "mcap")]
            Sink::Mcap(mcap) => mcap.write(event, bus),
            #[cfg(feature = "parquet")]
            Sink::Parquet(parquet) => parquet.write(event, bus),
            Sink::Text(_) | Sink::None => {}
        }
    }
}

fn tell_left_out(values: u64) {
    if values > 0 {
        let _ = writeln!(
            std::io::stderr(),
            "cobscope: {values} values of further signals are left out: there is a column for {MOST_COLUMNS}; --filter chooses, \
             -f csv has all"
        );
    }
}

/// Two files whose names begin alike.
#[cfg(feature = "parquet")]
fn parquet(to: Option<&Path>, read: &[PathBuf]) -> anyhow::Result<Parquet<Output>> {
    let to = to.context("this format is two files; name them with -o NAME")?;
    let (events, signals) = (beside(to, "events")?, beside(to, "signals")?);
    let parquet = Parquet::new(output(Some(&events), read)?, output(Some(&signals), read)?)
        .with_context(|| format!("{}: cannot be written", to.display()))?;
    let _ = writeln!(std::io::stderr(), "cobscope: writing {} and {}", events.display(), signals.display());
    Ok(parquet)
}

/// `run.parquet` or `run` to `run.events.parquet`.
#[cfg(feature = "parquet")]
fn beside(path: &Path, what: &str) -> anyhow::Result<PathBuf> {
    let is_parquet = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("parquet"));
    let stem = if is_parquet { path.file_stem() } else { path.file_name() };
    let mut name = stem.with_context(|| format!("{}: names no file", path.display()))?.to_owned();
    name.push(format!(".{what}.parquet"));
    Ok(path.with_file_name(name))
}

#[cfg(feature = "mcap")]
fn name_of(names: &BusNames, bus: BusIndex) -> &str {
    names.names().get(usize::from(bus.0)).map_or("", String::as_str)
}

/// The files that say what is known of the buses, as they are, and which program and profiles understood them.
#[cfg(feature = "mcap")]
fn attach(mcap: &mut Mcap<Output>, input: &InputArgs) {
    const TOML: &str = "application/toml";
    const TEXT: &str = "text/plain";
    let files = input.bus.iter().map(|path| (path, TOML));
    let files = files.chain(input.dbc.iter().map(|path| (path, TEXT)));
    for (path, media_type) in files.chain(input.eds.iter().map(|arg| (&arg.file, TEXT))) {
        // Files that cannot be read were refused before.
        if let (Ok(bytes), Some(name)) = (std::fs::read(path), path.file_name()) {
            mcap.attach(&name.to_string_lossy(), media_type, &bytes);
        }
    }
    let version = ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned());
    mcap.describe("cobscope", std::collections::BTreeMap::from([version]));
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
