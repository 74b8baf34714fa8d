//! Answers that name another object than the request.

use std::collections::VecDeque;

use crate::event::{Event, EventKind, Outcome, SdoTransfer};
use crate::finding::About;
use crate::frame::CanId;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// An SDO server confirms, or sends the value of, another object than the one the open request names, and the
    /// request itself stays without an answer. An answer to one of the last requests is late and no mismatch, and
    /// after frames were lost nothing is judged.
    ///
    /// # Why it matters
    /// A master that does not compare takes the value of one object for that of another.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.3, §7.2.4.3.6 (multiplexer of the answer)
    ///
    /// # What to look at first
    /// Whether two clients use the same SDO channel; then the firmware's SDO server.
    ///
    /// # Mutation
    /// change the index in an answer
    "sdo-answer-mismatch", Warning, "an SDO answer names another object than the request",
    kinds: ["sdo-transfer", "lost-frames", "link"],
    cases: &["2.7"],
    word: "SDO",
}

/// Requests remembered of a node: an answer may be that late.
const REMEMBERED: usize = 8;

/// An answer of which no request was open.
struct Stray {
    response: CanId,
    object: ObjectAddress,
    frame: u64,
}

#[derive(Default)]
struct Server {
    stray: Option<Stray>,
    /// Objects asked for last.
    asked: VecDeque<ObjectAddress>,
}

#[derive(Default)]
struct SdoAnswerMismatch {
    servers: NodeMap<Server>,
}

fn new(_policy: &Policy) -> SdoAnswerMismatch {
    SdoAnswerMismatch::default()
}

impl SdoAnswerMismatch {
    fn transfer(&mut self, event: &Event, node: NodeId, transfer: &SdoTransfer, context: &mut Context<'_>) {
        let (Some(object), Some(server)) = (transfer.object, self.servers.entry(node)) else { return };
        let is_answer = transfer.cut_start && transfer.frame_count == 1;
        if is_answer {
            let is_late = server.asked.contains(&object);
            let stray = Stray { response: transfer.response, object, frame: event.frames.last };
            server.stray = Some(stray).filter(|_| transfer.outcome == Outcome::Complete && !is_late);
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
            (Outcome::Complete, _) => context.pass(),
            (Outcome::Timeout | Outcome::Superseded, Some(stray)) => {
                let request = event.frames.first;
                let is_between = stray.frame > request && stray.response == transfer.response;
                if !is_between || transfer.frame_count != 1 || stray.object == object {
                    return;
                }
                let alarm = context.fail(event).about(About::Object(object));
                alarm.say(|| {
                    let (other, frame) = (stray.object, stray.frame);
                    format!("request {{{request}}} of {object} answered with {other} {{{frame}}}")
                });
            }
            _ => {}
        }
    }
}

impl Rule for SdoAnswerMismatch {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match (&event.kind, event.node) {
            (EventKind::SdoTransfer(transfer), Some(node)) => self.transfer(event, node, transfer, context),
            (EventKind::LostFrames { .. } | EventKind::Link { .. }, _) => self.servers = NodeMap::default(),
            _ => {}
        }
    }
}
