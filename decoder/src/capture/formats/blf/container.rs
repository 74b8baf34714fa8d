//! Containers: objects behind one another, compressed mostly. An object may begin in one and end in the next.
//!
//! ```text
//! header of the object   0 compression (2): 0 none, 2 zlib   8 size of the content (4)   16 content
//! ```
//! How much there is, is found out by reading it.

use super::object::{FILL, Head, TITLE};
use crate::capture::CaptureError;
use crate::capture::byte_order::ByteOrder::Little;
use crate::capture::inflate::{Inflated, inflate};

/// Largest container that is believed.
pub(super) const LARGEST_CONTAINER: usize = 16 * 1024 * 1024;

/// Largest content that is read.
const LARGEST_CONTENT: usize = 2 * LARGEST_CONTAINER;

const HEADER: usize = 16;
const STORED: u16 = 0;
const ZLIB: u16 = 2;

/// The content of a container.
#[derive(Debug)]
pub(super) struct Container {
    /// What was left of the one before, and what is in this one.
    pub(super) bytes: Vec<u8>,
    /// Whether the content stands in the capture as it is.
    pub(super) is_stored: bool,
    /// Bytes of the capture it stands for.
    pub(super) length: usize,
    /// What is wrong with it.
    pub(super) damage: Option<String>,
    /// Whether that breaks off the objects in it.
    pub(super) is_broken: bool,
    /// Whether that is the end of the capture inside it.
    pub(super) is_cut: bool,
}

impl Container {
    /// Bytes before the content of a container.
    pub(super) const fn before(head: Head) -> usize {
        head.header + HEADER
    }

    /// Opens the container at the front of `rest`, of which nothing more will come if it is cut off.
    ///
    /// # Errors
    /// When it is compressed and this build cannot read that.
    pub(super) fn open(head: Head, rest: &[u8], tail: &[u8], offset: u64) -> Result<Self, CaptureError> {
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
            container
                .broken(format!("the capture ends inside a container: found {found} of {} bytes", head.size));
        }
        let header = object.get(head.header..).unwrap_or_default();
        let Some((method, content)) = Little.u16(header, 0).zip(header.get(HEADER..)) else {
            container.broken(format!("a container of {} bytes: too short", head.size));
            return Ok(container);
        };
        match method {
            STORED => {
                container.is_stored = true;
                container.bytes.extend_from_slice(content);
            }
            ZLIB => container.inflate(head, content, Little.u32(header, 8), offset)?,
            _ => container.broken(format!("a container with compression {method}, expected 0 or 2 (zlib)")),
        }
        Ok(container)
    }

    fn broken(&mut self, damage: String) {
        self.is_broken = true;
        self.damage.get_or_insert(damage);
    }

    /// Its content is whole after so many bytes. If its size is another one, what follows is not lost.
    fn ends_after(&mut self, head: Head, length: usize) {
        if self.is_cut || self.length.saturating_sub(length) > FILL {
            self.damage =
                Some(format!("a container of {} bytes whose content ends after {length}", head.size));
            (self.is_broken, self.is_cut, self.length) = (false, false, length);
        }
    }

    fn inflate(
        &mut self,
        head: Head,
        content: &[u8],
        size: Option<u32>,
        offset: u64,
    ) -> Result<(), CaptureError> {
        match inflate(content, &mut self.bytes, LARGEST_CONTENT) {
            Inflated::Whole(taken) => self.ends_after(head, Self::before(head).saturating_add(taken)),
            Inflated::CutOff if content.is_empty() && size == Some(0) => {}
            Inflated::CutOff => self.broken("the content of a container ends too early".into()),
            Inflated::Damaged => {
                self.broken(
                    "the content of a container is damaged: the last frames from it may be wrong".into(),
                );
            }
            Inflated::TooLong => {
                self.broken(format!(
                    "a container with more than {LARGEST_CONTENT} bytes: the rest is not read"
                ));
            }
            Inflated::Unavailable => {
                return Err(CaptureError::Header {
                    format: TITLE,
                    offset,
                    found: "a compressed container".into(),
                    expected: "one that is not: this build leaves out the feature `gzip`; use one with it",
                });
            }
        }
        Ok(())
    }
}
