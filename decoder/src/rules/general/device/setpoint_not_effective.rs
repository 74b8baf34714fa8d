//! Set points without effect.

use crate::event::{
    EffectiveState, Event, EventKind, FrameRange, Kind, ProcedurePhase, SetPoint, StateCertainty,
};
use crate::finding::{FindingSubject, MergedFindings, Severity};
use crate::profile::ValueCarrier;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::{GateState, GateStatus, Node};
use crate::wire::NodeId;
use crate::wire::canopen::{NmtState, ObjectAddress};

declare_rule! {
    /// # What it checks
    /// A set point other than 0 is sent while one of its conditions is not met for longer than `time-ms`.
    /// Conditions that are not visible on the bus, and calibrations in progress, are exempt. The finding ends
    /// with the stream of a periodic RPDO or of a message with a time limit; a set point that is sent on
    /// change only stays in force.
    ///
    /// # Why it matters
    /// The controller commands a movement that does not take place. It may start suddenly when the condition
    /// is met later.
    ///
    /// # Source
    /// Conditions: device manual (state, command source, SYNC, running procedures).
    ///
    /// # What to look at first
    /// Restore the named condition. `cobscope why --node N --at T` lists all conditions.
    ///
    /// # Mutation
    /// clear the enable bit of the control word while the set point stays
    "setpoint-not-effective", Warning, "set point without effect",
    kinds: [Kind::SetPoint, Kind::Procedure, Kind::BootUp],
    needs: "a set point of the profile other than 0",
    merge: MergedFindings::Node,
    is_timing: true,
    word: "SETPT",
    tolerances: &[define_tolerance("time-ms", 500.0, "ms", "permitted duration without effect")],
}

/// Maximum number of set points per bus; further ones are not checked.
const POINT_LIMIT: usize = 4096;

/// State of one set point.
struct SetPointWatch {
    node: NodeId,
    object: ObjectAddress,
    carrier: ValueCarrier,
    /// Start of the time without effect.
    since: Option<i64>,
    is_reported: bool,
    /// The value depends on an assumption.
    assumed: bool,
    text: String,
    frames: FrameRange,
}

struct SetpointNotEffective {
    time: i64,
    points: Vec<SetPointWatch>,
}

fn new(policy: &RulePolicy) -> SetpointNotEffective {
    SetpointNotEffective { time: policy.tolerance_ns(&DECLARATION, "time-ms"), points: Vec::new() }
}

impl SetpointNotEffective {
    fn watch_place(&mut self, node: NodeId, point: &SetPoint) -> Option<usize> {
        let same =
            |it: &SetPointWatch| it.node == node && it.object == point.object && it.carrier == point.carrier;
        let known = self.points.iter().position(same);
        if known.is_none() && self.points.len() < POINT_LIMIT {
            self.points.push(SetPointWatch {
                node,
                object: point.object,
                carrier: point.carrier.clone(),
                since: None,
                is_reported: false,
                assumed: false,
                text: String::new(),
                frames: FrameRange::default(),
            });
            return Some(self.points.len() - 1);
        }
        known
    }

    fn set_point(&mut self, event: &Event, node: NodeId, reported: &SetPoint, context: &mut RuleContext<'_>) {
        let time = self.time;
        let Some(place) = self.watch_place(node, reported) else { return };
        let Some(point) = self.points.get_mut(place) else { return };
        let commands = reported.to.number.is_some_and(|number| number.abs() > 0.0);
        if commands && reported.effective == EffectiveState::Yes {
            context.count_pass();
        }
        if !(commands && reported.effective == EffectiveState::No) {
            return point.on_effective(context);
        }
        point.text.clone_from(&reported.to.text);
        point.assumed = reported.assumed;
        point.frames = event.frames;
        if point.since.is_none() {
            point.since = Some(context.now);
            context.wake_at(context.now.saturating_add(time), place as u64);
        }
    }
}

impl SetpointNotEffective {
    /// Restarts the time limit of all set points of a node after a procedure.
    fn restart_numbers(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        for (place, point) in self.points.iter_mut().enumerate().filter(|(_, point)| point.node == node) {
            if let Some(since) = &mut point.since {
                *since = context.now;
                context.wake_at(context.now.saturating_add(self.time), place as u64);
            }
        }
    }
}

