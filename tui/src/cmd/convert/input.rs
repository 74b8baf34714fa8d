//! Input captures, merged into one.

use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::capture::{Batch, BusNames, CaptureReader, MergedCapture, MergedReader};
use cobscope_decoder::series::{CapturePlacement, JoinOptions, arrange_captures};

use super::notes::common_name;
use crate::run::arguments::InputArgs;
use crate::run::input::{join_options, missing_parts, read_options};
use crate::run::messages::print_note;
use crate::source::{
    CaptureFile, CaptureRelations, CaptureSeries, DecompressedBytes, SeriesFrames, StoreReader, mixed_clocks,
    relate_files,
};

/// Captures being read.
pub(super) struct ConversionInput {
    reading: InputReading,
    names: Vec<String>,
    /// Name of the capture, if all files are its parts.
    series: Option<String>,
    paths: Vec<PathBuf>,
    /// Last batch read.
    pub(super) batch: Batch,
}

enum InputReading {
    One(Box<SeriesFrames>),
    Several(MergedReader<Box<dyn Read + Send>>),
}

impl ConversionInput {
    /// Opens the captures. A single capture is streamed; for several ones the first frames are read in
    /// advance.
    ///
    /// # Errors
    /// If a capture cannot be opened or recognised, or if the captures have no common time.
    pub(super) fn open(paths: &[PathBuf], input: &InputArgs, align: bool) -> anyhow::Result<Self> {
        // Unrelated clocks do not continue each other.
        let join = join_options(input);
        let join = JoinOptions { is_off: join.is_off || align, ..join };
        let files = CaptureFile::files_named(paths);
        let relations = relate_files(&files, &read_options(input), join);
        let series = relations.series();
        let notes = missing_parts(&files, input).into_iter();
        let notes = notes.chain(series.iter().filter_map(CaptureSeries::parts_note));
        notes.chain(relations.separation_notes()).for_each(|text| print_note(&text));
        let name = |path: &PathBuf| path.display().to_string();
        let (reading, names) = if let [series] = series.as_slice() {
            let frames = SeriesFrames::open(series, read_options(input), true)?;
            (InputReading::One(Box::new(frames)), series.parts.iter().map(name).collect())
        } else {
            let (captures, names) = open_several(&relations, input, align)?;
            (InputReading::Several(MergedReader::new(captures)), names)
        };
        let series = match series.as_slice() {
            [series] if series.is_joined() => Some(series.name()),
            _ => None,
        };
        Ok(Self { reading, names, series, paths: paths.to_vec(), batch: Batch::new() })
    }

    /// Reads the next batch; `false` at the end.
    ///
    /// # Errors
    /// Once for each capture that becomes unreadable; the other captures remain readable.
    pub(super) fn read(&mut self) -> anyhow::Result<bool> {
        match &mut self.reading {
            InputReading::One(frames) => frames.read(&mut self.batch),
            InputReading::Several(merged) => {
                let read = merged.read(&mut self.batch);
                read.with_context(|| self.names.get(merged.failed_capture()).cloned().unwrap_or_default())
            }
        }
    }

    /// Updates the progress.
    pub(super) fn update_progress(&mut self) {
        if let InputReading::One(frames) = &mut self.reading {
            frames.update_progress();
        }
    }

    /// Removes the progress.
    pub(super) fn finish_progress(&mut self) {
        if let InputReading::One(frames) = &mut self.reading {
            frames.finish_progress();
        }
    }

    pub(super) fn buses(&self) -> &BusNames {
        match &self.reading {
            InputReading::One(frames) => frames.buses(),
            InputReading::Several(merged) => merged.buses(),
        }
    }

    /// Index of the capture of a notice in the last batch.
    pub(super) fn notice_capture(&self, notice: usize) -> usize {
        match &self.reading {
            InputReading::One(frames) => frames.part_index(),
            InputReading::Several(merged) => merged.notice_capture(notice),
        }
    }

    /// Name of the capture, if all files are its parts.
    pub(super) fn series(&self) -> Option<&str> {
        self.series.as_deref()
    }

    /// Files as given.
    pub(super) fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Names of the captures in order.
    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// Name of one capture.
    pub(super) fn name(&self, capture: usize) -> &str {
        self.names.get(capture).map_or("", String::as_str)
    }

    /// Common name of all captures.
    pub(super) fn common_name(&self) -> String {
        if let Some(name) = &self.series {
            return name.clone();
        }
        common_name(&self.names, &(0..self.names.len()).collect())
    }
}

/// A capture to merge.
type Merged = MergedCapture<Box<dyn Read + Send>>;

/// Captures in the order of reading, with their names.
fn open_several(
    relations: &CaptureRelations,
    input: &InputArgs,
    align: bool,
) -> anyhow::Result<(Vec<Merged>, Vec<String>)> {
    let options = read_options(input);
    let paths = || relations.files.iter().map(|file| &file.path);
    let names: Vec<String> = paths().map(|path| path.display().to_string()).collect();
    let (mut stores, mut firsts) = (Vec::new(), Vec::new());
    for (index, (path, name)) in paths().zip(&names).enumerate() {
        let store = DecompressedBytes::open(path)?;
        let mut reader = CaptureReader::open(CompleteStore(store.reader_at(0), Arc::clone(&store)), &options)
            .with_context(|| name.clone())?;
        let mut batch = Batch::new();
        while batch.frames().is_empty() && reader.read(&mut batch).with_context(|| name.clone())? {}
        let first = batch.frames().first().and_then(|frame| frame.time);
        firsts.push(first.map(|time| time.plus(relations.time_shift(index))));
        stores.push(store);
    }
    let (mut captures, mut ordered) = (Vec::new(), Vec::new());
    for place in arrange_captures(&names, &firsts, relations.all_relations(), align).map_err(mixed_clocks)? {
        let CapturePlacement { index, group, shift, continues } = place;
        let (Some(store), Some(name)) = (stores.get(index), names.get(index)) else { continue };
        let source: Box<dyn Read + Send> = Box::new(CompleteStore(store.reader_at(0), Arc::clone(store)));
        let reader = CaptureReader::open(source, &options).with_context(|| name.clone())?;
        let shift = shift.saturating_add(relations.time_shift(index));
        captures.push(MergedCapture { reader, group, shift, continues });
        ordered.push(name.clone());
    }
    Ok((captures, ordered))
}

/// Reader that returns the error of an incomplete store, because the last line or record may be incomplete.
struct CompleteStore(StoreReader, Arc<DecompressedBytes>);

impl Read for CompleteStore {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.0.read(buffer)? {
            0 => self.1.end_error().map_or(Ok(0), Err),
            count => Ok(count),
        }
    }
}
