//! Short path of a frame: its contents bring nothing that the session needs. If no observer needs it either, no event is
//! made; otherwise the prepared event of a PDO is sent.
//!
//! A frame takes it only if all deadlines of the session are later, its timestamp follows the last one within the usual
//! gap, and its protocol and sender are known. Everything that later events depend on is updated: clock, intervals,
//! last frame of bus, node and identifier.

use super::bus::Bus;
use super::canopen::copy_payload;
use super::decoder::BusDecoder;
use super::observer::{MessagePreview, Observer};
use crate::event::{EventKind, FrameRange};
use crate::frame::Frame;

/// Frames in a row that the observer needed, after which it is asked less often: it may need each event.
const PATIENCE: u8 = 64;

/// Frames between two questions to such an observer.
const PAUSE: u64 = 64;

/// Whether an observer that may need each event is asked about this frame.
#[cold]
fn ends_pause(number: u64) -> bool {
    number.is_multiple_of(PAUSE)
}

impl BusDecoder {
    /// Whether to ask the observer about a frame. The answer saves work only; events without a question are correct, too.
    #[inline]
    fn may_skip(&self, frame: &Frame) -> bool {
        self.needed_in_a_row < PATIENCE || ends_pause(frame.number)
    }

    /// Handles a frame that the session itself does not need: updates times and counters, and sends the event of a PDO if
    /// the observer needs it. `false`, without any effect, for all other frames.
    #[inline]
    pub(super) fn take_quickly(&mut self, identifier: usize, frame: &Frame, out: &mut dyn Observer) -> bool {
        let Some(preview) = self.shared.bus.preview_frame(identifier, frame) else { return false };
        if self.shared.timers.is_due(preview.now) {
            return false;
        }
        if self.may_skip(frame) {
            if out.skip_event(&preview, &self.shared.bus) {
                self.needed_in_a_row = 0;
                self.shared.bus.advance_frame(&preview, false);
                return true;
            }
            self.needed_in_a_row = self.needed_in_a_row.saturating_add(1);
            if self.needed_in_a_row >= PATIENCE && out.is_selective(&preview, &self.shared.bus) {
                self.needed_in_a_row = 0;
            }
        }
        self.send_pdo(&preview, frame, out)
    }

    /// Sends the event of a PDO that the observer needs; `false` for a message of another protocol.
    #[inline(never)]
    fn send_pdo(&mut self, preview: &MessagePreview, frame: &Frame, out: &mut dyn Observer) -> bool {
        let state = self.shared.bus.routes.slot_mut(preview.identifier);
        let Some(event) = state.and_then(|state| state.prepared.as_deref_mut()) else { return false };
        let EventKind::Pdo(pdo) = &mut event.kind else { return false };
        (event.time, event.frames) = (frame.time, FrameRange::one(frame.number));
        (event.presumed, event.routine) = (false, preview.change == 0);
        (pdo.length, pdo.is_request) = (frame.length, false);
        copy_payload(&mut pdo.bytes, frame);
        self.shared.bus.advance_frame(preview, true);
        self.shared.lend_context(out).send_prepared(preview.identifier);
        true
    }
}

impl Bus {
    /// A frame whose event the session itself does not need; `None` for all other frames.
    #[inline]
    fn preview_frame(&self, identifier: usize, frame: &Frame) -> Option<MessagePreview> {
        let state = self.routes.slot(identifier)?;
        let needed = state.needed_bits()?;
        let time = frame.time?;
        let now = self.clock.regular_time(time)?;
        let (payload, change) = state.last.next(frame)?;
        if change & needed != 0 {
            return None;
        }
        let sender = self.nodes.node_at(usize::from(state.sender));
        if !self.protocols.is_settled_sender(state.service, sender) {
            return None;
        }
        Some(MessagePreview { identifier, frame: frame.number, time, now, payload, change })
    }

    /// Updates clock, identifier and sender at a frame that the session does not need; `has_event` if an observer needs it.
    #[expect(clippy::inline_always, reason = "the call alone costs a tenth of a skipped frame")]
    #[inline(always)]
    fn advance_frame(&mut self, preview: &MessagePreview, has_event: bool) {
        self.clock.advance_regularly(preview.time, preview.now);
        (self.last_frame, self.last_time) = (preview.frame, Some(preview.time));
        let Some(state) = self.routes.slot_mut(preview.identifier) else { return };
        state.note_frame(preview.now, preview.frame);
        if preview.change != 0 {
            state.pulse.note_change((preview.now, preview.frame), preview.payload, preview.change);
        }
        state.last.set_word(preview.payload);
        if !has_event && state.is_received() {
            state.skipped.get_or_insert_default().push(preview.time, preview.frame);
        }
        if let Some(planned) = state.plan.as_mut().filter(|planned| planned.plan.commands) {
            planned.recent.push(preview.frame, preview.now);
        }
        let sender = usize::from(state.sender);
        // A PDO alone does not prove its node: the identifier may be configured in another one.
        if let Some(node) = self.nodes.node_at_mut(sender) {
            node.last_frame = preview.frame;
            node.last_seen = Some(preview.time);
            node.last_received = preview.now;
        }
    }
}
