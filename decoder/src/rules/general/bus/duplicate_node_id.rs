//! Two devices with the same node-ID.

use crate::event::{BootCause, Event, EventKind, FrameRange, Kind, SdoOutcome, SdoTransfer};
use crate::rules::general::facts::confirmed_number;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// The heartbeat state of a node alternates between two values without an NMT command. Or its heartbeat
    /// intervals alternate between two phases of the producer time (1017), it boots twice within 500 ms, its
    /// heartbeats continue in state and phase after a boot-up, or two SDO responses with different values answer one
    /// request.
    /// Equal intervals are exempt, since one producer with half the time sends the same.
    ///
    /// # Why it matters
    /// Two devices respond to the same SDO requests and execute the same commands. Settings for one device
    /// reach both.
    ///
    /// # Source
    /// CiA 301 §7.3.3 (node-IDs are unique), §7.2.8.3.2.2 (heartbeat)
    ///
    /// # What to look at first
    /// Check rotary switches and stored node-IDs of all devices. A spare part may still have its factory
    /// node-ID.
    ///
    /// # Mutation
    /// insert a second series of heartbeats with another state
    "duplicate-node-id", Error, "node-ID used by two devices",
    kinds: [Kind::Heartbeat, Kind::NmtCommand, Kind::BootUp, Kind::SdoTransfer],
    needs: "heartbeats, a boot-up or an SDO transfer",
    is_timing: true,
    word: "TWICE",
    tolerances: &[define_tolerance("changes", 6.0, "", "consecutive alternations of heartbeats before a finding")],
}

/// Minimum start-up time of a device, in nanoseconds.
const STARTING: i64 = 500_000_000;

/// Latest heartbeats of a node.
#[derive(Default)]
struct HeartbeatWatch {
    states: [Option<NmtState>; 2],
    /// Consecutive changes of the state, and the frame of the first one.
    changes: u32,
    first: u64,
    last: Option<i64>,
    intervals: [i64; 2],
    phases: u32,
    booted: Option<(i64, u64)>,
}

/// Heartbeats before a boot-up. A device that restarts sends its next ones in another phase.
#[derive(Clone, Copy)]
struct SteadyHeartbeats {
    /// Time of the last one, period and tolerance, in nanoseconds.
    last: i64,
    period: i64,
    tolerance: i64,
    state: Option<NmtState>,
    /// Frame of the boot-up.
    boot: u64,
    /// Heartbeats after the boot-up that continue the earlier ones.
    continued: u32,
}

/// Heartbeats that must continue the earlier ones after a boot-up.
const CONTINUED: u32 = 2;

/// Minimum tolerance of a phase, in nanoseconds.
const PHASE_TOLERANCE: i64 = 1_000_000;

impl SteadyHeartbeats {
    /// Distance from the phase of the earlier heartbeats, in nanoseconds.
    fn phase_error(&self, time: i64) -> i64 {
        let rest = time.saturating_sub(self.last).rem_euclid(self.period);
        rest.min(self.period.saturating_sub(rest))
    }

    /// Whether a heartbeat after the boot-up proves a second device.
    fn is_proven_by(&mut self, time: i64, state: Option<NmtState>) -> bool {
        let continues = state == self.state && self.phase_error(time) <= self.tolerance;
        self.continued += u32::from(continues);
        continues && self.continued == CONTINUED
    }
}

struct DuplicateNodeId {
    changes: u32,
    watches: NodeMap<HeartbeatWatch>,
    /// Heartbeats before the last boot-up of each node.
    steady: NodeMap<SteadyHeartbeats>,
    /// Last SDO response of each node.
    responses: NodeMap<SdoResponse>,
}

/// Value in an SDO response.
#[derive(Default)]
struct SdoResponse {
    object: Option<ObjectAddress>,
    value: Vec<u8>,
    frame: u64,
}

fn new(policy: &RulePolicy) -> DuplicateNodeId {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let changes = policy.tolerance_value(&DECLARATION, "changes") as u32;
    DuplicateNodeId {
        changes: changes.max(2),
        watches: NodeMap::default(),
        steady: NodeMap::default(),
        responses: NodeMap::default(),
    }
}

impl HeartbeatWatch {
    /// Whether this heartbeat continues an alternation between two states.
    fn takes_turn(&mut self, state: Option<NmtState>) -> bool {
        let [last, before] = self.states;
        self.states = [state, last];
        last.is_some() && state != last && (before.is_none() || state == before)
    }

    /// Whether this heartbeat continues an alternation between two phases of the producer time.
    fn is_phase(&mut self, now: i64, time: Option<i64>) -> bool {
        let interval = self.last.replace(now).map_or(0, |last| now.saturating_sub(last));
        let [last, before] = self.intervals;
        self.intervals = [interval, last];
        let Some(time) = time else { return false };
        let tolerance = time / 20;
        let both = interval.saturating_add(last);
        (both - time).abs() <= tolerance
            && (interval - before).abs() <= tolerance
            && (interval - last).abs() > tolerance
    }

    /// Heartbeats before a boot-up at `now`, if their period is steady and the boot-up is not in their phase.
    fn steady_heartbeats(&self, now: i64, boot: u64) -> Option<SteadyHeartbeats> {
        let ([period, before], [state, other]) = (self.intervals, self.states);
        let jitter = (period - before).abs();
        if period <= 0 || before <= 0 || jitter > period / 25 || state != other {
            return None;
        }
        let tolerance = jitter.saturating_mul(4).saturating_add(PHASE_TOLERANCE).min(period / 25);
        let steady = SteadyHeartbeats { last: self.last?, period, tolerance, state, boot, continued: 0 };
        (steady.phase_error(now) > tolerance.saturating_mul(2)).then_some(steady)
    }

