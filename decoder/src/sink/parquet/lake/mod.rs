//! Tables of many captures in one folder, partitioned by machine and day, for DuckDB, Polars and Spark.
//!
//! ```text
//! captures  one row per capture      events   one row per event     objects  values of objects over time
//! findings  one row per finding      signals  one row per value     frames   on request
//! ```
//!
//! On request, `wide` has one table per message. Machine and day are part of the paths only: engines add them as columns.

mod capture;
mod captures;
mod day;
mod findings;
mod frames;
mod objects;
mod partitions;
mod wide;

use std::io;

pub use self::capture::{LakeCapture, LakeFiles, LakeResults};

use self::captures::TableRowCounts;
use self::day::DayCalendar;
use self::objects::ObjectIntervals;
use self::partitions::TablePartitions;
use self::wide::WideTables;
use super::events::{self, EventRowConverter};
use super::signals::{self, SignalRows};
use super::table::TableWriter;
use super::time::micros_of_date;
use crate::event::{Event, EventKind};
use crate::frame::Frame;
use crate::session::Bus;

/// Tables in the order in which their files receive their names: a capture is listed last.
pub const TABLES: [&str; 6] = ["frames", "signals", "events", "objects", "findings", "captures"];

/// A file of a table without rows. A lake has one per table, so that each table exists before its first row.
///
/// # Errors
/// Never for a table of [`TABLES`].
pub fn empty_table(table: &str) -> io::Result<Vec<u8>> {
    let headings = match table {
        "frames" => frames::HEADINGS,
        "signals" => signals::HEADINGS,
        "events" => events::HEADINGS,
        "objects" => objects::HEADINGS,
        "findings" => findings::HEADINGS,
        "captures" => captures::HEADINGS,
        _ => return Err(io::Error::other(format!("{table}: no table of a lake"))),
    };
    TableWriter::new(Vec::new(), headings, &[(partitions::HASH, "")])?.into_inner()
}

/// Writer for the tables of one capture. After the first write error nothing more is written; `finish` returns the
/// error.
pub struct LakeWriter<'a> {
    capture: LakeCapture,
    files: &'a mut dyn LakeFiles,
    calendar: DayCalendar,
    event_rows: EventRowConverter,
    signal_rows: SignalRows,
    intervals: ObjectIntervals,
    events: TablePartitions,
    signals: TablePartitions,
    objects: TablePartitions,
    frames: TablePartitions,
    wide: WideTables,
    error: Option<io::Error>,
}

impl<'a> LakeWriter<'a> {
    /// Starts the tables; files are created with their first row.
    pub fn new(capture: LakeCapture, files: &'a mut dyn LakeFiles) -> Self {
        let hash = capture.hash.as_str();
        let mut event_rows = EventRowConverter::new(micros_of_date);
        event_rows.set_capture(&capture.name);
        let mut signal_rows = SignalRows::new(micros_of_date);
        signal_rows.set_capture(&capture.name);
        Self {
            files,
            calendar: DayCalendar::new(capture.day),
            event_rows,
            signal_rows,
            intervals: ObjectIntervals::new(&capture.name),
            events: TablePartitions::new("events", events::HEADINGS, hash),
            signals: TablePartitions::new("signals", signals::HEADINGS, hash),
            objects: TablePartitions::new("objects", objects::HEADINGS, hash),
            frames: TablePartitions::new("frames", frames::HEADINGS, hash),
            wide: WideTables::default(),
            error: None,
            capture,
        }
    }

    /// Whether a write error occurred, so that no more events are needed.
    pub fn has_failed(&self) -> bool {
        self.error.is_some()
    }

    /// Whether [`Self::add_frame`] is needed.
    pub fn wants_frames(&self) -> bool {
        self.capture.has_frames
    }

    /// Number of messages above the limit of the wide layout.
    pub fn messages_skipped(&self) -> usize {
        self.wide.skipped_count()
    }

    /// Adds a frame of bus `bus`, before its events.
    pub fn add_frame(&mut self, frame: &Frame, bus: &str) {
        if self.error.is_none() && self.capture.has_frames {
            let Self { calendar, frames, files, capture, .. } = self;
            let day = calendar.day_of(frame.time);
            let row =
                frames::push_row(frame, (&capture.name, bus), &mut |cells| frames.push(day, *files, cells));
            self.error = row.err();
        }
    }

    fn write_rows(&mut self, event: &Event, bus: &Bus) -> io::Result<()> {
        let Self { calendar, files, event_rows, signal_rows, intervals, .. } = self;
        let day = calendar.day_of(event.time);
        signal_rows.push_rows(event, bus, &mut |cells| self.signals.push(day, *files, cells))?;
        if self.capture.has_wide {
            self.wide.add_row(event, bus, day, *files)?;
        }
        let objects = &mut self.objects;
        intervals
            .take_event(event, bus, &mut |time, cells| objects.push(calendar.day_of(time), *files, cells))?;
        if self.capture.has_all_events || has_news(event) {
            event_rows.push_row(event, bus, &mut |cells| self.events.push(day, *files, cells))?;
        }
        Ok(())
    }

    /// Adds findings, objects and the capture itself, and ends all files.
    ///
    /// # Errors
    /// The first write error since the start.
    pub fn finish_capture(mut self, results: &LakeResults<'_>) -> io::Result<()> {
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        let Self { capture, calendar, files, intervals, events, signals, objects, frames, wide, .. } =
            &mut self;
        wide.finish_files()?;
        intervals.finish_intervals(results.buses, &mut |time, cells| {
            objects.push(calendar.day_of(time), *files, cells)
        })?;
        let hash = capture.hash.as_str();
        let mut findings = TablePartitions::new("findings", findings::HEADINGS, hash);
        findings::push_rows(results.judged, results.diagnosis, results.buses, &mut |time, cells| {
            findings.push(calendar.day_of(time), *files, cells)
        })?;
        let counts = TableRowCounts { events: events.row_count(), signals: signals.row_count() };
        let mut captures = TablePartitions::new("captures", captures::HEADINGS, hash);
        captures::push_row(capture, results, counts, &mut |time, cells| {
            captures.push(calendar.day_of(time), *files, cells)
        })?;
        let all = [frames, signals, events, objects, &mut findings, &mut captures];
        all.into_iter().try_for_each(TablePartitions::finish_files)
    }
}

impl LakeWriter<'_> {
    /// Takes an event of the capture, or of a finding.
    pub fn event(&mut self, event: &Event, bus: &Bus) {
        if self.error.is_none() {
            self.error = self.write_rows(event, bus).err();
        }
    }
}

/// Whether an event has new information that no other table contains.
fn has_news(event: &Event) -> bool {
    let is_value = matches!(event.kind, EventKind::Pdo(_) | EventKind::J1939Message(_) | EventKind::Frame(_));
    !event.routine && !is_value
}
