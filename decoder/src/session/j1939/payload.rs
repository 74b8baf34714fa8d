//! Whole payloads of groups that concern addresses or faults.

use crate::event::FrameRange;
use crate::frame::Frame;
use crate::wire::j1939::J1939Id;

/// The payload of a group, in one frame or in several.
#[derive(Debug, Clone, Copy)]
pub(in crate::session) struct Payload<'a> {
    pub(in crate::session) id: J1939Id,
    pub(in crate::session) data: &'a [u8],
    /// Frames that carried it.
    pub(in crate::session) frames: FrameRange,
}

/// The payload of a completed transfer.
#[derive(Debug, Clone)]
pub(in crate::session) struct TransferPayload {
    pub(super) id: J1939Id,
    pub(super) data: Vec<u8>,
    pub(super) frames: FrameRange,
    /// The frame that ended the transfer, or its deadline.
    pub(in crate::session) frame: Frame,
}

impl TransferPayload {
    /// The payload, as if it had been transferred in one frame.
    pub(in crate::session) fn payload(&self) -> Payload<'_> {
        Payload { id: self.id, data: &self.data, frames: self.frames }
    }
}
