//! CRC of SDO block transfers.

use crate::event::{CrcCheck, Event, EventKind, Kind, SdoOutcome};
use crate::finding::Severity;
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};

declare_rule! {
    /// # What it checks
    /// The CRC of a block transfer differs from that of the captured data. Both sides must support the CRC,
    /// and the capture must contain all segments. It is a warning if the receiver refused the data.
    ///
    /// # Why it matters
    /// The receiver has other data than was sent, so firmware or parameters are corrupt.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.16 (CRC)
    ///
    /// # What to look at first
    /// Check the CRC algorithm of the sender (polynomial 1021h, start 0). Check whether the receiver verifies
    /// the CRC.
    ///
    /// # Mutation
    /// change a byte in a segment of a block
    "sdo-block-crc", Error, "CRC error in SDO block transfer",
    kinds: [Kind::SdoTransfer],
    needs: "a block transfer with CRC, captured completely",
    skips_holes: true,
    cases: &["2.23", "2.24", "2.25"],
    word: "SDO",
}

struct SdoBlockCrc;

fn new(_policy: &RulePolicy) -> SdoBlockCrc {
    SdoBlockCrc
}

impl Rule for SdoBlockCrc {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        match transfer.crc {
            Some(CrcCheck::Correct) => context.count_pass(),
            Some(CrcCheck::Wrong) => {
                let is_refused = transfer.outcome == SdoOutcome::Aborted;
                let severity = if is_refused { Severity::Warning } else { Severity::Error };
                let end = if is_refused { "refused" } else { "accepted" };
                let alarm = context
                    .start_finding(event)
                    .with_subject(transfer_subject(transfer))
                    .with_severity(severity);
                alarm.report_finding(|| format!("CRC error over {} bytes (data {end})", transfer.size));
            }
            _ => {}
        }
    }
}
