//! Gaps in cyclic commands.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::event::{
    DecodedPdo, Event, EventKind, FrameRange, J1939Message, Kind, MessageGap, ProcedurePhase, SdoOutcome,
    SdoTransfer,
};
use crate::finding::{FindingSubject, Severity};
use crate::frame::CanId;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{BySlot, FrameNeed, PdoSlot, PdoSubset, Rule, RuleContext, RulePolicy};
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
        define_tolerance("warning-percent", 60.0, "%", "of the limit in the device manual, a warning; beyond the limit an error"),
        define_tolerance("median-times", 3.0, "", "multiple of the usual interval of an RPDO, a warning"),
        define_tolerance("least-ms", 10.0, "ms", "minimum gap of an RPDO; shorter gaps may come from the capturing interface"),
    ],
}

/// Minimum number of consecutive intervals near the median for a cyclic RPDO.
const REGULAR: u32 = 15;

/// Time after an action of the master in which it explains a gap, in nanoseconds.
const BEFORE: i64 = 1_000_000_000;

/// Maximum number of J1939 identifiers; further ones are only checked by `message-gap` events.
const AWAITED_LIMIT: usize = 4096;

/// Stream of one RPDO, stored by its index in [`crate::rules::PdoTraffic`].
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

fn new(policy: &RulePolicy) -> CommandGap {
    CommandGap {
        warning: policy.tolerance_value(&DECLARATION, "warning-percent") / 100.0,
        times: policy.tolerance_value(&DECLARATION, "median-times"),
        least: policy.tolerance_ns(&DECLARATION, "least-ms"),
        streams: BySlot::default(),
        awaited: HashMap::default(),
        busy: NodeMap::default(),
        all_busy: None,
    }
}

impl CommandGap {
    #[inline]
    fn on_pdo(&mut self, event: &Event, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let Some(slot) = context.traffic.current_slot() else { return };
        let (Some(interval), Some(median)) = (slot.interval(), slot.median) else { return };
        let Some(stream) = self.streams.entry_of(slot) else { return };
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
                context.count_pass();
            }
            return;
        }
        let was_regular = std::mem::take(&mut stream.regular) >= REGULAR;
        context.ask_again();
        if was_regular && interval > self.min_gap(median) {
            self.on_gap(event, slot, (interval, median), context);
        }
    }

    /// Minimum length of a gap, in nanoseconds.
    fn min_gap(&self, median: i64) -> i64 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "a time to compare")]
        let limit = (median as f64 * self.times) as i64;
        limit.max(self.least)
    }

    #[cold]
    fn on_gap(
        &mut self,
        event: &Event,
        slot: &PdoSlot,
        (interval, median): (i64, i64),
        context: &mut RuleContext<'_>,
    ) {
        let Some((node, _, name)) = self.streams.get(slot.place).and_then(|stream| stream.of.as_ref()) else {
            return;
        };
        let severity = self.gap_severity(*node, context.now.saturating_sub(interval), context);
        let limit = self.min_gap(median);
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context
            .start_finding(event)
            .at_node(Some(*node))
            .with_measure(interval as f64)
            .with_severity(severity);
        let alarm =
            alarm.with_subject(FindingSubject::Name(name.as_str().into())).with_frames(slot.frames_between());
        alarm.report_finding(|| {
            let [interval, limit, median] = [interval, limit, median].map(milliseconds_text);
            format!("{name} interval {interval} > {limit} (usual {median})")
        });
    }

    /// Severity of a gap that began at `from`: a note if the master was acting on the node.
    fn gap_severity(&self, node: NodeId, from: i64, context: &RuleContext<'_>) -> Severity {
        let is_wanted = self.is_wanted(node, from);
        let is_off = context.confirmed_state(node).is_some_and(|state| state != NmtState::Operational);
        if is_wanted || is_off { Severity::Note } else { Severity::Warning }
    }

    /// Whether the master acted on the node, or a procedure of the node ended, at or after `from`.
    fn is_wanted(&self, node: NodeId, from: i64) -> bool {
        let times = self.all_busy.into_iter().chain(self.busy.get(node).copied());
        times.max().is_some_and(|time| time >= from.saturating_sub(BEFORE))
    }

    fn on_message(&mut self, event: &Event, message: &J1939Message, context: &mut RuleContext<'_>) {
        if !self.awaited.contains_key(&message.can_id) && self.awaited.len() >= AWAITED_LIMIT {
            return;
        }
        let entry = self.awaited.entry(message.can_id);
        let awaited = entry.or_insert_with(|| MonitoredMessage {
            of: context.bus.identifiers().awaited_message(message.can_id),
            last: None,
        });
        let Some((node, limit)) = awaited.of else { return };
        let (now, frame) = (context.now, event.frames.last);
        let Some((last, before)) = awaited.last.replace((now, frame)) else { return };
        let interval = now.saturating_sub(last);
        #[expect(clippy::cast_precision_loss, reason = "times to compare")]
        let share = interval as f64 / limit.max(1) as f64;
        if share <= self.warning {
            return context.count_pass();
        }
        if context.is_across_hole(before) {
            return;
        }
        // A `message-gap` event reports longer intervals.
        if share <= 1.0 {
            let frames = FrameRange { first: before, last: frame };
            let alarm = context
                .start_finding(event)
                .at_node(Some(node))
                .with_severity(Severity::Warning)
                .with_frames(frames);
            let alarm = alarm.with_subject(FindingSubject::Pgn(message.id.pgn.number())).with_measure(share);
            alarm.report_finding(|| {
                let name = message.name.as_deref().unwrap_or("message");
                let ([interval, limit], percent) =
                    ([interval, limit].map(milliseconds_text), self.warning * 100.0);
                format!("{name} interval {interval} > {percent:.0} % of the limit {limit}")
            });
        }
    }

    fn message_gap(event: &Event, gap: &MessageGap, context: &mut RuleContext<'_>) {
        #[expect(clippy::cast_precision_loss, reason = "times to compare")]
        let share = gap.gap as f64 / gap.limit.max(1) as f64;
        let alarm = context
            .start_finding(event)
            .with_subject(FindingSubject::Pgn(gap.pgn.number()))
            .with_measure(share);
        alarm.report_finding(|| {
            let [length, limit] = [gap.gap, gap.limit].map(milliseconds_text);
            let usual = gap
                .usual
                .map_or_else(String::new, |(usual, _)| format!(" (usual {})", milliseconds_text(usual)));
            let missing = if gap.has_returned { "" } else { " and missing until the end of the capture" };
            format!("{} interval {length} > {limit}{usual}{missing}", gap.message)
        });
    }

    fn on_transfer(&mut self, event: &Event, transfer: &SdoTransfer, now: i64) {
        // Communication and mapping parameters of PDOs (CiA 301 §7.5.2.35 to §7.5.2.38).
        let is_remap = transfer.object.is_some_and(|object| matches!(object.index, 0x1400..=0x1BFF));
        if is_remap
            && transfer.outcome == SdoOutcome::Complete
            && let Some(time) = event.node.and_then(|node| self.busy.entry(node))
        {
            *time = now;
        }
    }
}

