//! Fault reset bits that are held instead of toggled.

use super::machines::{edges_out, machine_subject, state_machine};
use crate::event::{DecodedPdo, DeviceState, EmcyAction, Event, EventKind, Kind};
use crate::profile::SignalId;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{PdoSubset, Rule, RuleContext, RulePolicy};
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
        define_tolerance("messages", 3.0, "", "consecutive control words with the bit set"),
        define_tolerance("time-ms", 300.0, "ms", "for which the bit is set"),
    ],
}

/// Maximum number of faults per node; each channel has at most one.
const FAULT_LIMIT: usize = 16;

/// Fault that has not been reset.
struct PendingFault {
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
    is_reported: bool,
}

struct FaultResetWithoutEdge {
    messages: f64,
    time: i64,
    faults: NodeMap<Vec<PendingFault>>,
    /// Number of faults of all nodes; without a fault, PDOs are skipped.
    count: usize,
}

fn new(policy: &RulePolicy) -> FaultResetWithoutEdge {
    FaultResetWithoutEdge {
        messages: policy.tolerance_value(&DECLARATION, "messages"),
        time: policy.tolerance_ns(&DECLARATION, "time-ms"),
        faults: NodeMap::default(),
        count: 0,
    }
}

impl FaultResetWithoutEdge {
    fn on_state(&mut self, event: &Event, node: NodeId, state: &DeviceState, context: &mut RuleContext<'_>) {
        if let Some(faults) = self.faults.get_mut(node)
            && let Some(place) = faults.iter().position(|fault| fault.channel == state.channel)
        {
            let fault = faults.swap_remove(place);
            self.count = self.count.saturating_sub(1);
            if fault.is_reported {
                fault.report_held_bits(event, context);
                context.close_condition(Some(node), machine_subject(fault.channel));
            } else if fault.has_edge {
                context.count_pass();
            }
        }
        let Some((_, machine)) = context.event_node(event).and_then(|node| state_machine(node, state)) else {
            return;
        };
        let edges = edges_out(machine, &state.to);
        let Some(faults) = self.faults.entry(node) else { return };
        if state.fault && edges != 0 && faults.len() < FAULT_LIMIT {
            self.count += 1;
            faults.push(PendingFault {
                channel: state.channel,
                state: state.to.clone(),
                leave: state.leave.clone(),
                control: machine.control.object.object,
                edges,
                since: None,
                first_frame: 0,
                count: 0,
                has_edge: false,
                is_reported: false,
            });
        }
    }

    #[cold]
    fn on_control(&mut self, event: &Event, node: NodeId, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let (Some(faults), Some(layout)) = (self.faults.get_mut(node), &pdo.layout) else { return };
        for fault in faults {
            let own = |id: SignalId| id == SignalId::Object(fault.control);
            let field = layout.fields.iter().find(|field| own(field.id));
            let Some(control) = field.and_then(|field| field.extract_bits(pdo.payload())) else { continue };
            fault.take_control(control, event.frames.last, context.now);
            let Some(since) = fault.since.filter(|_| !fault.has_edge && !fault.is_reported) else { continue };
            #[expect(clippy::cast_precision_loss, reason = "a count of messages")]
            let is_held = fault.count as f64 >= self.messages
                || context.has_time && context.now.saturating_sub(since) >= self.time;
            if is_held {
                fault.is_reported = true;
                fault.report_held_bits(event, context);
            }
        }
    }

    fn forget_fault(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        for fault in self.faults.remove(node).unwrap_or_default() {
            self.count = self.count.saturating_sub(1);
            if fault.is_reported {
                context.close_condition(Some(node), machine_subject(fault.channel));
            }
        }
    }
}

impl PendingFault {
    fn take_control(&mut self, control: u64, frame: u64, now: i64) {
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

    fn report_held_bits(&self, event: &Event, context: &mut RuleContext<'_>) {
        let (count, state) = (self.count, &self.state);
        let since = self.since.and_then(|time| context.timestamp_of(time));
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context
            .start_finding(event)
            .with_subject(machine_subject(self.channel))
            .with_measure(count as f64)
            .started_at(since);
        alarm.report_finding(|| {
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
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Pdo(pdo) if self.count > 0 => self.on_control(event, node, pdo, context),
            EventKind::DeviceState(state) => self.on_state(event, node, state, context),
            EventKind::Emcy(emergency) if emergency.action == EmcyAction::AllCleared => {
                for fault in self.faults.get_mut(node).into_iter().flatten().filter(|it| !it.is_reported) {
                    (fault.since, fault.count, fault.has_edge) = (None, 0, false);
                }
            }
            EventKind::BootUp { .. } => self.forget_fault(node, context),
            _ => {}
        }
    }
}
