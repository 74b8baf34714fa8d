//! Gaps in cyclic commands.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::event::{
    Event, EventKind, FrameRange, J1939Message, Kind, MessageGap, Outcome, Pdo, ProcedurePhase, SdoTransfer,
};
use crate::finding::{About, Severity};
use crate::frame::CanId;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{BySlot, Context, Need, PdoSlot, PdoSubset, Policy, Rule};
use crate::wire::canopen::NmtState;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// The interval of a J1939 command approaches or exceeds the limit in the device manual, or a cyclic RPDO
    /// pauses for several of its usual intervals. It is a note while the NMT master stops, resets or
    /// configures the node, or while the node is not operational. A stream that ends with such an action, or
    /// with a procedure of the node, is not missing.
    ///
    /// # Why it matters
    /// Devices that monitor their commands block their outputs. Others continue with the last command.
    ///
    /// # Source
    /// Time limit of a message: device manual. A cyclic RPDO: its median interval.
    ///
    /// # What to look at first
    /// Check cycle time and load of the controller. Check whether all of its messages pause (`cobscope
    /// stats`).
    ///
    /// # Mutation
    /// drop ten cyclic RPDOs in a row
    "command-gap", Error, "gap in cyclic commands",
    kinds: [
        Kind::Pdo, Kind::J1939Message, Kind::MessageGap, Kind::NmtCommand, Kind::SdoTransfer, Kind::Procedure,
    ],
    pdos: PdoSubset::Received,
    needs: "a cyclic RPDO, or a J1939 command with a time limit",
    is_timing: true,
    word: "GAP",
    tolerances: &[
        tolerance("warning-percent", 60.0, "%", "of the limit in the device manual, a warning; beyond the limit an error"),
        tolerance("median-times", 3.0, "", "multiple of the usual interval of an RPDO, a warning"),
        tolerance("least-ms", 10.0, "ms", "minimum gap of an RPDO; shorter gaps may come from the capturing interface"),
    ],
}

/// Minimum number of consecutive intervals near the median for a cyclic RPDO.
const REGULAR: u32 = 15;

/// Time after an action of the master in which it explains a gap, in nanoseconds.
const BEFORE: i64 = 1_000_000_000;

/// Maximum number of J1939 identifiers; further ones are only checked by `message-gap` events.
const AWAITED_LIMIT: usize = 4096;

/// Stream of one RPDO, stored by its index in [`crate::rules::Traffic`].
#[derive(Default)]
struct RpdoStream {
    /// Node, identifier and name, once the stream was cyclic.
    of: Option<(NodeId, CanId, String)>,
    /// Consecutive intervals near the median.
    regular: u32,
}

/// J1939 message that a device may monitor.
struct MonitoredMessage {
    of: Option<(NodeId, i64)>,
    last: Option<(i64, u64)>,
}

struct CommandGap {
    warning: f64,
    times: f64,
    least: i64,
    streams: BySlot<RpdoStream>,
    awaited: HashMap<CanId, MonitoredMessage, FixedState>,
    /// Time of the latest action of the master on a node, or on all nodes.
    busy: NodeMap<i64>,
    all_busy: Option<i64>,
}

fn new(policy: &Policy) -> CommandGap {
    CommandGap {
        warning: policy.tolerance(&DECLARATION, "warning-percent") / 100.0,
        times: policy.tolerance(&DECLARATION, "median-times"),
        least: policy.nanoseconds(&DECLARATION, "least-ms"),
        streams: BySlot::default(),
        awaited: HashMap::default(),
        busy: NodeMap::default(),
        all_busy: None,
    }
}