fn milliseconds_text(time: i64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "a time to read")]
    let milliseconds = time as f64 / 1e6;
    if milliseconds < 10.0 { format!("{milliseconds:.1} ms") } else { format!("{milliseconds:.0} ms") }
}

impl Rule for CommandGap {
    fn frame_need(&self, event: &Event, context: &RuleContext<'_>) -> FrameNeed {
        if let EventKind::J1939Message(message) = &event.kind {
            let is_awaited = self.awaited.get(&message.can_id).is_some_and(|awaited| awaited.of.is_some());
            return if is_awaited { FrameNeed::EACH } else { FrameNeed::NOTHING };
        }
        if event.presumed {
            return FrameNeed::EACH;
        }
        let Some(slot) = context.traffic.current_slot() else { return FrameNeed::EACH };
        let stream = self.streams.get(slot.place).filter(|stream| stream.regular >= REGULAR);
        let need = match (slot.median, stream) {
            (Some(median), Some(_)) => {
                FrameNeed { shortest: median / 2, longest: median.saturating_mul(2), ..FrameNeed::PASSED }
            }
            _ => FrameNeed::EACH,
        };
        FrameNeed { follows_interval: true, ..need }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) if !event.presumed => self.on_pdo(event, pdo, context),
            EventKind::J1939Message(message) if message.layout.is_some() => {
                self.on_message(event, message, context);
            }
            EventKind::MessageGap(gap) => Self::message_gap(event, gap, context),
            EventKind::SdoTransfer(transfer) => self.on_transfer(event, transfer, context.now),
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

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        for stream in self.streams.iter().filter(|stream| stream.regular >= REGULAR) {
            let Some((node, id, name)) = &stream.of else { continue };
            let Some((slot, median)) = context.pdos_of(*id).and_then(|slot| Some((slot, slot.median?)))
            else {
                continue;
            };
            let (last, frame, gap) = (slot.last, slot.frames.0, context.now.saturating_sub(slot.last));
            if gap <= self.min_gap(median) || self.is_wanted(*node, last) {
                continue;
            }
            let severity = self.gap_severity(*node, last, context);
            let (since, limit) = (context.timestamp_of(last), self.min_gap(median));
            #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
            let alarm =
                context.fail_at(context.now, Some(*node), FrameRange::one(frame)).with_measure(gap as f64);
            let alarm = alarm
                .with_subject(FindingSubject::Name(name.as_str().into()))
                .with_severity(severity)
                .started_at(since);
            alarm.report_finding(|| {
                let [limit, median] = [limit, median].map(milliseconds_text);
                format!("{name} missing (limit {limit}, usual {median})")
            });
        }
    }
}
