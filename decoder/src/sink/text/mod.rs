//! Text: one line per event.
//!
//! ```text
//!     TIME  NODE dec/hex NAME  KIND    what happened, cause, consequence {frames}
//!    0.412  32/20 boom         BOOT    boot-up, no NMT reset before → power cycle or self-reset {118}
//! ```
//!
//! `?` after a value or state marks it as presumed. Repeated events are printed only with `TextOptions::all`.

mod burst;
mod bus;
mod changes;
mod detail;
mod device;
mod emcy;
mod finding;
mod held;
mod j1939;
mod line;
mod news;
mod node;
mod parts;
mod pdo;
mod pdo_head;
mod sdo;
mod time;
mod tone;
mod transfer;
mod uds;

use std::io::{self, Write};

pub use super::options::{PdoLines, TextOptions, TimeColumn};
pub use changes::MessageChanges;
pub use line::EventLine;
pub use news::PrintedPayloads;
pub use tone::LineTone;
pub use transfer::TransferWords;

use self::burst::{BurstEnd, ErrorBursts};
use self::held::HeldLine;
use self::parts::{character_count, push_columns};
use self::pdo_head::PdoHeads;
use super::event_sink::{EventContent, EventFormat, EventSink};
use crate::ascii::push_blanks;
use crate::escape::{escape, push_escaped};
use crate::event::{DecodedPdo, Event, EventKind, FindingNews};
use crate::frame::Timestamp;
use crate::session::Bus;

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "text",
    suffix: "txt",
    title: "events as text",
    help: "One line of text per event",
    content: EventContent::News,
    is_binary: false,
    sink: |files, options| Ok(Box::new(TextSink::new(files.whole_file()?, options.text))),
};

/// Writer for event lines. After the first write error nothing more is written; `finish` returns the error.
pub struct TextSink<W> {
    output: W,
    options: TextOptions,
    clock: time::TimeFormatter,
    columns: line::LineColumns,
    pdo_heads: PdoHeads,
    news: PrintedPayloads,
    line: Vec<u8>,
    held: HeldLine,
    bursts: ErrorBursts,
    error: Option<io::Error>,
}

impl<W: Write> TextSink<W> {
    /// Writes to `output`, which should be buffered.
    pub fn new(output: W, options: TextOptions) -> Self {
        let clock = time::TimeFormatter::new(options.time);
        let line = Vec::with_capacity(512);
        Self {
            output,
            options,
            clock,
            columns: line::LineColumns::default(),
            pdo_heads: PdoHeads::default(),
            news: PrintedPayloads::default(),
            line,
            held: HeldLine::default(),
            bursts: ErrorBursts::default(),
            error: None,
        }
    }

    /// Writes one line. All strings of the capture are escaped, so ANSI colours are the only control
    /// characters.
    // Separate from `write`, because most events are filtered out there.
    #[inline(never)]
    fn write_line(&mut self, event: &Event, bus: &Bus) {
        if let EventKind::FindingOpened(news) = &event.kind
            && self.held.is_about(event, news)
        {
            return self.add_finding(news);
        }
        if self.held.is_held() {
            self.write_held();
        }
        if !self.bursts.is_empty() {
            self.end_bursts(event);
        }
        match &event.kind {
            EventKind::Pdo(pdo) => self.write_pdo(pdo, event, bus),
            _ => self.write_event(event, bus),
        }
    }

    /// Writes the line of an event other than a PDO, which a finding can complete.
    fn write_event(&mut self, event: &Event, bus: &Bus) {
        if !self.options.all && self.bursts.absorbs_event(event, bus) {
            return;
        }
        self.columns.fill_columns(event, bus);
        let (columns, line) = (&self.columns, &mut self.line);
        line.clear();
        self.clock.append_column(event.time, line);
        let colored = self.options.color && columns.tone != LineTone::Plain;
        let color = if colored { columns.tone.ansi_code() } else { "" };
        push_columns(bus, &columns.who, columns.kind, color, line);
        push_escaped(line, &columns.what);
        if event.presumed {
            line.push(b'?');
        }
        let kind = columns.kind;
        self.held.colored = colored;
        self.held.below = if self.options.verbose { detail::detail_lines(event, bus) } else { String::new() };
        self.held.hold_line(event, kind);
        if !held::may_be_judged(event) {
            self.write_held();
        }
    }

