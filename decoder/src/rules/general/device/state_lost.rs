//! Devices that leave their active state although it is still commanded.

use super::machines::{is_control, keeps_state, machine_subject, state_machine};
use crate::event::{
    BootCause, DeviceCause, DeviceState, DtcAction, EmcyAction, Event, EventKind, FrameRange, Kind,
};
use crate::finding::Severity;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::nmt::NmtService;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A device reports that it left its active state although the last control word still commands it, and
    /// the NMT master neither stopped nor reset it. The finding states the cause visible on the bus, also one
    /// reported up to 100 ms later, else "not on the bus". It is an error if the new state is a fault.
    ///
    /// # Why it matters
    /// The outputs are switched off in the middle of a movement, without a command of the controller.
    ///
    /// # Source
    /// State machine in the device manual; for fluid power CiA 408.
    ///
    /// # What to look at first
    /// Check the named cause, else hardware enable and supply. A tool of the manufacturer may also control
    /// the device.
    ///
    /// # Mutation
    /// set the status word of an active device to fault
    "state-lost", Error, "device left its active state",
    kinds: [Kind::DeviceState, Kind::NmtCommand, Kind::BootUp, Kind::SdoTransfer, Kind::Emcy, Kind::Dtc],
    needs: "a device in its active state",
    word: "STATE",
}

/// Time after an NMT command in which it explains a state change, in nanoseconds.
const WINDOW: i64 = 2_000_000_000;

/// Time in ns in which a later EMCY, DTC or boot sign is the cause: the TPDO may precede it.
const CAUSE_DELAY: i64 = 100_000_000;

/// A change of state without a cause on the bus so far.
struct UnexplainedChange {
    node: NodeId,
    state: DeviceState,
    control: u64,
    time: i64,
    frame: u64,
}

#[derive(Default)]
struct StateLost {
    unexplained: Vec<UnexplainedChange>,
    /// Time of the latest NMT command or control word by SDO, per node.
    commanded: NodeMap<i64>,
    all_commanded: Option<i64>,
}

fn new(_policy: &RulePolicy) -> StateLost {
    StateLost::default()
}

impl StateLost {
    fn note_cause(&mut self, node: NodeId, now: i64) {
        if let Some(time) = self.commanded.entry(node) {
            *time = now;
        }
    }

    fn is_commanded(&self, node: NodeId, now: i64) -> bool {
        let of_all = self.all_commanded.into_iter();
        of_all.chain(self.commanded.get(node).copied()).any(|time| now.saturating_sub(time) <= WINDOW)
    }

    fn on_state(&mut self, event: &Event, node: NodeId, state: &DeviceState, context: &mut RuleContext<'_>) {
        let Some((place, machine)) = context.event_node(event).and_then(|node| state_machine(node, state))
        else {
            return;
        };
        let is_active = |name: &str| machine.states.iter().any(|known| known.active && known.name == name);
        if is_active(&state.to) {
            self.report_all(context, |known| known.node == node && known.state.channel == state.channel);
            return context.close_condition(Some(node), machine_subject(state.channel));
        }
        let Some(from) = state.from.as_deref().filter(|from| is_active(from)) else { return };
        if matches!(state.cause, DeviceCause::ControlWord | DeviceCause::NmtCommand)
            || self.is_commanded(node, context.now)
        {
            return context.count_pass();
        }
        // Without a control word, the bus does not command the state.
        let control = context.event_node(event).and_then(|node| node.control_word(place));
        let Some(control) = control else { return };
        if !keeps_state(machine, from, control) {
            return context.count_pass();
        }
        let (time, frame) = (context.now, event.frames.last);
        self.unexplained.push(UnexplainedChange { node, state: state.clone(), control, time, frame });
        if state.cause == DeviceCause::NotOnTheBus && context.has_time {
            context.wake_at(time.saturating_add(CAUSE_DELAY), 0);
        } else {
            self.report_all(context, |known| known.node == node && known.frame == frame);
        }
    }

    /// An event that explains changes of the node shortly before it.
    fn on_cause(&mut self, event: &Event, cause: (DeviceCause, Option<u16>), context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        for known in self.unexplained.iter_mut().filter(|known| known.node == node) {
            (known.state.cause, known.state.emcy) = cause;
            known.state.cause_frame = event.frames.last;
        }
        self.report_all(context, |known| known.node == node);
    }

    fn report_all(&mut self, context: &mut RuleContext<'_>, is_due: impl Fn(&UnexplainedChange) -> bool) {
        for known in self.unexplained.extract_if(.., |known| is_due(known)) {
            let UnexplainedChange { node, state, control, time, frame } = known;
            let severity = if state.fault { Severity::Error } else { Severity::Warning };
            let alarm = context.fail_at(time, Some(node), FrameRange::one(frame));
            let alarm =
                alarm.with_subject(machine_subject(state.channel)).with_severity(severity).mark_ongoing();
            alarm.report_finding(|| {
                let (from, to) = (state.from.as_deref().unwrap_or_default(), &state.to);
                let cause = cause_text(&state);
                format!("{from} → {to} although control word {control:02X} commands {from} (cause: {cause})")
            });
        }
    }
}

fn cause_text(state: &DeviceState) -> String {
    let frame = state.cause_frame;
    match (state.cause, state.emcy) {
        (DeviceCause::NotOnTheBus, _) => "not on the bus, hardware enable?".to_owned(),
        (_, Some(code)) => format!("EMCY {code:04X} {{{frame}}}"),
        (cause, None) => format!("{} {{{frame}}}", cause.name()),
    }
}

impl Rule for StateLost {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::DeviceState(state), Some(node)) => self.on_state(event, node, state, context),
            (EventKind::NmtCommand { service: NmtService::Start, .. }, _) => {}
            (EventKind::NmtCommand { target: 0, .. }, _) => self.all_commanded = Some(context.now),
            (EventKind::NmtCommand { target, .. }, _) => {
                self.note_cause(NodeId::Canopen(*target), context.now);
            }
            (EventKind::BootUp { cause: BootCause::Commanded { .. }, .. }, Some(node)) => {
                self.note_cause(node, context.now);
            }
            (EventKind::BootUp { .. }, _) => self.on_cause(event, (DeviceCause::BootUp, None), context),
            (EventKind::Emcy(emergency), _) if emergency.boot.is_some() => {
                self.on_cause(event, (DeviceCause::BootUp, None), context);
            }
            (EventKind::Emcy(emergency), _) if emergency.action == EmcyAction::Raised => {
                self.on_cause(event, (DeviceCause::Emcy, emergency.code), context);
            }
            (EventKind::Dtc(dtc), _) if dtc.action == DtcAction::Raised => {
                self.on_cause(event, (DeviceCause::Dtc, None), context);
            }
            // A control word by SDO overrides the last one in a PDO.
            (EventKind::SdoTransfer(transfer), Some(node)) if is_control(event, transfer, context) => {
                self.note_cause(node, context.now);
            }
            _ => {}
        }
    }

    fn on_wake(&mut self, _token: u64, context: &mut RuleContext<'_>) {
        let now = context.now;
        self.report_all(context, |known| now >= known.time.saturating_add(CAUSE_DELAY));
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        self.report_all(context, |_| true);
    }
}
