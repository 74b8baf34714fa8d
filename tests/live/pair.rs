//! The program and candump beside each other on one bus, and their records frame for frame.

use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::harness::{Ended, HELLO, Program, greet};

/// A frame as it was recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recorded {
    /// Microseconds since 1970; candump has no more digits.
    pub time: u64,
    /// Bus.
    pub bus: String,
    /// Identifier and data in candump's form.
    pub frame: String,
}

/// Both, from where they heard the same frame to where they hear one again.
pub struct Pair {
    pub live: Program,
    candump: Program,
    bus: &'static str,
    folder: TempDir,
    first: String,
}

/// What they recorded between.
pub struct Records {
    pub ours: Vec<Recorded>,
    pub theirs: Vec<Recorded>,
    pub ended: Ended,
}

impl Pair {
    /// Both on one source, which is on this bus or includes it.
    pub fn start(source: &str, bus: &'static str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let record = folder.path().join("live.log");
        let live = Program::live([source, "--record", record.to_str().unwrap()]);
        let candump = Program::candump(&with_errors(source));
        let first = greet(bus, &[&live, &candump]);
        Self { live, candump, bus, folder, first }
    }

    pub fn record(&self) -> PathBuf {
        self.folder.path().join("live.log")
    }

    /// Ends both when they have heard all.
    pub fn end(self) -> Records {
        let record = self.record();
        let last = greet(self.bus, &[&self.live, &self.candump]);
        let ended = self.live.interrupt();
        let theirs = between(&parse(&self.candump.lines().join("\n")), &self.first, &last);
        let ours = between(&read(&record), &self.first, &last);
        Records { ours, theirs, ended }
    }
}

impl Records {
    /// Both are the same, times included, and have as many frames as were sent.
    pub fn assert_same(&self, sent: usize) {
        let pairs = self.ours.iter().zip(&self.theirs);
        for (number, (ours, theirs)) in pairs.enumerate() {
            assert_eq!(ours, theirs, "frame {} of {sent}", number + 1);
        }
        assert_eq!((self.ours.len(), self.theirs.len()), (sent, sent), "frames of the program, of candump");
    }

    /// The frames alone.
    pub fn frames(&self) -> Vec<&str> {
        self.ours.iter().map(|recorded| recorded.frame.as_str()).collect()
    }
}

/// Reads a record in candump's form.
pub fn read(path: &Path) -> Vec<Recorded> {
    parse(&fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
}

/// The program hears error frames unless it is told otherwise, candump only where it is told so.
fn with_errors(source: &str) -> String {
    match source {
        told if told.contains('#') => told.to_owned(),
        filtered if filtered.contains(',') => format!("{filtered},#1FFFFFFF"),
        bus => format!("{bus},0:0,#1FFFFFFF"),
    }
}

/// What stands between two frames.
fn between(all: &[Recorded], first: &str, last: &str) -> Vec<Recorded> {
    let place = |wanted: &str| all.iter().position(|recorded| recorded.frame == wanted);
    let (first, last) = (place(first).expect("first frame"), place(last).expect("last frame"));
    all[first + 1..last].iter().filter(|recorded| !recorded.frame.starts_with(HELLO)).cloned().collect()
}

/// Reads text in candump's form.
pub fn parse(text: &str) -> Vec<Recorded> {
    let line = |line: &str| {
        let mut words = line.split(' ');
        let mut next = || words.next().unwrap_or_else(|| panic!("short line: {line}"));
        let (stamp, bus, frame) = (next(), next(), next());
        Recorded { time: microseconds(stamp), bus: bus.to_owned(), frame: plain(frame) }
    };
    text.lines().map(line).collect()
}

/// `(1700000000.123456)`, or with nine digits; what is finer is cut, as the kernel does for candump.
fn microseconds(stamp: &str) -> u64 {
    let (seconds, fraction) = stamp.trim_matches(['(', ')']).split_once('.').unwrap();
    let micros: String = fraction.chars().chain("000000".chars()).take(6).collect();
    seconds.parse::<u64>().unwrap() * 1_000_000 + micros.parse::<u64>().unwrap()
}

/// The same words for the same thing: candump leaves the length 0 of a remote frame out, and shows the kernel's
/// own mark of FD frames (`CANFD_FDF`, 4) among their flags.
fn plain(frame: &str) -> String {
    let (id, rest) = frame.split_once('#').unwrap_or_else(|| panic!("not a frame: {frame}"));
    if rest == "R0" {
        return format!("{id}#R");
    }
    let Some(rest) = rest.strip_prefix('#') else { return frame.to_owned() };
    let (flags, data) = rest.split_at(1);
    format!("{id}##{:X}{data}", u8::from_str_radix(flags, 16).unwrap() & 3)
}
