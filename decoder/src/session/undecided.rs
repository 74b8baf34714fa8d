//! Frames whose protocol is not decided yet: 29-bit identifiers that may belong to UDS or to J1939.

use super::bus::{IdentifierService, UdsLink};
use super::decoder::BusDecoder;
use super::j1939::is_followed;
use super::observer::Observer;
use super::uds::{PairDecision, has_known_end};
use crate::frame::{CanId, Frame, FrameFlags, Timestamp};
use crate::wire::j1939::J1939Id;

/// Last PGN of data page 0.
const LAST_OF_PAGE_0: u32 = 0xFFFF;

impl BusDecoder {
    /// Whether a frame may belong to an undecided pair of identifiers of UDS.
    #[inline]
    pub(super) fn is_pair_undecided(&self, service: IdentifierService, frame: &Frame) -> bool {
        matches!(frame.id, CanId::Extended(_))
            && match service {
                IdentifierService::J1939(_) => !self.shared.bus.protocols.j1939.is_confirmed(),
                _ => service == IdentifierService::Unclassified,
            }
    }

    /// Handles a frame that proves a pair of identifiers of UDS, with the frames held before it, and a frame that waits
    /// for this proof; `false`, without any event, for all other frames.
    #[cold]
    pub(super) fn on_undecided_frame(
        &mut self,
        (slot, service): (usize, IdentifierService),
        frame: &Frame,
        out: &mut dyn Observer,
    ) -> bool {
        if self.pairs.withholds_frames() {
            self.release_withheld(frame.time, out);
        }
        let cx = &mut self.shared.lend_context(out);
        if let Some(link) = UdsLink::link_of(frame.id).filter(|link| has_known_end(*link, cx)) {
            cx.bus.routes.assign_link(frame.id, link);
            self.on_isotp(link, frame, out);
            return true;
        }
        let is_undecoded = service == IdentifierService::Unclassified
            || cx.bus.protocols.j1939.is_rejected()
            || frame.flags.contains(FrameFlags::FD);
        let is_described = cx.described_message(frame).is_some();
        let group = match service {
            IdentifierService::J1939(id) if !is_undecoded && !is_described => {
                let is_named = cx.bus.protocols.named.concerns_named(id) || cx.bus.database.is_j1939();
                // Fast packets of NMEA 2000 are on data page 1; their frames must not change their order.
                let may_wait = id.pgn.number() <= LAST_OF_PAGE_0 && !is_named;
                Some((slot, id)).filter(|_| may_wait && !cx.bus.protocols.j1939.is_evidence(id))
            }
            _ => None,
        };
        let decision = self.pairs.take_frame((frame, group), is_undecoded && !is_described, cx);
        match decision {
            PairDecision::Open => false,
            PairDecision::Withheld => true,
            PairDecision::Proven(pair) => {
                for (link, frame) in pair.frames {
                    self.on_isotp(link, &frame, out);
                }
                true
            }
        }
    }

    /// Decodes withheld frames that no response followed in time as messages of J1939; without `time`, all of them.
    #[cold]
    pub(super) fn release_withheld(&mut self, time: Option<Timestamp>, out: &mut dyn Observer) {
        while let Some(((slot, id), frame)) = self.pairs.take_withheld(time) {
            self.on_j1939(Some(slot), id, &frame, out);
        }
    }

    /// Whether to decode a frame before J1939 is confirmed. The frame that confirms it releases the withheld ones.
    #[cold]
    pub(super) fn follows_group(&mut self, id: J1939Id, frame: &Frame, out: &mut dyn Observer) -> bool {
        let is_decoded = is_followed(id, frame, &mut self.shared.lend_context(out));
        if self.shared.bus.protocols.j1939.is_confirmed() {
            self.release_withheld(None, out);
        }
        is_decoded
    }
}
