//! Sinks of events: what each format implements, and what it asks of the program.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, Write};

use super::options::SinkOptions;
use crate::capture::Notice;
use crate::event::Event;
use crate::frame::{Frame, Timestamp};
use crate::session::Bus;

/// Writes events in one format. The first write error is kept and ends all writing.
pub trait EventSink {
    /// The next capture of several begins; its buses have names of their own.
    fn begin_capture(&mut self, _name: &str) {}

    /// Takes note of a time without an event; the first one is the zero of a time column.
    fn observe_time(&mut self, _time: Option<Timestamp>) {}

    /// Writes an event; `false` if the format omits it as a repetition.
    fn write(&mut self, event: &Event, bus: &Bus) -> bool;

    /// Writes a frame of the bus of this name, before its events ([`EventContent::Capture`]).
    fn frame(&mut self, _frame: &Frame, _bus: &str) {}

    /// Writes a notice of the recorder on the bus of this name ([`EventContent::Capture`]).
    fn notice(&mut self, _notice: &Notice, _bus: &str) {}

    /// Stores a file of the user next to the messages: the bus file, a database ([`EventContent::Capture`]).
    fn attach(&mut self, _name: &str, _media_type: &str, _bytes: &[u8]) {}

    /// Stores a table that describes the whole file ([`EventContent::Capture`]).
    fn describe(&mut self, _name: &str, _values: BTreeMap<String, String>) {}

    /// Writes what is held back, unless nobody can read the format before its end.
    ///
    /// # Errors
    /// The first error of all writing.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }

    /// Writes what is still held back; nothing follows.
    ///
    /// # Errors
    /// The first error of all writing.
    fn finish(&mut self) -> io::Result<()>;

    /// Whether writing failed, so that no more events are needed.
    fn has_failed(&self) -> bool;

    /// Note for the user on values without a place in the output; complete after [`EventSink::finish`].
    fn remark(&self) -> Option<String> {
        None
    }
}

/// An output as the program opens it.
pub type Output = Box<dyn Write + Send>;

/// A file for rows that wait until all columns are known.
pub trait SpoolFile: Read + Write + Seek + Send {}

impl<F: Read + Write + Seek + Send> SpoolFile for F {}

/// Opens the files that a sink writes; the program implements it.
pub trait OutputFiles {
    /// The file of a format that is one file; buffered.
    ///
    /// # Errors
    /// When it cannot be written.
    fn whole(&mut self) -> io::Result<Output>;

    /// One file of a format that is several, named after its content; buffered.
    ///
    /// # Errors
    /// When it cannot be written.
    fn part(&mut self, content: &str) -> io::Result<Output>;

    /// An empty file without a name; not buffered.
    ///
    /// # Errors
    /// When there is no place for one.
    fn spool(&mut self) -> io::Result<Box<dyn SpoolFile>>;
}

/// Content of a format of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventContent {
    /// Events that say something new, unless all are asked for.
    News,
    /// All events.
    Events,
    /// Values that events carry; events without any are omitted.
    Values,
    /// A capture: frames, notices and files of the user next to the events.
    Capture,
}

/// One format of events.
#[derive(Debug)]
pub struct EventFormat {
    /// Short name, as options take it.
    pub name: &'static str,
    /// End of a file's name that selects the format; no format of frames has the same.
    pub suffix: &'static str,
    /// Content and format, for lists of suffixes.
    pub title: &'static str,
    /// One line of help.
    pub help: &'static str,
    /// Content.
    pub content: EventContent,
    /// Not for a terminal.
    pub is_binary: bool,
    /// A sink that has written nothing yet.
    pub sink: SinkConstructor,
}

/// Makes a sink; fails if one of its files cannot be written.
pub(crate) type SinkConstructor =
    fn(&mut dyn OutputFiles, &SinkOptions) -> io::Result<Box<dyn EventSink + Send>>;
