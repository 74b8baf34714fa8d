//! Undefined NMT commands.

use crate::event::{Event, EventKind, Kind};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::nmt::NmtService;

declare_rule! {
    /// # What it checks
    /// An NMT command must be one of the five defined commands, for a node-ID up to 127. `malformed-message`
    /// checks its length.
    ///
    /// # Why it matters
    /// Nodes ignore the command or react differently, while the master assumes that all nodes execute it.
    ///
    /// # Source
    /// CiA 301 §7.2.8.3.1 (NMT node control)
    ///
    /// # What to look at first
    /// Find the program that sends on identifier 000.
    ///
    /// # Mutation
    /// insert a command with specifier 3
    "nmt-command-invalid", Warning, "undefined NMT command",
    kinds: [Kind::NmtCommand],
    needs: "an NMT command",
    word: "NMT",
}

struct NmtCommandInvalid;

fn new(_policy: &RulePolicy) -> NmtCommandInvalid {
    NmtCommandInvalid
}

impl Rule for NmtCommandInvalid {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::NmtCommand { service: NmtService::Unknown(code), .. } => {
                context.start_finding(event).report_finding(|| format!("undefined NMT command {code:02X}h"));
            }
            EventKind::NmtCommand { target, .. } if *target > 127 => {
                context
                    .start_finding(event)
                    .report_finding(|| format!("NMT command to node-ID {target} (max 127)"));
            }
            EventKind::NmtCommand { .. } => context.count_pass(),
            _ => {}
        }
    }
}
