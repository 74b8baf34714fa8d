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

use self::events::EventRows;
use self::signals::SignalRows;
use self::table::Table;
use self::time::micros;
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
    sink: |files, _| Ok(Box::new(Parquet::new(files.part("events")?, files.part("signals")?)?)),
};

/// Writer for events and values as Parquet. After the first write error nothing more is written; `finish`
/// returns the error.
struct Parquet<W: Write + Send> {
    events: Table<W>,
    signals: Table<W>,
    event_rows: EventRows,
    signal_rows: SignalRows,
    error: Option<io::Error>,
}

impl<W: Write + Send> Parquet<W> {
    /// Starts both files.
    fn new(events: W, signals: W) -> io::Result<Self> {
        Ok(Self {
            events: Table::new(events, events::HEADINGS, &[])?,
            signals: Table::new(signals, signals::HEADINGS, &[])?,
            event_rows: EventRows::new(micros),
            signal_rows: SignalRows::new(micros),
            error: None,
        })
    }

    fn rows(&mut self, event: &Event, bus: &Bus) -> io::Result<()> {
        self.event_rows.row(event, bus, &mut |cells| self.events.push(cells))?;
        self.signal_rows.rows(event, bus, &mut |cells| self.signals.push(cells))
    }
}

impl<W: Write + Send> EventSink for Parquet<W> {
    fn begin_capture(&mut self, name: &str) {
        self.event_rows.set_capture(name);
        self.signal_rows.set_capture(name);
    }

    fn write(&mut self, event: &Event, bus: &Bus) -> bool {
        if self.error.is_none() {
            self.error = self.rows(event, bus).err();
        }
        true
    }

    fn finish(&mut self) -> io::Result<()> {
        match self.error.take() {
            Some(error) => Err(error),
            // Finish `signals` even if `events` fails: one readable file is better than none.
            None => self.events.finish().and(self.signals.finish()),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}
