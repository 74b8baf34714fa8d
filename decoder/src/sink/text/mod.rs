//! Text: one line an event, for people.
//!
//! ```text
//!     TIME  NODE dec/hex NAME  KIND    what happened, cause, consequence {frames}
//!    0.412  32/20 boom         BOOT    boot-up, no NMT reset before → power-on or self-reset {118}
//! ```
//!
//! `?` behind a value or state marks what is presumed. Repetitions are left out unless asked for.

mod detail;
mod line;
mod time;

use std::io::{self, Write};

pub use time::TimeColumn;

use crate::event::{Event, EventKind};
use crate::session::Bus;

/// Which PDOs are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PdoLines {
    /// The first of an identifier, and those whose payload differs from the one before.
    #[default]
    Change,
    /// All.
    All,
    /// None.
    None,
}

/// What the text shows.
#[derive(Debug, Clone, Copy, Default)]
pub struct TextOptions {
    /// Time column.
    pub time: TimeColumn,
    /// PDOs.
    pub pdo: PdoLines,
    /// Repetitions of everything else: heartbeats, SYNC, guarding, scan steps.
    pub all: bool,
    /// Frames no protocol owns.
    pub frames: bool,
    /// Everything known of an event, on further lines.
    pub verbose: bool,
    /// ANSI colours.
    pub color: bool,
}

/// Writes events as text. The first write error is kept and ends all writing.
pub struct Text<W> {
    output: W,
    options: TextOptions,
    clock: time::Clock,
    line: String,
    error: Option<io::Error>,
}

/// How serious a line looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tone {
    Plain,
    Quiet,
    Good,
    Caution,
    Bad,
}

impl Tone {
    const fn ansi(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Quiet => "\x1b[2m",
            Self::Good => "\x1b[32m",
            Self::Caution => "\x1b[33m",
            Self::Bad => "\x1b[31m",
        }
    }
}

impl<W: Write> Text<W> {
    /// Writes to `output`, which should be buffered.
    pub fn new(output: W, options: TextOptions) -> Self {
        let clock = time::Clock::new(options.time);
        Self { output, options, clock, line: String::with_capacity(256), error: None }
    }

    /// Writes one event, if it is one to be shown.
    pub fn write(&mut self, event: &Event, bus: &Bus) {
        self.clock.see(event.time);
        if self.error.is_some() || !self.is_shown(event) {
            return;
        }
        self.line.clear();
        let words = line::words(event, bus);
        let who = if bus.index().0 == 0 { words.who } else { format!("{} {}", bus.name(), words.who) };
        let (on, off) = if self.options.color && words.tone != Tone::Plain {
            (words.tone.ansi(), "\x1b[0m")
        } else {
            ("", "")
        };
        let mark = if event.presumed { "?" } else { "" };
        let frames = line::frames(event.frames);
        let time = self.clock.column(event.time);
        let line = format!("{time}  {who:<16}  {on}{:<6} {}{mark}{off}{frames}", words.kind, words.what);
        // Every string of the capture ends up in this line; our own colours are the only control characters.
        if self.options.color {
            self.line.push_str(&line.split('\x1b').map(super::escape).collect::<Vec<_>>().join("\x1b"));
        } else {
            self.line.push_str(&super::escape(&line));
        }
        self.line.push('\n');
        if self.options.verbose {
            detail::write(event, bus, &mut self.line);
        }
        self.error = self.output.write_all(self.line.as_bytes()).err();
    }

    fn is_shown(&self, event: &Event) -> bool {
        match &event.kind {
            EventKind::Pdo(_) => match self.options.pdo {
                PdoLines::All => true,
                PdoLines::Change => !event.routine,
                PdoLines::None => false,
            },
            EventKind::Frame(_) => self.options.frames,
            _ => !event.routine || self.options.all,
        }
    }

    /// Writes a line that is no event, such as a heading between captures.
    pub fn heading(&mut self, text: &str) {
        if self.error.is_none() {
            self.error = writeln!(self.output, "{}", super::escape(text)).err();
        }
        self.clock = time::Clock::new(self.options.time);
    }

    /// Flushes; gives the first error of all writing.
    ///
    /// # Errors
    /// When anything could not be written.
    pub fn finish(&mut self) -> io::Result<()> {
        match self.error.take() {
            Some(error) => Err(error),
            None => self.output.flush(),
        }
    }

    /// Whether writing failed, so that more work is in vain.
    pub fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}
