//! SDO responses for another object than requested.

use std::collections::VecDeque;

use crate::event::{Event, EventKind, Kind, SdoOutcome, SdoTransfer};
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// An SDO server sends a response for another object than the open request, which itself has no response.
    /// A late response to one of the previous requests is exempt, and so is traffic after lost frames.
    ///
    /// # Why it matters
    /// A master that does not compare the object uses the value of a wrong object.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.3, §7.2.4.3.6 (multiplexer of the response)
    ///
    /// # What to look at first
    /// Check whether two clients use the same SDO channel. If not, the SDO server of the firmware is wrong.
    ///
    /// # Mutation
    /// change the index in a response
    "sdo-answer-mismatch", Warning, "SDO response for another object",
    kinds: [Kind::SdoTransfer, Kind::LostFrames, Kind::Link, Kind::BusSilent],
    needs: "an SDO transfer",
    cases: &["2.7"],
    word: "SDO",
}

/// Number of previous requests per node that a late response may belong to.
const REMEMBERED: usize = 8;

/// Response without an open request.
struct StrayResponse {
    response: CanId,
    object: ObjectAddress,
    frame: u64,
}

#[derive(Default)]
struct SdoServer {
    stray: Option<StrayResponse>,
    /// Objects of the latest requests.
    asked: VecDeque<ObjectAddress>,
}

#[derive(Default)]
struct SdoAnswerMismatch {
    servers: NodeMap<SdoServer>,
}

fn new(_policy: &RulePolicy) -> SdoAnswerMismatch {
    SdoAnswerMismatch::default()
}

impl SdoAnswerMismatch {
    fn on_transfer(
        &mut self,
        event: &Event,
        node: NodeId,
        transfer: &SdoTransfer,
        context: &mut RuleContext<'_>,
    ) {
        let (Some(object), Some(server)) = (transfer.object, self.servers.entry(node)) else { return };
        let is_answer = transfer.cut_start && transfer.frame_count == 1;
        if is_answer {
            let is_late = server.asked.contains(&object);
            let stray = StrayResponse { response: transfer.response, object, frame: event.frames.last };
            server.stray = Some(stray).filter(|_| transfer.outcome == SdoOutcome::Complete && !is_late);
            return;
        }
        if transfer.cut_start {
            return;
        }
        let stray = server.stray.take();
        if server.asked.len() >= REMEMBERED {
            server.asked.pop_front();
        }
        server.asked.push_back(object);
        match (transfer.outcome, stray) {
            (SdoOutcome::Complete, _) => context.count_pass(),
            (SdoOutcome::Timeout | SdoOutcome::Superseded, Some(stray)) => {
                let request = event.frames.first;
                let is_between = stray.frame > request && stray.response == transfer.response;
                if !is_between || transfer.frame_count != 1 || stray.object == object {
                    return;
                }
                let alarm = context.start_finding(event).with_subject(FindingSubject::Object(object));
                alarm.report_finding(|| {
                    let (other, frame) = (stray.object, stray.frame);
                    format!("response for {other} {{{frame}}} to the request for {object} {{{request}}}")
                });
            }
            _ => {}
        }
    }
}

impl Rule for SdoAnswerMismatch {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::SdoTransfer(transfer), Some(node)) => {
                self.on_transfer(event, node, transfer, context);
            }
            (EventKind::LostFrames { .. } | EventKind::Link { .. } | EventKind::BusSilent { .. }, _) => {
                self.servers = NodeMap::default();
            }
            _ => {}
        }
    }
}
