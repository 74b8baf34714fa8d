//! J1939 requests without a response.

use std::collections::VecDeque;

use crate::event::{Event, EventKind, FrameRange, J1939Request, Kind};
use crate::finding::FindingSubject;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{FrameNeed, Rule, RuleContext, RulePolicy};
use crate::wire::NodeId;
use crate::wire::j1939::{ALL, NO_ADDRESS, Pgn};

declare_rule! {
    /// # What it checks
    /// A known device neither sends the requested group, in one frame or several, nor acknowledges or refuses
    /// it in time. Requests to all, and to unknown addresses, are exempt.
    ///
    /// # Why it matters
    /// The requesting device waits and continues without the value. The requested device may be stuck.
    ///
    /// # Source
    /// SAE J1939-21 §5.4.2 (response to a request to a specific address), §5.12.3 (1,250 ms)
    ///
    /// # What to look at first
    /// Check whether the device sends anything at that time. A device that does not support the group must
    /// send a NACK.
    ///
    /// # Mutation
    /// drop the NACK of a device
    "request-unanswered", Warning, "J1939 request without response",
    kinds: [
        Kind::J1939Request, Kind::J1939Message, Kind::J1939Transfer, Kind::Acknowledgement,
        Kind::AddressClaim, Kind::BusSilent,
    ],
    needs: "a J1939 request to a known device",
    is_timing: true,
    word: "REQ",
    tolerances: &[define_tolerance("answer-ms", 1_250.0, "ms", "to the response")],
}

/// Maximum number of open requests; the oldest one is evicted.
const OPEN_LIMIT: usize = 64;

/// Request without a response so far.
struct PendingRequest {
    token: u64,
    pgn: Pgn,
    /// Requesting address, and requested address.
    source: u8,
    of: u8,
    frame: u64,
}

struct RequestUnanswered {
    answer: i64,
    open: VecDeque<PendingRequest>,
    /// Number of requests so far; the token of the latest one.
    count: u64,
}

fn new(policy: &RulePolicy) -> RequestUnanswered {
    let answer = policy.tolerance_ns(&DECLARATION, "answer-ms");
    RequestUnanswered { answer, open: VecDeque::new(), count: 0 }
}

impl RequestUnanswered {
    fn on_request(&mut self, event: &Event, request: &J1939Request, context: &mut RuleContext<'_>) {
        let of = request.destination;
        if matches!(of, ALL | NO_ADDRESS) || of == request.source || !context.has_time {
            return;
        }
        if context.bus.node(NodeId::J1939(of)).is_none_or(|node| node.last_seen().0 == 0) {
            return;
        }
        if self.open.len() >= OPEN_LIMIT {
            self.open.pop_front();
        }
        self.count += 1;
        let (token, source, frame) = (self.count, request.source, event.frames.last);
        context.ask_again();
        self.open.push_back(PendingRequest { token, pgn: request.pgn, source, of, frame });
        context.wake_at(context.now.saturating_add(self.answer), token);
    }

    /// Closes the requests for a group from an address.
    fn on_response(&mut self, by: u8, pgn: Pgn, context: &mut RuleContext<'_>) {
        if !self.open.iter().any(|asked| (asked.of, asked.pgn) == (by, pgn)) {
            return;
        }
        self.open.retain(|asked| {
            let is_it = (asked.of, asked.pgn) == (by, pgn);
            if is_it {
                context.count_pass();
                context.ask_again();
            }
            !is_it
        });
    }
}

impl Rule for RequestUnanswered {
    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        match &event.kind {
            EventKind::J1939Message(message)
                if self.open.iter().all(|asked| asked.of != message.id.source) =>
            {
                FrameNeed::NOTHING
            }
            _ => FrameNeed::EACH,
        }
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::J1939Request(request) = &event.kind {
            return self.on_request(event, request, context);
        }
        if self.open.is_empty() {
            return;
        }
        match &event.kind {
            EventKind::J1939Message(message) => self.on_response(message.id.source, message.id.pgn, context),
            EventKind::Acknowledgement(answer) => {
                self.on_response(answer.source, answer.message.pgn, context);
            }
            EventKind::J1939Transfer(transfer) => {
                if let Some(pgn) = transfer.pgn {
                    self.on_response(transfer.source, pgn, context);
                }
            }
            // The response may be missing in the capture.
            EventKind::BusSilent { .. } => {
                self.open.clear();
                context.ask_again();
            }
            EventKind::AddressClaim(claim) => self.on_response(claim.source, Pgn::ADDRESS_CLAIMED, context),
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(place) = self.open.iter().position(|asked| asked.token == token) else { return };
        let Some(asked) = self.open.remove(place) else { return };
        context.ask_again();
        // The response is being transferred in several packets.
        if context.bus.is_transferring(asked.of, asked.pgn) {
            return context.count_pass();
        }
        let node = NodeId::J1939(asked.of);
        let alarm = context.fail_at(context.now, Some(node), FrameRange::one(asked.frame));
        let milliseconds = self.answer / 1_000_000;
        let PendingRequest { source, pgn, frame, .. } = asked;
        alarm.with_subject(FindingSubject::Pgn(pgn.number())).report_finding(|| {
            format!("no response within {milliseconds} ms to the request {{{frame}}} of {source:02X}")
        });
    }
}
