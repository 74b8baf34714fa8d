//! Writers of captures: frames to bytes.

use std::io::{self, Write};

use super::Notice;
use super::holds::FormatCapabilities;
use crate::frame::Frame;

/// Writes frames in one format. The output is a readable capture after each flush.
pub trait FrameWriter: Send {
    /// Writes a frame of the named bus. Frames that the format cannot store are dropped; [`FormatCapabilities::kept_frame`]
    /// returns the stored part of a frame.
    ///
    /// # Errors
    /// If the output fails.
    fn write(&mut self, frame: &Frame, bus: &str) -> io::Result<()>;

    /// Writes a frame with a comment of one or more lines; drops the comment if the format cannot store it.
    ///
    /// # Errors
    /// If the output fails.
    fn write_commented(&mut self, frame: &Frame, bus: &str, _comment: &str) -> io::Result<()> {
        self.write(frame, bus)
    }

    /// Writes a notice about the named bus; `false` if the format cannot store it.
    ///
    /// # Errors
    /// If the output fails.
    fn notice(&mut self, notice: &Notice, bus: &str) -> io::Result<bool>;

    /// Maximum number of bytes that a flush would add to the output.
    fn pending(&self) -> u64 {
        0
    }

    /// Writes all buffered data.
    ///
    /// # Errors
    /// If the output fails.
    fn flush(&mut self) -> io::Result<()>;

    /// Ends the capture: writes all buffered data and the end of the file.
    ///
    /// # Errors
    /// If the output fails.
    fn finish(&mut self) -> io::Result<()> {
        self.flush()
    }
}

/// Compression of a capture, in formats that support it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CaptureCompression {
    /// Uncompressed.
    None,
    /// LZ4: fast.
    Lz4,
    /// Zstandard: small files.
    #[default]
    Zstd,
}

/// Options of formats that can be written in several ways.
#[derive(Debug, Clone, Copy, Default)]
pub struct WriteOptions {
    /// Compression.
    pub packing: CaptureCompression,
    /// Comment of the whole capture; empty for none. Stored in pcapng, where Wireshark shows it as capture comment.
    pub comment: &'static str,
}

/// A format that can be written.
pub struct WritableFormat {
    /// Short name, as used in options.
    pub name: &'static str,
    /// Usual file name extension.
    pub suffix: &'static str,
    /// Name for display.
    pub title: &'static str,
    /// Data that the format can store.
    pub holds: FormatCapabilities,
    /// Creates a writer at the start of a capture; the output should be buffered.
    pub writer: fn(Box<dyn Write + Send>, &WriteOptions) -> Box<dyn FrameWriter>,
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use proptest::prelude::*;

    use super::*;
    use crate::capture::{Batch, CapturePlace, CaptureReader, LossCounter, ReadOptions, WRITABLE};
    use crate::frame::{BusIndex, CanId, FrameFlags, LinkState, Timestamp, fd_length};

    const START: i64 = 1_700_000_000_000_000_000;

    #[derive(Clone, Default)]
    struct Shared(Arc<Mutex<Vec<u8>>>);

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// A frame, its bus name, and a comment.
    type WriterInput = (Frame, String, Option<String>);

    fn error(class: u32, bytes: [u8; 8]) -> Frame {
        Frame { flags: FrameFlags::ERROR, ..Frame::data_frame(CanId::from_extended(class), &bytes) }
    }

    fn data_frames() -> Vec<Frame> {
        let standard = Frame::data_frame(CanId::from_standard(0x185), &[1, 2, 3]);
        let with = |flags: FrameFlags, frame| Frame { flags, ..frame };
        let mut all = vec![
            standard,
            Frame::data_frame(CanId::from_extended(0x18FE_CA80), &[0xFF; 8]),
            Frame::data_frame(CanId::from_standard(0x7FF), &[]),
            Frame::data_frame(CanId::from_extended(0), &[0]),
            with(FrameFlags::TRANSMITTED, standard),
            with(FrameFlags::RECEIVED, standard),
        ];
        for length in [0, 1, 8] {
            let id = if length == 1 { CanId::from_extended(5) } else { CanId::from_standard(0x705) };
            all.push(Frame { id, flags: FrameFlags::REMOTE, length, ..Frame::EMPTY });
        }
        for raw_dlc in 9..=15 {
            all.push(Frame { raw_dlc, ..Frame::data_frame(CanId::from_standard(1), &[7; 8]) });
        }
        all.push(Frame { raw_dlc: 9, flags: FrameFlags::REMOTE, length: 8, ..Frame::EMPTY });
        for (dlc, flags) in (0..=15).zip(
            [
                FrameFlags(0),
                FrameFlags::BIT_RATE_SWITCH,
                FrameFlags::ERROR_STATE,
                FrameFlags::BIT_RATE_SWITCH.with(FrameFlags::ERROR_STATE).with(FrameFlags::TRANSMITTED),
            ]
            .into_iter()
            .cycle(),
        ) {
            let payload = vec![0xA0 + dlc; fd_length(dlc).into()];
            let frame = Frame::data_frame(CanId::from_extended(5), &payload);
            all.push(with(FrameFlags::FD.with(flags), frame));
        }
        all
    }

