//! Parameters that are locked while something else is on.

use crate::event::{Abort, Direction, Event, EventKind, Outcome};
use crate::finding::Severity;
use crate::profile::{PdoDirection, PdoName, little_endian};
use crate::rules::general::facts::{INVALID, about, number, sure};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A device takes another value for a parameter that is locked: the counter overflow value (1019) while SYNC has a
    /// period (1006), inhibit time and SYNC start value of a TPDO (18xx:03, 18xx:06) while the TPDO is valid. Guard
    /// time and life time factor (100C, 100D) written while the heartbeat is on (1017) are a note: they are without
    /// effect. What locks must have been seen.
    ///
    /// # Why it matters
    /// What is changed half-way through a cycle acts at a time nobody knows; other devices refuse it, so the same
    /// configuration fails there.
    ///
    /// # Source
    /// CiA 301 §7.5.2.22 (1019), §7.5.2.37 (TPDO communication parameter), §7.5.2.20 (1017)
    ///
    /// # What to look at first
    /// The order of downloads in the master's configuration: switch off, set, switch on.
    ///
    /// # Mutation
    /// insert an accepted write of 1019 while SYNC has a period
    "parameter-locked", Warning, "a parameter is written while it is locked",
    kinds: ["sdo-transfer"],
    cases: &["6.9"],
    word: "LOCK",
}

struct ParameterLocked;

fn new(_policy: &Policy) -> ParameterLocked {
    ParameterLocked
}

/// What locks an object, and how bad it is where a device lets it be written all the same.
fn lock(node: &Node, object: ObjectAddress) -> Option<(Option<String>, Severity)> {
    let is_on =
        |index| sure(node, index, 0).map(|value| (value != 0).then(|| format!("{index:04X} = {value}")));
    match (object.index, object.sub) {
        (0x1019, 0) => Some((is_on(0x1006)?, Severity::Warning)),
        (0x100C | 0x100D, 0) => Some((is_on(0x1017)?, Severity::Note)),
        (index, 3 | 6) => {
            let name = PdoName::of_parameter(index)?;
            if name.direction != PdoDirection::Transmit || name.communication_index() != index {
                return None;
            }
            let is_valid = sure(node, index, 1)? & INVALID == 0;
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
        let before = sure(node, object.index, object.sub);
        match (locked, transfer.outcome, transfer.abort) {
            (None, Outcome::Complete, _)
            | (Some(_), Outcome::Aborted, Some(Abort { by_client: false, .. })) => context.pass(),
            (Some(by), Outcome::Complete, _) => {
                let Some(written) = number(transfer).filter(|_| !transfer.cut_start) else { return };
                // The same value again changes nothing, and 0 switches guarding off.
                let is_off = severity == Severity::Note && little_endian(&transfer.data) == 0;
                if before == Some(written) || is_off {
                    return context.pass();
                }
                let alarm = context.fail(event).about(about(transfer)).severity(severity);
                alarm.say(|| format!("{written} written and accepted, while {by}"));
            }
            _ => {}
        }
    }
}
