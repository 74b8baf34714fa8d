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
use cobscope_decoder::words::count_noun;

use crate::output_file::{self, ExistingFile, FinalName};
use crate::path_text::path_text;
use crate::record::format::{self, part_of};
use crate::timeline::shared::SharedResults;
use crate::timeline::walk::{self, TimelineWalk};
use crate::timeline::{RowMatcher, TimelineNews};

/// Size of the write buffer, in bytes.
const BUFFER: usize = 64 * 1024;

/// A request for an export.
#[derive(Debug, Clone)]
pub struct ExportRequest {
    /// Output file; its suffix selects the format.
    pub path: PathBuf,
    /// First frame.
    pub first: u64,
    /// Last frame; a larger number means the end of the captures.
    pub last: u64,
    /// Selection of the events, for event formats.
    pub matcher: RowMatcher,
}

/// Format by the suffix of the file name.
enum ExportFormat {
    Frames(&'static WritableFormat),
    Events(&'static EventFormat),
}

impl ExportFormat {
    /// Event formats take precedence, because their suffix may end in the suffix of a frame format.
    fn format_of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        let is_of = |format: &&EventFormat| {
            name.strip_suffix(format.suffix).is_some_and(|stem| stem.len() > 1 && stem.ends_with('.'))
        };
        let of_frames = || format::format_of(path).map(Self::Frames);
        EVENT_FORMATS.iter().find(is_of).map(Self::Events).or_else(of_frames)
    }
}

impl ExportRequest {
    /// Suffixes with the titles of their formats.
    pub fn all_suffixes() -> impl Iterator<Item = (&'static str, &'static str)> {
        format::all_suffixes().chain(EVENT_FORMATS.iter().map(|format| (format.suffix, format.title)))
    }

    /// Whether the suffix selects a format.
    pub fn has_format(path: &Path) -> bool {
        ExportFormat::format_of(path).is_some()
    }
}

/// Writes the file and reports the result.
pub(in crate::timeline) fn run_export(
    shared: &SharedResults,
    export: &ExportRequest,
    news: &Sender<TimelineNews>,
) {
    let mut files = ExportFiles { path: &export.path, opened: Vec::new() };
    let reported = write_export(shared, export, &mut files);
    let names: Vec<_> = files.opened.iter().map(|(path, _)| path_text(path)).collect();
    let reported = reported.and_then(|what| {
        anyhow::ensure!(!shared.is_over(), "the program ended before the file was whole");
        files.finish_files().map(|()| what).context("cannot be written")
    });
    let reported = reported
        .map(|what| format!("{}: {what}", names.join(", ")))
        .map_err(|error| format!("{}: {error:#}", path_text(&export.path)));
    // The application may have ended.
    let _ = news.send(TimelineNews::Exported(reported));
}

fn write_export(
    shared: &SharedResults,
    export: &ExportRequest,
    files: &mut ExportFiles<'_>,
) -> anyhow::Result<String> {
    match ExportFormat::format_of(&export.path) {
        Some(ExportFormat::Frames(format)) => {
            let output = files.whole_file()?;
            write_frames(shared, export, format, output)
        }
        Some(ExportFormat::Events(format)) => {
            let text = TextOptions { pdo: PdoLines::All, all: true, frames: true, ..TextOptions::default() };
            let options = SinkOptions { text, ..SinkOptions::default() };
            let sink = (format.sink)(files, &options).inspect_err(|_| files.discard_files())?;
            write_events(shared, export, format.content, sink)
        }
        None => anyhow::bail!(format::unknown_suffix(ExportRequest::all_suffixes())),
    }
}

/// Files of an export. Existing files are never overwritten.
struct ExportFiles<'a> {
    path: &'a Path,
    opened: Vec<(PathBuf, FinalName)>,
}

impl ExportFiles<'_> {
    fn open_file(&mut self, path: PathBuf) -> io::Result<Output> {
        let (file, name) =
            output_file::create_output(&path, ExistingFile::Keep).map_err(|error| creation_error(&error))?;
        self.opened.push((path, name));
        Ok(Box::new(BufWriter::with_capacity(BUFFER, file)))
    }

    /// Gives the files their names; all of them were written.
    fn finish_files(self) -> io::Result<()> {
        self.opened.into_iter().try_for_each(|(_, name)| name.finish_file())
    }

    /// Removes the empty files again.
    fn discard_files(&mut self) {
        self.opened.drain(..).for_each(|(_, name)| name.discard_file());
    }
}

