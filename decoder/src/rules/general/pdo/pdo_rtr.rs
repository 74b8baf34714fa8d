//! TPDOs requested by remote frames.

use crate::event::{DecodedPdo, Event, EventKind, FrameRange, Kind};
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::profile::PdoDirection;
use crate::rules::general::facts::{PRODUCES, confirmed_number};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{BySlot, Rule, RuleContext, RulePolicy};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

declare_rule! {
    /// # What it checks
    /// An operational node does not respond to a remote frame for a TPDO with permitted remote frames (bit 30
    /// of 18xx:01, written or read, is 0). Or a node responds in another state.
    ///
    /// # Why it matters
    /// A master that polls receives no value. CAN controllers that respond by themselves send an old value.
    ///
    /// # Source
    /// CiA 301 §7.2.2.5.2 (read PDO), §7.5.2.37 (bit 30)
    ///
    /// # What to look at first
    /// Check in the manual whether the device supports remote frames. Set bit 30 if it does not.
    ///
    /// # Mutation
    /// drop the response to a remote frame
    "pdo-rtr", Warning, "wrong response to a PDO remote frame",
    kinds: [Kind::Pdo],
    needs: "a remote frame for a TPDO with known 18xx:01 and 18xx:02",
    cases: &["3.3", "3.9", "3.15"],
    word: "PDO",
    tolerances: &[define_tolerance("error-ms", 1_000.0, "ms", "from the remote frame to the PDO")],
}

/// Maximum response time, in nanoseconds; a later PDO has another cause.
const ANSWER: i64 = 20_000_000;

#[derive(Clone, Copy)]
struct RemoteRequest {
    at: i64,
    frame: u64,
    node: NodeId,
    id: CanId,
    state: NmtState,
}

struct PdoRtr {
    limit: i64,
    open: BySlot<Option<RemoteRequest>>,
}

fn new(policy: &RulePolicy) -> PdoRtr {
    PdoRtr { limit: policy.tolerance_ns(&DECLARATION, "error-ms"), open: BySlot::default() }
}

impl PdoRtr {
    #[cold]
    fn on_request(&mut self, event: &Event, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let (Some(id), Some(node), Some(slot)) =
            (event.node, context.event_node(event), context.traffic.current_slot())
        else {
            return;
        };
        let cob_id = confirmed_number(node, pdo.name.communication_index(), 1);
        let permits = cob_id.is_some_and(|cob_id| cob_id & PRODUCES == 0);
        let Some(state) = context.confirmed_state(id) else { return };
        if pdo.name.direction == PdoDirection::Receive || state == NmtState::Operational && !permits {
            return;
        }
        let place = slot.place;
        if let Some(open) = self.open.entry_of(slot) {
            let request =
                RemoteRequest { at: context.now, frame: event.frames.last, node: id, id: pdo.cob_id, state };
            if open.is_none() {
                *open = Some(request);
                context.wake_at(context.now.saturating_add(self.limit), place as u64);
            }
        }
    }

    #[cold]
    fn on_answer(event: &Event, pdo: &DecodedPdo, request: RemoteRequest, context: &mut RuleContext<'_>) {
        if request.state == NmtState::Operational {
            return context.count_pass();
        }
        // The node may have become operational since the request.
        if context.now.saturating_sub(request.at) > ANSWER {
            return;
        }
        let frames = FrameRange { first: request.frame, last: event.frames.last };
        let alarm =
            context.start_finding(event).with_subject(FindingSubject::Id(pdo.cob_id)).with_frames(frames);
        alarm.report_finding(|| {
            format!("{} sent on a remote frame in NMT state {}", pdo.name, request.state.name())
        });
    }
}

impl Rule for PdoRtr {
    fn wants_pdos(&self) -> bool {
        self.open.iter().any(Option::is_some)
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::Pdo(pdo) = &event.kind else { return };
        if pdo.is_request {
            return self.on_request(event, pdo, context);
        }
        let place = context.traffic.current_slot().map(|slot| slot.place);
        let open = place.and_then(|place| self.open.get_mut(place)).and_then(Option::take);
        if let Some(request) = open {
            Self::on_answer(event, pdo, request, context);
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let place = usize::try_from(token).ok();
        let Some(open) = place.and_then(|place| self.open.get_mut(place)) else { return };
        let due = context.now.saturating_sub(self.limit);
        let Some(request) = open.take_if(|request| request.at <= due) else { return };
        if request.state != NmtState::Operational {
            return context.count_pass();
        }
        if context.confirmed_state(request.node) != Some(NmtState::Operational) {
            return;
        }
        let (at, limit) = (request.at.saturating_add(self.limit), self.limit / 1_000_000);
        let frames = FrameRange::one(request.frame);
        let alarm =
            context.fail_at(at, Some(request.node), frames).with_subject(FindingSubject::Id(request.id));
        alarm.report_finding(|| {
            format!("no TPDO within {limit} ms after the remote frame {{{}}}", request.frame)
        });
    }
}
