//! Captures (trace files) of PEAK-System, versions 1.0 to 1.3 and 2.x.
//!
//! ```text
//! ;$FILEVERSION=2.1                          from 1.1 on; without it the first row decides
//! ;$STARTTIME=44548.6028595139               days since 1899-12-30, local time
//! ;$COLUMNS=N,O,T,B,I,d,R,L,D                from 2.0 on
//! ;   any comment
//!       1     17535.400 DT 1  00000100 Tx -  8    00 00 00 00 00 00 00 00
//! ```
//!
//! PEAK stores bus states in separate lines. They are emitted as the error frames that SocketCAN creates for
//! them.

pub(super) mod line;
mod write;

use line::{LAYOUTS, TrcFrameLine, TrcLine};

use crate::capture::local_time::TimeOrigin;
use crate::capture::text::bus_labels::BusLabels;
use crate::capture::text::columns::{ColumnWords, windows_date};
use crate::capture::text::line_format::{CaptureAssumptions, LineFault, LineFormat, LineParser, ParsedLine};
use crate::capture::text::lines::line_excerpt;
use crate::capture::{CaptureFormat, DirectionSupport, ErrorFrames, FormatCapabilities, WritableFormat};

/// Maximum number of comment lines before the first frame.
const DETECTING_LINES: usize = 200;

/// Maximum number of columns; version 2.1 has nine.
const MOST_COLUMNS: usize = 16;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "trc",
    title: TrcFormat::TITLE,
    is_text: true,
    is_packed: false,
    detect: detect_trc,
    parser: |options| Box::new(LineParser::with_zones(TrcFormat::new(), options)),
};

pub(super) const WRITABLE: WritableFormat = WritableFormat {
    name: FORMAT.name,
    suffix: "trc",
    title: FORMAT.title,
    holds: FormatCapabilities {
        resolution: write::MICROSECOND,
        untimed: false,
        backwards: false,
        errors: ErrorFrames::Reports,
        directions: DirectionSupport::Assumed,
        bus_names: false,
        notices: false,
        ..FormatCapabilities::ALL
    },
    writer: |output, _| Box::new(write::TrcWriter::new(output)),
};

/// Detects a version line, or comments followed by a row of any version. PEAK's LIN captures have the same
/// start, but a checksum column.
fn detect_trc(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    let lines = head.split(|byte| *byte == b'\n').take(DETECTING_LINES).map(<[u8]>::trim_ascii);
    let (mut commented, mut versioned) = (false, false);
    let mut format = TrcFormat::new();
    for text in lines.filter(|text| !text.is_empty()) {
        if !text.starts_with(b";") {
            return versioned || commented && format.fits_layout(text);
        }
        if memchr::memmem::find(text, b"Checksum Type").is_some() {
            return false;
        }
        commented = true;
        if text.starts_with(b";$COLUMNS=") {
            let _ = format.on_comment(text.get(1..).unwrap_or_default());
        }
        versioned |= text.starts_with(b";$FILEVERSION=");
    }
    versioned
}

fn oldest_layout() -> &'static [u8] {
    LAYOUTS.first().map_or(b"", |(_, layout)| layout)
}

/// State that affects later lines.
#[derive(Clone)]
struct TrcFormat {
    layout: Vec<u8>,
    /// Whether a comment stated the version or the columns, or the first row decided.
    has_layout: bool,
    /// Start in nanoseconds since 1970, read as UTC; `None` if no comment states it.
    start: Option<i64>,
    buses: BusLabels,
}

impl TrcFormat {
    fn new() -> Self {
        let layout = oldest_layout().to_vec();
        Self { layout, has_layout: false, start: None, buses: BusLabels::default() }
    }

