//! A service is put on an identifier that belongs to another one.

use crate::event::{Direction, Event, EventKind, Outcome};
use crate::frame::CanId;
use crate::rules::declaration::declare_rule;
use crate::rules::general::facts::{about, number};
use crate::rules::general::sdo::sdo_situation::is_restricted_write;
use crate::rules::{Context, Rule, Setup};

declare_rule! {
    /// # What it checks
    /// A device takes an identifier for SYNC, TIME, EMCY, a PDO or an SDO client that CiA 301 keeps for NMT, SDO,
    /// error control and others (000–07F, 101–180, 581–5FF, 601–67F, 6E0–6FF, 701–7FF), or has such a one set.
    ///
    /// # Why it matters
    /// Its messages are taken for those of another service: a PDO on an SDO identifier confirms writes that nobody
    /// took.
    ///
    /// # Source
    /// CiA 301 §7.3.5, table 40 (restricted CAN-IDs)
    ///
    /// # What to look at first
    /// The identifier that the master's configuration writes, and its node-ID offset.
    ///
    /// # Mutation
    /// change an identifier written to 1800:01
    "cob-id-restricted", Warning, "an identifier that belongs to another service is used",
    kinds: ["sdo-transfer"],
    cases: &["8.10"],
    shows: &["8.10"],
    word: "COBID",
}

/// Whether CiA 301 keeps an identifier for others.
pub(in crate::rules::general) fn is_restricted(id: CanId) -> bool {
    let CanId::Standard(id) = id else { return false };
    matches!(id, 0x001..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF | 0x701..=0x7FF)
}

struct CobIdRestricted;

fn new(_setup: &Setup) -> CobIdRestricted {
    CobIdRestricted
}

impl Rule for CobIdRestricted {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let Some(object) = transfer.object else { return };
        if !matches!(object.index, 0x1005 | 0x1012 | 0x1014 | 0x1280..=0x12FF | 0x1400..=0x1BFF) {
            return;
        }
        if transfer.outcome == Outcome::Aborted {
            let written = crate::profile::little_endian(&transfer.data);
            if transfer.direction == Some(Direction::Download) && is_restricted_write(object, written) {
                context.pass();
            }
            return;
        }
        let Some(cob_id) = number(transfer) else { return };
        if !is_restricted_write(object, cob_id) {
            return context.pass();
        }
        let verb = if transfer.direction == Some(Direction::Download) { "accepted" } else { "set" };
        let alarm = context.fail(event).about(about(transfer));
        alarm.say(|| format!("identifier {:03X} {verb}, which CiA 301 keeps for others", cob_id & 0x7FF));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_the_standard() {
        for (id, expected) in
            [(0x80, false), (0x180, true), (0x181, false), (0x6DF, false), (0x6E0, true), (0x0, false)]
        {
            assert_eq!(is_restricted(CanId::standard(id)), expected, "{id:03X}");
        }
        assert!(!is_restricted(CanId::extended(0x601)));
    }
}
