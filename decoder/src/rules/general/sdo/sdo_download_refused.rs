//! SDO downloads that a device refuses.

use crate::event::{Event, EventKind, Kind, SdoAbort, SdoDirection, SdoMode, SdoOutcome, SdoTransfer};
use crate::finding::{FindingSubject, MergedFindings};
use crate::profile::abort_codes;
use crate::query::record;
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeMap;
use crate::wire::canopen::ObjectAddress;
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// The server aborts an SDO download. There is one finding per object, and a common one for all further
    /// objects of a node after the first 32. Captures with the case markers of a conformance test are exempt.
    ///
    /// # Why it matters
    /// The device does not have the setting that the master requires, and works with another one.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.17 (abort SDO transfer)
    ///
    /// # What to look at first
    /// Check access, range and length of the object in the EDS. The device state may also prevent the write.
    /// Compare the configuration of the master with the EDS of this firmware.
    ///
    /// # Mutation
    /// turn the response to a download into an abort
    "sdo-download-refused", Error, "SDO download refused",
    kinds: [Kind::SdoTransfer],
    needs: "an SDO download",
    merge: MergedFindings::Node,
    word: "REFUSE",
}

/// Maximum number of objects per node with their own finding.
const OBJECT_LIMIT: usize = 32;

/// Command specifier not valid or unknown (CiA 301 table 22): the server has no block transfer.
const NO_BLOCKS: u32 = 0x0504_0001;

#[derive(Default)]
struct SdoDownloadRefused {
    refused: NodeMap<Vec<ObjectAddress>>,
}

fn new(_policy: &RulePolicy) -> SdoDownloadRefused {
    SdoDownloadRefused::default()
}

impl SdoDownloadRefused {
    fn on_refused(
        &mut self,
        event: &Event,
        transfer: &SdoTransfer,
        code: u32,
        context: &mut RuleContext<'_>,
    ) {
        let known = event.node.and_then(|node| self.refused.entry(node)).zip(transfer.object);
        let is_one_of_many = known.is_some_and(|(known, object)| {
            let is_reported = known.contains(&object);
            if !is_reported && known.len() < OBJECT_LIMIT {
                known.push(object);
                return false;
            }
            !is_reported
        });
        let about = if is_one_of_many { FindingSubject::Whole } else { transfer_subject(transfer) };
        let device = record::event_device(event, context.bus);
        let own = device.abort_entry(code, transfer.object).map(|own| own.text.as_str());
        let text = own.unwrap_or_else(|| abort_codes().code_text(code));
        context.start_finding(event).with_subject(about).with_reason(text).report_finding(|| {
            let further = if is_one_of_many { " to a further object" } else { "" };
            format!("write of {}{further} refused: {code:08X} {text}", value_text(transfer))
        });
    }
}

/// The value of the write for display.
fn value_text(transfer: &SdoTransfer) -> String {
    match &transfer.meaning {
        Some(meaning) if !transfer.truncated && !transfer.data.is_empty() => {
            meaning.format_value(&meaning.decode(&transfer.data))
        }
        _ => count_noun(transfer.size, "byte"),
    }
}

impl Rule for SdoDownloadRefused {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        if transfer.direction != Some(SdoDirection::Download) || context.is_tested {
            return;
        }
        match (transfer.outcome, transfer.abort) {
            (SdoOutcome::Complete, _) => context.count_pass(),
            // A client that requests a block transfer continues without it.
            (SdoOutcome::Aborted, Some(SdoAbort { code: NO_BLOCKS, .. }))
                if transfer.mode == Some(SdoMode::Block) => {}
            (SdoOutcome::Aborted, Some(SdoAbort { code, by_client: false })) => {
                self.on_refused(event, transfer, code, context);
            }
            _ => {}
        }
    }
}