impl CommandGap {
    #[inline]
    fn pdo(&mut self, event: &Event, pdo: &Pdo, context: &mut Context<'_>) {
        let Some(slot) = context.traffic.current() else { return };
        let (Some(interval), Some(median)) = (slot.interval(), slot.median) else { return };
        let Some(stream) = self.streams.of(slot) else { return };
        if interval <= median.saturating_mul(2) {
            // A burst is not a cycle.
            let is_near = interval >= median / 2;
            stream.regular = if is_near { stream.regular.saturating_add(1) } else { 0 };
            if stream.regular == 0 {
                context.ask_again();
            }
            if stream.regular >= REGULAR {
                if stream.regular == REGULAR {
                    context.ask_again();
                }
                if stream.of.is_none() {
                    stream.of = event.node.map(|node| (node, pdo.cob_id, pdo.name.to_string()));
                }
                context.pass();
            }
            return;
        }
        let was_regular = std::mem::take(&mut stream.regular) >= REGULAR;
        context.ask_again();
        if was_regular && interval > self.limit(median) {
            self.gap(event, slot, (interval, median), context);
        }
    }

    /// Minimum length of a gap, in nanoseconds.
    fn limit(&self, median: i64) -> i64 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "a time to compare")]
        let limit = (median as f64 * self.times) as i64;
        limit.max(self.least)
    }

    #[cold]
    fn gap(
        &mut self,
        event: &Event,
        slot: &PdoSlot,
        (interval, median): (i64, i64),
        context: &mut Context<'_>,
    ) {
        let Some((node, _, name)) = self.streams.get(slot.place).and_then(|stream| stream.of.as_ref()) else {
            return;
        };
        let severity = self.severity(*node, context.now.saturating_sub(interval), context);
        let limit = self.limit(median);
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.fail(event).node(Some(*node)).measure(interval as f64).severity(severity);
        let alarm = alarm.about(About::Name(name.as_str().into())).frames(slot.between());
        alarm.report(|| {
            let [interval, limit, median] = [interval, limit, median].map(milliseconds);
            format!("{name} interval {interval} > {limit} (usual {median})")
        });
    }

    /// Severity of a gap that began at `from`: a note if the master was acting on the node.
    fn severity(&self, node: NodeId, from: i64, context: &Context<'_>) -> Severity {
        let is_wanted = self.is_wanted(node, from);
        let is_off = context.confirmed_state(node).is_some_and(|state| state != NmtState::Operational);
        if is_wanted || is_off { Severity::Note } else { Severity::Warning }
    }

    /// Whether the master acted on the node, or a procedure of the node ended, at or after `from`.
    fn is_wanted(&self, node: NodeId, from: i64) -> bool {
        let times = self.all_busy.into_iter().chain(self.busy.get(node).copied());
        times.max().is_some_and(|time| time >= from.saturating_sub(BEFORE))
    }

    fn message(&mut self, event: &Event, message: &J1939Message, context: &mut Context<'_>) {
        if !self.awaited.contains_key(&message.can_id) && self.awaited.len() >= AWAITED_LIMIT {
            return;
        }
        let entry = self.awaited.entry(message.can_id);
        let awaited =
            entry.or_insert_with(|| MonitoredMessage { of: context.bus.awaited(message.can_id), last: None });
        let Some((node, limit)) = awaited.of else { return };
        let (now, frame) = (context.now, event.frames.last);
        let Some((last, before)) = awaited.last.replace((now, frame)) else { return };
        let interval = now.saturating_sub(last);
        #[expect(clippy::cast_precision_loss, reason = "times to compare")]
        let share = interval as f64 / limit.max(1) as f64;
        if share <= self.warning {
            return context.pass();
        }
        if context.is_across_hole(before) {
            return;
        }
        // A `message-gap` event reports longer intervals.
        if share <= 1.0 {
            let frames = FrameRange { first: before, last: frame };
            let alarm = context.fail(event).node(Some(node)).severity(Severity::Warning).frames(frames);
            let alarm = alarm.about(About::Pgn(message.id.pgn.number())).measure(share);
            alarm.report(|| {
                let name = message.name.as_deref().unwrap_or("message");
                let ([interval, limit], percent) =
                    ([interval, limit].map(milliseconds), self.warning * 100.0);
                format!("{name} interval {interval} > {percent:.0} % of the limit {limit}")
            });
        }
    }

    fn message_gap(event: &Event, gap: &MessageGap, context: &mut Context<'_>) {
        #[expect(clippy::cast_precision_loss, reason = "times to compare")]
        let share = gap.gap as f64 / gap.limit.max(1) as f64;
        let alarm = context.fail(event).about(About::Pgn(gap.pgn.number())).measure(share);
        alarm.report(|| {
            let [length, limit] = [gap.gap, gap.limit].map(milliseconds);
            let usual =
                gap.usual.map_or_else(String::new, |(usual, _)| format!(" (usual {})", milliseconds(usual)));
            let missing = if gap.came_again { "" } else { " and missing until the end of the capture" };
            format!("{} interval {length} > {limit}{usual}{missing}", gap.message)
        });
    }

    fn transfer(&mut self, event: &Event, transfer: &SdoTransfer, now: i64) {
        // Communication and mapping parameters of PDOs (CiA 301 §7.5.2.35 to §7.5.2.38).
        let is_remap = transfer.object.is_some_and(|object| matches!(object.index, 0x1400..=0x1BFF));
        if is_remap
            && transfer.outcome == Outcome::Complete
            && let Some(time) = event.node.and_then(|node| self.busy.entry(node))
        {
            *time = now;
        }
    }
}

