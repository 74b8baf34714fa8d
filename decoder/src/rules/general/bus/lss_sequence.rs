//! Order of LSS messages, and refused LSS settings.

use std::sync::Arc;

use crate::event::{Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::profile::lss_names;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::lss::LssContent;

declare_rule! {
    /// # What it checks
    /// The four messages of switch state selective must arrive in this order: vendor, product, revision,
    /// serial number. A device must accept node-ID, bit timing and store commands (result 0), and refuse a
    /// node-ID other than 1 to 127 or 255 (none).
    ///
    /// # Why it matters
    /// The device keeps its old node-ID or bit rate, or loses the new one at power-off.
    ///
    /// # Source
    /// CiA 305 §3.9.2.1 (switch state selective), §3.9.3 (configuration)
    ///
    /// # What to look at first
    /// Look up the result code in the device manual. Check whether the device can store its configuration.
    ///
    /// # Mutation
    /// change the result of a configuration
    "lss-sequence", Warning, "LSS out of order or refused",
    kinds: [Kind::Lss],
    needs: "an LSS exchange",
    word: "LSS",
}

/// Command specifier of configure node-ID (CiA 305 §3.9.3.1).
const CONFIGURE_NODE_ID: u8 = 0x11;

/// First and last command specifier of switch state selective.
const VENDOR: u8 = 0x40;
const SERIAL: u8 = 0x43;

#[derive(Default)]
struct LssSequence {
    /// Next command specifier of switch state selective.
    next: Option<u8>,
    /// Requested node-ID, until the response.
    requested: Option<u8>,
}

fn new(_policy: &RulePolicy) -> LssSequence {
    LssSequence::default()
}

/// Node-ID that CiA 305 does not permit; 255 is a device without one.
const fn is_undefined(id: u8) -> bool {
    matches!(id, 0 | 128..=254)
}

impl LssSequence {
    /// Judges a node-ID that a device accepts or reports.
    fn node_id(event: &Event, id: u8, verb: &str, context: &mut RuleContext<'_>) {
        if !is_undefined(id) {
            return context.count_pass();
        }
        let alarm = context.start_finding(event).with_subject(FindingSubject::Name(Arc::from("node-ID")));
        alarm.report_finding(|| format!("node-ID {id} {verb} (1 to 127, or 255 = none)"));
    }
}

impl Rule for LssSequence {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::Lss { command, from_master, content } = &event.kind else { return };
        let command = *command;
        match (*from_master, content) {
            (true, _) if (VENDOR..=SERIAL).contains(&command) => {
                let wanted = self.next.replace(command + 1);
                // A capture may begin within the sequence.
                let Some(wanted) = wanted.or_else(|| (command == VENDOR).then_some(VENDOR)) else { return };
                if command == wanted || command == VENDOR {
                    return context.count_pass();
                }
                let alarm =
                    context.start_finding(event).with_subject(FindingSubject::Name(Arc::from("selective")));
                let names = [command, wanted].map(|command| lss_names().service_title(command).to_owned());
                alarm.report_finding(|| format!("{} received ({} expected)", names[0], names[1]));
            }
            (true, sent) => {
                self.next = None;
                self.requested = if let LssContent::NodeId(id) = sent { Some(*id) } else { None };
            }
            (false, LssContent::NodeId(id)) => Self::node_id(event, *id, "reported", context),
            (false, LssContent::Result { code: 0, .. }) if command == CONFIGURE_NODE_ID => {
                match self.requested.take() {
                    Some(id) => Self::node_id(event, id, "accepted", context),
                    None => context.count_pass(),
                }
            }
            (false, LssContent::Result { code: 0, .. }) => context.count_pass(),
            (false, LssContent::Result { code, specific }) => {
                let alarm = context
                    .start_finding(event)
                    .with_subject(FindingSubject::Name(Arc::from(lss_names().service_name(command))));
                alarm.report_finding(|| {
                    let text = lss_names().result_text(command, *code);
                    format!(
                        "{} refused: result {code} {text} (specific {specific:02X}h)",
                        lss_names().service_title(command)
                    )
                });
            }
            _ => {}
        }
    }
}
