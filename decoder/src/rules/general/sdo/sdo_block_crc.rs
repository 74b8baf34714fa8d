//! CRC of SDO block transfers.

use crate::event::{Crc, Event, EventKind, Outcome};
use crate::finding::Severity;
use crate::rules::general::facts::about;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// The CRC at the end of a block transfer equals that of the data seen, where both sides offered one and all
    /// segments were seen. A warning where the receiver refused the data therefore.
    ///
    /// # Why it matters
    /// The data that arrived is not the data that was sent: firmware or parameters are broken.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.16 (CRC)
    ///
    /// # What to look at first
    /// The sender's CRC (polynomial 1021h, start 0), and whether the receiver checks it at all.
    ///
    /// # Mutation
    /// change a byte of a block's segment
    "sdo-block-crc", Error, "the CRC of a block transfer does not fit its data",
    kinds: ["sdo-transfer"],
    cases: &["2.23", "2.24", "2.25"],
    word: "SDO",
}

struct SdoBlockCrc;

fn new(_policy: &Policy) -> SdoBlockCrc {
    SdoBlockCrc
}

impl Rule for SdoBlockCrc {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        match transfer.crc {
            Some(Crc::Correct) => context.pass(),
            Some(Crc::Wrong) => {
                let is_refused = transfer.outcome == Outcome::Aborted;
                let severity = if is_refused { Severity::Warning } else { Severity::Error };
                let end = if is_refused { "refused" } else { "taken nevertheless" };
                let alarm = context.fail(event).about(about(transfer)).severity(severity);
                alarm.say(|| format!("CRC does not fit the {} bytes sent: {end}", transfer.size));
            }
            _ => {}
        }
    }
}
