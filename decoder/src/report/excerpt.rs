//! The cut-out capture: frames around the claims, with comments.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

use crate::capture::{WRITABLE, WriteOptions};
use crate::frame::{BusIndex, Frame};

/// Maximum number of frames in a cut-out capture.
pub(super) const MOST_FRAMES: usize = 100_000;

/// Name of the format in [`WRITABLE`].
const FORMAT: &str = "pcapng";

/// Comment of each cut-out capture.
pub const COMMENT: &str = "cut out by cobscope report: the frames of its claims";

/// Frames around the claims, with comments at those that the claims cite.
#[derive(Debug, Clone, Default)]
pub struct CommentedExcerpt {
    pub(super) frames: Vec<Frame>,
    /// Bus names by index.
    pub(super) buses: Vec<String>,
    /// Comments by the number of the frame.
    pub(super) comments: BTreeMap<u64, String>,
    /// More frames are in the windows than stored here.
    pub(super) is_cut: bool,
}

impl CommentedExcerpt {
    /// Number of frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Number of the first frame in the capture.
    pub fn first_frame(&self) -> Option<u64> {
        self.frames.first().map(|frame| frame.number)
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Whether frames of the windows are missing, because there are too many.
    pub fn is_cut(&self) -> bool {
        self.is_cut
    }

    /// Adds a frame of the bus `name`.
    pub(super) fn add_frame(&mut self, frame: &Frame, name: &str) {
        if self.frames.len() >= MOST_FRAMES {
            self.is_cut = true;
            return;
        }
        let BusIndex(bus) = frame.bus;
        if self.buses.len() <= usize::from(bus) {
            self.buses.resize(usize::from(bus) + 1, String::new());
        }
        if let Some(known) = self.buses.get_mut(usize::from(bus)).filter(|known| known.is_empty()) {
            name.clone_into(known);
        }
        self.frames.push(*frame);
    }

    /// The frames as pcapng with comments.
    ///
    /// # Errors
    /// If a frame cannot be written.
    pub fn to_pcapng(&self) -> io::Result<Vec<u8>> {
        let format = WRITABLE.iter().find(|format| format.name == FORMAT);
        let format = format.ok_or_else(|| io::Error::other("pcapng is not a writable format"))?;
        let bytes = SharedBytes::default();
        let options = WriteOptions { comment: COMMENT, ..WriteOptions::default() };
        let mut writer = (format.writer)(Box::new(bytes.clone()), &options);
        for frame in &self.frames {
            let bus = self.buses.get(usize::from(frame.bus.0)).map_or("", String::as_str);
            match self.comments.get(&frame.number) {
                Some(comment) => writer.write_commented(frame, bus, comment)?,
                None => writer.write(frame, bus)?,
            }
        }
        writer.finish()?;
        drop(writer);
        Ok(bytes.take_bytes())
    }
}

/// Bytes of a writer, which must own its output.
#[derive(Clone, Default)]
struct SharedBytes(Arc<Mutex<Vec<u8>>>);

impl SharedBytes {
    fn take_bytes(&self) -> Vec<u8> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for SharedBytes {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
