//! GVRET: the binary protocol of SavvyCAN's adapters (GEVCU, ESP32RET, M2RET), as a logger stored it.
//!
//! ```text
//! F1 00                       a frame follows; other numbers are responses to commands
//! 0 microseconds (4)          restart after 2^32
//! 4 identifier (4)            bit 31: 29 bits
//! 8 length and bus            lower and upper four bits
//! 9 data                      then a checksum, which firmware sets to 0
//! ```
//! Numbers are little-endian. Sources: SavvyCAN, connections/gvretserial.cpp (`procRXChar`); collin80/ESP32RET,
//! comm_buffer.cpp (`sendFrameToBuffer`). SavvyCAN's E7 E7 switches the adapter to this protocol.

use crate::capture::byte_order::ByteOrder;
use crate::capture::{
    Batch, BusNames, CaptureError, CaptureFormat, CapturePlace, FormatParser, MAX_BUSES, Notice, ReadOptions,
};
use crate::frame::{CanId, Frame, Timestamp};

const TITLE: &str = "GVRET";

/// First byte of a record.
const MARK: u8 = 0xF1;

/// Mark, kind and header of a frame.
const HEADER: usize = 2 + 9;

/// Bytes of the longest record: header, eight bytes, checksum.
const LONGEST: usize = HEADER + 8 + 1;

/// Bit of an identifier with 29 bits.
const EXTENDED: u32 = 0x8000_0000;

/// Number of consecutive frames that prove the format.
const LEAST_FRAMES: usize = 3;

/// Sizes of the records other than frames, by kind, with mark and kind.
const OTHERS: &[(u8, usize)] = &[(1, 6), (2, 4), (3, 11), (4, 3), (6, 12), (7, 8), (9, 4), (12, 3), (13, 17)];

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "gvret",
    title: TITLE,
    is_text: false,
    is_packed: false,
    detect: detect_gvret,
    parser: |_: &ReadOptions| Box::new(GvretParser::default()),
};

/// Whether the bytes begin with records, of which three are frames with a checksum of 0.
fn detect_gvret(head: &[u8]) -> bool {
    let (mut rest, mut frames) = (head, 0_usize);
    while rest.starts_with(b"\xE7") {
        rest = rest.get(1..).unwrap_or_default();
    }
    loop {
        match parse_record(rest) {
            GvretRecord::Frame { size, .. } => {
                let has_checksum = size.checked_sub(1).and_then(|last| rest.get(last)) == Some(&0);
                if !has_checksum {
                    return false;
                }
                frames += 1;
                rest = rest.get(size..).unwrap_or_default();
            }
            GvretRecord::Other(size) => rest = rest.get(size..).unwrap_or_default(),
            GvretRecord::More | GvretRecord::Broken => return false,
        }
        if frames >= LEAST_FRAMES {
            return true;
        }
    }
}

/// A record at the start of the input.
#[derive(Debug, PartialEq, Eq)]
enum GvretRecord {
    Frame {
        /// Microseconds.
        time: u32,
        bus: u8,
        frame: Frame,
        size: usize,
    },
    /// A response, with its size.
    Other(usize),
    /// More input is needed.
    More,
    Broken,
}

fn parse_record(input: &[u8]) -> GvretRecord {
    let kind = match input {
        [] | [MARK] => return GvretRecord::More,
        [MARK, kind, ..] => *kind,
        _ => return GvretRecord::Broken,
    };
    if kind != 0 {
        let Some((_, size)) = OTHERS.iter().find(|(known, _)| *known == kind) else {
            return GvretRecord::Broken;
        };
        return if input.len() < *size { GvretRecord::More } else { GvretRecord::Other(*size) };
    }
    let little = ByteOrder::Little;
    let numbers = (little.u32(input, 2), little.u32(input, 6), input.get(10).copied());
    let (Some(time), Some(id), Some(shape)) = numbers else { return GvretRecord::More };
    let (length, bus) = (usize::from(shape & 0x0F), shape >> 4);
    let number = id & !EXTENDED;
    let is_extended = id & EXTENDED != 0;
    let id = match u16::try_from(number) {
        Ok(number) if !is_extended && number <= 0x7FF => CanId::from_standard(number),
        _ if is_extended && number <= 0x1FFF_FFFF => CanId::from_extended(number),
        _ => return GvretRecord::Broken,
    };
    if length > 8 {
        return GvretRecord::Broken;
    }
    let size = HEADER + length + 1;
    match input.get(HEADER..size - 1).filter(|_| input.len() >= size) {
        Some(data) => GvretRecord::Frame { time, bus, frame: Frame::data_frame(id, data), size },
        None => GvretRecord::More,
    }
}

#[derive(Clone, Default)]
struct GvretParser {
    buses: BusNames,
    frames: u64,
    offset: u64,
    /// Start of the current period of 2^32 microseconds.
    start: i64,
    last: u32,
    /// Place of skipped bytes, and their number.
    skipped: Option<(u64, u64)>,
}

