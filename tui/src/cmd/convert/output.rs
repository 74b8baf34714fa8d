//! Output of a conversion: one file, several, or stdout.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context as _, ensure};
use cobscope_decoder::capture::{BusNames, FrameWriter, LossCounter, Notice, WritableFormat, WriteOptions};
use cobscope_decoder::frame::{CanId, Frame, Timestamp};
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::count_noun;

use super::arguments::ConvertArgs;
use crate::output_file::{self, ExistingFile, FinalName};
use crate::path_text::path_text;
use crate::record::RecordNames;
use crate::run::output::{creation_error, ensure_not_read, files_known};

/// Size of the output buffer, in bytes.
const BUFFER: usize = 256 * 1024;

/// Maximum size of a frame with 64 bytes of data in any format, in bytes, without its comment.
const LARGEST_FRAME: u64 = 512;

/// Maximum size ratio of a written comment, after escaping for CSV.
const COMMENT_FACTOR: u64 = 2;

/// Output of a conversion.
pub(super) struct ConversionOutput {
    format: &'static WritableFormat,
    options: WriteOptions,
    losses: LossCounter,
    /// `None` for stdout.
    names: Option<RecordNames>,
    splits: bool,
    most: Option<u64>,
    force: bool,
    /// Input files, which are not overwritten.
    read: Vec<PathBuf>,
    path: PathBuf,
    part: Option<OutputPart>,
    parts: u32,
    frames: u64,
    /// Bus names in the order of their numbers, for formats with bus numbers.
    numbered: Vec<String>,
    /// Whether a bus number has different meanings in different files.
    is_renumbered: bool,
    /// Whether to start a new file with the next frame.
    is_split: bool,
}

struct OutputPart {
    writer: Box<dyn FrameWriter>,
    name: FinalName,
    written: Arc<AtomicU64>,
    frames: u64,
    /// Bus names in order of appearance, for formats with bus numbers.
    buses: Vec<String>,
}

