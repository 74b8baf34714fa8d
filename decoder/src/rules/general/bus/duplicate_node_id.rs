//! Two devices have one node-ID.

use crate::event::{BootCause, Event, EventKind, FrameRange};
use crate::rules::general::facts::sure;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

declare_rule! {
    /// # What it checks
    /// Heartbeats of a node tell two states in turn for several times without a command; or they come in two phases
    /// of the producer time (1017) in turn; or a node starts twice within half a second.
    ///
    /// # Why it matters
    /// Two devices answer the same SDO requests and obey the same commands; settings meant for one go to both.
    ///
    /// # Source
    /// CiA 301 §7.3.3 (node-IDs are unique), §7.2.8.3.2.2 (heartbeat)
    ///
    /// # What to look at first
    /// Rotary switches and stored node-IDs; a spare part that still has its delivered node-ID.
    ///
    /// # Mutation
    /// insert a second series of heartbeats with another state
    "duplicate-node-id", Error, "two devices have one node-ID",
    kinds: ["heartbeat", "nmt-command", "boot-up"],
    is_timing: true,
    word: "TWICE",
    tolerances: &[tolerance("changes", 6.0, "", "of heartbeats in turn before it is said")],
}

/// A device does not start twice within this time, in nanoseconds.
const STARTING: i64 = 500_000_000;

/// The last heartbeats of a node.
#[derive(Default)]
struct Watch {
    states: [Option<NmtState>; 2],
    /// Changes of the state in a row, and the frame of the first.
    changes: u32,
    first: u64,
    last: Option<i64>,
    intervals: [i64; 2],
    phases: u32,
    booted: Option<(i64, u64)>,
}

struct DuplicateNodeId {
    changes: u32,
    watches: NodeMap<Watch>,
}

fn new(policy: &Policy) -> DuplicateNodeId {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let changes = policy.tolerance(&DECLARATION, "changes") as u32;
    DuplicateNodeId { changes: changes.max(2), watches: NodeMap::default() }
}

impl Watch {
    /// Whether this heartbeat goes on with two states in turn.
    fn takes_turn(&mut self, state: Option<NmtState>) -> bool {
        let [last, before] = self.states;
        self.states = [state, last];
        last.is_some() && state != last && (before.is_none() || state == before)
    }

    /// Whether this heartbeat goes on with two phases in turn of a producer time.
    fn is_phase(&mut self, now: i64, time: Option<i64>) -> bool {
        let interval = self.last.replace(now).map_or(0, |last| now.saturating_sub(last));
        let [last, before] = self.intervals;
        self.intervals = [interval, last];
        let Some(time) = time else { return false };
        let tolerance = time / 20;
        let both = interval.saturating_add(last);
        (both - time).abs() <= tolerance
            && (interval - before).abs() <= tolerance
            && interval < time - tolerance
    }

    fn forget(&mut self) {
        *self = Self { booted: self.booted, ..Self::default() };
    }
}

impl DuplicateNodeId {
    fn heartbeat(&mut self, event: &Event, node: NodeId, state: Option<NmtState>, context: &mut Context<'_>) {
        let time = context.node(event).and_then(|node| sure(node, 0x1017, 0)).filter(|time| *time > 0);
        let time = time.and_then(|time| i64::try_from(time).ok()).map(|time| time.saturating_mul(1_000_000));
        let limit = self.changes;
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
            context.fail(event).frames(frames).say(|| {
                format!("heartbeats say {other} and {one} in turn, {limit} times, and nobody commands it")
            });
        } else if watch.phases == limit {
            let [one, other] = watch.intervals.map(crate::rules::general::facts::milliseconds);
            let time = time.map_or(0, crate::rules::general::facts::milliseconds);
            context.fail(event).say(|| {
                format!(
                    "heartbeats come {other} ms and {one} ms apart in turn: two series of {time} ms (1017)"
                )
            });
        } else if watch.changes == 0 && watch.phases == 0 {
            context.pass();
        }
    }

    fn booted(&mut self, event: &Event, node: NodeId, cause: BootCause, context: &mut Context<'_>) {
        let Some(watch) = self.watches.entry(node) else { return };
        let before = watch.booted.replace((context.now, event.frames.last));
        watch.forget();
        let Some((at, frame)) = before.filter(|_| matches!(cause, BootCause::PresumedPowerOn { .. })) else {
            return;
        };
        let after = context.now.saturating_sub(at);
        if after < STARTING && context.has_time {
            let frames = FrameRange { first: frame, last: event.frames.last };
            let milliseconds = crate::rules::general::facts::milliseconds(after);
            context.fail(event).frames(frames).say(|| format!("second boot-up after {milliseconds} ms"));
        }
    }
}

impl Rule for DuplicateNodeId {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Heartbeat { state, .. }, Some(node)) => self.heartbeat(event, node, *state, context),
            (EventKind::BootUp { cause, .. }, Some(node)) => self.booted(event, node, *cause, context),
            (EventKind::NmtCommand { target: 0, .. }, _) => self.watches = NodeMap::default(),
            (EventKind::NmtCommand { .. }, Some(node)) => {
                if let Some(watch) = self.watches.get_mut(node) {
                    watch.forget();
                }
            }
            _ => {}
        }
    }
}
