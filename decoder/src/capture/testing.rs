//! Helpers to read captures built by tests.

use std::io::Read;

use super::{Batch, Item, ReadOptions, Reader};
use crate::frame::Frame;

/// Content read from a capture.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Content {
    pub(super) frames: Vec<Frame>,
    /// Frames and notices in order, as text.
    pub(super) items: Vec<String>,
    pub(super) buses: Vec<String>,
}

/// Reads a complete capture.
pub(super) fn read(capture: &[u8]) -> Content {
    read_from(capture)
}

/// Reads a complete capture that arrives in pieces of these sizes, repeated in turn.
pub(super) fn read_in_pieces(capture: &[u8], sizes: &[usize]) -> Content {
    read_from(Pieces { rest: capture, sizes, turn: 0 })
}

fn read_from(source: impl Read) -> Content {
    let mut reader = Reader::open(source, &ReadOptions::default()).unwrap();
    let (mut batch, mut content) = (Batch::new(), Content::default());
    while reader.read(&mut batch).unwrap() {
        content.frames.extend(batch.frames());
        content.items.extend(batch.items().map(|item| match item {
            Item::Frame(frame) => format!("{frame:?}"),
            Item::Notice(notice) => notice.to_string(),
        }));
    }
    content.buses = reader.buses().names().to_vec();
    content
}

struct Pieces<'a> {
    rest: &'a [u8],
    sizes: &'a [usize],
    turn: usize,
}

impl Read for Pieces<'_> {
    fn read(&mut self, room: &mut [u8]) -> std::io::Result<usize> {
        let size = self.sizes[self.turn % self.sizes.len()].clamp(1, room.len().max(1));
        self.turn += 1;
        let end = size.min(self.rest.len()).min(room.len());
        room[..end].copy_from_slice(&self.rest[..end]);
        self.rest = &self.rest[end..];
        Ok(end)
    }
}
