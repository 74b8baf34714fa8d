//! Single frames that prove CANopen.

use super::nmt::is_valid_command;
use crate::frame::{Frame, FrameFlags};
use crate::session::bus::IdentifierService;
use crate::wire::canopen::error_control;

/// Whether a frame proves CANopen alone: a heartbeat, a boot-up or a guarding response, or an NMT command.
pub(in crate::session) fn proves_canopen(service: IdentifierService, frame: &Frame) -> bool {
    match service {
        IdentifierService::ErrorControl(_) => {
            frame.length == 1
                && !frame.flags.contains(FrameFlags::REMOTE)
                && error_control::parse(frame.data()).is_ok_and(|message| message.state.is_some())
        }
        IdentifierService::Nmt => is_valid_command(frame),
        _ => false,
    }
}
