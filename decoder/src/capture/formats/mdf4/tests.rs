//! Tests with captures built block by block.

use super::*;
use crate::capture::testing::{read_capture, read_in_pieces};
use crate::capture::{CaptureReader, ReadOptions};
use crate::frame::{CanId, FrameFlags};
use crate::words::UNKNOWN_ZONE;

const START: u64 = 1_700_000_000_000_000_000;

/// Builder of a capture.
struct CaptureFile(Vec<u8>);

impl CaptureFile {
    fn new(magic: &[u8; 8], version: u16, flags: u16) -> Self {
        let mut bytes = magic.to_vec();
        bytes.resize(28, b' ');
        bytes.extend(version.to_le_bytes());
        bytes.resize(60, 0);
        bytes.extend(flags.to_le_bytes());
        bytes.extend([0; 2]);
        Self(bytes)
    }

    /// Adds a block; returns its offset.
    fn block(&mut self, kind: &[u8; 2], links: &[u64], data: &[u8]) -> u64 {
        self.0.resize(self.0.len().next_multiple_of(8), 0);
        let at = self.0.len() as u64;
        self.0.extend(b"##");
        self.0.extend(kind);
        self.0.extend([0; 4]);
        let length = 24 + 8 * links.len() + data.len();
        self.0.extend((length as u64).to_le_bytes());
        self.0.extend((links.len() as u64).to_le_bytes());
        self.0.extend(links.iter().flat_map(|link| link.to_le_bytes()));
        self.0.extend(data);
        at
    }

    fn link(&mut self, block: u64, index: usize, to: u64) {
        let at = usize::try_from(block).unwrap() + 24 + 8 * index;
        self.0[at..at + 8].copy_from_slice(&to.to_le_bytes());
    }

    fn text(&mut self, text: &str) -> u64 {
        self.block(b"TX", &[], &[text.as_bytes(), &[0]].concat())
    }

    fn header(&mut self, flags: u8) -> u64 {
        let mut data = START.to_le_bytes().to_vec();
        data.extend([0, 0, 0, 0, flags, 0, 0, 0]);
        data.extend([0; 16]);
        self.block(b"HD", &[0; 6], &data)
    }

    /// Adds a channel of unsigned numbers: name, channel type, axis type, byte, bits.
    fn channel(&mut self, next: u64, channel: (&str, u8, u8, u32, u32), conversion: u64, data: u64) -> u64 {
        let (name, kind, axis, byte, bits) = channel;
        let name = self.text(name);
        let mut bytes = vec![kind, axis, 0, 0];
        bytes.extend([byte, bits, 0, 0].iter().flat_map(|number| number.to_le_bytes()));
        bytes.resize(72, 0);
        self.block(b"CN", &[next, 0, name, 0, conversion, data, 0, 0], &bytes)
    }

    /// Adds the channels of a frame: milliseconds in bytes 0 and 1, channel, identifier, length, and data.
    fn channels(&mut self, kind: &str, is_variable: bool, values: u64) -> u64 {
        let mut conversion = vec![1, 0, 0, 0, 0, 0, 2, 0];
        conversion.extend([0.0, 0.0, 0.0, 1e-3_f64].iter().flat_map(|number| number.to_le_bytes()));
        let conversion = self.block(b"CC", &[0; 4], &conversion);
        let mut next = self.channel(0, ("t", 2, 1, 0, 16), conversion, 0);
        let data = u8::from(is_variable);
        for (name, kind_of, byte, bits) in
            [("BusChannel", 0, 2, 8), ("ID", 0, 3, 16), ("DataLength", 0, 5, 8), ("DataBytes", data, 6, 64)]
        {
            let values = if kind_of == 1 { values } else { 0 };
            next = self.channel(next, (&format!("{kind}.{name}"), kind_of, 0, byte, bits), 0, values);
        }
        next
    }

