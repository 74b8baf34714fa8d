//! The master's guarding is late.

use crate::event::{EmcyAction, Emergency, Event, EventKind, FrameRange};
use crate::finding::{About, Severity};
use crate::rules::general::facts::sure_of;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::session::Node;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;

declare_rule! {
    /// # What it checks
    /// The requests of the guarding master are further apart than most of the node's life time, guard time (100C) ×
    /// life time factor (100D), or than all of it. Where the life time was not seen, only an EMCY with which the node
    /// itself reports the end of its life time counts.
    ///
    /// # Why it matters
    /// A node whose life time ends takes the master for gone: it goes to a safe state, in the middle of the work.
    ///
    /// # Source
    /// CiA 301 §7.2.8.3.2.1 (node guarding, life guarding), §7.5.2.11 (100C), §7.5.2.12 (100D)
    ///
    /// # What to look at first
    /// Cycle time and load of the master in that moment; whether its commands pause too.
    ///
    /// # Mutation
    /// drop guarding requests for longer than the life time
    "guard-late", Error, "the master's guarding requests are late",
    kinds: ["guard-request", "emcy", "boot-up", "nmt-command"],
    is_timing: true,
    word: "GUARD",
    tolerances: &[
        tolerance("warning-percent", 80.0, "%", "of the life time, a warning"),
        tolerance("error-percent", 100.0, "%", "of the life time, an error"),
    ],
}

const GUARD_TIME: ObjectAddress = ObjectAddress::new(0x100C, 0);
const LIFE_TIME_FACTOR: ObjectAddress = ObjectAddress::new(0x100D, 0);
const HEARTBEAT_CONSUMER: ObjectAddress = ObjectAddress::new(0x1016, 1);

/// Code of life guarding, and of the heartbeat consumer (CiA 301 table 26).
const LIFE_GUARD: u16 = 0x8130;

/// A digit of the stamps is no delay.
const SLACK: i64 = 1_000_000;

#[derive(Default)]
struct Guarded {
    /// Time and frame of the last request.
    last: Option<(i64, u64)>,
    is_told: bool,
    is_queued: bool,
}

struct GuardLate {
    warning: f64,
    error: f64,
    nodes: NodeMap<Guarded>,
}

fn new(policy: &Policy) -> GuardLate {
    let share = |key| policy.tolerance(&DECLARATION, key) / 100.0;
    GuardLate { warning: share("warning-percent"), error: share("error-percent"), nodes: NodeMap::default() }
}

/// Guard time and factor of a node that has both.
fn life_time(node: Option<&Node>) -> Option<(u16, u8)> {
    let node = node?;
    let time = u16::try_from(sure_of(node, GUARD_TIME)?).ok()?;
    let factor = u8::try_from(sure_of(node, LIFE_TIME_FACTOR)?).ok()?;
    (time > 0 && factor > 0).then_some((time, factor))
}

/// A share of the life time in nanoseconds.
fn part((time, factor): (u16, u8), share: f64) -> i64 {
    #[expect(clippy::cast_possible_truncation, reason = "at most 65,535 ms × 255, or saturates")]
    let nanoseconds = (f64::from(time) * f64::from(factor) * share * 1e6) as i64;
    nanoseconds
}

impl GuardLate {
    fn request(&mut self, event: &Event, node: NodeId, context: &mut Context<'_>) {
        let (NodeId::Canopen(number), true) = (node, context.has_time) else { return };
        let life = life_time(context.node(event));
        let Some(guarded) = self.nodes.entry(node) else { return };
        let before = guarded.last.replace((context.now, event.frames.last));
        let was_told = std::mem::take(&mut guarded.is_told);
        let Some(life) = life else { return };
        if !std::mem::replace(&mut guarded.is_queued, true) {
            context.wake_at(context.now.saturating_add(part(life, self.error) + SLACK), u64::from(number));
        }
        let Some((last, frame)) = before else { return };
        let gap = context.now.saturating_sub(last);
        if gap <= part(life, self.warning) + SLACK {
            return context.pass();
        }
        let is_over = gap > part(life, self.error) + SLACK;
        let severity = if is_over { Severity::Error } else { Severity::Warning };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.fail(event).severity(severity).measure(gap as f64);
        let frames = FrameRange { first: frame, last: event.frames.last };
        alarm.frames(frames).say(|| said(gap, life, if is_over { ">" } else { "of" }));
        if was_told {
            context.close(Some(node), About::Whole);
        }
    }

    /// The node says that its life time ended.
    fn emergency(&mut self, event: &Event, node: NodeId, emergency: &Emergency, context: &mut Context<'_>) {
        let (EmcyAction::Raised, Some(code), Some(known)) =
            (emergency.action, emergency.code, context.node(event))
        else {
            return;
        };
        let own = known.device().monitoring.life_guard_emcy;
        let is_plain = own.is_none() && code == LIFE_GUARD && known.store().get(HEARTBEAT_CONSUMER).is_none();
        if own != Some(code) && !is_plain {
            return;
        }
        let Some(guarded) = self.nodes.get_mut(node).filter(|guarded| !guarded.is_told) else { return };
        let Some((last, frame)) = guarded.last else { return };
        let gap = context.now.saturating_sub(last);
        let frames = FrameRange { first: frame, last: event.frames.last };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.fail(event).measure(gap as f64).frames(frames);
        alarm.say(|| {
            let milliseconds = gap / 1_000_000;
            format!("the node's life time ended, EMCY {code:04X}: last request {milliseconds} ms before")
        });
    }

    fn forget(&mut self, node: NodeId, context: &mut Context<'_>) {
        if let Some(guarded) = self.nodes.get_mut(node) {
            guarded.last = None;
            if std::mem::take(&mut guarded.is_told) {
                context.close(Some(node), About::Whole);
            }
        }
    }
}

fn said(gap: i64, (time, factor): (u16, u8), than: &str) -> String {
    let (milliseconds, life) = (gap / 1_000_000, u32::from(time) * u32::from(factor));
    format!("master silent for {milliseconds} ms {than} {life} ms ({time} ms × {factor})")
}

impl Rule for GuardLate {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match (&event.kind, event.node) {
            (EventKind::GuardRequest, Some(node)) if !event.presumed => self.request(event, node, context),
            (EventKind::Emcy(emergency), Some(node)) => self.emergency(event, node, emergency, context),
            // Life guarding begins anew with the first request behind a start.
            (EventKind::BootUp { .. }, Some(node)) => self.forget(node, context),
            (
                EventKind::NmtCommand {
                    service: NmtService::ResetNode | NmtService::ResetCommunication,
                    target,
                    ..
                },
                _,
            ) => {
                let all = (1..=127).filter(|number| *target == 0 || target == number);
                for number in all {
                    self.forget(NodeId::Canopen(number), context);
                }
            }
            _ => {}
        }
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let Ok(number) = u8::try_from(token) else { return };
        let node = NodeId::Canopen(number);
        let life = life_time(context.bus.node(node));
        let Some(guarded) = self.nodes.get_mut(node) else { return };
        guarded.is_queued = false;
        let (Some((last, frame)), Some(life)) = (guarded.last, life) else { return };
        let due = last.saturating_add(part(life, self.error) + SLACK);
        if due > context.now {
            guarded.is_queued = true;
            return context.wake_at(due, token);
        }
        guarded.is_told = true;
        // How long it was in the end the next request tells.
        let gap = part(life, self.error);
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.fail_at(due, Some(node), FrameRange::one(frame)).measure(gap as f64).ongoing();
        alarm.say(|| said(gap, life, "and more, life time"));
    }
}
