//! Frames to messages: pure parsers of payload bytes.
//!
//! Each message is a nom parser; its error becomes [`MalformedPayload`] in `parser.rs`. The parsers do not allocate
//! and have no state. The session passes the current meaning of an identifier and the phase of a transfer as
//! arguments.

pub mod canopen;
pub mod error_frame;
pub mod isotp;
pub mod j1939;
mod layer;
mod node_id;
mod node_map;
mod parser;
#[cfg(test)]
mod tests;
pub mod uds;

pub use node_id::NODE_PLACES;
pub use node_id::NodeId;
pub(crate) use node_map::{NodeMap, NodeSet};

/// A message shorter than its format requires.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MalformedPayload {
    /// Expected message: `nmt`, `sdo`, `lss`, …
    pub layer: &'static str,
    /// Offset in the payload at which the missing part should start.
    pub offset: u8,
    /// Bytes needed from `offset` on.
    pub needed: u8,
    /// Bytes available from `offset` on.
    pub available: u8,
}
