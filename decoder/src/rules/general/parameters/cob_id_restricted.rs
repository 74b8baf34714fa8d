//! A service is put on an identifier that belongs to another one.

use crate::event::{Direction, Event, EventKind, Outcome};
use crate::rules::general::facts::{about, is_restricted_write, number};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

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

struct CobIdRestricted;

fn new(_policy: &Policy) -> CobIdRestricted {
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
