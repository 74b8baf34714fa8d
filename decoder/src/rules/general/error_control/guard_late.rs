//! Late or missing guarding requests of the master.

use crate::event::{EmcyAction, Emergency, Event, EventKind, FrameRange, Kind};
use crate::finding::{FindingSubject, Severity};
use crate::rules::general::facts::value_or_default;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// The interval between guarding requests exceeds `warning-percent` or `error-percent` of the life time
    /// of the node, which is guard time (100C) × life time factor (100D). Life guarding starts with the
    /// first request. If 100C and 100D were neither written nor read, the factory settings of the device
    /// profile are assumed, with a lower severity: only after one interval within them, and until the node
    /// tolerates a longer one without its EMCY. If the life time is unknown, only the EMCY of the node about
    /// its expired life time counts. That EMCY is exempt within 1 s of NMT stop or reset, which can cause it too.
    ///
    /// # Why it matters
    /// When its life time expires, a node assumes that the master is lost and enters its safe state.
    ///
    /// # Source
    /// CiA 301 §7.2.8.3.2.1 (node guarding, life guarding), §7.5.2.11 (100C), §7.5.2.12 (100D)
    ///
    /// # What to look at first
    /// Check cycle time and load of the master. Check whether its commands pause at the same time.
    ///
    /// # Mutation
    /// drop guarding requests for longer than the life time
    "guard-late", Error, "guarding request late or missing",
    kinds: [Kind::GuardRequest, Kind::Emcy, Kind::BootUp, Kind::NmtCommand],
    needs: "two guarding requests, and 100C:00 and 100D:00 of the node",
    is_timing: true,
    word: "GUARD",
    tolerances: &[
        define_tolerance("warning-percent", 80.0, "%", "of the life time, a warning"),
        define_tolerance("error-percent", 100.0, "%", "of the life time, an error"),
    ],
}

const GUARD_TIME: ObjectAddress = ObjectAddress::new(0x100C, 0);
const LIFE_TIME_FACTOR: ObjectAddress = ObjectAddress::new(0x100D, 0);
const HEARTBEAT_CONSUMER: ObjectAddress = ObjectAddress::new(0x1016, 1);

/// EMCY code for life guarding and heartbeat errors (CiA 301 table 26).
const LIFE_GUARD: u16 = 0x8130;

/// Reason for a lower severity.
const ASSUMED: &str = "life time assumed: factory setting of 100C and 100D";

/// Rounding error of timestamps, in nanoseconds.
const SLACK: i64 = 1_000_000;

/// Time in ns after NMT stop or reset in which an EMCY may report the command instead of an expired life time.
const REACTION: i64 = 1_000_000_000;

#[derive(Default)]
struct LateGuarding {
    /// Time and frame of the last request.
    last: Option<(i64, u64)>,
    is_reported: bool,
    is_queued: bool,
    /// An interval was within the life time, so the period of the master fits an assumed one.
    has_fit: bool,
    /// The node reported an expired life time after the last request.
    has_expired: bool,
    /// The node tolerated a longer interval than the factory settings permit.
    is_default_refuted: bool,
    /// Time of the last NMT stop or reset.
    commanded: Option<i64>,
}

impl LateGuarding {
    /// Whether the life time is known well enough for a verdict.
    fn is_life_time_known(&self, life: LifeTime) -> bool {
        !life.is_assumed || (self.has_fit && !self.is_default_refuted)
    }
}

/// Life time of a node.
#[derive(Clone, Copy)]
struct LifeTime {
    /// Guard time in milliseconds.
    time: u16,
    factor: u8,
    /// At least one of the two is a factory setting.
    is_assumed: bool,
}

impl LifeTime {
    fn assumption(self) -> Option<&'static str> {
        self.is_assumed.then_some(ASSUMED)
    }
}

struct GuardLate {
    warning: f64,
    error: f64,
    nodes: NodeMap<LateGuarding>,
}

