//! A set point does not act.

use crate::event::{Certainty, Effective, Event, EventKind, FrameRange, SetPoint};
use crate::finding::{About, Severity};
use crate::profile::Carrier;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, Policy, Rule};
use crate::session::{GateState, GateStatus, Node};
use crate::wire::NodeId;
use crate::wire::canopen::{NmtState, ObjectAddress};

declare_rule! {
    /// # What it checks
    /// A set point other than 0 is sent while a condition of the device for it to act is not met, and that for
    /// longer than it takes to bring the device there. Conditions the bus does not show do not count, and nothing is
    /// judged while a calibration runs.
    ///
    /// # Why it matters
    /// The controller commands a movement that does not come; when the condition is met later, it comes at once.
    ///
    /// # Source
    /// The conditions are those of the device's manual: state, command source, SYNC, running procedures.
    ///
    /// # What to look at first
    /// The condition that is named, and how it is met (`cobscope why --node N --at T` lists all of them).
    ///
    /// # Mutation
    /// clear the enable bit of the control word while the set point stays
    "setpoint-not-effective", Warning, "a set point is sent and does not act",
    kinds: ["set-point", "procedure", "boot-up"],
    is_timing: true,
    word: "SETPT",
    tolerances: &[tolerance("time-ms", 500.0, "ms", "for which a set point may be without effect")],
}

/// Set points remembered on a bus; further ones are not judged.
const POINT_LIMIT: usize = 4096;

/// Last step of a procedure.
const FINISHED: &str = "finished";

/// What is known of one set point.
struct Point {
    node: NodeId,
    object: ObjectAddress,
    carrier: Carrier,
    /// Without effect since then.
    since: Option<i64>,
    is_told: bool,
    /// Rests on an assumption.
    assumed: bool,
    text: String,
    frames: FrameRange,
}

struct SetpointNotEffective {
    time: i64,
    points: Vec<Point>,
}

fn new(policy: &Policy) -> SetpointNotEffective {
    SetpointNotEffective { time: policy.nanoseconds(&DECLARATION, "time-ms"), points: Vec::new() }
}

impl SetpointNotEffective {
    fn place(&mut self, node: NodeId, point: &SetPoint) -> Option<usize> {
        let same = |it: &Point| it.node == node && it.object == point.object && it.carrier == point.carrier;
        let known = self.points.iter().position(same);
        if known.is_none() && self.points.len() < POINT_LIMIT {
            self.points.push(Point {
                node,
                object: point.object,
                carrier: point.carrier.clone(),
                since: None,
                is_told: false,
                assumed: false,
                text: String::new(),
                frames: FrameRange::default(),
            });
            return Some(self.points.len() - 1);
        }
        known
    }

    fn set_point(&mut self, event: &Event, node: NodeId, told: &SetPoint, context: &mut Context<'_>) {
        let time = self.time;
        let Some(place) = self.place(node, told) else { return };
        let Some(point) = self.points.get_mut(place) else { return };
        let commands = told.to.number.is_some_and(|number| number.abs() > 0.0);
        if commands && told.effective == Effective::Yes {
            context.pass();
        }
        if !(commands && told.effective == Effective::No) {
            return point.acts(context);
        }
        point.text.clone_from(&told.to.text);
        point.assumed = told.assumed;
        point.frames = event.frames;
        if point.since.is_none() {
            point.since = Some(context.now);
            context.wake_at(context.now.saturating_add(time), place as u64);
        }
    }
}

impl SetpointNotEffective {
    /// The device is its controller's again: what is without effect now has its time from here on.
    fn begin_anew(&mut self, node: NodeId, context: &mut Context<'_>) {
        for (place, point) in self.points.iter_mut().enumerate().filter(|(_, point)| point.node == node) {
            if let Some(since) = &mut point.since {
                *since = context.now;
                context.wake_at(context.now.saturating_add(self.time), place as u64);
            }
        }
    }
}

impl Point {
    /// It acts, is 0, or nothing is sure.
    fn acts(&mut self, context: &mut Context<'_>) {
        self.since = None;
        if std::mem::take(&mut self.is_told) {
            context.close(Some(self.node), About::Object(self.object));
        }
    }

    /// The time it may be without effect is over.
    fn judge(&self, context: &mut Context<'_>, time: i64) -> bool {
        let gates = context.bus.gates(self.node);
        let node = context.bus.node(self.node);
        let is_sure = |gate: &&GateState| {
            gate.set_point == self.object
                && gate.status == GateStatus::Closed
                && !node.is_some_and(|node| rests_on_command(node, gate))
        };
        if node.is_some_and(is_calibrated) {
            return false;
        }
        let Some(gate) = gates.iter().find(is_sure) else { return false };
        // A state that follows the control word shows that the contents of the PDOs are as assumed.
        let is_shown = node.is_some_and(|node| node.device_states().next().is_some());
        let severity = if self.assumed && !is_shown { Severity::Note } else { Severity::Warning };
        let alarm = context.fail_at(context.now, Some(self.node), self.frames);
        let alarm = alarm.about(About::Object(self.object)).severity(severity).ongoing();
        alarm.say(|| {
            let milliseconds = time / 1_000_000;
            let detail = if gate.detail.is_empty() { String::new() } else { format!(" ({})", gate.detail) };
            format!("{} without effect for {milliseconds} ms: needs {}{detail}", self.text, gate.gate)
        });
        true
    }
}

/// Whether a procedure that takes its time has the outputs: nobody expects set points to act.
fn is_calibrated(node: &Node) -> bool {
    node.procedures().any(|procedure| procedure.takes_over && procedure.seconds.is_some())
}

/// Whether a gate is closed by an NMT state that only a command tells.
fn rests_on_command(node: &Node, gate: &GateState) -> bool {
    node.nmt().is_some_and(|nmt| {
        nmt.certainty == Certainty::Presumed
            && nmt.state != NmtState::Operational
            && gate.detail == nmt.state.name()
    })
}

impl Rule for SetpointNotEffective {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::SetPoint(point) => self.set_point(event, node, point, context),
            EventKind::BootUp { .. } => {
                for point in self.points.iter_mut().filter(|point| point.node == node) {
                    point.acts(context);
                }
            }
            EventKind::Procedure(told) if told.takes_over && told.step == FINISHED => {
                self.begin_anew(node, context);
            }
            _ => {}
        }
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let time = self.time;
        let point = usize::try_from(token).ok().and_then(|place| self.points.get_mut(place));
        let Some(point) = point else { return };
        let Some(since) = point.since.filter(|_| !point.is_told) else { return };
        let due = since.saturating_add(time);
        // A new time without effect began meanwhile, and brought a wake of its own.
        if due > context.now {
            return;
        }
        point.is_told = point.judge(context, time);
        if !point.is_told {
            context.wake_at(context.now.saturating_add(time), token);
        }
    }
}
