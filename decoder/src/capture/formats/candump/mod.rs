//! candump text: log files and screen output of can-utils, in all dialects.

mod fast;
pub(super) mod line;
pub(super) mod stamp;
mod time;
mod write;

use fast::LineCache;
use line::{CandumpFrameLine, CandumpLine, LineError};
use time::CandumpClock;

use crate::capture::local_time::{LocalClock, TimeOrigin};
use crate::capture::notice::CAN_XL;
use crate::capture::text::lines::{AROUND, LineSplitter, LineStep, SkippedLines, line_excerpt};
use crate::capture::{
    Batch, BusNames, CaptureError, CaptureFormat, CapturePlace, FormatCapabilities, FormatParser,
    LARGEST_RECORD, Notice, ReadOptions, WritableFormat,
};
use crate::frame::{BusIndex, Frame, Timestamp};

/// Number of lines whose timestamps determine whether times are relative.
const DECIDING_LINES: usize = 1_000;

/// Number of lines at the start within which a frame must occur.
const DETECTING_LINES: usize = 200;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "candump",
    title: "candump text",
    is_text: true,
    is_packed: false,
    detect: |head| {
        head.split(|byte| matches!(byte, b'\n' | b'\r')).take(DETECTING_LINES).any(|line| {
            let line = line.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(line);
            let line = line.strip_suffix(b"\r").unwrap_or(line);
            matches!(
                line::parse_line(&line::without_colors(line)),
                Ok(CandumpLine::Frame(_)) | Err(LineError::CanXl)
            )
        })
    },
    parser: |options| Box::new(CandumpParser::new(options)),
};

pub(super) const WRITABLE: WritableFormat = WritableFormat {
    name: FORMAT.name,
    suffix: "log",
    title: FORMAT.title,
    holds: FormatCapabilities { negative: false, notices: false, comments: false, ..FormatCapabilities::ALL },
    writer: |output, _| Box::new(write::CandumpWriter::new(output)),
};

/// Parser of candump text.
#[derive(Clone)]
struct CandumpParser {
    lines: LineSplitter,
    clock: CandumpClock,
    cache: LineCache,
    buses: BusNames,
    frames: u64,
    around: SkippedLines,
    local: LocalClock,
    stated_lin: bool,
    stated_xl: bool,
}

impl CandumpParser {
    fn new(options: &ReadOptions) -> Self {
        Self {
            lines: LineSplitter::default(),
            clock: CandumpClock::new(options.time_style),
            cache: LineCache::default(),
            buses: BusNames::default(),
            frames: 0,
            around: SkippedLines::default(),
            local: LocalClock::new(&options.time_zones),
            stated_lin: false,
            stated_xl: false,
        }
    }

    /// Parses consecutive common lines; returns the number of bytes used.
    #[inline]
    fn parse_run(&mut self, input: &[u8], batch: &mut Batch) -> usize {
        // The rest of a line that is too long must not be parsed as a line.
        if !self.clock.is_absolute() || self.lines.is_skipping() {
            return 0;
        }
        let mut rest = input;
        let mut last = self.frames;
        for slot in batch.free_slots() {
            let Some(window) = rest.first_chunk() else { break };
            let Some(length) = self.cache.parse(window, slot) else { break };
            rest = rest.get(length..).unwrap_or_default();
            last += 1;
            slot.number = last;
        }
        let count = last.saturating_sub(self.frames);
        batch.commit_all(count);
        self.lines.count_lines(count);
        self.frames = last;
        input.len().saturating_sub(rest.len())
    }

    /// Parses one line with the general parser.
    fn parse_line(&mut self, line: &[u8], batch: &mut Batch) {
        match line::parse_line(&line::without_colors(line)) {
            Ok(CandumpLine::Nothing) => {}
            Ok(CandumpLine::Ellipsis) => {
                let place = CapturePlace::Line(self.lines.line_number());
                batch.add_notice(Notice::LostFrames { place, bus: BusIndex::default(), count: None });
            }
            Ok(CandumpLine::Around) => self.around.add_line(AROUND, self.lines.line_number()),
            Ok(CandumpLine::Dropped { count, bus }) => {
                let bus = self.buses.index_of(bus).unwrap_or_default();
                let place = CapturePlace::Line(self.lines.line_number());
                batch.add_notice(Notice::LostFrames { place, bus, count: Some(count) });
            }
            Ok(CandumpLine::Frame(found)) => self.add_frame(&found, batch),
            Err(error) => self.report_unreadable(line, &error, batch),
        }
    }

