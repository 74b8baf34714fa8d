//! SDO access against the access type in the object dictionary.

use crate::event::{Event, EventKind, Kind, SdoAbort, SdoDirection, SdoOutcome, SdoTransfer};
use crate::finding::MergedFindings;
use crate::profile::PdoName;
use crate::profile::object::SdoAccess;
use crate::rules::general::facts::{INVALID, confirmed_number, transfer_subject};
use crate::rules::general::sdo::sdo_situation::{find_situations, is_described, object_access};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A device accepts a write to a read-only object, or a read of a write-only object. Or it refuses access
    /// that its dictionary (EDS or profile) permits, with "read-only", "write-only" or "does not exist". PDO
    /// parameters are exempt where the state of the PDO permits the refusal: a write while the PDO may be
    /// valid, and a mapping entry beyond the number of mapped objects.
    ///
    /// # Why it matters
    /// Device and dictionary have different versions, so tools that use the EDS write a wrong configuration.
    ///
    /// # Source
    /// CiA 306-1 §4.6.3 (AccessType), CiA 301 §7.4.2
    ///
    /// # What to look at first
    /// Compare the firmware version (100A) with the EDS version.
    ///
    /// # Mutation
    /// turn the abort of a write to a read-only object into a confirmation
    "access-type", Warning, "object access differs from the dictionary",
    kinds: [Kind::SdoTransfer],
    needs: "SDO access to an object of an EDS or profile",
    merge: MergedFindings::Node,
    cases: &[
        "2.2", "2.3", "2.4", "2.5", "2.6", "3.1", "3.2", "4.1", "4.3", "4.4", "4.5", "4.7", "4.9", "7.1", "7.5",
        "7.101", "7.201",
    ],
    word: "ACCESS",
}

/// Abort codes (CiA 301 table 22) that contradict the dictionary.
const WRITE_ONLY: u32 = 0x0601_0001;
const READ_ONLY: u32 = 0x0601_0002;
const NO_OBJECT: u32 = 0x0602_0000;
const NO_SUB_INDEX: u32 = 0x0609_0011;

struct AccessType;

fn new(_policy: &RulePolicy) -> AccessType {
    AccessType
}

/// Violation by a completed or refused access.
fn find_violation(
    transfer: &SdoTransfer,
    access: SdoAccess,
    direction: SdoDirection,
    is_free: bool,
) -> Option<&'static str> {
    let may = match direction {
        SdoDirection::Upload => access != SdoAccess::Wo,
        SdoDirection::Download => matches!(access, SdoAccess::Rw | SdoAccess::Wo),
    };
    match (transfer.outcome, transfer.abort) {
        (SdoOutcome::Complete, _) if !may && direction == SdoDirection::Download => Some("write accepted"),
        (SdoOutcome::Complete, _) if !may => Some("read accepted"),
        (SdoOutcome::Aborted, Some(SdoAbort { code, by_client: false })) if may && is_free => match code {
            WRITE_ONLY => Some("refused as write-only"),
            READ_ONLY => Some("refused as read-only"),
            NO_OBJECT => Some("missing"),
            NO_SUB_INDEX => Some("sub-index missing"),
            _ => None,
        },
        _ => None,
    }
}

/// Whether the state of a PDO permits the refusal (CiA 301 §7.5.2.36): a valid PDO is not remapped, and entries beyond
/// the number of mapped objects need not exist.
fn depends_on_pdo(transfer: &SdoTransfer, object: ObjectAddress, node: &Node) -> bool {
    let Some(name) = PdoName::of_parameter(object.index) else { return false };
    match transfer.abort.map(|abort| abort.code) {
        Some(NO_SUB_INDEX) if object.index != name.communication_index() => {
            confirmed_number(node, object.index, 0).is_none_or(|count| u64::from(object.sub) > count)
        }
        Some(READ_ONLY) => {
            confirmed_number(node, name.communication_index(), 1).is_none_or(|cob_id| cob_id & INVALID == 0)
        }
        _ => false,
    }
}

impl Rule for AccessType {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let (Some(object), Some(direction)) = (transfer.object, transfer.direction) else { return };
        let Some(node) = context.event_node(event) else { return };
        let Some(access) = object_access(node.device(), object) else { return };
        let is_over = match transfer.outcome {
            SdoOutcome::Complete => !transfer.cut_start,
            SdoOutcome::Aborted => transfer.abort.is_some_and(|abort| !abort.by_client),
            _ => false,
        };
        if !is_over {
            return;
        }
        // A refusal may depend on the state of the PDO, or on another error in the request.
        let is_free = transfer.outcome == SdoOutcome::Complete
            || !depends_on_pdo(transfer, object, node) && find_situations(transfer, node).is_empty();
        let Some(what) = find_violation(transfer, access, direction, is_free) else {
            return context.count_pass();
        };
        let device = node.device();
        let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
        alarm.report_finding(|| {
            let code = transfer.abort.map_or_else(String::new, |abort| format!("{:08X}, ", abort.code));
            let (access, source) = if is_described(device, object) {
                (access.name(), device.default_origin(object).title())
            } else if object.sub <= 1 {
                ("mandatory", "CiA 301".to_owned())
            } else {
                (access.name(), "CiA 301".to_owned())
            };
            format!("{what} ({code}{access} in {source})")
        });
    }
}