    fn group(&mut self, next: u64, channels: u64, number: u64, records: u64, size: (u16, u32)) -> u64 {
        let (flags, size) = size;
        let mut data = [number, records].iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<_>>();
        data.extend(flags.to_le_bytes());
        data.extend([0; 6]);
        data.extend(size.to_le_bytes());
        data.extend([0; 4]);
        let name = self.text("a group");
        self.block(b"CG", &[next, channels, name, 0, 0, 0], &data)
    }

    fn data_group(&mut self, next: u64, groups: u64, data: u64, number_size: u8) -> u64 {
        self.block(b"DG", &[next, groups, data, 0], &[number_size, 0, 0, 0, 0, 0, 0, 0])
    }
}

/// A record of 14 bytes: `id` at `millisecond`, with `length` data bytes.
fn record(millisecond: u16, id: u16, length: u8) -> Vec<u8> {
    let mut record = millisecond.to_le_bytes().to_vec();
    record.push(1);
    record.extend(id.to_le_bytes());
    record.extend([length, 1, 2, 3, 4, 5, 6, 7, 8]);
    record
}

/// A capture with one group and one data block.
fn sorted(kind: &str, records: &[Vec<u8>]) -> Vec<u8> {
    let mut file = CaptureFile::new(b"MDF     ", 411, 0);
    let header = file.header(0);
    let channels = file.channels(kind, false, 0);
    let group = file.group(0, channels, 0, records.len() as u64, (0, 14));
    let data = file.block(b"DT", &[], &records.concat());
    let data_group = file.data_group(0, group, data, 0);
    file.link(header, 0, data_group);
    file.0
}

fn ids(capture: &[u8]) -> Vec<u32> {
    read_capture(capture).frames.iter().map(|frame| frame.id.number()).collect()
}

fn notices(capture: &[u8]) -> Vec<String> {
    read_capture(capture).items.into_iter().filter(|item| !item.starts_with('{')).collect()
}

#[test]
fn a_frame_of_a_sorted_group() {
    let capture = sorted("CAN_DataFrame", &[record(1_500, 0x181, 3), record(1_501, 0x900, 8)]);
    let content = read_capture(&capture);
    let [first, second] = content.frames.as_slice() else { panic!("{content:?}") };
    assert_eq!((first.id, first.data()), (CanId::Standard(0x181), &[1, 2, 3][..]));
    assert_eq!(first.time, Some(Timestamp(1_700_000_001_500_000_000)));
    assert_eq!(second.id, CanId::Extended(0x900), "more than 11 bits without an extended flag");
    assert_eq!(content.buses, ["1"]);
    assert_eq!(notices(&capture), [""; 0]);
    assert_eq!(read_in_pieces(&capture, &[1, 100]), content);
}

#[test]
fn remote_frames_have_no_data_and_error_frames_a_class() {
    let remote = read_capture(&sorted("CAN_RemoteFrame", &[record(1, 0x701, 1)]));
    assert_eq!((remote.frames[0].flags, remote.frames[0].length), (FrameFlags::REMOTE, 1));
    let error = read_capture(&sorted("CAN_ErrorFrame", &[record(1, 0x701, 1)]));
    assert_eq!((error.frames[0].flags, error.frames[0].id), (FrameFlags::ERROR, CanId::Extended(0x088)));
    let overload = read_capture(&sorted("CAN_OverloadFrame", &[record(1, 0x701, 1)]));
    assert_eq!(overload.frames[0].data()[2], 0x20);
}

#[test]
fn a_start_without_a_time_zone_is_reported() {
    let mut capture = sorted("CAN_DataFrame", &[record(1, 1, 0)]);
    capture[64 + 24 + 48 + 12] = 1;
    assert_eq!(notices(&capture), [UNKNOWN_ZONE]);
}

#[test]
fn records_without_frames_are_reported_one_by_one() {
    let capture = sorted("CAN_DataFrame", &[record(1, 1, 0), record(2, 2, 9), record(3, 3, 1)]);
    assert_eq!(ids(&capture), [1, 3]);
    let [texts] = notices(&capture).try_into().unwrap();
    assert!(texts.ends_with("record 2 of its group: data of the frame missing"), "{texts}");
}

