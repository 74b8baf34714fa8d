//! SDO uploads that a device refuses.

use crate::event::{Event, EventKind, Kind, SdoAbort, SdoDirection, SdoOutcome};
use crate::finding::MergedFindings;
use crate::profile::abort_codes;
use crate::query::record;
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeMap;

declare_rule! {
    /// # What it checks
    /// The server aborts an SDO upload. After `missing` reads of objects that do not exist, further ones
    /// count as a scan and are exempt.
    ///
    /// # Why it matters
    /// The client may lack a value that it requires. Often it only reads optional objects.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.17 (abort SDO transfer)
    ///
    /// # What to look at first
    /// Compare the request with the EDS of this firmware.
    ///
    /// # Mutation
    /// turn the response to an upload into an abort
    "sdo-upload-refused", Note, "SDO upload refused",
    kinds: [Kind::SdoTransfer],
    needs: "an SDO upload",
    merge: MergedFindings::Node,
    is_on: false,
    word: "REFUSE",
    tolerances: &[define_tolerance("missing", 5.0, "", "reads of missing objects before they count as a scan")],
}

struct SdoUploadRefused {
    most: f64,
    missing: NodeMap<f64>,
}

fn new(policy: &RulePolicy) -> SdoUploadRefused {
    SdoUploadRefused { most: policy.tolerance_value(&DECLARATION, "missing"), missing: NodeMap::default() }
}

/// Abort codes for a missing object and a missing sub-index.
const MISSING: [u32; 2] = [0x0602_0000, 0x0609_0011];

impl Rule for SdoUploadRefused {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        if transfer.direction != Some(SdoDirection::Upload) || context.is_tested {
            return;
        }
        let code = match (transfer.outcome, transfer.abort) {
            (SdoOutcome::Complete, _) => return context.count_pass(),
            (SdoOutcome::Aborted, Some(SdoAbort { code, by_client: false })) => code,
            _ => return,
        };
        if let Some(count) =
            event.node.and_then(|node| self.missing.entry(node)).filter(|_| MISSING.contains(&code))
        {
            *count += 1.0;
            if *count > self.most {
                return;
            }
        }
        let own = record::event_device(event, context.bus).abort_entry(code, transfer.object);
        let text = own.map_or_else(|| abort_codes().code_text(code), |own| &own.text);
        let alarm = context.start_finding(event).with_subject(transfer_subject(transfer)).with_reason(text);
        alarm.report_finding(|| format!("read refused: {code:08X} {text}"));
    }
}
