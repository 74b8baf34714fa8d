//! Restricted identifiers in COB-ID objects.

use crate::event::{Event, EventKind, Kind, SdoDirection, SdoOutcome};
use crate::rules::general::facts::{is_restricted_write, transfer_number, transfer_subject};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};

declare_rule! {
    /// # What it checks
    /// A device accepts, or has, a restricted identifier for SYNC, TIME, EMCY, a PDO or an SDO client. CiA
    /// 301 restricts 000–07F, 101–180, 581–5FF, 601–67F, 6E0–6FF and 701–7FF to NMT, SDO, error control and
    /// other services.
    ///
    /// # Why it matters
    /// Other nodes interpret its messages as another service. A PDO on an SDO identifier can confirm writes
    /// that no server executed.
    ///
    /// # Source
    /// CiA 301 §7.3.5, table 40 (restricted CAN-IDs)
    ///
    /// # What to look at first
    /// Check the COB-ID that the master writes, and its node-ID offset.
    ///
    /// # Mutation
    /// change an identifier written to 1800:01
    "cob-id-restricted", Warning, "restricted identifier in use",
    kinds: [Kind::SdoTransfer],
    transfers: TransferSubset::Communication,
    needs: "a written or read COB-ID",
    cases: &["8.10"],
    shows: &["8.10"],
    word: "COBID",
}

struct CobIdRestricted;

fn new(_policy: &RulePolicy) -> CobIdRestricted {
    CobIdRestricted
}

impl Rule for CobIdRestricted {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let Some(object) = transfer.object else { return };
        if !matches!(object.index, 0x1005 | 0x1012 | 0x1014 | 0x1280..=0x12FF | 0x1400..=0x1BFF) {
            return;
        }
        if transfer.outcome == SdoOutcome::Aborted {
            let written = crate::profile::little_endian(&transfer.data);
            if transfer.direction == Some(SdoDirection::Download) && is_restricted_write(object, written) {
                context.count_pass();
            }
            return;
        }
        let Some(cob_id) = transfer_number(transfer) else { return };
        if !is_restricted_write(object, cob_id) {
            return context.count_pass();
        }
        let verb = if transfer.direction == Some(SdoDirection::Download) { "accepted" } else { "in use" };
        let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
        alarm.report_finding(|| {
            format!("restricted identifier {:03X} {verb} (CiA 301 table 40)", cob_id & 0x7FF)
        });
    }
}
