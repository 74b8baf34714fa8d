//! Exports a part of the captures: frames in any writable format, or the shown events.

use std::io::{self, BufWriter, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::PoisonError;
use std::sync::mpsc::Sender;

use anyhow::Context as _;
use cobscope_decoder::capture::{WritableFormat, WriteOptions};
use cobscope_decoder::replay::{EventPosition, PlacedEvent};
use cobscope_decoder::sink::text::{PdoLines, TextOptions};
use cobscope_decoder::sink::{
    EVENT_FORMATS, EventContent, EventFormat, EventSink, Output, OutputFiles, SinkOptions, SpoolFile,
};
use cobscope_decoder::words::plural;

use crate::output_file::{self, Existing, FinalName};
use crate::path_text::shown;
use crate::record::format::{self, part_of};
use crate::timeline::shared::Shared;
use crate::timeline::walk::{self, TimelineWalk};
use crate::timeline::{Matcher, News};

/// Size of the write buffer, in bytes.
const BUFFER: usize = 64 * 1024;

/// A request for an export.
#[derive(Debug, Clone)]
pub struct Export {
    /// Output file; its suffix selects the format.
    pub path: PathBuf,
    /// First frame.
    pub first: u64,
    /// Last frame; a larger number means the end of the captures.
    pub last: u64,
    /// Selection of the events, for event formats.
    pub matcher: Matcher,
}

/// Format by the suffix of the file name.
enum Format {
    Frames(&'static WritableFormat),
    Events(&'static EventFormat),
}

impl Format {
    /// Event formats take precedence, because their suffix may end in the suffix of a frame format.
    fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        let is_of = |format: &&EventFormat| {
            name.strip_suffix(format.suffix).is_some_and(|stem| stem.len() > 1 && stem.ends_with('.'))
        };
        let of_frames = || format::of(path).map(Self::Frames);
        EVENT_FORMATS.iter().find(is_of).map(Self::Events).or_else(of_frames)
    }
}

impl Export {
    /// Suffixes with the titles of their formats.
    pub fn suffixes() -> impl Iterator<Item = (&'static str, &'static str)> {
        format::suffixes().chain(EVENT_FORMATS.iter().map(|format| (format.suffix, format.title)))
    }

    /// Whether the suffix selects a format.
    pub fn has_format(path: &Path) -> bool {
        Format::of(path).is_some()
    }
}

/// Writes the file and reports the result.
pub(in crate::timeline) fn run(shared: &Shared, export: &Export, news: &Sender<News>) {
    let mut files = ExportFiles { path: &export.path, opened: Vec::new() };
    let told = write(shared, export, &mut files);
    let names: Vec<_> = files.opened.iter().map(|(path, _)| shown(path)).collect();
    let told = told.and_then(|what| {
        anyhow::ensure!(!shared.is_over(), "the program ended before the file was whole");
        files.finish().map(|()| what).context("cannot be written")
    });
    let told = told
        .map(|what| format!("{}: {what}", names.join(", ")))
        .map_err(|error| format!("{}: {error:#}", shown(&export.path)));
    // The application may have ended.
    let _ = news.send(News::Exported(told));
}

fn write(shared: &Shared, export: &Export, files: &mut ExportFiles<'_>) -> anyhow::Result<String> {
    match Format::of(&export.path) {
        Some(Format::Frames(format)) => {
            let output = files.whole()?;
            frames(shared, export, format, output)
        }
        Some(Format::Events(format)) => {
            let text = TextOptions { pdo: PdoLines::All, all: true, frames: true, ..TextOptions::default() };
            let options = SinkOptions { text, ..SinkOptions::default() };
            let sink = (format.sink)(files, &options).inspect_err(|_| files.discard())?;
            events(shared, export, format.content, sink)
        }
        None => anyhow::bail!(format::unknown(Export::suffixes())),
    }
}

/// Files of an export. Existing files are never overwritten.
struct ExportFiles<'a> {
    path: &'a Path,
    opened: Vec<(PathBuf, FinalName)>,
}

impl ExportFiles<'_> {
    fn open(&mut self, path: PathBuf) -> io::Result<Output> {
        let (file, name) = output_file::create(&path, Existing::Keep).map_err(|error| refusal(&error))?;
        self.opened.push((path, name));
        Ok(Box::new(BufWriter::with_capacity(BUFFER, file)))
    }

    /// Gives the files their names; all of them were written.
    fn finish(self) -> io::Result<()> {
        self.opened.into_iter().try_for_each(|(_, name)| name.finish())
    }

    /// Removes the empty files again.
    fn discard(&mut self) {
        self.opened.drain(..).for_each(|(_, name)| name.discard());
    }
}

