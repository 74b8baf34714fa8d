//! Rules about frames and transfers: reserved identifiers, SDO transfer modes, lengths of remote frames.

use crate::event::{DecodedPdo, SdoDirection, SdoMode, SdoOutcome, SdoTransfer};
use crate::finding::FindingSubject;
use crate::frame::{CanId, Frame, FrameFlags};
use crate::profile::device::{DeviceRule, FrameForm};
use crate::profile::{PdoDirection, little_endian};
use crate::rules::RuleContext;
use crate::rules::device::case::RuleCase;
use crate::rules::device::describe::with_details;
use crate::wire::NodeId;
use crate::words::count_noun;

/// COB-ID bit 31: the service does not exist. Bit 29: the identifier has 29 bits.
const INVALID: u64 = 1 << 31;
const EXTENDED: u64 = 1 << 29;

/// SDO frames have eight bytes; 7 is not a valid command specifier (CiA 301 §7.2.4.3).
const SDO_BYTES: u8 = 8;
const NO_SPECIFIER: u8 = 7;

/// Checks the format of a data frame on a reserved identifier.
pub(in crate::rules::device) fn judge_frame(
    case: &RuleCase<'_>,
    frame: &Frame,
    context: &mut RuleContext<'_>,
) {
    if !is_reserved(case.rule, frame.id) || frame.flags.contains(FrameFlags::REMOTE) {
        return;
    }
    let Some(FrameForm::Sdo) = case.rule.shape else { return };
    let command = frame.data().first().copied().unwrap_or(u8::MAX);
    if frame.length == SDO_BYTES && command >> 5 != NO_SPECIFIER {
        return context.count_pass();
    }
    let length = frame.length;
    report_id(case, frame.id, &format!("{}, not a valid SDO message", count_noun(length, "byte")), context);
}

/// Checks a PDO with a reserved identifier.
pub(in crate::rules::device) fn judge_pdo_id(
    case: &RuleCase<'_>,
    pdo: &DecodedPdo,
    context: &mut RuleContext<'_>,
) {
    if is_reserved(case.rule, pdo.cob_id) {
        let of = case
            .event
            .and_then(|event| event.node)
            .map_or_else(String::new, |node| format!(" of {}", node.sentence_label()));
        report_id(case, pdo.cob_id, &format!("{}{of}", pdo.name), context);
    }
}

/// Checks the download of a COB-ID to any node.
pub(in crate::rules::device) fn judge_cob_id(
    case: &RuleCase<'_>,
    transfer: &SdoTransfer,
    context: &mut RuleContext<'_>,
) {
    let is_write =
        transfer.direction == Some(SdoDirection::Download) && transfer.outcome == SdoOutcome::Complete;
    let Some(object) = transfer.object.filter(|_| is_write && transfer.data.len() <= 8) else { return };
    let holds_id = matches!(
        (object.index, object.sub),
        (0x1005 | 0x1012 | 0x1014, 0) | (0x1400..=0x15FF | 0x1800..=0x19FF, 1)
    );
    let value = little_endian(&transfer.data);
    // In the COB-ID of SYNC and TIME, bit 31 does not disable the service (CiA 301 §7.5.2.5, §7.5.2.15).
    let exists = value & INVALID == 0 || matches!(object.index, 0x1005 | 0x1012);
    let Some(id) =
        u16::try_from(value & 0x1FFF_FFFF).ok().filter(|_| holds_id && exists && value & EXTENDED == 0)
    else {
        return;
    };
    let id = CanId::from_standard(id);
    if is_reserved(case.rule, id) {
        let node = case.event.and_then(|event| event.node).map_or_else(String::new, NodeId::sentence_label);
        report_id(case, id, &format!("assigned to {object} of {node}"), context);
    }
}

/// Whether a rule reserves an identifier for its device.
pub(in crate::rules::device) fn is_reserved(rule: &DeviceRule, id: CanId) -> bool {
    let CanId::Standard(number) = id else { return false };
    rule.ids.is_some_and(|[first, last]| (first..=last).contains(&u32::from(number)))
}

/// Reports an identifier for the bus, since it is reserved for all such devices.
fn report_id(case: &RuleCase<'_>, id: CanId, what: &str, context: &mut RuleContext<'_>) {
    let Some(event) = case.event else { return };
    let text = &case.rule.text;
    context
        .start_finding(event)
        .at_node(None)
        .with_subject(FindingSubject::Id(id))
        .report_finding(|| with_details(text, what));
}

/// A transfer must be expedited.
pub(in crate::rules::device) fn judge_transfer(
    case: &RuleCase<'_>,
    transfer: &SdoTransfer,
    context: &mut RuleContext<'_>,
) {
    let is_answered = matches!(transfer.outcome, SdoOutcome::Complete | SdoOutcome::Aborted);
    let (Some(object), Some(mode)) = (transfer.object.filter(|_| is_answered), transfer.mode) else { return };
    if case.rule.except.iter().any(|range| range.covers(object, 0, 0)) || !case.is_due() {
        return;
    }
    let mode = match mode {
        SdoMode::Expedited => return context.count_pass(),
        SdoMode::Segmented => "segmented",
        SdoMode::Block => "block",
    };
    let Some(event) = case.event else { return };
    let text = &case.rule.text;
    let alarm = context
        .start_finding(event)
        .at_node(Some(case.facts.id))
        .with_subject(FindingSubject::Object(object));
    alarm.report_finding(|| with_details(text, &format!("{mode} transfer")));
}

/// A remote frame must have the length of the TPDO.
pub(in crate::rules::device) fn judge_remote_length(
    case: &RuleCase<'_>,
    pdo: &DecodedPdo,
    context: &mut RuleContext<'_>,
) {
    if !pdo.is_request || pdo.name.direction != PdoDirection::Transmit || !case.is_due() {
        return;
    }
    let Some(layout) = pdo.layout.as_deref().filter(|layout| !layout.assumed) else { return };
    let (asked, has) = (u16::from(pdo.length), layout.bits.div_ceil(8));
    if asked == has {
        return context.count_pass();
    }
    let Some(event) = case.event else { return };
    let (name, text) = (pdo.name, &case.rule.text);
    let alarm = context
        .start_finding(event)
        .at_node(Some(case.facts.id))
        .with_subject(FindingSubject::Name(name.to_string().into()));
    alarm.report_finding(|| {
        with_details(text, &format!("{} requested, {name} has {has}", count_noun(asked, "byte")))
    });
}
