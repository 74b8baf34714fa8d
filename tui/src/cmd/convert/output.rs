//! What is written: one file, several, or standard output.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context as _, ensure};
use cobscope_decoder::capture::{BusNames, FrameWriter, Losses, Notice, WritableFormat, WriteOptions};
use cobscope_decoder::frame::{CanId, Frame, Timestamp};
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::plural;

use crate::cli::ConvertArgs;
use crate::cmd::output::{ensure_not_read, files_known};
use crate::record::Names;

/// Bytes gathered before the system gets them.
const BUFFER: usize = 256 * 1024;

/// Bytes that a frame takes at most in any format, with 64 bytes of data; its comment comes on top.
const LARGEST_FRAME: u64 = 512;

/// Times a comment's bytes are written at most: escaped for CSV.
const COMMENT_FACTOR: u64 = 2;

/// Where frames go.
pub(super) struct Output {
    format: &'static WritableFormat,
    options: WriteOptions,
    losses: Losses,
    /// None on standard output.
    names: Option<Names>,
    splits: bool,
    most: Option<u64>,
    force: bool,
    /// What is read; nothing of it is written over.
    read: Vec<PathBuf>,
    path: PathBuf,
    part: Option<Part>,
    parts: u32,
    frames: u64,
    /// Names of the buses by their numbers, where the format numbers them.
    numbered: Vec<String>,
    /// Whether a number is another bus in another file.
    is_numbered_anew: bool,
    /// Whether a file begins with the frame that is next.
    is_split: bool,
}

struct Part {
    writer: Box<dyn FrameWriter>,
    written: Arc<AtomicU64>,
    frames: u64,
    /// Names of its buses in the order in which they came, where the format numbers them.
    buses: Vec<String>,
}

impl Output {
    /// Makes the first file.
    ///
    /// # Errors
    /// When it cannot be made, is there already, or is one of the captures that are read.
    pub(super) fn open(
        captures: &[PathBuf],
        out: &Path,
        format: &'static WritableFormat,
        arguments: &ConvertArgs,
    ) -> anyhow::Result<Self> {
        let splits = arguments.split_size.is_some() || arguments.split_at.is_some();
        if let Some(most) = arguments.split_size {
            ensure_room(most, format, arguments)?;
        }
        let is_stdout = out.as_os_str() == "-";
        let names = if is_stdout { None } else { Some(Names::of(out, splits)?) };
        if let Some(names) = names.as_ref().filter(|_| !arguments.force) {
            names.ensure_free()?;
        }
        let mut output = Self {
            format,
            options: WriteOptions { packing: arguments.packing.into() },
            losses: Losses::new(format.holds),
            names,
            splits,
            most: arguments.split_size,
            force: arguments.force,
            read: captures.iter().cloned().chain(files_known(&arguments.input)).collect(),
            path: out.to_owned(),
            part: None,
            parts: 0,
            frames: 0,
            numbered: Vec::new(),
            is_numbered_anew: false,
            is_split: false,
        };
        output.begin()?;
        Ok(output)
    }

    /// Begins the next file.
    fn begin(&mut self) -> anyhow::Result<()> {
        let output: Box<dyn Write + Send> = match &mut self.names {
            None => Box::new(io::stdout()),
            Some(names) => {
                self.path = names.next();
                names.number += 1;
                ensure_not_read(&self.path, &self.read)?;
                let mut options = File::options();
                // Nothing of the user's is written over unasked.
                options.write(true).truncate(self.force).create(self.force).create_new(!self.force);
                Box::new(options.open(&self.path).map_err(|error| refused(&self.path, &error))?)
            }
        };
        let written = Arc::new(AtomicU64::new(0));
        let counted =
            Counted { output: BufWriter::with_capacity(BUFFER, output), written: Arc::clone(&written) };
        let writer = (self.format.writer)(Box::new(counted), &self.options);
        self.part = Some(Part { writer, written, frames: 0, buses: Vec::new() });
        self.parts += 1;
        // What is written as the time of its first frame differs from file to file.
        self.losses.begin();
        Ok(())
    }