impl ConversionOutput {
    /// Creates the first file.
    ///
    /// # Errors
    /// If the file cannot be created, exists, or is an input.
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
        let names = if is_stdout { None } else { Some(RecordNames::names_for(out, splits)?) };
        if let Some(names) = names.as_ref().filter(|_| !arguments.force) {
            names.ensure_free()?;
        }
        let mut output = Self {
            format,
            options: WriteOptions { packing: arguments.packing.into(), ..WriteOptions::default() },
            losses: LossCounter::new(format.holds),
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
            is_renumbered: false,
            is_split: false,
        };
        output.begin_file()?;
        Ok(output)
    }

    /// Starts the next file.
    fn begin_file(&mut self) -> anyhow::Result<()> {
        let mut name = FinalName::at_once();
        let output: Box<dyn Write + Send> = match &mut self.names {
            None => Box::new(io::stdout()),
            Some(names) => {
                self.path = names.next();
                names.number += 1;
                ensure_not_read(&self.path, &self.read)?;
                ensure_not_read(&output_file::part_of(&self.path), &self.read)?;
                // Files of the user are overwritten only with `--force`.
                let existing = if self.force { ExistingFile::Replace } else { ExistingFile::Keep };
                let created = output_file::create_output(&self.path, existing);
                let (file, final_name) = created.map_err(|error| creation_error(&self.path, &error))?;
                name = final_name;
                Box::new(file)
            }
        };
        let written = Arc::new(AtomicU64::new(0));
        let counted =
            CountedOutput { output: BufWriter::with_capacity(BUFFER, output), written: Arc::clone(&written) };
        let writer = (self.format.writer)(Box::new(counted), &self.options);
        self.part = Some(OutputPart { writer, name, written, frames: 0, buses: Vec::new() });
        self.parts += 1;
        // The precision of the time of the first frame differs between files.
        self.losses.begin_file();
        Ok(())
    }

    /// Starts a new file with the next frame, if the output can be split.
    pub(super) fn split_output(&mut self) {
        self.is_split = true;
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// If the file cannot be written.
    #[inline]
    pub(super) fn write_frame(&mut self, frame: &Frame, bus: &str, comment: &str) -> anyhow::Result<()> {
        if self.splits && self.is_full(comment) {
            self.end_file()?;
            self.begin_file()?;
        }
        self.is_split = false;
        self.losses.count_frame(frame);
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
        written.with_context(|| write_failure(&self.path))
    }

    /// Whether a new file must be started for a frame.
    fn is_full(&self, comment: &str) -> bool {
        let Some(part) = self.part.as_ref().filter(|part| part.frames > 0) else { return false };
        let frame = LARGEST_FRAME.saturating_add(COMMENT_FACTOR.saturating_mul(comment.len() as u64));
        let size =
            part.written.load(Ordering::Relaxed).saturating_add(part.writer.pending()).saturating_add(frame);
        self.is_split || self.most.is_some_and(|most| size > most)
    }

    /// Whether the format can store comments on frames.
    pub(super) fn holds_comments(&self) -> bool {
        self.format.holds.comments
    }

    /// Writes a notice.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn write_notice(&mut self, notice: &Notice, bus: &str) -> anyhow::Result<()> {
        let Some(part) = &mut self.part else { return Ok(()) };
        let has_place = part.writer.notice(notice, bus).with_context(|| write_failure(&self.path))?;
        if !has_place {
            self.losses.miss_notice();
        }
        Ok(())
    }

    /// Ends a file. One without frames would look like a capture, and is removed.
    fn end_file(&mut self) -> anyhow::Result<()> {
        let Some(mut part) = self.part.take() else { return Ok(()) };
        self.is_renumbered |= part.buses.iter().zip(&self.numbered).any(|(one, other)| one != other);
        if part.buses.len() > self.numbered.len() {
            self.numbered = part.buses;
        }
        part.writer.finish().with_context(|| write_failure(&self.path))?;
        if part.frames == 0 {
            part.name.discard_file();
            return Ok(());
        }
        part.name.finish_file().with_context(|| write_failure(&self.path))
    }

    /// Note on bus numbers, unless they equal the names; `buses` are all buses of the input.
    fn bus_numbers(&self, buses: &BusNames) -> Option<String> {
        let title = self.format.title;
        let are_plain = (1..).zip(&self.numbered).all(|(number, name)| *name == u32::to_string(&number));
        if buses.names().len() < 2 || are_plain {
            return None;
        }
        if self.is_renumbered {
            return Some(format!(
                "{title} stores bus numbers, assigned per file; comments in the files contain the names"
            ));
        }
        let numbered =
            (1..).zip(&self.numbered).map(|(number, name)| format!("{} is {number}", escape(name)));
        Some(format!("{title} stores bus numbers: {}", numbered.collect::<Vec<_>>().join(", ")))
    }

    /// Ends the last file; returns notes for the user. `has_frames` states whether the input contains frames.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn finish(mut self, buses: &BusNames, has_frames: bool) -> anyhow::Result<Vec<String>> {
        self.end_file()?;
        let mut notes = Vec::new();
        if self.frames == 0 && has_frames {
            notes.push(format!("{}: no frames selected", path_text(&self.path)));
        }
        let lost = self.losses.loss_texts();
        if !lost.is_empty() {
            notes.push(format!("{} cannot store all data: {}", self.format.title, lost.join("; ")));
        }
        notes.extend(self.bus_numbers(buses));
        if self.splits {
            notes.push(format!("{} in {}", count_noun(self.frames, "frame"), count_noun(self.parts, "file")));
        }
        Ok(notes)
    }
}

/// Rejects a size too small for the file header, the file end and one frame.
fn ensure_room(most: u64, format: &'static WritableFormat, arguments: &ConvertArgs) -> anyhow::Result<()> {
    let written = Arc::new(AtomicU64::new(0));
    let counted = CountedOutput { output: io::sink(), written: Arc::clone(&written) };
    let options = WriteOptions { packing: arguments.packing.into(), ..WriteOptions::default() };
    let mut writer = (format.writer)(Box::new(counted), &options);
    let frame = Frame::data_frame(CanId::from_standard(0), &[]);
    let frame = Frame { number: 1, time: Some(Timestamp(0)), ..frame };
    writer.write(&frame, "can0").and_then(|()| writer.finish()).context("--split-size")?;
    let least = written.load(Ordering::Relaxed).saturating_add(LARGEST_FRAME);
    ensure!(
        most >= least,
        "--split-size: found {most} bytes; expected {least} or more (largest {} file with one frame)",
        format.title
    );
    Ok(())
}

fn write_failure(path: &Path) -> String {
    format!("{}: cannot be written", path_text(path))
}

/// Writer that counts bytes.
struct CountedOutput<W> {
    output: W,
    written: Arc<AtomicU64>,
}

impl<W: Write> Write for CountedOutput<W> {
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
