//! NMT commands that are none.

use crate::event::{Event, EventKind};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::wire::canopen::nmt::NmtService;

declare_rule! {
    /// # What it checks
    /// An NMT command is one of the five, to a node-ID up to 127. Its length is told by `malformed-message`.
    ///
    /// # Why it matters
    /// Nodes ignore it, or each does something else: the master believes that the machine obeys.
    ///
    /// # Source
    /// CiA 301 §7.2.8.3.1 (NMT node control)
    ///
    /// # What to look at first
    /// What of the application sends on identifier 000.
    ///
    /// # Mutation
    /// insert a command with specifier 3
    "nmt-command-invalid", Warning, "an NMT command is none",
    kinds: ["nmt-command"],
    word: "NMT",
}

struct NmtCommandInvalid;

fn new(_policy: &Policy) -> NmtCommandInvalid {
    NmtCommandInvalid
}

impl Rule for NmtCommandInvalid {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::NmtCommand { service: NmtService::Unknown(code), .. } => {
                context.fail(event).say(|| format!("command {code:02X}h is none of the five"));
            }
            EventKind::NmtCommand { target, .. } if *target > 127 => {
                context.fail(event).say(|| format!("command to node {target}; node-IDs go up to 127"));
            }
            EventKind::NmtCommand { .. } => context.pass(),
            _ => {}
        }
    }
}