    /// Whether the first row fits the stated columns or, without a statement, those of some version: 1.0 first, which
    /// states none, then the latest. Sets these columns.
    fn fits_layout(&mut self, row: &[u8]) -> bool {
        if self.has_layout {
            return line::parse_line(&self.layout, row).is_ok();
        }
        // Up to 1.3 a bracket follows the number of the row.
        let has_bracket = ColumnWords::new(row).next().is_some_and(|word| word.ends_with(b")"));
        let fits = |(version, layout): &&(&str, &[u8])| {
            version.starts_with('1') == has_bracket && line::parse_line(layout, row).is_ok()
        };
        let found = LAYOUTS.iter().take(1).chain(LAYOUTS.iter().rev()).find(fits);
        if let Some((_, layout)) = found {
            self.layout = layout.to_vec();
        }
        self.has_layout = found.is_some();
        self.has_layout
    }

    /// Handles a comment: free text, except for three keywords and the names of buses.
    fn on_comment(&mut self, comment: &[u8]) -> Result<(), LineFault> {
        if let Some(version) = comment.strip_prefix(b"$FILEVERSION=") {
            return self.set_version(version.trim_ascii());
        }
        if let Some(columns) = comment.strip_prefix(b"$COLUMNS=") {
            let columns = columns.split(|byte| *byte == b',').take(MOST_COLUMNS);
            self.layout = columns.filter_map(|column| column.trim_ascii().first().copied()).collect();
            self.has_layout = true;
        }
        if let Some(label) = comment.strip_prefix(b"   Bus ") {
            self.buses.learn_label(label);
        }
        if let Some(days) = comment.strip_prefix(b"$STARTTIME=") {
            let start = windows_date(days.trim_ascii_end());
            self.start =
                Some(start.ok_or("start time: expected days since 1899-12-30, such as 44548.6028595139")?);
        }
        Ok(())
    }

    fn set_version(&mut self, version: &[u8]) -> Result<(), LineFault> {
        let known = LAYOUTS.iter().find(|(known, _)| known.as_bytes() == version);
        // From 2.0 on the columns are named, so later versions can be read too.
        let later = || LAYOUTS.last().filter(|_| version.starts_with(b"2."));
        let Some((_, layout)) = known.or_else(later) else {
            return Err(LineFault::Header {
                found: format!("file version {}", line_excerpt(version)),
                expected: "1.0, 1.1, 1.2, 1.3 or 2.x",
            });
        };
        self.layout = layout.to_vec();
        self.has_layout = true;
        Ok(())
    }
}

