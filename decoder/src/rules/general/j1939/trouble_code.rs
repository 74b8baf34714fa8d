//! Faults that a J1939 device reports in DM1.

use std::fmt::Write as _;

use crate::event::{Dtc, DtcAction, Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::profile;
use crate::query::record;
use crate::rules::rule::declare_rule;
use crate::rules::{FrameNeed, Rule, RuleContext, RulePolicy};
use crate::wire::NodeSet;
use crate::wire::j1939::Pgn;

declare_rule! {
    /// # What it checks
    /// A device lists a trouble code (SPN and FMI) in DM1. There is one finding per code, open until DM1
    /// omits the code or the device clears it. A code that a more urgent fault may hide stays open.
    ///
    /// # Why it matters
    /// The device itself reports a fault.
    ///
    /// # Source
    /// SAE J1939-73 §5.7.1 (DM1); codes: manual of the device.
    ///
    /// # What to look at first
    /// Look up SPN and FMI in the device manual. `cobscope why` shows the events before the fault.
    ///
    /// # Mutation
    /// replace a DM1 without faults by one with a fault
    "trouble-code", Warning, "fault reported in DM1",
    kinds: [Kind::Dtc, Kind::J1939Message],
    needs: "DM1",
    word: "DTC",
}

#[derive(Default)]
struct TroubleCode {
    /// Nodes with at least one DM1.
    seen: NodeSet,
}

fn new(_policy: &RulePolicy) -> TroubleCode {
    TroubleCode::default()
}

/// Description of the fault.
fn fault_text(dtc: &Dtc, event: &Event, context: &RuleContext<'_>) -> String {
    let own = record::event_device(event, context.bus).trouble_code_entry(dtc.spn, dtc.fmi);
    let parameter =
        context.bus.suspect_parameter(dtc.spn).map_or(String::new(), |known| format!("{}: ", known.name));
    let mode = profile::failure_modes().find_code(u32::from(dtc.fmi));
    let mut text = match (own, mode) {
        (Some(own), _) => format!("fault in DM1: {}", own.text),
        (None, Some(mode)) => format!("fault in DM1: {parameter}{}", mode.text),
        (None, None) => format!("fault in DM1: {parameter}SPN {} FMI {}", dtc.spn, dtc.fmi),
    };
    if !dtc.lamps.is_empty() {
        let _ = write!(text, " (lamps {})", dtc.lamps.join(" "));
    }
    text
}

impl Rule for TroubleCode {
    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        match &event.kind {
            EventKind::J1939Message(message) if message.id.pgn != Pgn::DM1 => FrameNeed::NOTHING,
            _ => FrameNeed::EACH,
        }
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::J1939Message(message) if message.id.pgn == Pgn::DM1 => {
                let (Some(id), Some(node)) = (event.node, context.event_node(event)) else { return };
                // Faults in this DM1 are reported by later events; the previous DM1 listed none.
                if !self.seen.insert(id) && node.active_dtcs().next().is_none() {
                    context.count_pass();
                }
            }
            EventKind::Dtc(dtc) => {
                let about = FindingSubject::Fault(dtc.spn, dtc.fmi);
                match dtc.action {
                    DtcAction::Raised | DtcAction::Recurred => {
                        let text = fault_text(dtc, event, context);
                        context
                            .start_finding(event)
                            .with_subject(about)
                            .mark_ongoing()
                            .report_finding(|| text);
                    }
                    DtcAction::NoLongerReported if dtc.may_be_hidden => {}
                    DtcAction::NoLongerReported | DtcAction::Cleared => {
                        context.close_condition(event.node, about);
                    }
                    DtcAction::PreviouslyActive => {}
                }
            }
            _ => {}
        }
    }
}
