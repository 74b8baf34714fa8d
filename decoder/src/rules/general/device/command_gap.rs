//! A stream of commands pauses.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::event::{Event, EventKind, FrameRange, J1939Message, MessageGap, Outcome, Pdo, SdoTransfer};
use crate::finding::{About, Severity};
use crate::frame::CanId;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{BySlot, Context, NodeMap, PdoSlot, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::nmt::NmtService;

declare_rule! {
    /// # What it checks
    /// A J1939 command comes later than the device's manual permits, or nearly so; an RPDO that came regularly
    /// pauses for several of its usual intervals, or for good. Just a note while the NMT master itself stops, resets
    /// or configures that node, or the node is not operational.
    ///
    /// # Why it matters
    /// Devices that watch their commands block their outputs; others go on with the last command.
    ///
    /// # Source
    /// Time of a message: the device's manual. An RPDO that is sent cyclically: its own median interval.
    ///
    /// # What to look at first
    /// Cycle time and load of the controller in that moment; whether everything it sends pauses (`cobscope stats`).
    ///
    /// # Mutation
    /// drop ten cyclic RPDOs in a row
    "command-gap", Error, "a stream of commands pauses",
    kinds: ["rpdo", "j1939-message", "message-gap", "nmt-command", "sdo-transfer"],
    is_timing: true,
    word: "GAP",
    tolerances: &[
        tolerance("warning-percent", 60.0, "%", "of the time a device's manual gives, a warning; beyond it an error"),
        tolerance("median-times", 3.0, "", "usual intervals of an RPDO, a warning"),
        tolerance("least-ms", 10.0, "ms", "of an RPDO's gap: below it recorders are as likely to blame"),
    ],
}

/// Intervals in a row near the median that make an RPDO a cyclic one.
const REGULAR: u32 = 15;

/// The master's own doing explains a gap that begins so much later, in nanoseconds.
const BEFORE: i64 = 1_000_000_000;

/// J1939 messages looked up; further ones are judged by their gaps only.
const AWAITED_LIMIT: usize = 4096;

/// An RPDO by its place in [`crate::rules::Traffic`].
#[derive(Default)]
struct Stream {
    /// What and whose it is, once it was regular.
    of: Option<(NodeId, CanId, String)>,
    /// Intervals in a row near the median.
    regular: u32,
}

/// A J1939 message a device may wait for.
struct Awaited {
    of: Option<(NodeId, i64)>,
    last: Option<(i64, u64)>,
}

struct CommandGap {
    warning: f64,
    times: f64,
    least: i64,
    streams: BySlot<Stream>,
    awaited: HashMap<CanId, Awaited, FixedState>,
    /// When the master last did something to a node, or to all.
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
        let (Some(interval), Some(median)) = (slot.interval, slot.median) else { return };
        let Some(stream) = self.streams.of(slot) else { return };
        if interval <= median.saturating_mul(2) {
            // A burst is no cycle.
            let is_near = interval >= median / 2;
            stream.regular = if is_near { stream.regular.saturating_add(1) } else { 0 };
            if stream.regular >= REGULAR {
                if stream.of.is_none() {
                    stream.of = event.node.map(|node| (node, pdo.cob_id, pdo.name.to_string()));
                }
                context.pass();
            }
            return;
        }
        let was_regular = std::mem::take(&mut stream.regular) >= REGULAR;
        if was_regular && interval > self.limit(median) {
            self.gap(event, slot, (interval, median), context);
        }
    }

    /// From which length on an interval is a gap.
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
        alarm.say(|| {
            let [interval, limit, median] = [interval, limit, median].map(milliseconds);
            format!("{name} after {interval} > {limit} (usual {median})")
        });
    }

    /// A gap that begins at `from` is what the master wants while it is busy with the node.
    fn severity(&self, node: NodeId, from: i64, context: &Context<'_>) -> Severity {
        let times = self.all_busy.into_iter().chain(self.busy.get(node).copied());
        let is_wanted = times.max().is_some_and(|time| time >= from.saturating_sub(BEFORE));
        let is_off = context.confirmed_state(node).is_some_and(|state| state != NmtState::Operational);
        if is_wanted || is_off { Severity::Note } else { Severity::Warning }
    }

    fn message(&mut self, event: &Event, message: &J1939Message, context: &mut Context<'_>) {
        if !self.awaited.contains_key(&message.can_id) && self.awaited.len() >= AWAITED_LIMIT {
            return;
        }
        let entry = self.awaited.entry(message.can_id);
        let awaited =
            entry.or_insert_with(|| Awaited { of: context.bus.awaited(message.can_id), last: None });
        let Some((node, limit)) = awaited.of else { return };
        let (now, frame) = (context.now, event.frames.last);
        let Some((last, before)) = awaited.last.replace((now, frame)) else { return };
        let interval = now.saturating_sub(last);
        #[expect(clippy::cast_precision_loss, reason = "times to compare")]
        let share = interval as f64 / limit.max(1) as f64;
        if share <= self.warning {
            return context.pass();
        }
        // Beyond the limit it is told as a gap.
        if share <= 1.0 {
            let frames = FrameRange { first: before, last: frame };
            let alarm = context.fail(event).node(Some(node)).severity(Severity::Warning).frames(frames);
            let alarm = alarm.about(About::Pgn(message.id.pgn.number())).measure(share);
            alarm.say(|| {
                let name = message.name.as_deref().unwrap_or("message");
                let [interval, limit] = [interval, limit].map(milliseconds);
                format!("{name} after {interval}, {limit} are permitted")
            });
        }
    }

    fn message_gap(event: &Event, gap: &MessageGap, context: &mut Context<'_>) {
        #[expect(clippy::cast_precision_loss, reason = "times to compare")]
        let share = gap.gap as f64 / gap.limit.max(1) as f64;
        let alarm = context.fail(event).about(About::Pgn(gap.pgn.number())).measure(share);
        alarm.say(|| {
            let [length, limit] = [gap.gap, gap.limit].map(milliseconds);
            let usual =
                gap.usual.map_or_else(String::new, |(usual, _)| format!(" (usual {})", milliseconds(usual)));
            let missing = if gap.came_again { "" } else { ", missing until the end" };
            format!("{}: {length} > {limit}{usual}{missing}", gap.message)
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
    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) if !event.presumed => self.pdo(event, pdo, context),
            EventKind::J1939Message(message) if message.layout.is_some() => {
                self.message(event, message, context);
            }
            EventKind::MessageGap(gap) => Self::message_gap(event, gap, context),
            EventKind::SdoTransfer(transfer) => self.transfer(event, transfer, context.now),
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
            let Some((slot, median)) = context.traffic.of(*id).and_then(|slot| Some((slot, slot.median?)))
            else {
                continue;
            };
            let (last, frame, gap) = (slot.last, slot.frames.0, context.now.saturating_sub(slot.last));
            if gap <= self.limit(median) {
                continue;
            }
            let severity = self.severity(*node, last, context);
            #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
            let alarm = context.fail_at(context.now, Some(*node), FrameRange::one(frame)).measure(gap as f64);
            let alarm = alarm.about(About::Name(name.as_str().into())).severity(severity);
            alarm.say(|| {
                let [gap, median] = [gap, median].map(milliseconds);
                format!("{name} missing for {gap} until the end (usual {median})")
            });
        }
    }
}
