//! Frames to messages: pure parsers of payload bytes.
//!
//! Nothing here remembers anything. What an identifier means now, and in which phase a transfer is, the
//! session knows and states as an argument. Nothing here allocates, and nothing can fail but by saying
//! how many bytes were missing.

pub mod canopen;
pub mod error_frame;
pub mod isotp;
pub mod j1939;
mod node_id;
pub mod uds;

pub use node_id::NODE_PLACES;
pub use node_id::NodeId;

/// Bytes that are too few for what they should be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Malformed {
    /// Which message was expected: `nmt`, `sdo`, `lss`, …
    pub layer: &'static str,
    /// Byte of the payload at which the missing part should begin.
    pub offset: u8,
    /// Bytes needed from there on.
    pub needed: u8,
    /// Bytes there are.
    pub available: u8,
}

impl Malformed {
    /// `needed` bytes at `offset` of a payload of `length` bytes.
    fn at(layer: &'static str, offset: usize, needed: usize, length: usize) -> Self {
        let small = |value: usize| u8::try_from(value).unwrap_or(u8::MAX);
        Self {
            layer,
            offset: small(offset),
            needed: small(needed),
            available: small(length.saturating_sub(offset)),
        }
    }
}