    fn error_frames() -> Vec<Frame> {
        vec![
            error(0x020, [0, 0, 0, 0, 0, 0, 0, 5]),
            error(0x088, [0; 8]),
            error(0x28C, [0, 0x10, 0x84, 2, 0, 0, 130, 9]),
            error(0x2A8, [0, 0, 0x80, 0x19, 0, 0, 8, 8]),
            error(0x088, [0, 0, 1, 0x0A, 0, 0, 0, 0]),
            error(0x008, [0, 0, 0x20, 0, 0, 0, 0, 0]),
            error(0x004, [0, 0x0C, 0, 0, 0, 0, 0, 0]),
            error(0x004, [0, 0x30, 0, 0, 0, 0, 0, 0]),
            error(0x004, [0, 1, 0, 0, 0, 0, 0, 0]),
            error(0x040, [0; 8]),
            error(0x100, [0; 8]),
            error(0x200, [0, 0, 0, 0, 0, 0, 1, 2]),
            error(0x001, [0; 8]),
            error(0x002, [7, 0, 0, 0, 0, 0, 0, 0]),
            Frame { flags: FrameFlags::ERROR.with(FrameFlags::RECEIVED), ..error(0x088, [0; 8]) },
        ]
    }

    /// One frame of each type, on two buses.
    fn frames() -> Vec<WriterInput> {
        let mut all: Vec<WriterInput> = Vec::new();
        for (number, frame) in (1_u32..).zip(data_frames().into_iter().chain(error_frames())) {
            let bus = usize::from(number % 3 == 2);
            let time = Some(Timestamp(START + i64::from(number) * 1_001));
            all.push((Frame { time, ..frame }, ["can0", "can1"][bus].into(), None));
        }
        all
    }

    /// Assigns frame numbers and bus indices in order of appearance.
    fn number(mut frames: Vec<WriterInput>) -> Vec<WriterInput> {
        let mut names: Vec<String> = Vec::new();
        for (number, (frame, bus, _)) in (1..).zip(&mut frames) {
            let known = names.iter().position(|name| name == bus);
            let index = known.unwrap_or(names.len());
            if known.is_none() {
                names.push(bus.clone());
            }
            frame.number = number;
            frame.bus = BusIndex(u8::try_from(index).unwrap());
        }
        frames
    }

    /// The frames as they are read back, according to the format's `FormatCapabilities`.
    fn expected(holds: &FormatCapabilities, frames: &[WriterInput]) -> Vec<Frame> {
        let (mut first, mut last) = (None, None);
        let mut kept = Vec::new();
        for (frame, _, _) in frames {
            let Some(found) = holds.kept_frame(frame) else { continue };
            let time = match found.time {
                None if holds.untimed => None,
                None => Some(last.unwrap_or_default()),
                Some(time) => {
                    let first = *first.get_or_insert(time);
                    last = Some(if holds.backwards { time } else { time.max(first) });
                    last
                }
            };
            kept.push(Frame { time, number: 1 + kept.len() as u64, ..found });
        }
        kept
    }

    fn written(format: &WritableFormat, frames: &[WriterInput]) -> (Vec<u8>, Vec<u8>) {
        let output = Shared::default();
        let mut writer = (format.writer)(Box::new(output.clone()), &WriteOptions::default());
        for (frame, bus, comment) in frames {
            match comment {
                Some(comment) => writer.write_commented(frame, bus, comment).unwrap(),
                None => writer.write(frame, bus).unwrap(),
            }
        }
        writer.flush().unwrap();
        let flushed = output.0.lock().unwrap().clone();
        writer.finish().unwrap();
        let finished = output.0.lock().unwrap().clone();
        (flushed, finished)
    }