/// A capture with two groups with separate data: frames at 1, 3, 3 and 2, 3, 0.
fn two_groups() -> Vec<u8> {
    let mut file = CaptureFile::new(b"MDF     ", 410, 0);
    let header = file.header(0);
    let mut next = 0;
    for (first, times) in [(20, [2, 3, 0]), (10, [1, 3, 3])] {
        let channels = file.channels("CAN_DataFrame", false, 0);
        let group = file.group(0, channels, 0, 3, (0, 14));
        let records = times.iter().zip(first..).flat_map(|(time, id)| record(*time, id, 0));
        let data = file.block(b"DT", &[], &records.collect::<Vec<_>>());
        next = file.data_group(next, group, data, 0);
    }
    file.link(header, 0, next);
    file.0
}

#[test]
fn frames_of_several_groups_come_by_time_and_never_before_an_earlier_one_of_theirs() {
    assert_eq!(ids(&two_groups()), [10, 20, 11, 12, 21, 22]);
}

#[test]
fn reading_resumes_from_any_position() {
    let records: Vec<_> = (0..2_000).map(|n| record(n, n % 0x700, 2)).collect();
    let capture = sorted("CAN_DataFrame", &records);
    let whole = ids(&capture);
    let mut reader = CaptureReader::open(&capture[..], &ReadOptions::default()).unwrap();
    let mut batch = Batch::new();
    let mut taken = 0;
    while reader.read(&mut batch).unwrap() {
        taken += batch.frames().len();
        let position = reader.position();
        let rest = &capture[usize::try_from(position.offset).unwrap()..];
        let mut resumed = CaptureReader::resume(rest, &position);
        let (mut found, mut own) = (Vec::new(), Batch::new());
        while resumed.read(&mut own).unwrap() {
            found.extend(own.frames().iter().map(|frame| frame.id.number()));
        }
        assert_eq!(found, whole[taken..], "after {taken} frames");
    }
    assert_eq!(taken, 2_000);
}

/// A capture with a group whose data are in a list of value blocks.
fn with_values(offsets: [u64; 3]) -> Vec<u8> {
    let mut file = CaptureFile::new(b"MDF     ", 410, 0);
    let header = file.header(0);
    let first = file.block(b"SD", &[], &[2, 0, 0, 0, 0xAA, 0xBB, 3, 0]);
    let second = file.block(b"SD", &[], &[0, 0, 1, 2, 3]);
    let list = file.block(b"DL", &[0, first, second], &[0; 24]);
    let channels = file.channels("CAN_DataFrame", true, list);
    let group = file.group(0, channels, 0, 3, (0, 14));
    let mut records = Vec::new();
    for (offset, length) in offsets.iter().zip([2, 2, 3]) {
        let mut record = record(1, 1, length);
        record[6..].copy_from_slice(&offset.to_le_bytes());
        records.extend(record);
    }
    let data = file.block(b"DT", &[], &records);
    let data_group = file.data_group(0, group, data, 0);
    file.link(header, 0, data_group);
    file.0
}

#[test]
fn values_of_variable_length_in_blocks() {
    let content = read_capture(&with_values([0, 0, 6]));
    let data: Vec<&[u8]> = content.frames.iter().map(Frame::data).collect();
    assert_eq!(data, [&[0xAA, 0xBB][..], &[0xAA, 0xBB], &[1, 2, 3]]);
    for wrong in [u64::MAX, 13, 14] {
        assert_eq!(read_capture(&with_values([0, wrong, 6])).frames.len(), 2, "{wrong} is after the end");
    }
    assert_eq!(notices(&with_values([6, 0, 6])).len(), 2, "skipped values");
}

