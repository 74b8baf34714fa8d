//! Frames of a capture in one or several files, one part after the other.

use std::path::PathBuf;

use anyhow::Context as _;
use cobscope_decoder::capture::{Batch, BusNames, CaptureFormat, Notice, ReadOptions};
use cobscope_decoder::frame::BusIndex;

use super::ahead::FramesAhead;
use super::file::open_capture;
use super::progress::ProgressLine;
use super::series::CaptureSeries;

/// Reader of a series. A single file is read without any change.
pub struct SeriesFrames {
    parts: Vec<PathBuf>,
    /// Nanoseconds added to the timestamps of each part.
    shifts: Vec<i64>,
    /// Index of the current part.
    part: usize,
    options: ReadOptions,
    may_read_ahead: bool,
    frames: FramesAhead,
    progress: ProgressLine,
    is_hidden: bool,
    format: &'static CaptureFormat,
    /// Frames of the parts before the current one.
    before: u64,
    /// Number of the last frame.
    last: u64,
    names: BusNames,
    /// Bus of the series for each bus of the current part.
    buses: Vec<BusIndex>,
    /// Assumptions of earlier parts, which each part would repeat.
    assumptions: Vec<String>,
}

impl SeriesFrames {
    /// Opens the first part. Pipes are not read ahead.
    ///
    /// # Errors
    /// If the file cannot be opened or has no known format.
    pub fn open(series: &CaptureSeries, options: ReadOptions, may_read_ahead: bool) -> anyhow::Result<Self> {
        let (frames, progress) = open_capture(series.first_path(), &options)?.read_frames(may_read_ahead);
        Ok(Self {
            parts: series.parts.clone(),
            shifts: series.shifts.clone(),
            part: 0,
            options,
            may_read_ahead,
            format: frames.format(),
            frames,
            progress,
            is_hidden: false,
            before: 0,
            last: 0,
            names: BusNames::default(),
            buses: Vec::new(),
            assumptions: Vec::new(),
        })
    }

    /// Hides the progress.
    pub fn hide_progress(&mut self) {
        self.is_hidden = true;
        self.progress.hide_line();
    }

    /// Updates the progress.
    pub fn update_progress(&mut self) {
        self.progress.update_line();
    }

    /// Removes the progress.
    pub fn finish_progress(&mut self) {
        self.progress.remove_line();
    }

    /// Replaces the content of `batch` by the next frames and notices, all of one part; `false` at the end.
    ///
    /// # Errors
    /// Once for each part that cannot be opened or read further, with its name; the next call continues with
    /// the next part.
    pub fn read(&mut self, batch: &mut Batch) -> anyhow::Result<bool> {
        loop {
            let more = self.frames.read(batch).with_context(|| self.file_name())?;
            if !self.is_joined() {
                return Ok(more);
            }
            if more {
                self.adapt_batch(batch);
                if !batch.is_empty() {
                    return Ok(true);
                }
            } else if self.has_more_parts() {
                self.next_part()?;
            } else {
                return Ok(false);
            }
        }
    }

    /// Whether the capture has several parts.
    pub fn is_joined(&self) -> bool {
        self.parts.len() > 1
    }

    /// Whether parts follow the current one.
    pub fn has_more_parts(&self) -> bool {
        self.part + 1 < self.parts.len()
    }

    /// Index of the part of the last batch.
    pub fn part_index(&self) -> usize {
        self.part
    }

    /// File of the last batch.
    pub fn file_name(&self) -> String {
        self.parts.get(self.part).map_or(String::new(), |path| path.display().to_string())
    }

    /// Buses seen so far.
    pub fn buses(&self) -> &BusNames {
        if self.is_joined() { &self.names } else { self.frames.buses() }
    }

    /// Format of the first part.
    pub fn format(&self) -> &'static CaptureFormat {
        self.format
    }

    fn next_part(&mut self) -> anyhow::Result<()> {
        self.part += 1;
        self.before = self.last;
        self.buses.clear();
        let Some(path) = self.parts.get(self.part) else { return Ok(()) };
        let (frames, mut progress) = open_capture(path, &self.options)?.read_frames(self.may_read_ahead);
        self.progress.remove_line();
        if self.is_hidden {
            progress.hide_line();
        }
        (self.frames, self.progress) = (frames, progress);
        Ok(())
    }

    /// Continues frame numbers and buses of the earlier parts.
    fn adapt_batch(&mut self, batch: &mut Batch) {
        for name in self.frames.buses().names().iter().skip(self.buses.len()) {
            // With too many buses, the last one, as in a single capture.
            let last = u8::try_from(self.names.names().len().saturating_sub(1)).unwrap_or(u8::MAX);
            self.buses.push(self.names.index_of(name.as_bytes()).unwrap_or(BusIndex(last)));
        }
        batch.continue_from(self.before, &self.buses);
        if let Some(shift) = self.shifts.get(self.part).filter(|shift| **shift != 0) {
            batch.shift_times(*shift);
        }
        if let Some(last) = batch.frames().last() {
            self.last = last.number;
        }
        let (part, known) = (self.part, &mut self.assumptions);
        batch.retain_notices(|notice| match notice {
            Notice::Assumption(text) if part == 0 => {
                known.push(text.clone());
                true
            }
            Notice::Assumption(text) => {
                let is_new = !known.contains(text);
                if is_new {
                    known.push(text.clone());
                }
                is_new
            }
            _ => true,
        });
    }
}