fn new(policy: &RulePolicy) -> GuardLate {
    let share = |key| policy.tolerance_value(&DECLARATION, key) / 100.0;
    GuardLate { warning: share("warning-percent"), error: share("error-percent"), nodes: NodeMap::default() }
}

/// Life time from guard time and life time factor; `None` unless both are set.
fn life_time(node: Option<&Node>) -> Option<LifeTime> {
    let node = node?;
    let (time, factor) = (value_or_default(node, GUARD_TIME)?, value_or_default(node, LIFE_TIME_FACTOR)?);
    let is_assumed = time.is_default || factor.is_default;
    let (time, factor) = (u16::try_from(time.value).ok()?, u8::try_from(factor.value).ok()?);
    (time > 0 && factor > 0).then_some(LifeTime { time, factor, is_assumed })
}

/// Share of the life time, in nanoseconds.
fn life_time_share(LifeTime { time, factor, .. }: LifeTime, share: f64) -> i64 {
    #[expect(clippy::cast_possible_truncation, reason = "at most 65,535 ms × 255, or saturates")]
    let nanoseconds = (f64::from(time) * f64::from(factor) * share * 1e6) as i64;
    nanoseconds
}

impl GuardLate {
    fn on_request(&mut self, event: &Event, node: NodeId, context: &mut RuleContext<'_>) {
        let (NodeId::Canopen(number), true) = (node, context.has_time) else { return };
        let life = life_time(context.event_node(event));
        let Some(guarded) = self.nodes.entry(node) else { return };
        let before = guarded.last.replace((context.now, event.frames.last));
        if let (Some(life), false) = (life, guarded.is_queued) {
            guarded.is_queued = true;
            context.wake_at(
                context.now.saturating_add(life_time_share(life, self.error) + SLACK),
                u64::from(number),
            );
        }
        let was_reported = std::mem::take(&mut guarded.is_reported);
        if let (Some(life), Some(before)) =
            (life, before.filter(|(_, frame)| !context.is_across_hole(*frame)))
        {
            self.judge_interval(event, node, (life, before), context);
        }
        if was_reported {
            context.close_condition(Some(node), FindingSubject::Whole);
        }
    }

    /// Judges the interval from the request `before` (time and frame) to the one of the event.
    fn judge_interval(
        &mut self,
        event: &Event,
        node: NodeId,
        (life, (last, frame)): (LifeTime, (i64, u64)),
        context: &mut RuleContext<'_>,
    ) {
        let Some(guarded) = self.nodes.get_mut(node) else { return };
        let gap = context.now.saturating_sub(last);
        let is_over = gap > life_time_share(life, self.error) + SLACK;
        let is_judged = guarded.is_life_time_known(life);
        let has_expired = std::mem::take(&mut guarded.has_expired);
        guarded.has_fit |= !is_over;
        guarded.is_default_refuted |= life.is_assumed && is_over && !has_expired;
        if gap <= life_time_share(life, self.warning) + SLACK {
            return context.count_pass();
        }
        if !is_judged {
            return;
        }
        let (severity, share) =
            if is_over { (Severity::Error, self.error) } else { (Severity::Warning, self.warning) };
        let frames = FrameRange { first: frame, last: event.frames.last };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.start_finding(event).with_severity(severity).with_measure(gap as f64);
        alarm
            .with_frames(frames)
            .with_assumption(life.assumption())
            .report_finding(|| interval_text(gap, life, share));
    }

