//! Writes a part of the captures to a file: frames in any format that can be written, or the events shown.

use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::PathBuf;
use std::sync::PoisonError;
use std::sync::mpsc::Sender;

use anyhow::Context as _;
use cobscope_decoder::capture::{WritableFormat, WriteOptions};
use cobscope_decoder::replay::{Spot, Told};
use cobscope_decoder::sink::jsonl::Jsonl;
use cobscope_decoder::sink::text::{PdoLines, Text, TextOptions};
use cobscope_decoder::words::plural;

use crate::record::format;
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
    Text,
    JsonLines,
}

impl Export {
    /// Ends of names that say a format, with what is written then.
    pub fn suffixes() -> impl Iterator<Item = (&'static str, &'static str)> {
        format::suffixes().chain([("txt", "events as text"), ("jsonl", "events as JSON Lines")])
    }

    fn format(&self) -> anyhow::Result<Format> {
        if let Some(format) = format::of(&self.path) {
            return Ok(Format::Frames(format));
        }
        match format::suffix(&self.path) {
            "txt" => Ok(Format::Text),
            "jsonl" => Ok(Format::JsonLines),
            _ => anyhow::bail!(format::unknown(Self::suffixes())),
        }
    }
}

/// Writes it, and tells what was written.
pub(in crate::timeline) fn run(shared: &Shared, export: &Export, news: &Sender<News>) {
    let name = export.path.display();
    let told = write(shared, export);
    let told =
        told.map(|what| format!("{name}: {what} written")).map_err(|error| format!("{name}: {error:#}"));
    // The application may be gone.
    let _ = news.send(News::Exported(told));
}

fn write(shared: &Shared, export: &Export) -> anyhow::Result<String> {
    let format = export.format()?;
    let mut options = File::options();
    // Nothing of the user's is ever written over.
    let file = options.write(true).create_new(true).open(&export.path).map_err(refusal)?;
    let output = BufWriter::with_capacity(BUFFER, file);
    let count = match format {
        Format::Frames(format) => frames(shared, export, format, output)?,
        Format::Text => {
            let options =
                TextOptions { pdo: PdoLines::All, all: true, frames: true, ..TextOptions::default() };
            let mut text = Text::new(output, options);
            let count = events(shared, export, |told| {
                text.see(told.frame.and_then(|frame| frame.time));
                text.write(told.event, told.bus);
            })?;
            text.finish().context("cannot be written")?;
            count
        }
        Format::JsonLines => {
            let mut lines = Jsonl::new(output);
            let count = events(shared, export, |told| lines.write(told.event, told.bus))?;
            lines.finish().context("cannot be written")?;
            count
        }
    };
    Ok(count)
}

/// Why a file cannot be made, in the words of its user.
fn refusal(error: io::Error) -> anyhow::Error {
    match error.kind() {
        ErrorKind::AlreadyExists => anyhow::anyhow!("is there already; choose another name"),
        ErrorKind::NotFound => anyhow::anyhow!("there is no such folder"),
        ErrorKind::PermissionDenied => anyhow::anyhow!("nothing may be written there; choose another folder"),
        _ => anyhow::Error::new(error).context("cannot be made"),
    }
}

/// The frames, all of them: a filter of events says nothing of frames.
fn frames(
    shared: &Shared,
    export: &Export,
    format: &WritableFormat,
    output: impl Write + Send + 'static,
) -> anyhow::Result<String> {
    let mut writer = (format.writer)(Box::new(output), &WriteOptions::default());
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
    Ok(plural(count, "frame"))
}

/// The events that are shown.
fn events(shared: &Shared, export: &Export, mut see: impl FnMut(&Told<'_>)) -> anyhow::Result<String> {
    let mut walk = walk_to(shared, export.first)?;
    let (first, last) = (Spot::before(export.first), Spot::behind(export.last));
    let mut count: u64 = 0;
    while !shared.is_over() {
        if walk.is_at_head(shared) || walk.peek()?.is_some_and(|frame| frame.number > export.last) {
            break;
        }
        let more = walk.step(&mut |told: Told<'_>| {
            if told.spot >= first && told.spot <= last && export.matcher.takes(&told) {
                count += 1;
                see(&told);
            }
        })?;
        if !more {
            break;
        }
    }
    Ok(plural(count, "event"))
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