    /// Writes the line of a PDO, which is neither held nor coloured.
    fn write_pdo(&mut self, pdo: &DecodedPdo, event: &Event, bus: &Bus) {
        let line = &mut self.line;
        line.clear();
        self.clock.append_column(event.time, line);
        self.pdo_heads.push_line(pdo, event, bus, line);
        parts::push_frames(event.frames, line);
        if self.options.verbose {
            line.extend_from_slice(detail::detail_lines(event, bus).as_bytes());
        }
        self.write_out();
    }

    /// Writes the ends of bursts before an event.
    fn end_bursts(&mut self, event: &Event) {
        for burst in self.bursts.ended_bursts(Some(event)) {
            self.write_burst(&burst);
        }
    }

    /// Adds a finding to the held line about the same fact, and writes the line.
    fn add_finding(&mut self, news: &FindingNews) {
        let known = String::from_utf8_lossy(&self.columns.what);
        let new = held::news_of(&known, self.columns.kind, &news.text);
        let mut text = format!("; {}", news.severity.name());
        if !new.is_empty() {
            text.push_str(": ");
            text.push_str(new);
        }
        finding::push_source(news, &mut text);
        push_escaped(&mut self.line, text.as_bytes());
        self.write_held();
    }

    /// Writes the held line.
    fn write_held(&mut self) {
        if !self.held.is_held() {
            return;
        }
        self.held.release_line();
        let line = &mut self.line;
        if self.held.colored {
            line.extend_from_slice(b"\x1b[0m");
        }
        parts::push_frames(self.held.frames, line);
        line.extend_from_slice(self.held.below.as_bytes());
        self.write_out();
    }

    fn write_out(&mut self) {
        if let Err(error) = self.output.write_all(&self.line) {
            self.error = Some(error);
        }
    }

    /// Writes the line at the end of a burst of error frames.
    fn write_burst(&mut self, burst: &BurstEnd) {
        let line = &mut self.line;
        line.clear();
        self.clock.append_column(burst.time, line);
        line.extend_from_slice(b"  ");
        push_escaped(line, burst.bus.as_bytes());
        push_blanks(line, 16, character_count(burst.bus.as_bytes()));
        line.extend_from_slice(b"  ERROR  ");
        line.extend_from_slice(burst.text.as_bytes());
        parts::push_frames(burst.frames, line);
        self.write_out();
    }

    fn is_shown(&mut self, event: &Event) -> bool {
        match &event.kind {
            EventKind::Pdo(_) | EventKind::J1939Message(_) => match self.options.pdo {
                PdoLines::All => true,
                PdoLines::Change => self.news.has_news(event),
                PdoLines::None => false,
            },
            EventKind::Frame(_) if self.options.frames => true,
            EventKind::Frame(undecoded) => match self.options.pdo {
                PdoLines::All => undecoded.message.is_some(),
                // Without a database, frames are routine events.
                PdoLines::Change => !event.routine,
                PdoLines::None => false,
            },
            EventKind::FindingOpened(news) | EventKind::FindingClosed(news) if news.member_of.is_some() => {
                self.options.all
            }
            _ => !event.routine || self.options.all,
        }
    }
}

impl<W: Write> EventSink for TextSink<W> {
    /// Writes a heading with the capture name.
    fn begin_capture(&mut self, name: &str) {
        self.write_held();
        if self.error.is_none() {
            self.error = writeln!(self.output, "== {}", escape(name)).err();
        }
        self.clock = time::TimeFormatter::new(self.options.time);
    }

    fn observe_time(&mut self, time: Option<Timestamp>) {
        self.clock.note_time(time);
    }

    #[inline]
    fn write_event(&mut self, event: &Event, bus: &Bus) -> bool {
        // The state of a link may be known before the first frame.
        if event.frames.last > 0 {
            self.clock.note_time(event.time);
        }
        if self.error.is_some() || !self.is_shown(event) {
            return false;
        }
        self.write_line(event, bus);
        true
    }

    fn flush(&mut self) -> io::Result<()> {
        self.write_held();
        match self.error.take() {
            Some(error) => Err(error),
            None => self.output.flush(),
        }
    }

    fn finish_output(&mut self) -> io::Result<()> {
        self.write_held();
        for burst in self.bursts.ended_bursts(None) {
            self.write_burst(&burst);
        }
        match self.error.take() {
            Some(error) => Err(error),
            None => self.output.flush(),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}
