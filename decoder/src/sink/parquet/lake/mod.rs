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

use self::captures::RowCounts;
use self::day::Calendar;
use self::objects::ObjectIntervals;
use self::partitions::Partitions;
use self::wide::WideTables;
use super::events::{self, EventRows};
use super::signals::{self, SignalRows};
use super::table::Table;
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
    Table::new(Vec::new(), headings, &[(partitions::HASH, "")])?.into_inner()
}

/// Writer for the tables of one capture. After the first write error nothing more is written; `finish` returns the
/// error.
pub struct LakeWriter<'a> {
    capture: LakeCapture,
    files: &'a mut dyn LakeFiles,
    calendar: Calendar,
    event_rows: EventRows,
    signal_rows: SignalRows,
    intervals: ObjectIntervals,
    events: Partitions,
    signals: Partitions,
    objects: Partitions,
    frames: Partitions,
    wide: WideTables,
    error: Option<io::Error>,
}

impl<'a> LakeWriter<'a> {
    /// Starts the tables; files are created with their first row.
    pub fn new(capture: LakeCapture, files: &'a mut dyn LakeFiles) -> Self {
        let hash = capture.hash.as_str();
        let mut event_rows = EventRows::new(micros_of_date);
        event_rows.set_capture(&capture.name);
        let mut signal_rows = SignalRows::new(micros_of_date);
        signal_rows.set_capture(&capture.name);
        Self {
            files,
            calendar: Calendar::new(capture.day),
            event_rows,
            signal_rows,
            intervals: ObjectIntervals::new(&capture.name),
            events: Partitions::new("events", events::HEADINGS, hash),
            signals: Partitions::new("signals", signals::HEADINGS, hash),
            objects: Partitions::new("objects", objects::HEADINGS, hash),
            frames: Partitions::new("frames", frames::HEADINGS, hash),
            wide: WideTables::default(),
            error: None,
            capture,
        }
    }

    /// Whether a write error occurred, so that no more events are needed.
    pub fn has_failed(&self) -> bool {
        self.error.is_some()
    }

    /// Whether [`Self::frame`] is needed.
    pub fn wants_frames(&self) -> bool {
        self.capture.has_frames
    }

    /// Number of messages above the limit of the wide layout.
    pub fn messages_skipped(&self) -> usize {
        self.wide.skipped()
    }

    /// Adds a frame of bus `bus`, before its events.
    pub fn frame(&mut self, frame: &Frame, bus: &str) {
        if self.error.is_none() && self.capture.has_frames {
            let Self { calendar, frames, files, capture, .. } = self;
            let day = calendar.day(frame.time);
            let row = frames::row(frame, (&capture.name, bus), &mut |cells| frames.push(day, *files, cells));
            self.error = row.err();
        }
    }

    fn rows(&mut self, event: &Event, bus: &Bus) -> io::Result<()> {
        let Self { calendar, files, event_rows, signal_rows, intervals, .. } = self;
        let day = calendar.day(event.time);
        signal_rows.rows(event, bus, &mut |cells| self.signals.push(day, *files, cells))?;
        if self.capture.has_wide {
            self.wide.row(event, bus, day, *files)?;
        }
        let objects = &mut self.objects;
        intervals.event(event, bus, &mut |time, cells| objects.push(calendar.day(time), *files, cells))?;
        if self.capture.has_all_events || has_news(event) {
            event_rows.row(event, bus, &mut |cells| self.events.push(day, *files, cells))?;
        }
        Ok(())
    }

    /// Adds findings, objects and the capture itself, and ends all files.
    ///
    /// # Errors
    /// The first write error since the start.
    pub fn finish(mut self, results: &LakeResults<'_>) -> io::Result<()> {
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        let Self { capture, calendar, files, intervals, events, signals, objects, frames, wide, .. } =
            &mut self;
        wide.finish()?;
        intervals
            .finish(results.buses, &mut |time, cells| objects.push(calendar.day(time), *files, cells))?;
        let hash = capture.hash.as_str();
        let mut findings = Partitions::new("findings", findings::HEADINGS, hash);
        findings::rows(results.judged, results.diagnosis, results.buses, &mut |time, cells| {
            findings.push(calendar.day(time), *files, cells)
        })?;
        let counts = RowCounts { events: events.rows(), signals: signals.rows() };
        let mut captures = Partitions::new("captures", captures::HEADINGS, hash);
        captures::row(capture, results, counts, &mut |time, cells| {
            captures.push(calendar.day(time), *files, cells)
        })?;
        let all = [frames, signals, events, objects, &mut findings, &mut captures];
        all.into_iter().try_for_each(Partitions::finish)
    }
}

impl LakeWriter<'_> {
    /// Takes an event of the capture, or of a finding.
    pub fn event(&mut self, event: &Event, bus: &Bus) {
        if self.error.is_none() {
            self.error = self.rows(event, bus).err();
        }
    }
}

/// Whether an event has new information that no other table contains.
fn has_news(event: &Event) -> bool {
    let is_value = matches!(event.kind, EventKind::Pdo(_) | EventKind::J1939Message(_) | EventKind::Frame(_));
    !event.routine && !is_value
}
