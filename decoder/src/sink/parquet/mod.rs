//! Events and their values as two Parquet files, for DuckDB, Polars and Spark.
//!
//! ```text
//! signals  one row per value, as in CSV; values that are not numbers are in `text`
//! events   one row per event, with its text line and its JSON Lines object
//! ```
//!
//! Types are those that Spark, DuckDB, Polars, Arrow and `DataFusion` read without options: times in µs, signed integers,
//! texts.

mod events;
pub mod lake;
mod signals;
mod table;
mod time;

use std::io::{self, Write};

use self::events::EventRowConverter;
use self::signals::SignalRows;
use self::table::TableWriter;
use self::time::micros_cell;
use super::{EventContent, EventFormat, EventSink};
use crate::event::Event;
use crate::session::Bus;

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "parquet",
    suffix: "parquet",
    title: "events as Parquet",
    help: "Events and values for DuckDB, Polars and Spark: NAME.events.parquet and NAME.signals.parquet; \
           requires -o NAME",
    content: EventContent::Events,
    is_binary: true,
    sink: |files, _| Ok(Box::new(ParquetSink::new(files.part_file("events")?, files.part_file("signals")?)?)),
};

/// Writer for events and values as Parquet. After the first write error nothing more is written; `finish`
/// returns the error.
struct ParquetSink<W: Write + Send> {
    events: TableWriter<W>,
    signals: TableWriter<W>,
    event_rows: EventRowConverter,
    signal_rows: SignalRows,
    error: Option<io::Error>,
}

impl<W: Write + Send> ParquetSink<W> {
    /// Starts both files.
    fn new(events: W, signals: W) -> io::Result<Self> {
        Ok(Self {
            events: TableWriter::new(events, events::HEADINGS, &[])?,
            signals: TableWriter::new(signals, signals::HEADINGS, &[])?,
            event_rows: EventRowConverter::new(micros_cell),
            signal_rows: SignalRows::new(micros_cell),
            error: None,
        })
    }

    fn write_rows(&mut self, event: &Event, bus: &Bus) -> io::Result<()> {
        self.event_rows.push_row(event, bus, &mut |cells| self.events.push(cells))?;
        self.signal_rows.push_rows(event, bus, &mut |cells| self.signals.push(cells))
    }
}

impl<W: Write + Send> EventSink for ParquetSink<W> {
    fn begin_capture(&mut self, name: &str) {
        self.event_rows.set_capture(name);
        self.signal_rows.set_capture(name);
    }

    fn write_event(&mut self, event: &Event, bus: &Bus) -> bool {
        if self.error.is_none() {
            self.error = self.write_rows(event, bus).err();
        }
        true
    }

    fn finish_output(&mut self) -> io::Result<()> {
        match self.error.take() {
            Some(error) => Err(error),
            // Finish `signals` even if `events` fails: one readable file is better than none.
            None => self.events.finish_table().and(self.signals.finish_table()),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}