#[test]
fn invalid_and_circular_links_are_reported() {
    let capture = sorted("CAN_DataFrame", &[record(1, 1, 0)]);
    let data_group = capture.len() - 64;
    let with = |index: usize, link: u64| {
        let mut capture = capture.clone();
        capture[data_group + 24 + 8 * index..][..8].copy_from_slice(&link.to_le_bytes());
        capture
    };
    let back = with(0, data_group as u64);
    assert_eq!(ids(&back), [1]);
    assert_eq!(notices(&back), [format!("byte {data_group}: data group block linked twice")]);
    for link in [7, u64::MAX, 1 << 40, 64] {
        assert_eq!(ids(&with(0, link)), [1], "{link}");
        assert_eq!(notices(&with(0, link)).len(), 1, "{link}");
        assert_eq!(ids(&with(2, link)), [] as [u32; 0], "{link}");
        assert!(notices(&with(2, link)).len() >= 2, "{link}: {:?}", notices(&with(2, link)));
    }
    assert!(notices(&with(1, 0))[0].starts_with("no group contains CAN frames"));
}

/// MDF 4.2: an LD block lists DV blocks, which may cut records; with flag bit 31, DI blocks hold the invalidation bytes of
/// the records. `stated` is the number of data blocks in the list.
fn with_list_of_values(flags: u32, stated: u32) -> Vec<u8> {
    let mut file = CaptureFile::new(b"MDF     ", 420, 0);
    let header = file.header(0);
    let channels = file.channels("CAN_DataFrame", false, 0);
    let group = file.group(0, channels, 0, 3, (0, 14));
    // The last four bytes of the group: one invalidation byte for each record.
    let group_at = usize::try_from(group).unwrap();
    file.0[group_at + 24 + 6 * 8 + 28] = u8::from(flags != 0);
    let records = [record(1, 1, 0), record(2, 2, 0), record(3, 3, 0)].concat();
    let first = file.block(b"DV", &[], &records[..20]);
    let second = file.block(b"DV", &[], &records[20..]);
    let validity = file.block(b"DI", &[], &[0; 3]);
    let data: Vec<u8> =
        [flags, stated].iter().flat_map(|number| number.to_le_bytes()).chain([0; 16]).collect();
    let links = if flags == 0 { vec![0, first, second] } else { vec![0, first, second, validity, 0] };
    let list = file.block(b"LD", &links, &data);
    let data_group = file.data_group(0, group, list, 0);
    file.link(header, 0, data_group);
    file.0
}

#[test]
fn lists_of_values_with_and_without_separate_invalidation_bits() {
    for (flags, stated) in [(0, 2), (1 << 31, 2), (0, u32::MAX)] {
        let capture = with_list_of_values(flags, stated);
        assert_eq!(ids(&capture), [1, 2, 3], "{flags} {stated}");
        assert_eq!(notices(&capture), [""; 0], "{flags} {stated}");
    }
    let fewer = with_list_of_values(0, 1);
    assert_eq!(ids(&fewer), [1]);
    assert_eq!(notices(&fewer).len(), 2, "{:?}", notices(&fewer));
}

#[test]
fn column_storage_is_reported() {
    let mut file = CaptureFile::new(b"MDF     ", 420, 0);
    let header = file.header(0);
    let channels = file.channels("CAN_DataFrame", false, 0);
    let group = file.group(0, channels, 0, 1, (8, 14));
    let data = file.block(b"DV", &[], &record(1, 1, 0));
    let data_group = file.data_group(0, group, data, 0);
    file.link(header, 0, data_group);
    let texts = notices(&file.0);
    assert!(texts[0].contains("column storage"), "{texts:?}");
}

#[test]
fn fewer_records_than_stated_and_a_partial_one() {
    let capture = sorted("CAN_DataFrame", &[record(1, 1, 0), record(2, 2, 0)[..9].to_vec()]);
    assert_eq!(ids(&capture), [1]);
    let texts = notices(&capture);
    assert!(texts[0].ends_with("the data end inside a record"), "{texts:?}");
    assert!(texts[1].ends_with("group: found 1 records; expected 2"), "{texts:?}");
}

