//! Containers: sequences of objects, usually compressed. An object may begin in one container and end in the
//! next.
//!
//! ```text
//! header of the object   0 compression (2): 0 none, 2 zlib   8 size of the content (4)   16 content
//! ```
//! The declared size is not trusted; the actual size is known after decompression.

use super::object::{FILL, ObjectHeader, TITLE};
use crate::capture::CaptureError;
use crate::capture::byte_order::ByteOrder::Little;
use crate::capture::inflate::{Decompression, inflate};

/// Largest accepted container in bytes.
pub(super) const LARGEST_CONTAINER: usize = 16 * 1024 * 1024;

/// Largest content read, in bytes.
const LARGEST_CONTENT: usize = 2 * LARGEST_CONTAINER;

const HEADER: usize = 16;
const STORED: u16 = 0;
const ZLIB: u16 = 2;

#[derive(Debug)]
pub(super) struct LogContainer {
    /// Remaining bytes of the previous container, then the content of this one.
    pub(super) bytes: Vec<u8>,
    /// Whether the content is stored uncompressed.
    pub(super) is_stored: bool,
    /// Size of the container in the capture, in bytes.
    pub(super) length: usize,
    /// Description of the damage, if any.
    pub(super) damage: Option<String>,
    /// Whether the damage cuts off the objects in the content.
    pub(super) is_broken: bool,
    /// Whether the capture ends inside the container.
    pub(super) is_cut: bool,
}

impl LogContainer {
    /// Number of bytes before the content of a container.
    pub(super) const fn bytes_before_content(head: ObjectHeader) -> usize {
        head.header + HEADER
    }

    /// Opens the container at the start of `rest`. If the container is incomplete, the capture ends in it.
    ///
    /// # Errors
    /// If the container is compressed and this build cannot decompress it.
    pub(super) fn open(
        head: ObjectHeader,
        rest: &[u8],
        tail: &[u8],
        offset: u64,
    ) -> Result<Self, CaptureError> {
        let object = rest.get(..head.size).unwrap_or(rest);
        let mut container = Self {
            bytes: tail.to_vec(),
            is_stored: false,
            length: object.len(),
            damage: None,
            is_broken: false,
            is_cut: object.len() < head.size,
        };
        if container.is_cut {
            let found = object.len();
            container.mark_broken(format!(
                "the capture ends inside a container: found {found} of {} bytes",
                head.size
            ));
        }
        let header = object.get(head.header..).unwrap_or_default();
        let Some((method, content)) = Little.u16(header, 0).zip(header.get(HEADER..)) else {
            container.mark_broken(format!("container too short ({} bytes)", head.size));
            return Ok(container);
        };
        match method {
            STORED => {
                container.is_stored = true;
                container.bytes.extend_from_slice(content);
            }
            ZLIB => container.inflate_content(head, content, Little.u32(header, 8), offset)?,
            _ => container.mark_broken(format!("container compression {method}; expected 0 or 2 (zlib)")),
        }
        Ok(container)
    }

    fn mark_broken(&mut self, damage: String) {
        self.is_broken = true;
        self.damage.get_or_insert(damage);
    }

    /// Handles content that is complete after `length` bytes. If the declared size differs, the data after it
    /// is kept.
    fn ends_after(&mut self, head: ObjectHeader, length: usize) {
        if self.is_cut || self.length.saturating_sub(length) > FILL {
            self.damage =
                Some(format!("container of {} bytes: content ends after {length} bytes", head.size));
            (self.is_broken, self.is_cut, self.length) = (false, false, length);
        }
    }

    fn inflate_content(
        &mut self,
        head: ObjectHeader,
        content: &[u8],
        size: Option<u32>,
        offset: u64,
    ) -> Result<(), CaptureError> {
        match inflate(content, &mut self.bytes, LARGEST_CONTENT) {
            Decompression::Whole(taken) => {
                self.ends_after(head, Self::bytes_before_content(head).saturating_add(taken));
            }
            Decompression::CutOff if content.is_empty() && size == Some(0) => {}
            Decompression::CutOff => self.mark_broken("content of a container ends early".into()),
            Decompression::Damaged => {
                self.mark_broken("content of a container damaged: its last frames may be wrong".into());
            }
            Decompression::TooLong => {
                self.mark_broken(format!(
                    "content of a container longer than {LARGEST_CONTENT} bytes: rest skipped"
                ));
            }
            Decompression::Unavailable => {
                return Err(CaptureError::Header {
                    format: TITLE,
                    offset,
                    found: "a compressed container".into(),
                    expected: "an uncompressed container (this build lacks the feature `gzip`)",
                });
            }
        }
        Ok(())
    }
}
