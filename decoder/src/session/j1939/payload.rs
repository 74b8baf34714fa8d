//! Complete payloads of groups about addresses or faults.

use crate::event::FrameRange;
use crate::frame::Frame;
use crate::wire::j1939::J1939Id;

/// Payload of a group, from one frame or several.
#[derive(Debug, Clone, Copy)]
pub(in crate::session) struct GroupPayload<'a> {
    pub(in crate::session) id: J1939Id,
    pub(in crate::session) data: &'a [u8],
    /// Frames of the message.
    pub(in crate::session) frames: FrameRange,
}

/// Payload of a completed transfer.
#[derive(Debug, Clone)]
pub(in crate::session) struct TransferPayload {
    pub(super) id: J1939Id,
    pub(super) data: Vec<u8>,
    pub(super) frames: FrameRange,
    /// Last frame of the transfer, or its deadline.
    pub(in crate::session) frame: Frame,
}

impl TransferPayload {
    /// Payload in the form of a single-frame message.
    pub(in crate::session) fn as_payload(&self) -> GroupPayload<'_> {
        GroupPayload { id: self.id, data: &self.data, frames: self.frames }
    }
}
