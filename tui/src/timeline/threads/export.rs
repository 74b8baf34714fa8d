//! Writes a part of the captures to a file: frames in any format that can be written, or the events shown.

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::PoisonError;
use std::sync::mpsc::Sender;

use anyhow::Context as _;
use cobscope_decoder::capture::{WritableFormat, WriteOptions};
use cobscope_decoder::replay::{Spot, Told};
use cobscope_decoder::sink::text::{PdoLines, TextOptions};
use cobscope_decoder::sink::{
    EVENT_FORMATS, EventContent, EventFormat, EventSink, Output, OutputFiles, SinkOptions, SpoolFile,
};
use cobscope_decoder::words::plural;

use crate::record::format::{self, part_of};
use crate::timeline::shared::Shared;
use crate::timeline::walk::Walk;
use crate::timeline::{Matcher, News};

/// Bytes gathered before they are written.
const BUFFER: usize = 64 * 1024;

/// What is written where.
#[derive(Debug, Clone)]
pub struct Export {
    /// File; the end of its name says the format.
    pub path: PathBuf,
    /// First frame.
    pub first: u64,
    /// Last frame; beyond the last one the captures' end.
    pub last: u64,
    /// Which events, where events are written.
    pub matcher: Matcher,
}

/// A format by the end of a file's name.
enum Format {
    Frames(&'static WritableFormat),
    Events(&'static EventFormat),
}

impl Format {
    /// Formats of events first: the end of their names may be that of a format of frames with a word before it.
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
    /// Ends of names that say a format, with what is written then.
    pub fn suffixes() -> impl Iterator<Item = (&'static str, &'static str)> {
        format::suffixes().chain(EVENT_FORMATS.iter().map(|format| (format.suffix, format.title)))
    }

    /// Whether the end of a file's name says a format.
    pub fn has_format(path: &Path) -> bool {
        Format::of(path).is_some()
    }
}

/// Writes it, and tells what was written.
pub(in crate::timeline) fn run(shared: &Shared, export: &Export, news: &Sender<News>) {
    let mut files = ExportFiles { path: &export.path, opened: Vec::new() };
    let told = write(shared, export, &mut files);
    let names: Vec<_> = files.opened.iter().map(|path| path.display().to_string()).collect();
    let told = told
        .map(|what| format!("{}: {what}", names.join(", ")))
        .map_err(|error| format!("{}: {error:#}", export.path.display()));
    // The application may be gone.
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

/// The files of an export. Nothing of the user's is ever written over.
struct ExportFiles<'a> {
    path: &'a Path,
    opened: Vec<PathBuf>,
}

impl ExportFiles<'_> {
    fn open(&mut self, path: PathBuf) -> io::Result<Output> {
        let file =
            File::options().write(true).create_new(true).open(&path).map_err(|error| refusal(&error))?;
        self.opened.push(path);
        Ok(Box::new(BufWriter::with_capacity(BUFFER, file)))
    }

    /// Removes the files again, in which nothing was written.
    fn discard(&self) {
        for path in &self.opened {
            // An empty file that stays does no harm.
            let _ = fs::remove_file(path);
        }
    }
}

impl OutputFiles for ExportFiles<'_> {
    fn whole(&mut self) -> io::Result<Output> {
        self.open(self.path.to_owned())
    }

    fn part(&mut self, content: &str) -> io::Result<Output> {
        let suffix = format::suffix(self.path);
        let path = part_of(self.path, content, suffix).ok_or(ErrorKind::InvalidFilename)?;
        let name = path.display().to_string();
        self.open(path).map_err(|error| io::Error::other(format!("{name} {error}")))
    }

    fn spool(&mut self) -> io::Result<Box<dyn SpoolFile>> {
        Ok(Box::new(tempfile::tempfile()?))
    }
}

/// Why a file cannot be made, in the words of its user.
fn refusal(error: &io::Error) -> io::Error {
    io::Error::other(match error.kind() {
        ErrorKind::AlreadyExists => "is there already; choose another name".to_owned(),
        ErrorKind::NotFound => "there is no such folder".to_owned(),
        ErrorKind::PermissionDenied => "nothing may be written there; choose another folder".to_owned(),
        _ => format!("cannot be made: {error}"),
    })
}

/// The frames, all of them: a filter of events says nothing of frames.
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
        // A capture that grows is written as far as it is known.
        if walk.is_at_head(shared) {
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

/// The events that are shown, in a capture with all frames.
fn events(
    shared: &Shared,
    export: &Export,
    content: EventContent,
    mut sink: Box<dyn EventSink + Send>,
) -> anyhow::Result<String> {
    let mut walk = walk_to(shared, export.first)?;
    let (first, last) = (Spot::before(export.first), Spot::behind(export.last));
    let mut count: u64 = 0;
    while !shared.is_over() && !sink.has_failed() && !walk.is_at_head(shared) {
        let next = walk.peek()?.copied();
        if next.is_some_and(|frame| frame.number > export.last) {
            break;
        }
        if let Some(frame) = next.filter(|_| content == EventContent::Capture) {
            let bus = walk.names().get(usize::from(frame.bus.0)).map_or("", String::as_str);
            sink.frame(&frame, bus);
        }
        let more = walk.step(&mut |told: Told<'_>| {
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

/// Before a frame, from the nearest mark.
fn walk_to(shared: &Shared, first: u64) -> anyhow::Result<Walk> {
    let before = first.saturating_sub(1);
    let index = shared.index.read().unwrap_or_else(PoisonError::into_inner);
    let mark = index.before_frame(before).cloned();
    drop(index);
    let mut walk = match mark {
        Some(mark) => Walk::resume(shared, &mark)?,
        None => Walk::start(shared)?,
    };
    while walk.world.frames() < before && walk.leap(before, &mut |_| ())? {}
    Ok(walk)
}
