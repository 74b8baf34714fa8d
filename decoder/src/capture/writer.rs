//! Frames to bytes of a capture.

use std::io::{self, Write};

use super::Notice;
use super::holds::Holds;
use crate::frame::Frame;

/// Writes frames in one format. What it wrote is a readable capture after each frame that was flushed.
pub trait FrameWriter: Send {
    /// Writes a frame of the bus of this name. A frame for which the format has no place at all is left out; what of it
    /// the format keeps is told by [`Holds::kept`].
    ///
    /// # Errors
    /// When the output fails.
    fn write(&mut self, frame: &Frame, bus: &str) -> io::Result<()>;

    /// Writes a frame with a text of lines that belongs to it; without the text where the format has no place for it.
    ///
    /// # Errors
    /// When the output fails.
    fn write_commented(&mut self, frame: &Frame, bus: &str, _comment: &str) -> io::Result<()> {
        self.write(frame, bus)
    }

    /// Writes what else the recorder knows of the bus of this name; `false` where the format has no place for it.
    ///
    /// # Errors
    /// When the output fails.
    fn notice(&mut self, notice: &Notice, bus: &str) -> io::Result<bool>;

    /// Bytes the output may get at most for what is held back, besides what it got already.
    fn pending(&self) -> u64 {
        0
    }

    /// Writes what is held back so far.
    ///
    /// # Errors
    /// When the output fails.
    fn flush(&mut self) -> io::Result<()>;

    /// Nothing follows: writes what is still held back.
    ///
    /// # Errors
    /// When the output fails.
    fn finish(&mut self) -> io::Result<()> {
        self.flush()
    }
}

/// How a capture is packed, in formats that pack what they hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Packing {
    /// Not at all.
    None,
    /// LZ4: quick.
    Lz4,
    /// Zstandard: small.
    #[default]
    Zstd,
}

/// How a capture is written, where its format leaves that open.
#[derive(Debug, Clone, Copy, Default)]
pub struct WriteOptions {
    /// How it is packed.
    pub packing: Packing,
}

/// One format that can be written.
pub struct WritableFormat {
    /// Short name, as options take it.
    pub name: &'static str,
    /// Usual end of a file's name.
    pub suffix: &'static str,
    /// What people call it.
    pub title: &'static str,
    /// What it has a place for.
    pub holds: Holds,
    /// A writer at the start of a capture; the output should be buffered.
    pub writer: fn(Box<dyn Write + Send>, &WriteOptions) -> Box<dyn FrameWriter>,
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::capture::{Batch, Place, ReadOptions, Reader, WRITABLE};
    use crate::frame::{BusIndex, CanId, FrameFlags, LinkState, Timestamp};

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

    /// A frame of each sort, on two buses.
    fn frames() -> Vec<(Frame, &'static str)> {
        let standard = Frame::data_frame(CanId::standard(0x185), &[1, 2, 3]);
        let mut all = vec![
            (standard, "can0"),
            (Frame::data_frame(CanId::extended(0x18FE_CA80), &[0xFF; 8]), "can1"),
            (
                Frame {
                    flags: FrameFlags::REMOTE,
                    length: 1,
                    ..Frame::data_frame(CanId::standard(0x705), &[])
                },
                "can0",
            ),
            (
                Frame {
                    flags: FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH),
                    ..Frame::data_frame(CanId::extended(5), &[9; 64])
                },
                "can0",
            ),
            (
                Frame {
                    flags: FrameFlags::ERROR,
                    ..Frame::data_frame(CanId::extended(0x20), &[0, 0, 0, 0, 0, 0, 0, 5])
                },
                "can1",
            ),
            (Frame { raw_dlc: 15, ..Frame::data_frame(CanId::standard(1), &[7; 8]) }, "can0"),
            (Frame { flags: FrameFlags::TRANSMITTED, ..standard }, "can0"),
            (Frame { flags: FrameFlags::RECEIVED, ..standard }, "can0"),
        ];
        for (number, (frame, bus)) in (1_u8..).zip(&mut all) {
            frame.number = number.into();
            frame.time = Some(Timestamp(1_700_000_000_000_000_000 + i64::from(number) * 1_001));
            frame.bus = BusIndex(u8::from(*bus == "can1"));
        }
        all
    }

    #[test]
    fn what_else_the_recorder_knew_is_kept_where_there_is_a_place_for_it() {
        let time = |offset: i64| Timestamp(1_700_000_000_000_000_000 + offset);
        let lost = |count| Notice::LostFrames { place: Place::Now, bus: BusIndex(1), count: Some(count) };
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
            for (frame, bus) in frames().into_iter().take(2) {
                writer.write(&frame, bus).unwrap();
            }
            let kept: Vec<bool> =
                notices.iter().map(|notice| writer.notice(notice, "can1").unwrap()).collect();
            writer.finish().unwrap();
            let bytes = output.0.lock().unwrap().clone();
            let mut reader = Reader::open(&bytes[..], &ReadOptions::default()).unwrap();
            let (mut batch, mut read) = (Batch::new(), Vec::new());
            while reader.read(&mut batch).unwrap() {
                read.extend(batch.notices().iter().map(|(_, notice)| match notice.clone() {
                    Notice::LostFrames { bus, count, .. } => {
                        Notice::LostFrames { place: Place::Now, bus, count }
                    }
                    other => other,
                }));
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
            let output = Shared::default();
            let mut writer = (format.writer)(Box::new(output.clone()), &WriteOptions::default());
            for (frame, bus) in frames() {
                writer.write(&frame, bus).unwrap();
            }
            writer.finish().unwrap();
            let bytes = output.0.lock().unwrap().clone();
            let mut reader = Reader::open(&bytes[..], &ReadOptions::default()).unwrap();
            assert_eq!(reader.format().name, format.name);
            let mut batch = Batch::new();
            let mut read = Vec::new();
            while reader.read(&mut batch).unwrap() {
                assert!(batch.notices().is_empty(), "{}: {:?}", format.name, batch.notices());
                read.extend_from_slice(batch.frames());
            }
            let written = frames().into_iter().filter_map(|(frame, _)| format.holds.kept(&frame));
            let written: Vec<Frame> =
                (1..).zip(written).map(|(number, frame)| Frame { number, ..frame }).collect();
            assert_eq!(read, written, "{}", format.name);
            if format.holds.bus_names {
                assert_eq!(reader.buses().names(), ["can0", "can1"], "{}", format.name);
            }
        }
    }
}