impl OutputFiles for ExportFiles<'_> {
    fn whole(&mut self) -> io::Result<Output> {
        self.open(self.path.to_owned())
    }

    fn part(&mut self, content: &str) -> io::Result<Output> {
        let suffix = format::suffix(self.path);
        let path = part_of(self.path, content, &suffix).ok_or(ErrorKind::InvalidFilename)?;
        let name = shown(&path);
        self.open(path).map_err(|error| io::Error::other(format!("{name}: {error}")))
    }

    fn spool(&mut self) -> io::Result<Box<dyn SpoolFile>> {
        Ok(Box::new(tempfile::tempfile()?))
    }
}

/// Error text for a file that cannot be created.
fn refusal(error: &io::Error) -> io::Error {
    io::Error::other(match error.kind() {
        ErrorKind::AlreadyExists => "file exists; choose another name".to_owned(),
        ErrorKind::NotFound => "folder does not exist; create it first".to_owned(),
        ErrorKind::PermissionDenied => "no write permission; choose another folder".to_owned(),
        _ => format!("cannot be created: {error}"),
    })
}

/// Writes all frames of the range; filters select events, not frames.
fn frames(
    shared: &Shared,
    export: &Export,
    format: &WritableFormat,
    output: Output,
) -> anyhow::Result<String> {
    let mut writer = (format.writer)(output, &WriteOptions::default());
    let mut walk = walk_to(shared, export.first)?;
    let mut count: u64 = 0;
    while !shared.is_over() {
        // A growing capture is written up to its present end.
        if walk::is_at_head(&walk, shared) {
            break;
        }
        let next = walk.peek()?.copied();
        if next.is_some_and(|frame| frame.number > export.last) {
            break;
        }
        if !walk.step(&mut |_| ())? {
            break;
        }
        if let Some(frame) = next {
            let bus = walk.world.buses().get(usize::from(frame.bus.0)).map_or("", |bus| bus.name());
            writer.write(&frame, bus).context("cannot be written")?;
            count += 1;
        }
    }
    writer.finish().context("cannot be written")?;
    Ok(format!("{} written", plural(count, "frame")))
}

/// Writes the shown events; a capture format also gets all frames.
fn events(
    shared: &Shared,
    export: &Export,
    content: EventContent,
    mut sink: Box<dyn EventSink + Send>,
) -> anyhow::Result<String> {
    let mut walk = walk_to(shared, export.first)?;
    let (first, last) = (EventPosition::before(export.first), EventPosition::after(export.last));
    let mut count: u64 = 0;
    while !shared.is_over() && !sink.has_failed() && !walk::is_at_head(&walk, shared) {
        let next = walk.peek()?.copied();
        if next.is_some_and(|frame| frame.number > export.last) {
            break;
        }
        if let Some(frame) = next.filter(|_| content == EventContent::Capture) {
            let bus = walk.names().get(usize::from(frame.bus.0)).map_or("", String::as_str);
            sink.frame(&frame, bus);
        }
        let more = walk.step(&mut |told: PlacedEvent<'_>| {
            if told.spot >= first && told.spot <= last && export.matcher.takes(&told) {
                count += 1;
                sink.observe_time(told.frame.and_then(|frame| frame.time));
                sink.write(told.event, told.bus);
            }
        })?;
        if !more {
            break;
        }
    }
    sink.finish().context("cannot be written")?;
    let remark = sink.remark().map_or(String::new(), |remark| format!("; {remark}"));
    Ok(format!("{} written{remark}", plural(count, "event")))
}

/// Walks from the nearest mark to a frame.
fn walk_to(shared: &Shared, first: u64) -> anyhow::Result<TimelineWalk> {
    let before = first.saturating_sub(1);
    let index = shared.index.read().unwrap_or_else(PoisonError::into_inner);
    let mark = index.before_frame(before).cloned();
    drop(index);
    let mut walk = match mark {
        Some(mark) => walk::resume(shared, &mark)?,
        None => walk::start(shared)?,
    };
    while walk.world.frames() < before && walk.leap(before, &mut |_| ())? {}
    Ok(walk)
}