impl GvretParser {
    /// Time in nanoseconds. A step back of more than half of the period starts the next one.
    fn elapsed(&mut self, time: u32) -> i64 {
        if time < self.last && self.last - time > u32::MAX / 2 {
            self.start = self.start.saturating_add(1 << 32);
        }
        self.last = time;
        self.start.saturating_add(i64::from(time)).saturating_mul(1_000)
    }

    fn report_skipped(&mut self, batch: &mut Batch) {
        if let Some((offset, count)) = self.skipped.take() {
            let bytes = if count == 1 { "byte" } else { "bytes" };
            let reason = format!("expected F1 and a record of GVRET; {count} {bytes} skipped");
            batch.push_unreadable(CapturePlace::Offset(offset), reason);
        }
    }

    fn skip_byte(&mut self) {
        let (first, count) = self.skipped.unwrap_or((self.offset, 0));
        self.skipped = Some((first, count.saturating_add(1)));
    }

    fn add_frame(&mut self, time: u32, bus: u8, frame: Frame, batch: &mut Batch) {
        let Some(bus) = self.buses.index_of(bus.to_string().as_bytes()) else {
            batch.push_unreadable(CapturePlace::Offset(self.offset), format!("more than {MAX_BUSES} buses"));
            return;
        };
        self.frames += 1;
        let time = Some(Timestamp(self.elapsed(time)));
        batch.push(Frame { number: self.frames, time, bus, ..frame });
    }
}

impl FormatParser for GvretParser {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            let size = match parse_record(rest) {
                GvretRecord::Frame { time, bus, frame, size } => {
                    self.report_skipped(batch);
                    self.add_frame(time, bus, frame, batch);
                    size
                }
                GvretRecord::Other(size) => size,
                GvretRecord::More if rest.is_empty() => break,
                GvretRecord::More if at_end => {
                    self.report_skipped(batch);
                    let reason = format!("the capture ends inside a record: found {} bytes", rest.len());
                    batch.add_notice(Notice::CutOff { place: CapturePlace::Offset(self.offset), reason });
                    rest.len()
                }
                GvretRecord::More => break,
                // E7 switches the adapter to this protocol.
                GvretRecord::Broken if rest.starts_with(b"\xE7") && self.frames == 0 => 1,
                GvretRecord::Broken => {
                    self.skip_byte();
                    1
                }
            };
            taken += size;
            self.offset = self.offset.saturating_add(size as u64);
        }
        if at_end && taken == input.len() && !batch.is_full() {
            self.report_skipped(batch);
        }
        Ok(taken)
    }

    fn largest_input(&self) -> usize {
        LONGEST
    }

    fn buses(&self) -> &BusNames {
        &self.buses
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::{read_capture, read_in_pieces};

    fn record(time: u32, id: u32, bus: u8, data: &[u8]) -> Vec<u8> {
        let shape = bus << 4 | u8::try_from(data.len()).unwrap();
        [&[MARK, 0][..], &time.to_le_bytes(), &id.to_le_bytes(), &[shape], data, &[0]].concat()
    }

    #[test]
    fn frames_and_responses() {
        let bytes = [
            b"\xE7\xE7".to_vec(),
            record(4_294_967_290, 0x705, 0, &[5]),
            vec![MARK, 9, 0xDE, 0xAD],
            record(10, 0x98FE_F100, 1, &[1, 2, 3, 4, 5, 6, 7, 8]),
            record(20, 0x181, 0, &[]),
        ]
        .concat();
        let whole = read_capture(&bytes);
        assert_eq!(whole, read_in_pieces(&bytes, &[1, 3, 20]));
        assert_eq!(
            whole.items,
            [
                "{1} (4294.967290000) bus0 705#05 flags=00 dlc=0",
                "{2} (4294.967306000) bus1 18FEF100#0102030405060708 flags=00 dlc=0",
                "{3} (4294.967316000) bus0 181# flags=00 dlc=0",
            ]
        );
        assert_eq!(whole.buses, ["0", "1"]);
    }

    #[test]
    fn rubbish_is_skipped_and_a_cut_end_reported() {
        let three = [record(1, 1, 0, &[1]), record(2, 2, 0, &[2]), record(3, 3, 0, &[3])].concat();
        let bytes = [&three[..], b"abc", &record(4, 4, 0, &[4]), &[MARK, 0, 5]].concat();
        let content = read_capture(&bytes);
        assert_eq!(content, read_in_pieces(&bytes, &[2]));
        assert_eq!(
            content.items[3..],
            [
                "byte 39: expected F1 and a record of GVRET; 3 bytes skipped",
                "{4} (0.000004000) bus0 004#04 flags=00 dlc=0",
                "byte 55: the capture ends inside a record: found 3 bytes",
            ]
        );
    }

    #[test]
    fn other_bytes_are_not_gvret() {
        let two = [record(1, 1, 0, &[1]), record(2, 2, 0, &[2])].concat();
        let mut wrong = [&two[..], &record(3, 3, 0, &[3])].concat();
        assert!(detect_gvret(&wrong));
        *wrong.last_mut().unwrap() = 7;
        assert!(!detect_gvret(&wrong));
        for other in [&two[..], b"", b"\xF1", b"\xE7\xE7", &[MARK; 60]] {
            assert!(!detect_gvret(other), "{}", other.escape_ascii());
        }
    }
}