    /// The next frame that is written begins a file, if one can be split.
    pub(super) fn split(&mut self) {
        self.is_split = true;
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// When the file cannot be written.
    #[inline]
    pub(super) fn write(&mut self, frame: &Frame, bus: &str, comment: &str) -> anyhow::Result<()> {
        if self.splits && self.is_full(comment) {
            self.end()?;
            self.begin()?;
        }
        self.is_split = false;
        self.losses.see(frame);
        let Some(part) = &mut self.part else { return Ok(()) };
        part.frames += 1;
        self.frames += 1;
        if !self.format.holds.bus_names && !part.buses.iter().any(|known| known == bus) {
            part.buses.push(bus.to_owned());
        }
        let written = if comment.is_empty() {
            part.writer.write(frame, bus)
        } else {
            part.writer.write_commented(frame, bus, comment)
        };
        written.with_context(|| failed(&self.path))
    }

    /// Whether a frame begins the next file.
    fn is_full(&self, comment: &str) -> bool {
        let Some(part) = self.part.as_ref().filter(|part| part.frames > 0) else { return false };
        let frame = LARGEST_FRAME.saturating_add(COMMENT_FACTOR.saturating_mul(comment.len() as u64));
        let size =
            part.written.load(Ordering::Relaxed).saturating_add(part.writer.pending()).saturating_add(frame);
        self.is_split || self.most.is_some_and(|most| size > most)
    }

    /// Writes what else is known of a bus.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(super) fn notice(&mut self, notice: &Notice, bus: &str) -> anyhow::Result<()> {
        let Some(part) = &mut self.part else { return Ok(()) };
        let has_place = part.writer.notice(notice, bus).with_context(|| failed(&self.path))?;
        if !has_place {
            self.losses.miss_notice();
        }
        Ok(())
    }

    /// Removes a file without any frame, which others would take for a capture.
    fn remove(&self) {
        let is_file = self.path.symlink_metadata().is_ok_and(|metadata| metadata.is_file());
        if self.names.is_some() && is_file {
            // One that cannot be removed stays, and was told to have no frame.
            let _ = std::fs::remove_file(&self.path);
        }
    }

    fn end(&mut self) -> anyhow::Result<()> {
        let Some(mut part) = self.part.take() else { return Ok(()) };
        self.is_numbered_anew |= part.buses.iter().zip(&self.numbered).any(|(one, other)| one != other);
        if part.buses.len() > self.numbered.len() {
            self.numbered = part.buses;
        }
        part.writer.finish().with_context(|| failed(&self.path))
    }

    /// Which number each bus got, where that is not plain; `buses` are those there were to choose from.
    fn numbers(&self, buses: &BusNames) -> Option<String> {
        let title = self.format.title;
        let are_plain = (1..).zip(&self.numbered).all(|(number, name)| *name == u32::to_string(&number));
        if buses.names().len() < 2 || are_plain {
            return None;
        }
        if self.is_numbered_anew {
            return Some(format!("{title} numbers its buses, each file anew: its comments name them"));
        }
        let numbered =
            (1..).zip(&self.numbered).map(|(number, name)| format!("{} is {number}", escape(name)));
        Some(format!("{title} numbers its buses: {}", numbered.collect::<Vec<_>>().join(", ")))
    }

    /// Ends the last file; what is to be said of it all. `has_frames` tells whether there were any to choose from.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn finish(mut self, buses: &BusNames, has_frames: bool) -> anyhow::Result<Vec<String>> {
        self.end()?;
        let mut said = Vec::new();
        if self.frames == 0 {
            self.remove();
        }
        if self.frames == 0 && has_frames {
            said.push(format!("{}: no frame was chosen", self.path.display()));
        }
        let lost = self.losses.said();
        if !lost.is_empty() {
            said.push(format!("{} has no place for all of it: {}", self.format.title, lost.join("; ")));
        }
        said.extend(self.numbers(buses));
        if self.splits {
            said.push(format!("{} in {}", plural(self.frames, "frame"), plural(self.parts, "file")));
        }
        Ok(said)
    }
}

/// Refuses a size in which a file cannot have what it begins and ends with and a frame.
fn ensure_room(most: u64, format: &'static WritableFormat, arguments: &ConvertArgs) -> anyhow::Result<()> {
    let written = Arc::new(AtomicU64::new(0));
    let counted = Counted { output: io::sink(), written: Arc::clone(&written) };
    let options = WriteOptions { packing: arguments.packing.into() };
    let mut writer = (format.writer)(Box::new(counted), &options);
    let frame = Frame::data_frame(CanId::standard(0), &[]);
    let frame = Frame { number: 1, time: Some(Timestamp(0)), ..frame };
    writer.write(&frame, "can0").and_then(|()| writer.finish()).context("--split-size")?;
    let least = written.load(Ordering::Relaxed).saturating_add(LARGEST_FRAME);
    ensure!(
        most >= least,
        "--split-size: found {most} bytes, expected {least} or more: {} with one frame may have so many",
        format.title
    );
    Ok(())
}

fn refused(path: &Path, error: &io::Error) -> anyhow::Error {
    let shown = path.display().to_string();
    let shown = escape(&shown);
    match error.kind() {
        io::ErrorKind::AlreadyExists => anyhow::anyhow!("{shown}: is there already; --force writes over it"),
        _ => anyhow::anyhow!("{shown}: cannot be made: {error}"),
    }
}

fn failed(path: &Path) -> String {
    format!("{}: cannot be written", path.display())
}

/// Counts what goes through.
struct Counted<W> {
    output: W,
    written: Arc<AtomicU64>,
}

impl<W: Write> Write for Counted<W> {
    #[inline]
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.output.write(bytes)?;
        self.written.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }

    #[inline]
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.output.write_all(bytes)?;
        self.written.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        Ok(())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }
}
