//! A part of the captures as a pcapng file, written in steps.

use cobscope_decoder::capture::{
    Batch, BatchItem, FrameWriter, MergedReader, Notice, WRITABLE, WriteOptions,
};

use crate::export::OutputBuffer;
use crate::files::ContentSource;

/// Format of the file.
const FORMAT: &str = "pcapng";

/// Frames and notices of a part of the captures.
pub struct CutJob {
    reader: MergedReader<ContentSource>,
    batch: Batch,
    writer: Box<dyn FrameWriter>,
    buffer: OutputBuffer,
    frames: (u64, u64),
    read: u64,
}

impl CutJob {
    /// Starts to write the frames from the first to the last one of `frames`.
    ///
    /// # Errors
    /// If the format cannot be written.
    pub fn new(reader: MergedReader<ContentSource>, frames: (u64, u64)) -> Result<Self, String> {
        let format = WRITABLE.iter().find(|format| format.name == FORMAT);
        let format = format.ok_or_else(|| format!("{FORMAT}: cannot be written"))?;
        let buffer = OutputBuffer::default();
        let writer = (format.writer)(Box::new(buffer.clone()), &WriteOptions::default());
        Ok(Self { reader, batch: Batch::new(), writer, buffer, frames, read: 0 })
    }

    /// Frames read so far.
    pub fn frames(&self) -> u64 {
        self.read
    }

    /// Reads up to about `frames` more frames; `false` at the end.
    ///
    /// # Errors
    /// If the output cannot be written.
    pub fn step(&mut self, frames: u64) -> Result<bool, String> {
        let limit = self.read.saturating_add(frames);
        while self.read < limit {
            // An error that ends the capture is in the overview.
            let is_read = matches!(self.reader.read(&mut self.batch), Ok(true));
            self.write().map_err(|error| error.to_string())?;
            if !is_read || self.read >= self.frames.1 {
                self.writer.finish().map_err(|error| error.to_string())?;
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn write(&mut self) -> std::io::Result<()> {
        let (first, last) = self.frames;
        let names = self.reader.buses().names();
        let name = |bus: u8| names.get(usize::from(bus)).map_or("", String::as_str);
        for item in self.batch.items() {
            match item {
                BatchItem::Frame(frame) => {
                    self.read = frame.number;
                    if (first..=last).contains(&frame.number) {
                        self.writer.write(frame, name(frame.bus.0))?;
                    }
                }
                BatchItem::Notice(notice) => {
                    let (Notice::LostFrames { bus, .. } | Notice::Link { bus, .. }) = notice else {
                        continue;
                    };
                    if (first..=last).contains(&self.read.saturating_add(1)) {
                        self.writer.notice(notice, name(bus.0))?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Bytes written since the last call.
    pub fn bytes(&self) -> Vec<u8> {
        self.buffer.take()
    }
}