impl OutputFiles for ExportFiles<'_> {
    fn whole_file(&mut self) -> io::Result<Output> {
        self.open_file(self.path.to_owned())
    }

    fn part_file(&mut self, content: &str) -> io::Result<Output> {
        let suffix = format::suffix(self.path);
        let path = part_of(self.path, content, &suffix).ok_or(ErrorKind::InvalidFilename)?;
        let name = path_text(&path);
        self.open_file(path).map_err(|error| io::Error::other(format!("{name}: {error}")))
    }

    fn spool_file(&mut self) -> io::Result<Box<dyn SpoolFile>> {
        Ok(Box::new(tempfile::tempfile()?))
    }
}

/// Error text for a file that cannot be created.
fn creation_error(error: &io::Error) -> io::Error {
    io::Error::other(match error.kind() {
        ErrorKind::AlreadyExists => "file exists; choose another name".to_owned(),
        ErrorKind::NotFound => "folder does not exist; create it first".to_owned(),
        ErrorKind::PermissionDenied => "no write permission; choose another folder".to_owned(),
        _ => format!("cannot be created: {error}"),
    })
}

/// Writes all frames of the range; filters select events, not frames.
fn write_frames(
    shared: &SharedResults,
    export: &ExportRequest,
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
        let next = walk.peek_frame()?.copied();
        if next.is_some_and(|frame| frame.number > export.last) {
            break;
        }
        if !walk.step_item(&mut |_| ())? {
            break;
        }
        if let Some(frame) = next {
            let bus = walk.world.buses().get(usize::from(frame.bus.0)).map_or("", |bus| bus.name());
            writer.write(&frame, bus).context("cannot be written")?;
            count += 1;
        }
    }
    writer.finish().context("cannot be written")?;
    Ok(format!("{} written", count_noun(count, "frame")))
}

/// Writes the shown events; a capture format also gets all frames.
fn write_events(
    shared: &SharedResults,
    export: &ExportRequest,
    content: EventContent,
    mut sink: Box<dyn EventSink + Send>,
) -> anyhow::Result<String> {
    let mut walk = walk_to(shared, export.first)?;
    let (first, last) = (EventPosition::before_frame(export.first), EventPosition::after_frame(export.last));
    let mut count: u64 = 0;
    while !shared.is_over() && !sink.has_failed() && !walk::is_at_head(&walk, shared) {
        let next = walk.peek_frame()?.copied();
        if next.is_some_and(|frame| frame.number > export.last) {
            break;
        }
        if let Some(frame) = next.filter(|_| content == EventContent::Capture) {
            let bus = walk.names().get(usize::from(frame.bus.0)).map_or("", String::as_str);
            sink.write_frame(&frame, bus);
        }
        let more = walk.step_item(&mut |reported: PlacedEvent<'_>| {
            if reported.spot >= first && reported.spot <= last && export.matcher.matches_event(&reported) {
                count += 1;
                sink.observe_time(reported.frame.and_then(|frame| frame.time));
                sink.write_event(reported.event, reported.bus);
            }
        })?;
        if !more {
            break;
        }
    }
    sink.finish_output().context("cannot be written")?;
    let remark = sink.omission_note().map_or(String::new(), |remark| format!("; {remark}"));
    Ok(format!("{} written{remark}", count_noun(count, "event")))
}

/// Walks from the nearest mark to a frame.
fn walk_to(shared: &SharedResults, first: u64) -> anyhow::Result<TimelineWalk> {
    let before = first.saturating_sub(1);
    let index = shared.index.read().unwrap_or_else(PoisonError::into_inner);
    let mark = index.before_frame(before).cloned();
    drop(index);
    let mut walk = match mark {
        Some(mark) => walk::resume_walk(shared, &mark)?,
        None => walk::start_walk(shared)?,
    };
    while walk.world.frames() < before && walk.skip_batch(before, &mut |_| ())? {}
    Ok(walk)
}
