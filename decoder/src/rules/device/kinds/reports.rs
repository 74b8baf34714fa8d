//! Rules about error reports: length, code and register of EMCY messages, codes of SDO aborts.

use crate::event::{Emergency, SdoAbort, SdoTransfer};
use crate::finding::FindingSubject;
use crate::profile::DeviceProfile;
use crate::profile::device::{AtBoot, ClearMeaning, RuleKind};
use crate::rules::RuleContext;
use crate::rules::device::case::RuleCase;
use crate::rules::device::describe::with_details;
use crate::words::count_noun;

/// Bytes of an EMCY (CiA 301 §7.2.7.3), and those before the manufacturer-specific ones.
const BYTES: u8 = 8;
const BEFORE: u8 = 3;

/// Checks an EMCY by the kind of the rule.
pub(in crate::rules::device) fn judge_emcy(
    case: &RuleCase<'_>,
    emergency: &Emergency,
    context: &mut RuleContext<'_>,
) {
    if !case.is_due() {
        return;
    }
    let (rule, device) = (case.rule, case.facts.node.device());
    let defect = match rule.kind {
        RuleKind::EmcyLength => length_defect(emergency, device),
        RuleKind::EmcyCode => code_defect(emergency, device),
        RuleKind::EmcyRegister => register_defect(emergency, device),
        _ => return,
    };
    let Some(defect) = defect else { return context.count_pass() };
    let (Some(event), about) =
        (case.event, emergency.code.map_or(FindingSubject::Whole, FindingSubject::Code))
    else {
        return;
    };
    let alarm = context.start_finding(event).at_node(Some(case.facts.id)).with_subject(about);
    alarm.report_finding(|| with_details(&rule.text, &defect));
}

/// An EMCY has eight bytes; only the ready message of a device that has one is empty.
fn length_defect(emergency: &Emergency, device: &DeviceProfile) -> Option<String> {
    let bytes = match (emergency.code, emergency.register) {
        (None, _) => 0,
        (Some(_), None) => BEFORE - 1,
        (Some(_), Some(_)) => BEFORE.saturating_add(emergency.vendor_length),
    };
    let is_ready = bytes == 0 && device.emcy.at_boot == AtBoot::ReadyTelegram;
    (bytes != BYTES && !is_ready).then(|| count_noun(bytes, "byte"))
}

/// The code is in the list of the profile.
fn code_defect(emergency: &Emergency, device: &DeviceProfile) -> Option<String> {
    let code = emergency.code.filter(|code| device.error_entry(*code).is_none())?;
    let other = emergency.alternative;
    let other = other.map_or_else(String::new, |other| format!(", {other:04X} in the other byte order"));
    Some(format!("EMCY {code:04X}{other}"))
}

/// The bits that the manual gives for the code are set. Further bits may belong to other active errors.
fn register_defect(emergency: &Emergency, device: &DeviceProfile) -> Option<String> {
    let (code, register) = (emergency.code?, emergency.register?);
    let expected = device.error_entry(code)?.register?;
    let is_met = match expected {
        0 => register == 0 || device.emcy.cleared != ClearMeaning::AllGone,
        _ => register & expected == expected,
    };
    (!is_met).then(|| format!("EMCY {code:04X} with {register:02X}h, expected {expected:02X}h"))
}

/// The server aborts only with codes of the profile.
pub(in crate::rules::device) fn judge_abort(
    case: &RuleCase<'_>,
    transfer: &SdoTransfer,
    context: &mut RuleContext<'_>,
) {
    let Some(SdoAbort { code, by_client: false, .. }) = transfer.abort else { return };
    let Some(event) = case.event.filter(|_| case.is_due()) else { return };
    if case.facts.node.device().aborts.iter().any(|abort| abort.code == code) {
        return context.count_pass();
    }
    let about = transfer.object.map_or(FindingSubject::Whole, FindingSubject::Object);
    let alarm = context.start_finding(event).at_node(Some(case.facts.id)).with_subject(about);
    alarm.report_finding(|| with_details(&case.rule.text, &format!("{code:08X}")));
}
