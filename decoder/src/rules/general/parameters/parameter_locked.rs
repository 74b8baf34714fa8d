//! Writes to locked parameters.

use crate::event::{Event, EventKind, Kind, SdoAbort, SdoDirection, SdoOutcome};
use crate::finding::Severity;
use crate::profile::{PdoDirection, PdoName, little_endian};
use crate::rules::general::facts::{INVALID, confirmed_number, transfer_number, transfer_subject};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A device accepts a new counter overflow value (1019) while the SYNC period (1006) is not 0, or inhibit
    /// time and SYNC start value (18xx:03, 18xx:06) of a valid TPDO. Guard time and life time factor (100C,
    /// 100D), without effect while the heartbeat (1017) is active, are a note. Unknown states are exempt.
    ///
    /// # Why it matters
    /// The new value takes effect at an unpredictable time. Other devices refuse the write, so the same
    /// configuration fails there.
    ///
    /// # Source
    /// CiA 301 §7.5.2.22 (1019), §7.5.2.37 (TPDO communication parameter), §7.5.2.20 (1017)
    ///
    /// # What to look at first
    /// Disable SYNC or the PDO before the write, and enable it afterwards.
    ///
    /// # Mutation
    /// insert an accepted write of 1019 while SYNC has a period
    "parameter-locked", Warning, "locked parameter written",
    kinds: [Kind::SdoTransfer],
    needs: "a write to 1019, 100C, 100D or 18xx:03, and the setting that locks it",
    cases: &["6.9"],
    word: "LOCK",
}

struct ParameterLocked;

fn new(_policy: &RulePolicy) -> ParameterLocked {
    ParameterLocked
}

/// Reason for the lock, if it is active, and severity of an accepted write; `None` if unknown or never
/// locked.
fn active_lock(node: &Node, object: ObjectAddress) -> Option<(Option<String>, Severity)> {
    let is_on = |index| {
        confirmed_number(node, index, 0)
            .map(|value| (value != 0).then(|| format!("{index:04X}:00 = {value}")))
    };
    match (object.index, object.sub) {
        (0x1019, 0) => Some((is_on(0x1006)?, Severity::Warning)),
        (0x100C | 0x100D, 0) => Some((is_on(0x1017)?, Severity::Note)),
        (index, 3 | 6) => {
            let name = PdoName::of_parameter(index)?;
            if name.direction != PdoDirection::Transmit || name.communication_index() != index {
                return None;
            }
            let is_valid = confirmed_number(node, index, 1)? & INVALID == 0;
            Some((is_valid.then(|| format!("{name} is valid")), Severity::Warning))
        }
        _ => None,
    }
}

impl Rule for ParameterLocked {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let Some(object) = transfer.object.filter(|_| transfer.direction == Some(SdoDirection::Download))
        else {
            return;
        };
        let Some(node) = context.event_node(event) else { return };
        let Some((locked, severity)) = active_lock(node, object) else { return };
        let before = confirmed_number(node, object.index, object.sub);
        match (locked, transfer.outcome, transfer.abort) {
            (None, SdoOutcome::Complete, _)
            | (Some(_), SdoOutcome::Aborted, Some(SdoAbort { by_client: false, .. })) => context.count_pass(),
            (Some(by), SdoOutcome::Complete, _) => {
                let Some(written) = transfer_number(transfer).filter(|_| !transfer.cut_start) else { return };
                // The same value changes nothing, and 0 disables guarding.
                let is_off = severity == Severity::Note && little_endian(&transfer.data) == 0;
                if before == Some(written) || is_off {
                    return context.count_pass();
                }
                let alarm = context
                    .start_finding(event)
                    .with_subject(transfer_subject(transfer))
                    .with_severity(severity);
                alarm.report_finding(|| format!("write of {written} accepted while {by}"));
            }
            _ => {}
        }
    }
}
