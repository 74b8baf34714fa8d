//! Read values against the written values.

use crate::event::{Event, EventKind, Kind, SdoDirection};
use crate::profile::little_endian;
use crate::rules::general::facts::{transfer_number, transfer_subject};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::session::OriginKind;

declare_rule! {
    /// # What it checks
    /// A communication object (1000–1FFF) reads back differently after a confirmed write, without a restart
    /// or another write in between. Command objects (1003, 1010, 1011, 1023 to 1026, 1F50 and up) and the
    /// flags of a COB-ID are exempt.
    ///
    /// # Why it matters
    /// The device has confirmed a setting without applying it.
    ///
    /// # Source
    /// CiA 301 §7.2.4.1 (a confirmed download has taken place)
    ///
    /// # What to look at first
    /// Check whether the device rounds the value. Check whether another client writes it.
    ///
    /// # Mutation
    /// change the value in the response to an upload
    "read-back", Warning, "read-back differs from the written value",
    kinds: [Kind::SdoTransfer],
    transfers: TransferSubset::Communication,
    needs: "a write to a communication object, then a read of it",
    cases: &["2.2", "3.4", "4.9", "7.5"],
    word: "SDO",
}

struct ReadBack;

fn new(_policy: &RulePolicy) -> ReadBack {
    ReadBack
}

/// Flags of a COB-ID that the device may set, such as the remote frame bit.
const fn own_bits(index: u16) -> u64 {
    match index {
        0x1005 | 0x1012 | 0x1014 | 0x1200..=0x15FF | 0x1800..=0x19FF => 0xC000_0000,
        _ => 0,
    }
}

impl Rule for ReadBack {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let is_command =
            |index: u16| matches!(index, 0x1003 | 0x1010 | 0x1011 | 0x1023..=0x1026 | 0x1F50..=0x1FFF);
        let object =
            transfer.object.filter(|it| (0x1000..0x2000).contains(&it.index) && !is_command(it.index));
        let Some(object) = object.filter(|_| transfer.direction == Some(SdoDirection::Upload)) else {
            return;
        };
        let (Some(read), Some(node)) = (transfer_number(transfer), context.event_node(event)) else { return };
        let Some(entry) = node.store().seen_value(object) else { return };
        let is_written = entry.origin.kind == OriginKind::Download && !entry.stale && entry.value.len() <= 8;
        if !is_written || node.store().waiting_value(object).is_some() {
            return;
        }
        let written = little_endian(&entry.value);
        if (read ^ written) & !own_bits(object.index) == 0 {
            return context.count_pass();
        }
        let frame = entry.origin.frame;
        let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
        alarm.report_finding(|| {
            format!("read-back {read:X}h differs from the written value {written:X}h {{{frame}}}")
        });
    }
}
