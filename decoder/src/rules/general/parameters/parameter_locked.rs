//! Writes to locked parameters.

use crate::event::{Abort, Direction, Event, EventKind, Kind, Outcome};
use crate::finding::Severity;
use crate::profile::{PdoDirection, PdoName, little_endian};
use crate::rules::general::facts::{INVALID, about, confirmed_number, number};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
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

fn new(_policy: &Policy) -> ParameterLocked {
    ParameterLocked
}

/// Reason for the lock, if it is active, and severity of an accepted write; `None` if unknown or never
/// locked.
fn lock(node: &Node, object: ObjectAddress) -> Option<(Option<String>, Severity)> {
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
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let Some(object) = transfer.object.filter(|_| transfer.direction == Some(Direction::Download)) else {
            return;
        };
        let Some(node) = context.node(event) else { return };
        let Some((locked, severity)) = lock(node, object) else { return };
        let before = confirmed_number(node, object.index, object.sub);
        match (locked, transfer.outcome, transfer.abort) {
            (None, Outcome::Complete, _)
            | (Some(_), Outcome::Aborted, Some(Abort { by_client: false, .. })) => context.pass(),
            (Some(by), Outcome::Complete, _) => {
                let Some(written) = number(transfer).filter(|_| !transfer.cut_start) else { return };
                // The same value changes nothing, and 0 disables guarding.
                let is_off = severity == Severity::Note && little_endian(&transfer.data) == 0;
                if before == Some(written) || is_off {
                    return context.pass();
                }
                let alarm = context.fail(event).about(about(transfer)).severity(severity);
                alarm.report(|| format!("write of {written} accepted while {by}"));
            }
            _ => {}
        }
    }
}
