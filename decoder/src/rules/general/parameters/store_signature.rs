//! Signatures of store and restore commands.

use crate::event::{Event, EventKind, Kind, SdoAbort, SdoDirection, SdoOutcome, SdoTransfer};
use crate::profile::device::{DeviceRule, RuleKind};
use crate::rules::general::facts::{confirmed_number, transfer_subject};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A device accepts another signature than "save" in 1010 or "load" in 1011, or refuses the right one
    /// although bit 0 of the sub-index permits it. Refusals because of device state, local control, hardware
    /// or memory are exempt. So are manufacturer groups (sub-index 4 and up), and devices with their own
    /// rule.
    ///
    /// # Why it matters
    /// The signature prevents an accidental store or restore. If the right signature is refused, the device
    /// has lost its settings at the next start.
    ///
    /// # Source
    /// CiA 301 §7.5.2.13 (1010), §7.5.2.14 (1011)
    ///
    /// # What to look at first
    /// Check the byte order of the signature in the master. On the bus, "save" is 73 61 76 65 and "load" is
    /// 6C 6F 61 64.
    ///
    /// # Mutation
    /// change a letter of an accepted "save"
    "store-signature", Warning, "wrong handling of the store signature",
    kinds: [Kind::SdoTransfer],
    transfers: TransferSubset::Communication,
    needs: "a write to 1010 or 1011",
    cases: &["6.10", "8.1", "8.3", "8.5", "8.7"],
    word: "STORE",
}

/// Abort codes for a temporary reason: memory, hardware, local control, device state.
const CAUSES: [u32; 4] = [0x0504_0005, 0x0606_0000, 0x0800_0021, 0x0800_0022];

/// Bit 0 of 1010 and 1011: the device stores or restores on command.
const ON_COMMAND: u64 = 1;

/// Last sub-index of the standard groups; manufacturer groups may have their own signatures.
const LAST: u8 = 3;

struct StoreSignature;

fn new(_policy: &RulePolicy) -> StoreSignature {
    StoreSignature
}

/// Whether a rule of the device profile defines the signatures of this object.
fn is_device_s(node: Option<&Node>, object: ObjectAddress) -> bool {
    let Some(node) = node.filter(|node| node.assigned_by().is_some()) else { return false };
    let names = |rule: &DeviceRule| {
        rule.objects.iter().chain(&rule.object).any(|named| named.shift_object(0, 0) == object)
    };
    node.device().rules.iter().any(|rule| matches!(rule.kind, RuleKind::Permitted) && names(rule))
}

/// Required signature of a write.
fn required_signature(transfer: &SdoTransfer) -> Option<&'static [u8; 4]> {
    let object = transfer.object.filter(|object| (1..=LAST).contains(&object.sub))?;
    let is_whole = !transfer.truncated && !transfer.cut_start && !transfer.data.is_empty();
    match (object.index, transfer.direction) {
        (0x1010, Some(SdoDirection::Download)) if is_whole => Some(b"save"),
        (0x1011, Some(SdoDirection::Download)) if is_whole => Some(b"load"),
        _ => None,
    }
}

impl Rule for StoreSignature {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let (Some(wanted), Some(object)) = (required_signature(transfer), transfer.object) else { return };
        if is_device_s(context.event_node(event), object) {
            return;
        }
        let is_right = transfer.data == wanted;
        match (transfer.outcome, transfer.abort) {
            (SdoOutcome::Complete, _) if is_right => context.count_pass(),
            (SdoOutcome::Complete, _) => {
                let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
                alarm.report_finding(|| {
                    let (written, wanted) = (transfer.data.escape_ascii(), wanted.escape_ascii());
                    format!("signature \"{written}\" accepted (expected \"{wanted}\")")
                });
            }
            (SdoOutcome::Aborted, Some(SdoAbort { by_client: false, .. })) if !is_right => {
                context.count_pass();
            }
            (SdoOutcome::Aborted, Some(SdoAbort { by_client: false, code })) if !CAUSES.contains(&code) => {
                let says = context
                    .event_node(event)
                    .and_then(|node| confirmed_number(node, object.index, object.sub));
                if says.is_some_and(|says| says & ON_COMMAND != 0) {
                    let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
                    alarm.report_finding(|| {
                        let wanted = wanted.escape_ascii();
                        format!(
                            "signature \"{wanted}\" refused ({code:08X}) although bit 0 of {object} is set"
                        )
                    });
                }
            }
            _ => {}
        }
    }
}