    fn add_frame(&mut self, found: &CandumpFrameLine<'_>, batch: &mut Batch) {
        let Some(bus) = self.buses.index_of(found.bus) else {
            let reason = format!("more than {} interfaces", crate::capture::MAX_BUSES);
            batch.add_notice(Notice::Unreadable {
                place: CapturePlace::Line(self.lines.line_number()),
                reason,
            });
            return;
        };
        self.report_assumptions(found, batch);
        self.frames += 1;
        let time = match found.stamp {
            Some(stamp) if found.is_date => {
                // candump prints the time of the computer.
                let (Timestamp(local), bus) = (self.clock.convert_stamp(stamp), self.buses.name_of(bus));
                Some(Timestamp(self.local.convert_time(local, TimeOrigin::LocalDates, bus, batch)))
            }
            stamp => stamp.map(|stamp| self.clock.convert_stamp(stamp)),
        };
        if found.stamp.is_some() {
            self.cache.learn_interface(found.bus, bus);
        }
        batch.push(Frame {
            number: self.frames,
            time,
            bus,
            id: found.id,
            flags: found.flags,
            length: found.length,
            raw_dlc: found.raw_dlc,
            bytes: found.bytes,
        });
    }

    fn report_assumptions(&mut self, found: &CandumpFrameLine<'_>, batch: &mut Batch) {
        if self.clock.take_guess() {
            let text = "timestamps step back: read as time since the frame before (candump -t d); --time a reads \
                        them as absolute times";
            batch.add_notice(Notice::Assumption(text.into()));
        }
        if found.bus.starts_with(b"lin") && !std::mem::replace(&mut self.stated_lin, true) {
            let text = format!("interface {} looks like LIN: frames read as CAN", line_excerpt(found.bus));
            batch.add_notice(Notice::Assumption(text));
        }
    }

    fn report_unreadable(&mut self, line: &[u8], error: &LineError, batch: &mut Batch) {
        let reason = match error {
            LineError::CanXl if !std::mem::replace(&mut self.stated_xl, true) => {
                format!("{CAN_XL}: not supported{}", xl_fields(line))
            }
            LineError::CanXl => format!("{CAN_XL}{}", xl_fields(line)),
            LineError::Broken(what) => format!("{what}; found {}", line_excerpt(line)),
            LineError::NotCandump => format!("not a candump line; found {}", line_excerpt(line)),
        };
        batch.add_notice(Notice::Unreadable { place: CapturePlace::Line(self.lines.line_number()), reason });
    }

    /// Whether the meaning of the timestamps is known, or can be determined from the lines ahead.
    fn is_decided(&mut self, line: &[u8], ahead: &[u8], at_end: bool) -> bool {
        let plain = line::without_colors(line);
        let Ok(CandumpLine::Frame(CandumpFrameLine { stamp: Some(stamp), is_log, .. })) =
            line::parse_line(&plain)
        else {
            return true;
        };
        if is_log || !self.clock.must_decide(stamp) {
            self.clock.settle_absolute();
            return true;
        }
        // The decision uses the same lines for any amount of input.
        let ahead = ahead.get(..LARGEST_RECORD / 2).unwrap_or(ahead);
        let enough = at_end
            || ahead.len() >= LARGEST_RECORD / 2
            || memchr::memchr_iter(b'\n', ahead).nth(DECIDING_LINES).is_some();
        if !enough {
            return false;
        }
        let stamps =
            ahead.split(|byte| matches!(byte, b'\n' | b'\r')).take(DECIDING_LINES).filter_map(|line| {
                match line::parse_line(&line::without_colors(line.strip_suffix(b"\r").unwrap_or(line))) {
                    Ok(CandumpLine::Frame(found)) => found.stamp,
                    _ => None,
                }
            });
        self.clock.decide_style(stamps);
        true
    }
}

/// Fields of a CAN XL frame, written as `81:00:12345678`: flags, SDT and AF.
fn xl_fields(line: &[u8]) -> String {
    let words = line.split(|byte| byte.is_ascii_whitespace() || b"#()|".contains(byte));
    let mut fields = words.filter_map(|word| {
        let parts: Vec<_> = word.split(|byte| *byte == b':').map(String::from_utf8_lossy).collect();
        let [flags, kind, acceptance] = parts.as_slice() else { return None };
        let is_hex = word.iter().all(|byte| byte.is_ascii_hexdigit() || *byte == b':');
        is_hex.then(|| format!(" (flags {flags}, SDT {kind}, AF {acceptance})"))
    });
    fields.next_back().unwrap_or_default()
}

impl FormatParser for CandumpParser {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            let before = taken;
            taken += self.parse_run(rest, batch);
            if batch.is_full() {
                break;
            }
            let rest = rest.get(taken - before..).unwrap_or_default();
            let mut lines = self.lines.clone();
            match lines.next(rest, at_end) {
                LineStep::Line(line, length) => {
                    if !self.is_decided(line, rest, at_end) {
                        break;
                    }
                    self.lines = lines;
                    self.parse_line(line, batch);
                    taken += length;
                }
                LineStep::Skip(length) => {
                    self.lines = lines;
                    taken += length;
                }
                LineStep::More => break,
            }
        }
        if at_end && taken == input.len() && !batch.is_full() {
            self.around.report_lines(batch);
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        &self.buses
    }

    fn line_number(&self) -> Option<u64> {
        Some(self.lines.line_number())
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}