#[test]
fn an_unfinished_capture_is_read_to_the_end() {
    let mut file = CaptureFile::new(b"UnFinMF ", 411, 5);
    let header = file.header(0);
    let channels = file.channels("CAN_DataFrame", false, 0);
    let group = file.group(0, channels, 0, 0, (0, 14));
    let data_group = file.data_group(0, group, 0, 0);
    file.link(header, 0, data_group);
    let data = file.block(b"DT", &[], &[]);
    file.link(data_group, 2, data);
    file.0.extend((0..5).flat_map(|n| record(n, n, 0)));
    assert_eq!(ids(&file.0), [0, 1, 2, 3, 4]);
    assert_eq!(notices(&file.0), [""; 0]);
}

#[test]
fn older_versions_and_captures_without_a_header_are_refused() {
    let open = |capture: &[u8]| {
        let mut reader = CaptureReader::open(capture, &ReadOptions::default()).unwrap();
        reader.read(&mut Batch::new()).unwrap_err().to_string()
    };
    let old = open(&CaptureFile::new(b"MDF     ", 330, 0).0);
    assert_eq!(
        old,
        "ASAM MDF: byte 28: found version 330; expected 400 or later: convert the capture to MDF 4"
    );
    let empty = open(&CaptureFile::new(b"MDF     ", 411, 0).0);
    assert_eq!(empty, "ASAM MDF: byte 64: found no header; expected an HD block");
}

#[cfg(feature = "gzip")]
mod compressed {
    use std::io::Write as _;

    use super::*;

    /// Three blocks of three records each, the second one transposed; `damaged` has a wrong byte in one of
    /// them.
    fn in_blocks(damaged: Option<usize>) -> Vec<u8> {
        let mut file = CaptureFile::new(b"MDF     ", 410, 0);
        let header = file.header(0);
        let mut links = vec![0];
        for block in 0..3_u16 {
            let mut content: Vec<u8> = (0..3).flat_map(|n| record(block, block * 3 + n, 0)).collect();
            if block == 1 {
                let rows: Vec<&[u8]> = content.chunks(14).collect();
                content = (0..14).flat_map(|column| rows.iter().map(move |row| row[column])).collect();
            }
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(&content).unwrap();
            let mut packed = encoder.finish().unwrap();
            if damaged == Some(usize::from(block)) {
                *packed.last_mut().unwrap() ^= 1;
            }
            let mut data = b"DT".to_vec();
            data.extend([u8::from(block == 1), 0, 14, 0, 0, 0, 42, 0, 0, 0, 0, 0, 0, 0]);
            data.extend((packed.len() as u64).to_le_bytes());
            data.extend(packed);
            links.push(file.block(b"DZ", &[], &data));
        }
        let list = file.block(b"DL", &links, &[0; 32]);
        let lists = file.block(b"HL", &[list], &[0; 8]);
        let channels = file.channels("CAN_DataFrame", false, 0);
        let group = file.group(0, channels, 0, 9, (0, 14));
        let data_group = file.data_group(0, group, lists, 0);
        file.link(header, 0, data_group);
        file.0
    }

    #[test]
    fn lists_of_compressed_blocks() {
        assert_eq!(ids(&in_blocks(None)), (0..9).collect::<Vec<_>>());
        assert_eq!(notices(&in_blocks(None)), [""; 0]);
    }

    #[test]
    fn a_damaged_block_of_columns_is_left_out_and_what_follows_is_read() {
        let capture = in_blocks(Some(1));
        assert_eq!(ids(&capture), [0, 1, 2, 6, 7, 8]);
        let texts = notices(&capture);
        assert!(texts[0].ends_with("compressed block damaged"), "{texts:?}");
        assert!(texts[1].ends_with("group: found 6 records; expected 9"), "{texts:?}");
    }
}
