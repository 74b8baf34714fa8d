//! Helpers to read captures built by tests.

use std::io::Read;

use super::{Batch, BatchItem, CaptureReader, ReadOptions};
use crate::frame::Frame;

/// Content read from a capture.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct ParsedCapture {
    pub(super) frames: Vec<Frame>,
    /// Frames and notices in order, as text.
    pub(super) items: Vec<String>,
    pub(super) buses: Vec<String>,
}

/// Reads a complete capture.
pub(super) fn read_capture(capture: &[u8]) -> ParsedCapture {
    read_from(capture)
}

/// Reads a complete capture that arrives in pieces of these sizes, repeated in turn.
pub(super) fn read_in_pieces(capture: &[u8], sizes: &[usize]) -> ParsedCapture {
    read_from(ChunkedSource { rest: capture, sizes, turn: 0 })
}

fn read_from(source: impl Read) -> ParsedCapture {
    let mut reader = CaptureReader::open(source, &ReadOptions::default()).unwrap();
    let (mut batch, mut content) = (Batch::new(), ParsedCapture::default());
    while reader.read(&mut batch).unwrap() {
        content.frames.extend(batch.frames());
        content.items.extend(batch.items().map(|item| match item {
            BatchItem::Frame(frame) => format!("{frame:?}"),
            BatchItem::Notice(notice) => notice.to_string(),
        }));
    }
    content.buses = reader.buses().names().to_vec();
    content
}

struct ChunkedSource<'a> {
    rest: &'a [u8],
    sizes: &'a [usize],
    turn: usize,
}

impl Read for ChunkedSource<'_> {
    fn read(&mut self, room: &mut [u8]) -> std::io::Result<usize> {
        let size = self.sizes[self.turn % self.sizes.len()].clamp(1, room.len().max(1));
        self.turn += 1;
        let end = size.min(self.rest.len()).min(room.len());
        room[..end].copy_from_slice(&self.rest[..end]);
        self.rest = &self.rest[end..];
        Ok(end)
    }
}
