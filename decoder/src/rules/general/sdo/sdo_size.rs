//! Sizes of SDO transfers.

use super::sdo_situation::is_described;
use crate::event::{Event, EventKind, Kind, SdoDirection, SdoMode, SdoOutcome, SdoTransfer};
use crate::finding::Severity;
use crate::profile::DataType;
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::TRANSFER_DATA_LIMIT;
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// The size of a transfer differs from the announced size. For a read communication object, or an object
    /// of the device dictionary, a size that differs from the data type is a note.
    ///
    /// # Why it matters
    /// Data is lost or padded, and the master misreads the value.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.3, §7.2.4.3.6 (size indicator)
    ///
    /// # What to look at first
    /// Check how the sender sets the size. Check the capture for lost frames.
    ///
    /// # Mutation
    /// change the announced size of a segmented transfer
    "sdo-size", Warning, "wrong SDO transfer size",
    kinds: [Kind::SdoTransfer],
    needs: "an SDO transfer with an announced size or of a known object",
    skips_holes: true,
    cases: &[
        "2.1", "2.8", "2.9", "2.13", "2.14", "2.15", "2.16", "2.18", "2.19", "2.20", "2.21", "2.22", "2.23", "2.24",
        "2.25", "3.1", "3.2", "4.1", "4.7",
    ],
    word: "SDO",
}

struct SdoSize;

fn new(_policy: &RulePolicy) -> SdoSize {
    SdoSize
}

impl Rule for SdoSize {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let has_gap = transfer.truncated && transfer.data.len() < TRANSFER_DATA_LIMIT;
        // Segments out of order also cause a wrong size.
        let is_whole = !transfer.cut_start && !has_gap && transfer.irregularity.is_none();
        if transfer.outcome != SdoOutcome::Complete || !is_whole {
            return;
        }
        let size = transfer.size;
        if let Some(announced) = transfer.announced {
            if u64::from(announced) == size {
                return context.count_pass();
            }
            let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
            return alarm.report_finding(|| {
                format!("{} transferred, {announced} announced", count_noun(size, "byte"))
            });
        }
        let Some(wanted) = bytes_of_type(event, transfer, context) else { return };
        // An expedited response of 4 bytes may lack a size indicator.
        if wanted == size || size == 4 && wanted < 4 {
            return context.count_pass();
        }
        let alarm = context
            .start_finding(event)
            .with_subject(transfer_subject(transfer))
            .with_severity(Severity::Note);
        alarm.report_finding(|| format!("{} read (data type: {wanted})", count_noun(size, "byte")));
    }
}

/// Size of the data type of an object that was read by an expedited transfer.
fn bytes_of_type(event: &Event, transfer: &SdoTransfer, context: &RuleContext<'_>) -> Option<u64> {
    let is_read =
        transfer.direction == Some(SdoDirection::Upload) && transfer.mode == Some(SdoMode::Expedited);
    let object = transfer.object.filter(|_| is_read)?;
    let device = context.event_node(event)?.device();
    let is_reported = is_described(device, object) || object.index < 0x2000;
    let bits = device.dictionary.data_type(object).and_then(DataType::bits).filter(|_| is_reported)?;
    Some(u64::from(bits.div_ceil(8)))
}
