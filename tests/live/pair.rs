//! The program and candump on the same bus, with a comparison of their captures frame by frame.

use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::harness::{Ended, HELLO, Program, greet};

/// A captured frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recorded {
    /// µs since 1970, the resolution of candump.
    pub time: u64,
    /// Name of the bus.
    pub bus: String,
    /// Identifier and data in candump's form.
    pub frame: String,
}

/// The program and candump, running from one greeting to the next.
pub struct Pair {
    pub live: Program,
    candump: Program,
    bus: &'static str,
    folder: TempDir,
    first: String,
}

/// Captures of both programs between the two greetings.
pub struct Records {
    pub ours: Vec<Recorded>,
    pub theirs: Vec<Recorded>,
    pub ended: Ended,
}

impl Pair {
    /// Starts both on one source, which is this bus or includes it.
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

    /// Ends both after they have received all frames.
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
    /// Asserts that both captures are equal, including times, and have as many frames as were sent.
    pub fn assert_same(&self, sent: usize) {
        let pairs = self.ours.iter().zip(&self.theirs);
        for (number, (ours, theirs)) in pairs.enumerate() {
            assert_eq!(ours, theirs, "frame {} of {sent}", number + 1);
        }
        assert_eq!((self.ours.len(), self.theirs.len()), (sent, sent), "frames of the program, of candump");
    }

    /// The frames without times and buses.
    pub fn frames(&self) -> Vec<&str> {
        self.ours.iter().map(|recorded| recorded.frame.as_str()).collect()
    }
}

/// Reads a capture in candump's form.
pub fn read(path: &Path) -> Vec<Recorded> {
    parse(&fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
}

/// Adds an error filter for candump, which needs one to receive error frames; the program does not.
fn with_errors(source: &str) -> String {
    match source {
        reported if reported.contains('#') => reported.to_owned(),
        filtered if filtered.contains(',') => format!("{filtered},#1FFFFFFF"),
        bus => format!("{bus},0:0,#1FFFFFFF"),
    }
}

/// Frames between two greetings.
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

/// µs of `(1700000000.123456)`, also with nine digits; truncates like the kernel does for candump.
fn microseconds(stamp: &str) -> u64 {
    let (seconds, fraction) = stamp.trim_matches(['(', ')']).split_once('.').unwrap();
    let micros: String = fraction.chars().chain("000000".chars()).take(6).collect();
    seconds.parse::<u64>().unwrap() * 1_000_000 + micros.parse::<u64>().unwrap()
}

/// A common notation: candump omits the length 0 of a remote frame, and shows the kernel's own mark of FD
/// frames (`CANFD_FDF`, 4) in their flags.
fn plain(frame: &str) -> String {
    let (id, rest) = frame.split_once('#').unwrap_or_else(|| panic!("not a frame: {frame}"));
    if rest == "R0" {
        return format!("{id}#R");
    }
    let Some(rest) = rest.strip_prefix('#') else { return frame.to_owned() };
    let (flags, data) = rest.split_at(1);
    format!("{id}##{:X}{data}", u8::from_str_radix(flags, 16).unwrap() & 3)
}
