//! Files of the user: read in slices, never stored.

use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;

/// Access to the content of files by number.
pub trait ContentAccess: Send + Sync {
    /// Reads bytes from `offset` into `room`; returns their number, 0 at the end.
    ///
    /// # Errors
    /// If the file can no longer be read.
    fn read(&self, file: u32, offset: u64, room: &mut [u8]) -> io::Result<usize>;
}

/// Size of the blocks of a decompressed capture.
pub const BLOCK: usize = 1 << 20;

/// A decompressed capture in blocks of [`BLOCK`] bytes; only the last one may be shorter.
pub type Blocks = Vec<Box<[u8]>>;

/// Content of a capture: a file, or its decompressed content in memory.
#[derive(Clone)]
pub enum StoredContent {
    /// An uncompressed file.
    File(Arc<dyn ContentAccess>, u32),
    /// A decompressed file, and the error that ended decompression early.
    Memory(Arc<Blocks>, Option<Arc<str>>),
}

/// Reader of a capture.
#[derive(Clone)]
pub struct ContentSource {
    content: StoredContent,
    offset: u64,
}

impl ContentSource {
    /// Reads from `offset`.
    pub fn new(content: StoredContent, offset: u64) -> Self {
        Self { content, offset }
    }
}

impl Read for ContentSource {
    fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
        let count = match &self.content {
            StoredContent::File(files, file) => files.read(*file, self.offset, room)?.min(room.len()),
            StoredContent::Memory(blocks, failure) => {
                let place = usize::try_from(self.offset).unwrap_or(usize::MAX);
                let block = blocks.get(place / BLOCK).map(|block| &**block).unwrap_or_default();
                let rest = block.get(place % BLOCK..).unwrap_or_default();
                if let Some(failure) = failure.as_ref().filter(|_| rest.is_empty()) {
                    return Err(io::Error::new(io::ErrorKind::UnexpectedEof, failure.to_string()));
                }
                let count = rest.len().min(room.len());
                let (from, to) = (rest.get(..count), room.get_mut(..count));
                if let (Some(from), Some(to)) = (from, to) {
                    to.copy_from_slice(from);
                }
                count
            }
        };
        self.offset = self.offset.saturating_add(count as u64);
        Ok(count)
    }
}

impl Seek for ContentSource {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let offset = match to {
            SeekFrom::Start(offset) => Some(offset),
            SeekFrom::Current(distance) => self.offset.checked_add_signed(distance),
            SeekFrom::End(_) => None,
        };
        self.offset = offset.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.offset)
    }
}

/// Files in memory, for tests.
pub struct MemoryFiles(pub Vec<Vec<u8>>);

impl ContentAccess for MemoryFiles {
    fn read(&self, file: u32, offset: u64, room: &mut [u8]) -> io::Result<usize> {
        let bytes = usize::try_from(file).ok().and_then(|file| self.0.get(file));
        let bytes = bytes.ok_or(io::ErrorKind::NotFound)?;
        let rest = usize::try_from(offset).ok().and_then(|offset| bytes.get(offset..));
        rest.unwrap_or_default().read(room)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_read_as_one_content() {
        let blocks: Blocks = vec![vec![1; BLOCK].into(), vec![2; 3].into()];
        let mut bytes = Vec::new();
        let place = BLOCK as u64 - 2;
        ContentSource::new(StoredContent::Memory(Arc::new(blocks), None), place)
            .read_to_end(&mut bytes)
            .unwrap();
        assert_eq!(bytes, [1, 1, 2, 2, 2]);
    }

    #[test]
    fn a_position_after_the_end_is_the_end() {
        let files = Arc::new(MemoryFiles(vec![b"abc".to_vec()]));
        let mut source = ContentSource::new(StoredContent::File(files, 0), 0);
        assert_eq!(source.seek(SeekFrom::Start(9)).unwrap(), 9);
        assert_eq!(source.read(&mut [0; 4]).unwrap(), 0);
    }
}
