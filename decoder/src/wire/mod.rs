//! Frames to messages: pure parsers of payload bytes.
//!
//! The parsers have no state. The session passes the current meaning of an identifier and the phase of a
//! transfer as arguments. The parsers do not allocate. Their only error is [`Malformed`]: missing bytes.

pub mod canopen;
pub mod error_frame;
pub mod isotp;
pub mod j1939;
mod layer;
mod node_id;
mod node_map;
pub mod uds;

pub use node_id::NODE_PLACES;
pub use node_id::NodeId;
pub(crate) use node_map::{NodeMap, NodeSet};

/// A message shorter than its format requires.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Malformed {
    /// Expected message: `nmt`, `sdo`, `lss`, …
    pub layer: &'static str,
    /// Offset in the payload at which the missing part should start.
    pub offset: u8,
    /// Bytes needed from `offset` on.
    pub needed: u8,
    /// Bytes available from `offset` on.
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
