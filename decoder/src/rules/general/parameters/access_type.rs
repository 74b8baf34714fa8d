//! Access by SDO against the dictionary.

use crate::event::{Abort, Direction, Event, EventKind, Outcome, SdoTransfer};
use crate::profile::object::Access;
use crate::rules::general::facts::about;
use crate::rules::general::sdo::sdo_situation::{access, is_told, situations};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A device takes a write to an object that its dictionary (EDS or profile) calls read-only, gives the value of
    /// a write-only one, or refuses with "read-only", "write-only" or "does not exist" what its dictionary has.
    ///
    /// # Why it matters
    /// Device and dictionary are not of the same version: tools that go by the EDS configure something else.
    ///
    /// # Source
    /// CiA 306-1 §4.6.3 (AccessType), CiA 301 §7.4.2
    ///
    /// # What to look at first
    /// Firmware version (100A) against the EDS's file version.
    ///
    /// # Mutation
    /// turn the abort of a write to a read-only object into a confirmation
    "access-type", Warning, "a device permits other access than its dictionary",
    kinds: ["sdo-transfer"],
    cases: &[
        "2.2", "2.3", "2.4", "2.5", "2.6", "3.1", "3.2", "4.1", "4.3", "4.4", "4.5", "4.7", "4.9", "7.1", "7.5",
        "7.101", "7.201",
    ],
    word: "ACCESS",
}

struct AccessType;

fn new(_policy: &Policy) -> AccessType {
    AccessType
}

/// What is wrong with an access that ended.
fn wrong(
    transfer: &SdoTransfer,
    access: Access,
    direction: Direction,
    is_free: bool,
) -> Option<&'static str> {
    let may = match direction {
        Direction::Upload => access != Access::Wo,
        Direction::Download => matches!(access, Access::Rw | Access::Wo),
    };
    match (transfer.outcome, transfer.abort) {
        (Outcome::Complete, _) if !may && direction == Direction::Download => Some("written"),
        (Outcome::Complete, _) if !may => Some("read"),
        (Outcome::Aborted, Some(Abort { code, by_client: false })) if may && is_free => match code {
            0x0601_0001 => Some("refused as write-only"),
            0x0601_0002 => Some("refused as read-only"),
            0x0602_0000 | 0x0609_0011 => Some("refused as not there"),
            _ => None,
        },
        _ => None,
    }
}

impl Rule for AccessType {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let (Some(object), Some(direction)) = (transfer.object, transfer.direction) else { return };
        let Some(node) = context.node(event) else { return };
        let Some(access) = access(node.device(), object) else { return };
        let is_over = match transfer.outcome {
            Outcome::Complete => !transfer.cut_start,
            Outcome::Aborted => transfer.abort.is_some_and(|abort| !abort.by_client),
            _ => false,
        };
        if !is_over {
            return;
        }
        // PDO parameters are refused by the state of the PDO, others by what was asked.
        let is_free = !(0x1400..=0x1BFF).contains(&object.index)
            && (transfer.outcome == Outcome::Complete || situations(transfer, node).is_empty());
        let source =
            if is_told(node.device(), object) { node.device().default_origin(object) } else { "CiA 301" };
        let Some(what) = wrong(transfer, access, direction, is_free) else { return context.pass() };
        let alarm = context.fail(event).about(about(transfer));
        alarm.say(|| format!("{what}, though it is {} by {source}", access.name()));
    }
}