impl SetPointWatch {
    /// The set point is effective, 0 or unknown.
    fn on_effective(&mut self, context: &mut RuleContext<'_>) {
        self.since = None;
        if std::mem::take(&mut self.is_reported) {
            context.close_condition(Some(self.node), FindingSubject::Object(self.object));
        }
    }

    /// Reports the set point if a condition is still not met.
    fn judge_set_point(&self, context: &mut RuleContext<'_>) -> bool {
        let gates = context.bus.gates(self.node);
        let node = context.bus.node(self.node);
        let is_certain = |gate: &&GateState| {
            gate.set_point == self.object
                && gate.status == GateStatus::Closed
                && !node.is_some_and(|node| rests_on_command(node, gate))
        };
        if node.is_some_and(is_calibrated) {
            return false;
        }
        let Some(gate) = gates.iter().find(is_certain) else { return false };
        // A state that follows the control word confirms the assumed contents of the PDOs.
        let is_shown = node.is_some_and(|node| node.device_states().next().is_some());
        let severity = if self.assumed && !is_shown { Severity::Note } else { Severity::Warning };
        let since = self.since.and_then(|time| context.timestamp_of(time));
        let alarm = context.fail_at(context.now, Some(self.node), self.frames);
        let alarm = alarm
            .with_subject(FindingSubject::Object(self.object))
            .with_severity(severity)
            .started_at(since)
            .with_reason(&gate.gate);
        alarm.report_finding(|| {
            let detail = if gate.detail.is_empty() { String::new() } else { format!(" ({})", gate.detail) };
            format!("{} without effect: gate {} closed{detail}", self.text, gate.gate)
        });
        true
    }
}

/// Whether the periodic stream that carries the set point ended.
fn has_ended(point: &SetPointWatch, context: &RuleContext<'_>) -> bool {
    let name = match &point.carrier {
        ValueCarrier::Pdo(name) => name,
        ValueCarrier::Message(name) => {
            return context.bus.node(point.node).is_some_and(|node| node.is_overdue(name));
        }
    };
    let slots = context.traffic.slots().iter();
    let carrying =
        slots.filter(|slot| context.bus.identifiers().pdo_on(slot.id) == Some((*name, point.node)));
    carrying.max_by_key(|slot| slot.last).is_some_and(|slot| {
        slot.period_since(i64::MIN).is_some_and(|period| slot.has_ended(period, context.now))
    })
}

/// Whether a procedure such as a calibration controls the outputs, so that set points have no effect.
fn is_calibrated(node: &Node) -> bool {
    node.procedures().any(|procedure| procedure.takes_over && procedure.seconds.is_some())
}

/// Whether a gate is closed because of an NMT state that is only presumed from a command.
fn rests_on_command(node: &Node, gate: &GateState) -> bool {
    node.nmt().is_some_and(|nmt| {
        nmt.certainty == StateCertainty::Presumed
            && nmt.state != NmtState::Operational
            && gate.detail == nmt.state.name()
    })
}

impl Rule for SetpointNotEffective {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::SetPoint(point) => self.set_point(event, node, point, context),
            EventKind::BootUp { .. } => {
                for point in self.points.iter_mut().filter(|point| point.node == node) {
                    point.on_effective(context);
                }
            }
            EventKind::Procedure(reported)
                if reported.takes_over && reported.phase == ProcedurePhase::Finished =>
            {
                self.restart_numbers(node, context);
            }
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let time = self.time;
        let point = usize::try_from(token).ok().and_then(|place| self.points.get_mut(place));
        let Some(point) = point else { return };
        let Some(since) = point.since else { return };
        if has_ended(point, context) {
            // If the stream returns, the time limit starts again.
            point.on_effective(context);
            point.since = Some(context.now);
            return context.wake_at(context.now.saturating_add(time), token);
        }
        let due = since.saturating_add(time);
        // A later time without effect has its own wake-up.
        if due > context.now {
            return;
        }
        if !point.is_reported {
            point.is_reported = point.judge_set_point(context);
        }
        context.wake_at(context.now.saturating_add(time), token);
    }
}