impl LineFormat for TrcFormat {
    const TITLE: &'static str = "PEAK TRC";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        _: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let text = text.trim_ascii();
        if let Some(comment) = text.strip_prefix(b";") {
            return self.on_comment(comment).map(|()| None);
        }
        if !self.has_layout {
            self.fits_layout(text);
        }
        let TrcFrameLine { offset, bus, frame, lost } = match line::parse_line(&self.layout, text)? {
            TrcLine::Nothing => return Ok(None),
            TrcLine::Frame(found) => found,
        };
        let bus = self.buses.name(bus);
        let time = self.start.unwrap_or(0).saturating_add(offset);
        Ok(Some(ParsedLine { time: Some(time), bus, frame, lost }))
    }

    fn time_origin(&self) -> TimeOrigin {
        self.start.map_or(TimeOrigin::Universal, TimeOrigin::LocalStart)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Batch, CaptureError, FormatParser, Notice};
    use crate::frame::Timestamp;

    fn read(text: &str) -> Result<Batch, CaptureError> {
        let mut batch = Batch::new();
        assert_eq!(LineParser::new(TrcFormat::new()).parse(text.as_bytes(), true, &mut batch)?, text.len());
        Ok(batch)
    }

    #[test]
    fn times_count_from_the_start_time() {
        let batch =
            read(";$FILEVERSION=1.1\r\n;$STARTTIME=25569.5\r\n;\r\n 1) 144.5 Rx 0728 1 7F \r\n").unwrap();
        let [frame] = batch.frames() else { panic!("{:?}", batch.frames()) };
        assert_eq!(frame.time, Some(Timestamp(43_200_144_500_000)));
        assert_eq!(frame.number, 1);
        assert!(matches!(batch.notices(), [(0, Notice::Assumption(_))]), "{:?}", batch.notices());
    }

    #[test]
    fn without_a_start_time_they_count_from_zero_and_nothing_is_assumed() {
        let batch = read(";##\n;  Start time: 18.12.2021 14:28:07.062\n 1) 17535 0100 1 7F\n").unwrap();
        assert_eq!(batch.frames()[0].time, Some(Timestamp(17_535_000_000)));
        assert!(batch.notices().is_empty());
    }

    #[test]
    fn the_columns_line_decides() {
        let text = ";$FILEVERSION=2.2\n;$COLUMNS=O,I,d,T,l,D\n1.5 0181 Rx DT 2 AA BB\n";
        let batch = read(text).unwrap();
        assert_eq!(batch.frames()[0].data(), [0xAA, 0xBB]);
    }

    #[test]
    fn without_a_version_the_first_row_decides() {
        for (text, expected) in [
            (";a comment\n 1) 2.5 Rx 0728 1 7F\n", "{1} (0.002500000) bus0 728#7F flags=40 dlc=0"),
            (";a\n 1 2.5 DT 0728 Tx 1 7F\n", "{1} (0.002500000) bus0 728#7F flags=20 dlc=0"),
            (";a\n 1 2.5 DT 1 18FEF100 Rx - 1 7F\n", "{1} (0.002500000) bus0 18FEF100#7F flags=40 dlc=0"),
            (";$COLUMNS=O,I,d,T,l,D\n2.5 0728 Rx DT 1 7F\n", "{1} (0.002500000) bus0 728#7F flags=40 dlc=0"),
        ] {
            assert!(detect_trc(text.as_bytes()), "{text}");
            let batch = read(text).unwrap();
            let frames: Vec<_> = batch.frames().iter().map(|frame| format!("{frame:?}")).collect();
            assert_eq!(frames, [expected]);
        }
        for other in [";a\n 1 2.5 0728 1 7F\n", ";a\n 1) broken\n", ";$COLUMNS=O,I,d,T,l,D\nbroken\n"] {
            assert!(!detect_trc(other.as_bytes()), "{other}");
        }
    }

    #[test]
    fn an_unreadable_line_is_named_and_the_next_is_read() {
        let text = ";$FILEVERSION=1.1\n 1) 1.0 Rx 0728 9 7F\n 2) 2.0 Warng FFFFFFFF 4 00 00 00 02\n";
        let batch = read(text).unwrap();
        assert_eq!(batch.frames().len(), 1);
        let [(0, bad), (0, lost)] = batch.notices() else { panic!("{:?}", batch.notices()) };
        assert_eq!(
            bad.to_string(),
            "line 2: data: fewer bytes than the length; found \"1) 1.0 Rx 0728 9 7F\""
        );
        assert_eq!(lost.to_string(), "line 3: frames lost");
    }

    #[test]
    fn an_unknown_version_is_refused_with_its_place() {
        let error = read(";\n;$FILEVERSION=3.0\n").err().unwrap().to_string();
        assert_eq!(error, "PEAK TRC: byte 2: found file version \"3.0\"; expected 1.0, 1.1, 1.2, 1.3 or 2.x");
    }

    #[test]
    fn peak_traces_are_recognised_and_others_are_not() {
        assert!(detect_trc(b"\xEF\xBB\xBF;$FILEVERSION=1.1\r\n"));
        assert!(detect_trc(b";###\r\n;  C:\\x.trc\r\n;\r\n     1)      1841      0001  1  00\r\n"));
        for other in [
            &b";$FILEVERSION=1.1\n;  |  +Checksum Type\n 1) 756186 Sub 02 2 -- -- 00 EH SR/TO\n"[..],
            b"@ TEXT @ 2 @ 64 @ 0 @ 55 @ 10078 @ 00:00:10.078 @\n46,016\t1\t0004\t45A\t8\t5A",
            b"; a comment\n(1.0) can0 123#11\n",
            b"     1)      1841      0001  1  00\r\n",
            b"",
        ] {
            assert!(!detect_trc(other), "{}", other.escape_ascii());
        }
    }
}