    /// Format, frames, notices, and bus names.
    type ReadCapture = (&'static str, Vec<Frame>, Vec<Notice>, Vec<String>);

    fn read(bytes: &[u8]) -> ReadCapture {
        let mut reader = CaptureReader::open(bytes, &ReadOptions::default()).unwrap();
        let (mut batch, mut frames, mut notices) = (Batch::new(), Vec::new(), Vec::new());
        while reader.read(&mut batch).unwrap() {
            frames.extend_from_slice(batch.frames());
            notices.extend(batch.notices().iter().map(|(_, notice)| notice.clone()));
        }
        (reader.format().name, frames, notices, reader.buses().names().to_vec())
    }

    /// Checks that frames are read back as the format's `FormatCapabilities` states, and that losses are counted.
    fn comes_back(format: &WritableFormat, frames: &[WriterInput]) -> Result<(), TestCaseError> {
        let (flushed, finished) = written(format, frames);
        let expected = expected(&format.holds, frames);
        for bytes in [flushed, finished] {
            let (name, frames, notices, _) = read(&bytes);
            prop_assert_eq!(name, format.name);
            let unreadable = notices.iter().find(|notice| matches!(notice, Notice::Unreadable { .. }));
            prop_assert_eq!(unreadable, None, "{}", format.name);
            prop_assert_eq!(&frames, &expected, "{}", format.name);
        }
        let mut losses = LossCounter::new(format.holds);
        for (frame, _, _) in frames {
            losses.count_frame(frame);
        }
        let given: Vec<Frame> = frames.iter().map(|(frame, _, _)| *frame).collect();
        let mut texts = losses.loss_texts();
        // Counters of 0 are read back as unknown.
        texts.retain(|text| !text.ends_with("with unknown error counters, written as 0"));
        prop_assert_eq!(texts.is_empty(), given == expected, "{}: {:?}", format.name, texts);
        Ok(())
    }

    #[test]
    fn what_else_the_recorder_knew_is_kept_where_there_is_a_place_for_it() {
        let time = |offset: i64| Timestamp(START + offset);
        let lost =
            |count| Notice::LostFrames { place: CapturePlace::Now, bus: BusIndex(1), count: Some(count) };
        let link = |state, bit_rate| Notice::Link { bus: BusIndex(1), time: time(7), state, bit_rate };
        let notices = [
            lost(3),
            lost(4),
            link(LinkState::Down, None),
            link(LinkState::Up, Some(250_000)),
            Notice::Quiet(time(9)),
        ];
        for format in WRITABLE {
            let output = Shared::default();
            let mut writer = (format.writer)(Box::new(output.clone()), &WriteOptions::default());
            for (frame, bus, _) in frames().into_iter().take(2) {
                writer.write(&frame, &bus).unwrap();
            }
            let kept: Vec<bool> =
                notices.iter().map(|notice| writer.notice(notice, "can1").unwrap()).collect();
            writer.finish().unwrap();
            let bytes = output.0.lock().unwrap().clone();
            let (_, _, mut read, _) = read(&bytes);
            // The assumption that times are UTC was not written.
            read.retain(|notice| !matches!(notice, Notice::Assumption(_)));
            for notice in &mut read {
                if let Notice::LostFrames { place, .. } = notice {
                    *place = CapturePlace::Now;
                }
            }
            let expected: Vec<_> = notices
                .iter()
                .zip(&kept)
                .filter(|(_, kept)| **kept)
                .map(|(notice, _)| notice.clone())
                .collect();
            assert_eq!(read, expected, "{}", format.name);
            assert_eq!(kept, [format.holds.notices; 5], "{}", format.name);
        }
    }

    #[test]
    fn what_is_written_is_read_again() {
        for format in WRITABLE {
            let frames = number(frames());
            comes_back(format, &frames).unwrap();
            let (_, finished) = written(format, &frames);
            assert_eq!(read(&finished).3, ["can0", "can1"], "{}", format.name);
        }
    }

    #[test]
    fn each_frame_alone_comes_back_and_tells_what_it_lost() {
        for format in WRITABLE {
            for (frame, bus, _) in frames() {
                let whole = Frame { time: Some(Timestamp(START)), ..frame };
                for frame in [whole, Frame { time: Some(Timestamp(START + 1)), ..frame }] {
                    comes_back(format, &number(vec![(frame, bus.clone(), None)])).unwrap();
                }
            }
        }
    }

    #[test]
    fn times_step_back_and_are_missing() {
        let at = |offset: Option<i64>| {
            let frame = Frame::data_frame(CanId::from_standard(0x701), &[5]);
            let time = offset.map(|offset| Timestamp(START + 5_000_000_000 + offset));
            (Frame { time, flags: FrameFlags::RECEIVED, ..frame }, "can0".to_owned(), None)
        };
        for format in WRITABLE {
            for offsets in [
                &[Some(1_000), Some(-5_000_000), Some(0), Some(2_000)][..],
                &[Some(0), None, Some(7_000), None, Some(3_000), None],
                &[None, None, Some(1_000), Some(500)],
                &[Some(0), Some(86_400_000_000_000 * 400)],
            ] {
                let frames = offsets.iter().map(|offset| at(*offset)).collect();
                comes_back(format, &number(frames)).unwrap();
            }
        }
    }

    #[test]
    fn odd_names_of_buses_are_buses() {
        let frame = Frame { time: Some(Timestamp(START)), ..Frame::EMPTY };
        for format in WRITABLE {
            for name in [
                "",
                " ",
                "(1.0)",
                "#",
                ";x",
                "*",
                "can 0",
                "=1+1",
                "a,b\"c",
                "\x1b[2J",
                "1,",
                "1.5",
                "12:30:01.5",
                "Rx",
                "\n1.0 1 123 Rx d 0\n",
            ] {
                for frame in [frame, Frame { time: None, ..frame }] {
                    comes_back(format, &[(Frame { number: 1, ..frame }, name.to_owned(), None)]).unwrap();
                }
            }
        }
    }

    fn a_frame() -> impl Strategy<Value = Frame> {
        let id = prop_oneof![
            (0..0x800_u16).prop_map(CanId::from_standard),
            (0..0x2000_0000_u32).prop_map(CanId::from_extended)
        ];
        let direction =
            prop::sample::select(vec![FrameFlags(0), FrameFlags::RECEIVED, FrameFlags::TRANSMITTED]);
        let payload = any::<[u8; 32]>().prop_map(|half| [half, half].concat());
        (id, direction, payload, 0..6_u8, 0..=15_u8, 0..4_u8).prop_map(
            |(id, direction, payload, kind, dlc, bits)| {
                let length = if kind == 2 { fd_length(dlc) } else { dlc.min(8) };
                let frame = Frame::data_frame(id, &payload[..length.into()]);
                let raw_dlc = if dlc > 8 { dlc } else { 0 };
                let mut frame = match kind {
                    1 => Frame { flags: FrameFlags::REMOTE, raw_dlc, ..frame },
                    2 => {
                        let flags = [FrameFlags(0), FrameFlags::BIT_RATE_SWITCH, FrameFlags::ERROR_STATE];
                        let both = flags[1].with(flags[2]);
                        let flags = flags.get(usize::from(bits)).copied().unwrap_or(both);
                        Frame { flags: FrameFlags::FD.with(flags), ..frame }
                    }
                    3 => {
                        let class = CanId::from_extended(id.number() & 0x3FF);
                        Frame { id: class, flags: FrameFlags::ERROR, ..frame }
                    }
                    _ => Frame { raw_dlc, ..frame },
                };
                frame.flags = frame.flags.with(direction);
                frame
            },
        )
    }

    fn a_text() -> impl Strategy<Value = String> {
        let odd = prop::sample::select(vec![
            "",
            "=",
            "\n",
            "\r",
            "\0",
            ";",
            "//",
            "\"",
            ",",
            "(",
            ")",
            "#",
            " ",
            "\u{202e}",
            "$COLUMNS=N",
            "é",
            "Checksum Type",
            "Begin Triggerblock",
            "1.0 1 123 Rx d 0",
        ]);
        let part = prop_oneof![odd.prop_map(str::to_owned), any::<char>().prop_map(String::from)];
        prop::collection::vec(part, 0..12).prop_map(|parts| parts.concat())
    }

    fn a_recording() -> impl Strategy<Value = Vec<WriterInput>> {
        let time = prop_oneof![
            1 => Just(None),
            4 => (0..4_000_000_000_i64).prop_map(|offset| Some(Timestamp(START + offset))),
            4 => (0..4_000_000_i64).prop_map(|offset| Some(Timestamp(START + offset * 1_000))),
        ];
        let one = (a_frame(), time, 0..3_usize, prop::option::weighted(0.2, a_text()));
        let names = prop::collection::vec(a_text(), 3);
        (prop::collection::vec(one, 1..30), names).prop_map(|(frames, names)| {
            let given = frames.into_iter().map(|(frame, time, bus, comment)| {
                (Frame { time, ..frame }, format!("{bus}{}", names[bus]), comment)
            });
            number(given.collect())
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn any_frames_come_back(frames in a_recording()) {
            for format in WRITABLE {
                comes_back(format, &frames)?;
            }
        }

        /// Values that no reader emits; the result is not compared.
        #[test]
        fn any_numbers_are_written(
            times in prop::collection::vec(any::<Option<i64>>(), 1..8),
            flags in any::<u8>(),
            length in any::<u8>(),
            raw_dlc in any::<u8>(),
            bus in a_text(),
        ) {
            for format in WRITABLE {
                let frames = times.iter().map(|time| {
                    let (flags, time) = (FrameFlags(flags), time.map(Timestamp));
                    (Frame { time, flags, length, raw_dlc, ..Frame::EMPTY }, bus.clone(), None)
                });
                let (_, bytes) = written(format, &frames.collect::<Vec<_>>());
                prop_assert!(!bytes.is_empty());
            }
        }
    }
}
