//! Decompresses a capture into memory, in bounded steps.

use std::io::{BufReader, Read};
use std::sync::Arc;

use cobscope_decoder::capture::{CaptureReader, ReadOptions, decompress, is_compressed};

use crate::files::{BLOCK, Blocks, ContentAccess, ContentSource, StoredContent};

/// Maximum size of a decompressed capture: WebAssembly has 4 GiB for everything.
pub const MOST_UNPACKED: u64 = 2 << 30;

/// A compressed capture while it is read.
pub struct UnpackJob {
    reader: Box<dyn Read + Send>,
    blocks: Blocks,
    /// Bytes of an incomplete block.
    partial: Vec<u8>,
}

/// Whether a file is compressed.
///
/// # Errors
/// If it cannot be read.
pub fn is_packed(files: &dyn ContentAccess, file: u32) -> Result<bool, String> {
    let mut head = [0; 4];
    let count = files.read(file, 0, &mut head).map_err(|error| error.to_string())?;
    Ok(is_compressed(head.get(..count).unwrap_or_default()))
}

impl UnpackJob {
    /// Opens a compressed capture. Its start must have a known format, so that other content is refused
    /// before it fills the memory.
    ///
    /// # Errors
    /// If the compression or the content is not supported.
    pub fn new(files: &Arc<dyn ContentAccess>, file: u32, options: &ReadOptions) -> Result<Self, String> {
        let open = || {
            let source = ContentSource::new(StoredContent::File(Arc::clone(files), file), 0);
            decompress(BufReader::with_capacity(BLOCK, source)).map_err(|error| error.to_string())
        };
        CaptureReader::open(open()?, options).map_err(|error| error.to_string())?;
        Ok(Self { reader: open()?, blocks: Vec::new(), partial: Vec::new() })
    }

    /// Bytes decompressed so far.
    pub fn size(&self) -> u64 {
        (self.blocks.len() as u64).saturating_mul(BLOCK as u64).saturating_add(self.partial.len() as u64)
    }

    /// Decompresses one more block; `false` at the end.
    ///
    /// # Errors
    /// If the content is too large for a browser. A file that ends early, or is damaged, is an error with the
    /// second element `true`: its content before that is kept.
    pub fn step(&mut self) -> Result<bool, (String, bool)> {
        if self.partial.capacity() < BLOCK {
            let reserved = self.partial.try_reserve_exact(BLOCK);
            reserved.map_err(|_| (self.too_large(), false))?;
        }
        let before = self.partial.len();
        let room = BLOCK.saturating_sub(before) as u64;
        let read = self.reader.by_ref().take(room).read_to_end(&mut self.partial);
        read.map_err(|error| (error.to_string(), true))?;
        let is_full = self.partial.len() >= BLOCK;
        if is_full {
            self.blocks.push(std::mem::take(&mut self.partial).into_boxed_slice());
            if self.size() > MOST_UNPACKED {
                return Err((self.too_large(), false));
            }
        }
        Ok(is_full)
    }

    fn too_large(&self) -> String {
        format!(
            "decompressed content above {} MB; max {} MB in a browser; decompress the file first",
            self.size() >> 20,
            MOST_UNPACKED >> 20
        )
    }

    /// The decompressed content; `failure` ended it early.
    pub fn finish(mut self, failure: Option<&str>) -> StoredContent {
        if !self.partial.is_empty() {
            self.blocks.push(self.partial.into_boxed_slice());
        }
        StoredContent::Memory(Arc::new(self.blocks), failure.map(Into::into))
    }
}
