//! Guarding requests without an answer.

use crate::event::{Event, EventKind, FrameRange};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::nmt::NmtService;

declare_rule! {
    /// # What it checks
    /// A node that answers guarding leaves requests without an answer until it answers again or counts as lost. A node
    /// that never answered since its start, or sends heartbeats, does not guard; requests within 20 ms of each other
    /// may be those of two masters.
    ///
    /// # Why it matters
    /// The master takes the node for lost after a few of them, and the machine stops.
    ///
    /// # Source
    /// CiA 301 §7.2.8.3.2.1 (node guarding)
    ///
    /// # What to look at first
    /// Load of the bus and of the node in that moment; whether the recording lost frames.
    ///
    /// # Mutation
    /// drop an answer to guarding
    "guard-no-answer", Warning, "a guarding request is not answered",
    kinds: ["guard-request", "guard-reply", "heartbeat", "boot-up", "nmt-command", "node-lost", "lost-frames", "link"],
    cases: &["7.2", "7.4", "7.203"],
    shows: &["7.2"],
    word: "GUARD",
}

/// Two requests within this time are no two rounds of one master, in nanoseconds.
const TOGETHER: i64 = 20_000_000;

#[derive(Default)]
struct Guarded {
    /// It answers guarding.
    answers: bool,
    /// Time and frame of the request that waits.
    open: Option<(i64, u64)>,
    /// Requests without an answer in a row, from the first to the last of them.
    missed: u64,
    frames: FrameRange,
}

#[derive(Default)]
struct GuardNoAnswer {
    nodes: NodeMap<Guarded>,
}

fn new(_policy: &Policy) -> GuardNoAnswer {
    GuardNoAnswer::default()
}

impl Guarded {
    fn request(&mut self, now: i64, has_time: bool, frame: u64) {
        if let Some((asked, first)) = self.open {
            if has_time && now.saturating_sub(asked) < TOGETHER {
                return;
            }
            if self.answers {
                self.frames.first = if self.missed == 0 { first } else { self.frames.first };
                self.frames.last = first;
                self.missed = self.missed.saturating_add(1);
            }
        }
        self.open = Some((now, frame));
    }

    /// Tells what was missed so far.
    fn tell(&mut self, event: &Event, context: &mut Context<'_>) {
        let (missed, frames) = (std::mem::take(&mut self.missed), self.frames);
        if missed == 0 {
            return;
        }
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.fail(event).frames(frames).measure(missed as f64);
        alarm.say(|| said(missed, frames));
    }
}

fn said(missed: u64, frames: FrameRange) -> String {
    match missed {
        1 => format!("request {{{}}} not answered", frames.first),
        _ => format!(
            "{missed} requests in a row not answered, from {{{}}} to {{{}}}",
            frames.first, frames.last
        ),
    }
}

impl GuardNoAnswer {
    fn reset(&mut self, service: NmtService, target: u8) {
        if !matches!(service, NmtService::ResetNode | NmtService::ResetCommunication) {
            return;
        }
        if target == 0 {
            self.nodes = NodeMap::default();
        } else {
            self.nodes.remove(NodeId::Canopen(target));
        }
    }
}

impl Rule for GuardNoAnswer {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match event.kind {
            EventKind::NmtCommand { service, target, .. } => return self.reset(service, target),
            // What was lost may have been answers.
            EventKind::LostFrames { .. } | EventKind::Link { .. } => return self.nodes = NodeMap::default(),
            _ => {}
        }
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::GuardRequest if !event.presumed => {
                let (now, has_time) = (context.now, context.has_time);
                if let Some(guarded) = self.nodes.entry(node) {
                    guarded.request(now, has_time, event.frames.last);
                }
            }
            EventKind::GuardReply { .. } => {
                let Some(guarded) = self.nodes.get_mut(node) else { return };
                guarded.answers = true;
                if guarded.open.take().is_some() && guarded.missed == 0 {
                    context.pass();
                }
                guarded.tell(event, context);
            }
            EventKind::NodeLost(silence) if silence.monitored_by == "guarding" => {
                if let Some(mut guarded) = self.nodes.remove(node) {
                    guarded.tell(event, context);
                }
            }
            EventKind::BootUp { .. } | EventKind::Heartbeat { .. } => {
                self.nodes.remove(node);
            }
            _ => {}
        }
    }

    fn finish(&mut self, context: &mut Context<'_>) {
        for (node, guarded) in self.nodes.iter().filter(|(_, guarded)| guarded.missed > 0) {
            let (missed, frames) = (guarded.missed, guarded.frames);
            #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
            let alarm = context.fail_at(context.now, Some(node), frames).measure(missed as f64);
            alarm.say(|| said(missed, frames));
        }
    }
}
