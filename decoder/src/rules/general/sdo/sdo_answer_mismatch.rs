//! SDO responses for another object than requested.

use std::collections::VecDeque;

use crate::event::{Event, EventKind, Kind, MisplacedResponse, SdoOutcome, SdoTransfer};
use crate::finding::{FindingSubject, Severity};
use crate::frame::CanId;
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// An SDO server sends a response for another object than the open request, or on another identifier: that of the
    /// requests, or of the responses of another node. The request itself has no response.
    /// A late response to one of the previous requests is exempt, and so is traffic after lost frames.
    ///
    /// # Why it matters
    /// A master that does not compare the object uses the value of a wrong object. A response on another identifier does
    /// not arrive: the master reports a time-out of a node that responds.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.3, §7.2.4.3.6 (multiplexer of the response), §7.3.3 (identifiers of the SDO)
    ///
    /// # What to look at first
    /// Check object and identifier in the responses of the SDO server: its firmware may be wrong. Check whether two
    /// clients use the same SDO channel.
    ///
    /// # Mutation
    /// change the index in a response
    "sdo-answer-mismatch", Warning, "SDO response with another object or identifier",
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
        if let Some(misplaced) = transfer.misplaced {
            return report_misplaced(event, transfer, misplaced, context);
        }
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

/// Reports a response on another identifier than that of the responses.
fn report_misplaced(
    event: &Event,
    transfer: &SdoTransfer,
    misplaced: MisplacedResponse,
    context: &mut RuleContext<'_>,
) {
    let MisplacedResponse { id, frame } = misplaced;
    if transfer.outcome == SdoOutcome::Unfinished {
        return;
    }
    let alarm =
        context.start_finding(event).with_subject(transfer_subject(transfer)).with_severity(Severity::Error);
    alarm.with_reason("identifier").report_finding(|| {
        let (response, request) = (transfer.response, event.frames.first);
        format!("response on {id} {{{frame}}} instead of {response} to the request {{{request}}}")
    });
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