    /// Checks for an EMCY that reports an expired life time.
    fn on_emergency(
        &mut self,
        event: &Event,
        node: NodeId,
        emergency: &Emergency,
        context: &mut RuleContext<'_>,
    ) {
        let (EmcyAction::Raised, Some(code), Some(known)) =
            (emergency.action, emergency.code, context.event_node(event))
        else {
            return;
        };
        let own = known.device().monitoring.life_guard_emcy;
        let is_plain = own.is_none() && code == LIFE_GUARD && known.store().get(HEARTBEAT_CONSUMER).is_none();
        if own != Some(code) && !is_plain {
            return;
        }
        let life = life_time(Some(known));
        let Some(guarded) = self.nodes.get_mut(node) else { return };
        if guarded.commanded.is_some_and(|at| context.now.saturating_sub(at) <= REACTION) {
            return;
        }
        guarded.has_expired = true;
        // The EMCY confirms a finding that depends on an assumed life time.
        if guarded.is_reported && life.is_some_and(|life| !life.is_assumed) {
            return;
        }
        let Some((last, frame)) = guarded.last else { return };
        let gap = context.now.saturating_sub(last);
        let frames = FrameRange { first: frame, last: event.frames.last };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm =
            context.start_finding(event).with_measure(gap as f64).with_frames(frames).reported_by_device();
        alarm.report_finding(|| {
            let milliseconds = gap / 1_000_000;
            let life = life.map_or_else(String::new, |LifeTime { time, factor, is_assumed }| {
                format!(" ({time} ms × {factor}{})", if is_assumed { ", factory setting" } else { "" })
            });
            format!("life guarding expired: no guarding request for {milliseconds} ms{life}, EMCY {code:04X}")
        });
    }

    fn on_command(&mut self, service: NmtService, target: u8, context: &mut RuleContext<'_>) {
        let is_reset = matches!(service, NmtService::ResetNode | NmtService::ResetCommunication);
        if !is_reset && service != NmtService::Stop {
            return;
        }
        for node in (1..=127).filter(|number| target == 0 || target == *number).map(NodeId::Canopen) {
            if is_reset {
                self.forget_node(node, context);
            }
            if let Some(guarded) = self.nodes.get_mut(node) {
                guarded.commanded = Some(context.now);
            }
        }
    }

    fn forget_node(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        if let Some(guarded) = self.nodes.get_mut(node) {
            guarded.last = None;
            guarded.has_expired = false;
            if std::mem::take(&mut guarded.is_reported) {
                context.close_condition(Some(node), FindingSubject::Whole);
            }
        }
    }
}

/// `guarding interval 450 ms > 400 ms (80 % of the life time 250 ms × 2)`
fn interval_text(gap: i64, life: LifeTime, share: f64) -> String {
    let LifeTime { time, factor, .. } = life;
    let (gap, limit, percent) = (gap / 1_000_000, life_time_share(life, share) / 1_000_000, share * 100.0);
    format!("guarding interval {gap} ms > {limit} ms ({percent:.0} % of the life time {time} ms × {factor})")
}

impl Rule for GuardLate {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::GuardRequest, Some(node)) if !event.presumed => self.on_request(event, node, context),
            (EventKind::Emcy(emergency), Some(node)) => self.on_emergency(event, node, emergency, context),
            // After a restart, life guarding starts with the first request.
            (EventKind::BootUp { .. }, Some(node)) => self.forget_node(node, context),
            (EventKind::NmtCommand { service, target, .. }, _) => self.on_command(*service, *target, context),
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Ok(number) = u8::try_from(token) else { return };
        let node = NodeId::Canopen(number);
        let life = life_time(context.bus.node(node));
        let Some(guarded) = self.nodes.get_mut(node) else { return };
        guarded.is_queued = false;
        let (Some((last, frame)), Some(life)) = (guarded.last, life) else { return };
        let due = last.saturating_add(life_time_share(life, self.error) + SLACK);
        if due > context.now {
            guarded.is_queued = true;
            return context.wake_at(due, token);
        }
        if !guarded.is_life_time_known(life) {
            return;
        }
        guarded.is_reported = true;
        // The next request determines the final interval.
        let gap = life_time_share(life, self.error);
        let since = context.timestamp_of(last);
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.fail_at(due, Some(node), FrameRange::one(frame)).with_measure(gap as f64);
        alarm.started_at(since).with_assumption(life.assumption()).report_finding(|| {
            let LifeTime { time, factor, .. } = life;
            let limit = u32::from(time) * u32::from(factor);
            format!("guarding requests missing (life time {limit} ms = {time} ms × {factor})")
        });
    }
}
