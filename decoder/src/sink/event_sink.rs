//! Interface of event formats, and the files that they need from the program.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, Write};

use super::options::SinkOptions;
use crate::capture::Notice;
use crate::event::Event;
use crate::frame::{Frame, Timestamp};
use crate::session::Bus;

/// Writer for events in one format. After the first write error nothing more is written; `finish` returns the
/// error.
pub trait EventSink {
    /// Starts the next of several captures; its bus names are independent of the previous ones.
    fn begin_capture(&mut self, _name: &str) {}

    /// Records the time of a frame without an event; the first time is the zero of a time column.
    fn observe_time(&mut self, _time: Option<Timestamp>) {}

    /// Writes an event; returns `false` if the format omits it as a repetition.
    fn write_event(&mut self, event: &Event, bus: &Bus) -> bool;

    /// Writes a frame of bus `bus`, before its events ([`EventContent::Capture`]).
    fn write_frame(&mut self, _frame: &Frame, _bus: &str) {}

    /// Writes a notice of the recorder on bus `bus` ([`EventContent::Capture`]).
    fn write_notice(&mut self, _notice: &Notice, _bus: &str) {}

    /// Stores a file of the user, such as the bus file or a DBC ([`EventContent::Capture`]).
    fn attach_file(&mut self, _name: &str, _media_type: &str, _bytes: &[u8]) {}

    /// Stores metadata of the whole file ([`EventContent::Capture`]).
    fn write_metadata(&mut self, _name: &str, _values: BTreeMap<String, String>) {}

    /// Writes buffered data, unless the format is readable only after its end.
    ///
    /// # Errors
    /// The first write error since the start.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }

    /// Writes all remaining data and ends the output.
    ///
    /// # Errors
    /// The first write error since the start.
    fn finish_output(&mut self) -> io::Result<()>;

    /// Whether a write error occurred, so that no more events are needed.
    fn has_failed(&self) -> bool;

    /// Note on values that the output cannot contain; complete after [`EventSink::finish_output`].
    fn omission_note(&self) -> Option<String> {
        None
    }
}

/// Output opened by the program.
pub type Output = Box<dyn Write + Send>;

/// Temporary file for rows, until all columns are known.
pub trait SpoolFile: Read + Write + Seek + Send {}

impl<F: Read + Write + Seek + Send> SpoolFile for F {}

/// Opens the output files of a sink; implemented by the program.
pub trait OutputFiles {
    /// The file of a single-file format, buffered.
    ///
    /// # Errors
    /// If the file cannot be written.
    fn whole_file(&mut self) -> io::Result<Output>;

    /// One file of a multi-file format, named after its content, buffered.
    ///
    /// # Errors
    /// If the file cannot be written.
    fn part_file(&mut self, content: &str) -> io::Result<Output>;

    /// An empty temporary file, not buffered.
    ///
    /// # Errors
    /// If no temporary file can be created.
    fn spool_file(&mut self) -> io::Result<Box<dyn SpoolFile>>;
}

/// Content of an event format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventContent {
    /// Events with new information; all events with [`TextOptions::all`](super::text::TextOptions::all).
    News,
    /// All events.
    Events,
    /// Values of events; events without values are omitted.
    Values,
    /// A capture: frames, notices and files of the user, together with the events.
    Capture,
}

/// An event format.
#[derive(Debug)]
pub struct EventFormat {
    /// Short name for options.
    pub name: &'static str,
    /// File suffix that selects the format; unique among all event and frame formats.
    pub suffix: &'static str,
    /// Content and format, for lists of suffixes.
    pub title: &'static str,
    /// Help text, one line.
    pub help: &'static str,
    /// Events or values that the format contains.
    pub content: EventContent,
    /// Not suitable for a terminal.
    pub is_binary: bool,
    /// Creates the sink.
    pub sink: SinkConstructor,
}

/// Creates a sink; fails if one of its files cannot be written.
pub(crate) type SinkConstructor =
    fn(&mut dyn OutputFiles, &SinkOptions) -> io::Result<Box<dyn EventSink + Send>>;