fn milliseconds(time: i64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "a time to read")]
    let milliseconds = time as f64 / 1e6;
    if milliseconds < 10.0 { format!("{milliseconds:.1} ms") } else { format!("{milliseconds:.0} ms") }
}

impl Rule for CommandGap {
    fn need(&self, event: &Event, context: &Context<'_>) -> Need {
        if let EventKind::J1939Message(message) = &event.kind {
            let is_awaited = self.awaited.get(&message.can_id).is_some_and(|awaited| awaited.of.is_some());
            return if is_awaited { Need::EACH } else { Need::NOTHING };
        }
        if event.presumed {
            return Need::EACH;
        }
        let Some(slot) = context.traffic.current() else { return Need::EACH };
        let stream = self.streams.get(slot.place).filter(|stream| stream.regular >= REGULAR);
        let need = match (slot.median, stream) {
            (Some(median), Some(_)) => {
                Need { shortest: median / 2, longest: median.saturating_mul(2), ..Need::PASSED }
            }
            _ => Need::EACH,
        };
        Need { follows_interval: true, ..need }
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) if !event.presumed => self.pdo(event, pdo, context),
            EventKind::J1939Message(message) if message.layout.is_some() => {
                self.message(event, message, context);
            }
            EventKind::MessageGap(gap) => Self::message_gap(event, gap, context),
            EventKind::SdoTransfer(transfer) => self.transfer(event, transfer, context.now),
            EventKind::Procedure(procedure) if procedure.phase == ProcedurePhase::Finished => {
                if let Some(time) = event.node.and_then(|node| self.busy.entry(node)) {
                    *time = context.now;
                }
            }
            EventKind::NmtCommand { service: NmtService::Start, .. } => {}
            EventKind::NmtCommand { target: 0, .. } => self.all_busy = Some(context.now),
            EventKind::NmtCommand { target, .. } => {
                if let Some(time) = self.busy.entry(NodeId::Canopen(*target)) {
                    *time = context.now;
                }
            }
            _ => {}
        }
    }

    fn finish(&mut self, context: &mut Context<'_>) {
        for stream in self.streams.iter().filter(|stream| stream.regular >= REGULAR) {
            let Some((node, id, name)) = &stream.of else { continue };
            let Some((slot, median)) = context.pdos_of(*id).and_then(|slot| Some((slot, slot.median?)))
            else {
                continue;
            };
            let (last, frame, gap) = (slot.last, slot.frames.0, context.now.saturating_sub(slot.last));
            if gap <= self.limit(median) || self.is_wanted(*node, last) {
                continue;
            }
            let severity = self.severity(*node, last, context);
            let (since, limit) = (context.timestamp_of(last), self.limit(median));
            #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
            let alarm = context.fail_at(context.now, Some(*node), FrameRange::one(frame)).measure(gap as f64);
            let alarm = alarm.about(About::Name(name.as_str().into())).severity(severity).since(since);
            alarm.report(|| {
                let [limit, median] = [limit, median].map(milliseconds);
                format!("{name} missing (limit {limit}, usual {median})")
            });
        }
    }
}