    fn forget_heartbeats(&mut self) {
        *self = Self { booted: self.booted, ..Self::default() };
    }
}

impl DuplicateNodeId {
    fn on_heartbeat(
        &mut self,
        event: &Event,
        node: NodeId,
        state: Option<NmtState>,
        context: &mut RuleContext<'_>,
    ) {
        let time = context
            .event_node(event)
            .and_then(|node| confirmed_number(node, 0x1017, 0))
            .filter(|time| *time > 0);
        let time = time.and_then(|time| i64::try_from(time).ok()).map(|time| time.saturating_mul(1_000_000));
        let limit = self.changes;
        if let Some(steady) = self.steady.get_mut(node)
            && steady.is_proven_by(context.now, state)
        {
            let frames = FrameRange { first: steady.boot, last: event.frames.last };
            let period = crate::rules::general::facts::to_milliseconds(steady.period);
            context.start_finding(event).with_frames(frames).report_finding(|| {
                format!(
                    "boot-up between heartbeats that continue every {period} ms in the same state and phase"
                )
            });
            return;
        }
        let Some(watch) = self.watches.entry(node) else { return };
        let takes_turn = watch.takes_turn(state);
        if !takes_turn || watch.changes == 0 {
            watch.first = event.frames.first;
        }
        watch.changes = if takes_turn { watch.changes + 1 } else { 0 };
        watch.phases = if watch.is_phase(context.now, time) { watch.phases + 1 } else { 0 };
        let frames = FrameRange { first: watch.first, last: event.frames.last };
        if watch.changes == limit {
            let [one, other] = watch.states.map(|state| state.map_or("unknown", NmtState::name));
            context.start_finding(event).with_frames(frames).report_finding(|| {
                format!(
                    "heartbeat state alternates between {other} and {one} without a command ({limit} changes)"
                )
            });
        } else if watch.phases == limit {
            let [one, other] = watch.intervals.map(crate::rules::general::facts::to_milliseconds);
            let time = time.map_or(0, crate::rules::general::facts::to_milliseconds);
            context.start_finding(event).report_finding(|| {
                format!("heartbeat intervals alternate between {other} ms and {one} ms (1017:00 = {time} ms)")
            });
        } else if watch.changes == 0 && watch.phases == 0 {
            context.count_pass();
        }
    }

    fn on_boot(&mut self, event: &Event, node: NodeId, cause: BootCause, context: &mut RuleContext<'_>) {
        let Some(watch) = self.watches.entry(node) else { return };
        let before = watch.booted.replace((context.now, event.frames.last));
        let steady = watch.steady_heartbeats(context.now, event.frames.last).filter(|_| context.has_time);
        watch.forget_heartbeats();
        match steady.filter(|_| matches!(cause, BootCause::PresumedPowerOn { .. })) {
            Some(steady) => self.steady.insert(node, steady),
            None => drop(self.steady.remove(node)),
        }
        let Some((at, frame)) = before.filter(|_| matches!(cause, BootCause::PresumedPowerOn { .. })) else {
            return;
        };
        let after = context.now.saturating_sub(at);
        if after < STARTING && context.has_time {
            let frames = FrameRange { first: frame, last: event.frames.last };
            let milliseconds = crate::rules::general::facts::to_milliseconds(after);
            context.start_finding(event).with_frames(frames).report_finding(|| {
                format!("second boot-up after {milliseconds} ms (min 500 ms for one device)")
            });
        }
    }
}

impl DuplicateNodeId {
    /// Compares the value of a response without a request of its own with that of the response before it.
    fn on_transfer(
        &mut self,
        event: &Event,
        node: NodeId,
        transfer: &SdoTransfer,
        context: &mut RuleContext<'_>,
    ) {
        let Some(last) = self.responses.entry(node) else { return };
        let is_whole = transfer.outcome == SdoOutcome::Complete && transfer.object.is_some();
        if transfer.is_unrequested
            && is_whole
            && last.object == transfer.object
            && last.value != transfer.data
        {
            let (request, object) = (transfer.request, transfer.object);
            let frames = FrameRange { first: last.frame, last: event.frames.last };
            context.start_finding(event).with_frames(frames).report_finding(|| {
                let object = object.map(|object| object.to_string()).unwrap_or_default();
                format!("two different responses to one request on {request} for {object}")
            });
        } else if !transfer.is_unrequested {
            let value = if is_whole { transfer.data.clone() } else { Vec::new() };
            let object = transfer.object.filter(|_| is_whole);
            *last = SdoResponse { object, value, frame: event.frames.last };
        }
    }
}

impl Rule for DuplicateNodeId {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Heartbeat { state, .. }, Some(node)) => {
                self.on_heartbeat(event, node, *state, context);
            }
            (EventKind::SdoTransfer(transfer), Some(node)) => {
                self.on_transfer(event, node, transfer, context);
            }
            (EventKind::BootUp { cause, .. }, Some(node)) => self.on_boot(event, node, *cause, context),
            (EventKind::NmtCommand { target: 0, .. }, _) => self.watches = NodeMap::default(),
            (EventKind::NmtCommand { .. }, Some(node)) => {
                if let Some(watch) = self.watches.get_mut(node) {
                    watch.forget_heartbeats();
                }
            }
            _ => {}
        }
    }
}
