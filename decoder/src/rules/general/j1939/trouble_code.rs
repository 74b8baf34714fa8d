//! A J1939 device reports a fault.

use std::fmt::Write as _;

use crate::event::{Dtc, DtcAction, Event, EventKind};
use crate::finding::About;
use crate::profile;
use crate::query::record;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeSet, Policy, Rule};
use crate::wire::j1939::Pgn;

declare_rule! {
    /// # What it checks
    /// A device lists a trouble code (SPN and FMI) in DM1. One finding a code, until DM1 comes without it or the device
    /// clears it; one that a more urgent fault may hide goes on.
    ///
    /// # Why it matters
    /// The device itself says that something is wrong.
    ///
    /// # Source
    /// SAE J1939-73 §5.7.1 (DM1); codes by the device's manual.
    ///
    /// # What to look at first
    /// What SPN and FMI mean by the manual, and what changed just before (`cobscope why`).
    ///
    /// # Mutation
    /// replace a DM1 without faults by one with a fault
    "trouble-code", Warning, "a device reports a fault in DM1",
    kinds: ["dtc", "j1939-message"],
    word: "DTC",
}

#[derive(Default)]
struct TroubleCode {
    /// A DM1 of theirs was seen.
    seen: NodeSet,
}

fn new(_policy: &Policy) -> TroubleCode {
    TroubleCode::default()
}

/// What the code means.
fn words(dtc: &Dtc, event: &Event, context: &Context<'_>) -> String {
    let own = record::device(event, context.bus).dtc(dtc.spn, dtc.fmi);
    let parameter = context.bus.parameter(dtc.spn).map_or(String::new(), |known| format!("{}: ", known.name));
    let mode = profile::failure_modes().find(u32::from(dtc.fmi));
    let mut text = match (own, mode) {
        (Some(own), _) => format!("fault in DM1: {}", own.text),
        (None, Some(mode)) => format!("fault in DM1: {parameter}{}", mode.text),
        (None, None) => format!("fault in DM1: {parameter}SPN {} FMI {}", dtc.spn, dtc.fmi),
    };
    if !dtc.lamps.is_empty() {
        let _ = write!(text, "; lamps {}", dtc.lamps.join(" "));
    }
    text
}

impl Rule for TroubleCode {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::J1939Message(message) if message.id.pgn == Pgn::DM1 => {
                let (Some(id), Some(node)) = (event.node, context.node(event)) else { return };
                // What this DM1 lists comes as events behind it; the one before had no fault.
                if !self.seen.insert(id) && node.active_dtcs().next().is_none() {
                    context.pass();
                }
            }
            EventKind::Dtc(dtc) => {
                let about = About::Fault(dtc.spn, dtc.fmi);
                match dtc.action {
                    DtcAction::Raised | DtcAction::Recurred => {
                        let text = words(dtc, event, context);
                        context.fail(event).about(about).ongoing().say(|| text);
                    }
                    DtcAction::NoLongerReported if dtc.may_be_hidden => {}
                    DtcAction::NoLongerReported | DtcAction::Cleared => context.close(event.node, about),
                    DtcAction::PreviouslyActive => {}
                }
            }
            _ => {}
        }
    }
}
