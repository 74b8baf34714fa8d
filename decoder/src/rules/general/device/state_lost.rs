//! A device leaves its active state although it is still commanded.

use super::machines::{about, machine, stays};
use crate::event::{BootCause, DeviceCause, DeviceState, Direction, Event, EventKind, SdoTransfer};
use crate::finding::Severity;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::nmt::NmtService;

declare_rule! {
    /// # What it checks
    /// A device reports that it left the state in which set points act, while the control word as sent last still
    /// commands that state and the NMT master neither stopped nor reset it. What the bus tells of the cause is
    /// said; where it tells nothing, the cause is "not on the bus". An error where the new state is a fault.
    ///
    /// # Why it matters
    /// The outputs went off in the middle of a movement, and the controller did not want it.
    ///
    /// # Source
    /// State machine of the device's manual; for fluid power CiA 408.
    ///
    /// # What to look at first
    /// The cause; if it is not on the bus: the hardware enable, the maker's tool, supply of the outputs.
    ///
    /// # Mutation
    /// set the status word of an active device to fault
    "state-lost", Error, "a device leaves its active state although it is still commanded",
    kinds: ["device-state", "nmt-command", "boot-up", "sdo-transfer"],
    word: "STATE",
}

/// An NMT command explains states for so long, in nanoseconds.
const WINDOW: i64 = 2_000_000_000;

#[derive(Default)]
struct StateLost {
    /// When the master stopped or reset a node last, or wrote its control word by SDO.
    commanded: NodeMap<i64>,
    all_commanded: Option<i64>,
}

fn new(_policy: &Policy) -> StateLost {
    StateLost::default()
}

impl StateLost {
    fn note(&mut self, node: NodeId, now: i64) {
        if let Some(time) = self.commanded.entry(node) {
            *time = now;
        }
    }

    fn is_commanded(&self, node: NodeId, now: i64) -> bool {
        let of_all = self.all_commanded.into_iter();
        of_all.chain(self.commanded.get(node).copied()).any(|time| now.saturating_sub(time) <= WINDOW)
    }

    fn state(&self, event: &Event, node: NodeId, state: &DeviceState, context: &mut Context<'_>) {
        let Some((place, machine)) = context.node(event).and_then(|node| machine(node, state)) else {
            return;
        };
        let is_active = |name: &str| machine.states.iter().any(|known| known.active && known.name == name);
        if is_active(&state.to) {
            return context.close(Some(node), about(state.channel));
        }
        let Some(from) = state.from.as_deref().filter(|from| is_active(from)) else { return };
        if matches!(state.cause, DeviceCause::ControlWord | DeviceCause::NmtCommand)
            || self.is_commanded(node, context.now)
        {
            return context.pass();
        }
        // Without a control word nobody on the bus commands it.
        let control = context.node(event).and_then(|node| node.control_word(place));
        let Some(control) = control else { return };
        if !stays(machine, from, control) {
            return context.pass();
        }
        let severity = if state.fault { Severity::Error } else { Severity::Warning };
        let alarm = context.fail(event).about(about(state.channel)).severity(severity).ongoing();
        alarm.say(|| {
            let to = &state.to;
            format!("{from} → {to} while control {control:02X} commands {from}, cause {}", cause(state))
        });
    }
}

/// Whether a transfer writes a control word.
fn is_control(event: &Event, transfer: &SdoTransfer, context: &Context<'_>) -> bool {
    transfer.direction == Some(Direction::Download)
        && context.node(event).is_some_and(|node| {
            let mut machines = node.device().machines.iter();
            machines.any(|machine| transfer.object == Some(machine.control.object.object))
        })
}

fn cause(state: &DeviceState) -> String {
    let frame = state.cause_frame;
    match (state.cause, state.emcy) {
        (DeviceCause::NotOnTheBus, _) => "not on the bus (hardware enable?)".to_owned(),
        (_, Some(code)) => format!("EMCY {code:04X} {{{frame}}}"),
        (cause, None) => format!("{} {{{frame}}}", cause.name()),
    }
}

impl Rule for StateLost {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match (&event.kind, event.node) {
            (EventKind::DeviceState(state), Some(node)) => self.state(event, node, state, context),
            (EventKind::NmtCommand { service: NmtService::Start, .. }, _) => {}
            (EventKind::NmtCommand { target: 0, .. }, _) => self.all_commanded = Some(context.now),
            (EventKind::NmtCommand { target, .. }, _) => self.note(NodeId::Canopen(*target), context.now),
            (EventKind::BootUp { cause: BootCause::Commanded { .. }, .. }, Some(node)) => {
                self.note(node, context.now);
            }
            // A control word by SDO is not the one sent last in a PDO.
            (EventKind::SdoTransfer(transfer), Some(node)) if is_control(event, transfer, context) => {
                self.note(node, context.now);
            }
            _ => {}
        }
    }
}
