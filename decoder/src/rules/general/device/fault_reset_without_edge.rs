//! Fault reset bits that are held instead of toggled.

use super::machines::{about, edges_out, machine};
use crate::event::{DeviceState, EmcyAction, Event, EventKind, Kind, Pdo};
use crate::profile::SignalId;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, PdoSubset, Policy, Rule};
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A device reports a fault that only a rising edge of a control word bit resets, and that bit stays set.
    /// After an edge without success, the check restarts when all errors are cleared.
    ///
    /// # Why it matters
    /// The fault is never reset, and the device seems to be defective.
    ///
    /// # Source
    /// State machine in the device manual; for fluid power CiA 408: the reset bit is edge-triggered.
    ///
    /// # What to look at first
    /// Send the control word without the reset bit, then with it.
    ///
    /// # Mutation
    /// send the control word with the reset bit set, starting before the fault
    "fault-reset-without-edge", Warning, "fault reset bit held without an edge",
    kinds: [Kind::Pdo, Kind::DeviceState, Kind::Emcy, Kind::BootUp],
    pdos: PdoSubset::Received,
    needs: "a reported fault that an edge of the control word resets",
    word: "STUCK",
    tolerances: &[
        tolerance("messages", 3.0, "", "consecutive control words with the bit set"),
        tolerance("time-ms", 300.0, "ms", "for which the bit is set"),
    ],
}

/// Maximum number of faults per node; each channel has at most one.
const FAULT_LIMIT: usize = 16;

/// Fault that has not been reset.
struct Fault {
    channel: Option<u8>,
    state: String,
    leave: Option<String>,
    control: ObjectAddress,
    /// Bits that need a rising edge.
    edges: u64,
    /// Time since all of these bits are set.
    since: Option<i64>,
    first_frame: u64,
    count: u64,
    /// The bits were cleared during this fault, so an edge follows.
    has_edge: bool,
    is_told: bool,
}

struct FaultResetWithoutEdge {
    messages: f64,
    time: i64,
    faults: NodeMap<Vec<Fault>>,
    /// Number of faults of all nodes; without a fault, PDOs are skipped.
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
                fault.report_held_bits(event, context);
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
                fault.report_held_bits(event, context);
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
            // A rising edge is possible from here on.
            (self.since, self.count, self.has_edge) = (None, 0, true);
            return;
        }
        if self.since.is_none() {
            (self.since, self.first_frame) = (Some(now), frame);
        }
        self.count += 1;
    }

    fn report_held_bits(&self, event: &Event, context: &mut Context<'_>) {
        let (count, state) = (self.count, &self.state);
        let since = self.since.and_then(|time| context.timestamp_of(time));
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.fail(event).about(about(self.channel)).measure(count as f64).since(since);
        alarm.report(|| {
            let how = self.leave.as_deref().map_or_else(String::new, |leave| format!(": {leave}"));
            let bits = match self.edges.count_ones() {
                1 => format!("bit {}", self.edges.trailing_zeros()),
                _ => format!("bits {:02X}h", self.edges),
            };
            let first = self.first_frame;
            format!("fault reset ({bits}) held at 1 in {state} since {{{first}}} (needs a 0→1 edge{how})")
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
