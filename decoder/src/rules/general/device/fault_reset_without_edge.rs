//! A controller holds the reset bit of a fault instead of raising it.

use super::machines::{about, edges_out, machine};
use crate::event::{DeviceState, EmcyAction, Event, EventKind, Pdo};
use crate::profile::SignalId;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A device reports a fault that only a rising bit of the control word leaves, and that bit stays set in message
    /// after message: it never rises. A bit that rose in vain counts again once all errors are gone.
    ///
    /// # Why it matters
    /// The fault stays for ever, however often the reset is sent, and it looks like a broken device.
    ///
    /// # Source
    /// State machine of the device's manual; for fluid power CiA 408: the reset bit acts by its edge.
    ///
    /// # What to look at first
    /// What the controller sends as control word: first without the bit, then with it.
    ///
    /// # Mutation
    /// send the control word with the reset bit from before the fault on
    "fault-reset-without-edge", Warning, "the reset bit is held, so the fault is never reset",
    kinds: ["rpdo", "device-state", "emcy", "boot-up"],
    word: "STUCK",
    tolerances: &[
        tolerance("messages", 3.0, "", "control words in a row with the bit set"),
        tolerance("time-ms", 300.0, "ms", "for which it is set"),
    ],
}

/// Faults remembered of a node: one a channel.
const FAULT_LIMIT: usize = 16;

/// A fault that waits for its reset.
struct Fault {
    channel: Option<u8>,
    state: String,
    leave: Option<String>,
    control: ObjectAddress,
    /// Bits that must rise.
    edges: u64,
    /// All of them are set since then.
    since: Option<i64>,
    first_frame: u64,
    count: u64,
    /// They were clear in this fault, and rose or will.
    has_edge: bool,
    is_told: bool,
}

struct FaultResetWithoutEdge {
    messages: f64,
    time: i64,
    faults: NodeMap<Vec<Fault>>,
    /// Faults of all nodes: with none a PDO costs nothing.
    count: usize,
}

fn new(policy: &Policy) -> FaultResetWithoutEdge {
    FaultResetWithoutEdge {
        messages: policy.tolerance(&DECLARATION, "messages"),
        time: policy.nanoseconds(&DECLARATION, "time-ms"),
        faults: NodeMap::default(),
        count: 0,
    }
}

impl FaultResetWithoutEdge {
    fn state(&mut self, event: &Event, node: NodeId, state: &DeviceState, context: &mut Context<'_>) {
        if let Some(faults) = self.faults.get_mut(node)
            && let Some(place) = faults.iter().position(|fault| fault.channel == state.channel)
        {
            let fault = faults.swap_remove(place);
            self.count = self.count.saturating_sub(1);
            if fault.is_told {
                fault.tell(event, context);
                context.close(Some(node), about(fault.channel));
            } else if fault.has_edge {
                context.pass();
            }
        }
        let Some((_, machine)) = context.node(event).and_then(|node| machine(node, state)) else { return };
        let edges = edges_out(machine, &state.to);
        let Some(faults) = self.faults.entry(node) else { return };
        if state.fault && edges != 0 && faults.len() < FAULT_LIMIT {
            self.count += 1;
            faults.push(Fault {
                channel: state.channel,
                state: state.to.clone(),
                leave: state.leave.clone(),
                control: machine.control.object.object,
                edges,
                since: None,
                first_frame: 0,
                count: 0,
                has_edge: false,
                is_told: false,
            });
        }
    }

    #[cold]
    fn control(&mut self, event: &Event, node: NodeId, pdo: &Pdo, context: &mut Context<'_>) {
        let (Some(faults), Some(layout)) = (self.faults.get_mut(node), &pdo.layout) else { return };
        for fault in faults {
            let own = |id: SignalId| id == SignalId::Object(fault.control);
            let field = layout.fields.iter().find(|field| own(field.id));
            let Some(control) = field.and_then(|field| field.extract(pdo.payload())) else { continue };
            fault.take(control, event.frames.last, context.now);
            let Some(since) = fault.since.filter(|_| !fault.has_edge && !fault.is_told) else { continue };
            #[expect(clippy::cast_precision_loss, reason = "a count of messages")]
            let is_held = fault.count as f64 >= self.messages
                || context.has_time && context.now.saturating_sub(since) >= self.time;
            if is_held {
                fault.is_told = true;
                fault.tell(event, context);
            }
        }
    }

    fn forget(&mut self, node: NodeId, context: &mut Context<'_>) {
        for fault in self.faults.remove(node).unwrap_or_default() {
            self.count = self.count.saturating_sub(1);
            if fault.is_told {
                context.close(Some(node), about(fault.channel));
            }
        }
    }
}

impl Fault {
    fn take(&mut self, control: u64, frame: u64, now: i64) {
        if control & self.edges != self.edges {
            // From here on the bits can rise.
            (self.since, self.count, self.has_edge) = (None, 0, true);
            return;
        }
        if self.since.is_none() {
            (self.since, self.first_frame) = (Some(now), frame);
        }
        self.count += 1;
    }

    fn tell(&self, event: &Event, context: &mut Context<'_>) {
        let (count, state, bits) = (self.count, &self.state, self.edges);
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.fail(event).about(about(self.channel)).measure(count as f64).ongoing();
        alarm.say(|| {
            let how = self.leave.as_deref().map_or_else(String::new, |leave| format!(": {leave}"));
            let first = self.first_frame;
            format!("{state}: control with bit {bits:02X} set × {count} since {{{first}}}, it must rise{how}")
        });
    }
}

impl Rule for FaultResetWithoutEdge {
    fn wants_pdos(&self) -> bool {
        self.count > 0
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Pdo(pdo) if self.count > 0 => self.control(event, node, pdo, context),
            EventKind::DeviceState(state) => self.state(event, node, state, context),
            EventKind::Emcy(emergency) if emergency.action == EmcyAction::AllCleared => {
                for fault in self.faults.get_mut(node).into_iter().flatten().filter(|it| !it.is_told) {
                    (fault.since, fault.count, fault.has_edge) = (None, 0, false);
                }
            }
            EventKind::BootUp { .. } => self.forget(node, context),
            _ => {}
        }
    }
}
