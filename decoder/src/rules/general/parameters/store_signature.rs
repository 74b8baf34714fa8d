//! Signatures written to store and restore parameters.

use crate::event::{Abort, Direction, Event, EventKind, Outcome, SdoTransfer};
use crate::profile::device::{DeviceRule, RuleKind};
use crate::rules::general::facts::{about, sure};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// Something other than "save" is written to 1010, or other than "load" to 1011, and the device accepts it; or it
    /// refuses the right signature though it says that it stores on command (bit 0 of the same sub-index) and gives
    /// no cause: its state, local control, hardware, memory. Groups of the maker (sub-index 4 on) and devices whose
    /// profile has a rule of its own for this are not judged.
    ///
    /// # Why it matters
    /// The signature is what keeps parameters from being stored or restored by mistake; a right one that is refused
    /// leaves the device without its settings at the next start.
    ///
    /// # Source
    /// CiA 301 §7.5.2.13 (1010), §7.5.2.14 (1011)
    ///
    /// # What to look at first
    /// The byte order of the signature in the master: "save" is 73 61 76 65 on the bus, "load" 6C 6F 61 64.
    ///
    /// # Mutation
    /// change a letter of an accepted "save"
    "store-signature", Warning, "a wrong signature is accepted, or the right one refused",
    kinds: ["sdo-transfer"],
    cases: &["6.10", "8.1", "8.3", "8.5", "8.7"],
    word: "STORE",
}

/// Codes that say why now is not the time: memory, hardware, local control, state of the device.
const CAUSES: [u32; 4] = [0x0504_0005, 0x0606_0000, 0x0800_0021, 0x0800_0022];

/// Bit 0 of what 1010 and 1011 read as: the device does it on command.
const ON_COMMAND: u64 = 1;

/// Groups of the standard end here; devices have signatures of their own for those of the maker.
const LAST: u8 = 3;

struct StoreSignature;

fn new(_policy: &Policy) -> StoreSignature {
    StoreSignature
}

/// Whether a rule of the device itself says which signatures it takes.
fn is_device_s(node: Option<&Node>, object: ObjectAddress) -> bool {
    let Some(node) = node.filter(|node| node.assigned().is_some()) else { return false };
    let names = |rule: &DeviceRule| {
        rule.objects.iter().chain(&rule.object).any(|named| named.shifted(0, 0) == object)
    };
    node.device().rules.iter().any(|rule| matches!(rule.kind, RuleKind::Permitted) && names(rule))
}

/// The signature that a write should carry.
fn wanted(transfer: &SdoTransfer) -> Option<&'static [u8; 4]> {
    let object = transfer.object.filter(|object| (1..=LAST).contains(&object.sub))?;
    let is_whole = !transfer.truncated && !transfer.cut_start && !transfer.data.is_empty();
    match (object.index, transfer.direction) {
        (0x1010, Some(Direction::Download)) if is_whole => Some(b"save"),
        (0x1011, Some(Direction::Download)) if is_whole => Some(b"load"),
        _ => None,
    }
}

impl Rule for StoreSignature {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        let (Some(wanted), Some(object)) = (wanted(transfer), transfer.object) else { return };
        if is_device_s(context.node(event), object) {
            return;
        }
        let is_right = transfer.data == wanted;
        match (transfer.outcome, transfer.abort) {
            (Outcome::Complete, _) if is_right => context.pass(),
            (Outcome::Complete, _) => {
                let alarm = context.fail(event).about(about(transfer));
                alarm.say(|| {
                    let (written, wanted) = (transfer.data.escape_ascii(), wanted.escape_ascii());
                    format!("\"{written}\" accepted instead of \"{wanted}\"")
                });
            }
            (Outcome::Aborted, Some(Abort { by_client: false, .. })) if !is_right => context.pass(),
            (Outcome::Aborted, Some(Abort { by_client: false, code })) if !CAUSES.contains(&code) => {
                let says = context.node(event).and_then(|node| sure(node, object.index, object.sub));
                if says.is_some_and(|says| says & ON_COMMAND != 0) {
                    let alarm = context.fail(event).about(about(transfer));
                    alarm.say(|| {
                        let wanted = wanted.escape_ascii();
                        format!("\"{wanted}\" refused with {code:08X}, though bit 0 of {object} is set")
                    });
                }
            }
            _ => {}
        }
    }
}
