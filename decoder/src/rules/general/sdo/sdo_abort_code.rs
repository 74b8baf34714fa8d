//! Wrong or unknown SDO abort codes.

use super::abort_codes::{RefusedRequest, SituationId, find_situation};
use super::sdo_situation::find_situations;
use crate::event::{Event, EventKind, Kind, SdoTransfer};
use crate::finding::Severity;
use crate::profile::abort_codes;
use crate::query::record;
use crate::rules::general::facts::transfer_subject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeMap;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A server refuses an invalid request with a wrong code, or sends a code that neither CiA 301 nor the
    /// device manual defines. Requests are invalid according to the EDS or profile, CiA 301 and earlier
    /// writes, such as a write to a read-only object. Codes for a temporary device state are exempt.
    ///
    /// # Why it matters
    /// A master that evaluates the code reacts wrongly, for example by a retry. The user looks for the wrong
    /// cause.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.17, table 22 (abort codes), §7.5.2 (codes of single objects)
    ///
    /// # What to look at first
    /// Check whether the EDS matches the firmware version. If it does, the SDO server of the firmware is
    /// wrong.
    ///
    /// # Mutation
    /// change the code of an abort
    "sdo-abort-code", Warning, "wrong or unknown SDO abort code",
    kinds: [Kind::SdoTransfer, Kind::Malformed],
    needs: "a refused SDO request",
    cases: &[
        "2.3", "2.4", "2.5", "2.6", "2.7", "2.8", "2.9", "2.10", "2.11", "2.17", "2.19", "2.20", "2.21", "2.22",
        "2.23", "2.24", "2.25", "2.26", "2.27", "2.28", "2.29", "2.30", "3.23", "3.24", "3.25", "3.26", "3.28",
        "3.29", "3.31", "3.32", "4.3", "4.4", "4.5", "4.6", "5.3", "6.5", "6.9", "7.104", "8.1", "8.3", "8.5",
        "8.7", "8.10", "9.1", "9.2", "9.3", "9.4",
    ],
    word: "SDO",
}

/// Codes for a temporary state of the device: out of memory, hardware error, local control, device state.
const OF_STATE: [u32; 4] = [0x0504_0005, 0x0606_0000, 0x0800_0021, 0x0800_0022];

#[derive(Default)]
struct SdoAbortCode {
    /// Frame of the last request with an unknown command specifier.
    unknown: NodeMap<u64>,
}

fn new(_policy: &RulePolicy) -> SdoAbortCode {
    SdoAbortCode::default()
}

impl SdoAbortCode {
    fn on_aborted(&mut self, event: &Event, transfer: &SdoTransfer, context: &mut RuleContext<'_>) {
        let Some(abort) = transfer.abort else { return };
        let (code, device) = (abort.code, record::event_device(event, context.bus));
        let is_own = device.abort_entry(code, transfer.object).is_some();
        if !is_own && abort_codes().find_code(code).is_none() {
            let alarm = context.start_finding(event).with_subject(transfer_subject(transfer));
            return alarm.report_finding(|| format!("unknown SDO abort code {code:08X}"));
        }
        let Some(node) = context.event_node(event).filter(|_| !abort.by_client && !is_own) else {
            return context.count_pass();
        };
        let unknown = event.node.and_then(|node| self.unknown.remove(node));
        let mut names = find_situations(transfer, node);
        if transfer.direction.is_none() && unknown.is_some_and(|frame| frame < event.frames.first) {
            names = vec![SituationId::UnknownCommand];
        }
        let found: Vec<&'static RefusedRequest> = names.into_iter().filter_map(find_situation).collect();
        if found.is_empty() {
            return context.count_pass();
        }
        if let Some(met) = found.iter().find(|situation| situation.accepted.contains(&code)) {
            context.count_pass();
            return test_cases(met, transfer.object).for_each(|case| context.pass_case(case));
        }
        if OF_STATE.contains(&code) {
            return;
        }
        let Some(first) = found.first() else { return };
        test_cases(first, transfer.object).for_each(|case| context.fail_case(case));
        // A read of a history entry that may not exist is common.
        let severity = if first.id == SituationId::EmptyHistory { Severity::Note } else { Severity::Warning };
        context
            .start_finding(event)
            .with_subject(transfer_subject(transfer))
            .with_severity(severity)
            .report_finding(|| {
                let accepted = first.accepted.iter().map(|code| format!("{code:08X}"));
                let accepted = accepted.collect::<Vec<_>>().join(" or ");
                format!(
                    "{}: abort code {code:08X} {} (expected {accepted})",
                    first.text,
                    abort_codes().code_text(code)
                )
            });
    }
}

/// Cases of the conformance test with this situation and object.
fn test_cases(
    situation: &'static RefusedRequest,
    object: Option<ObjectAddress>,
) -> impl Iterator<Item = &'static str> {
    let index = object.map_or(0, |object| object.index);
    let sub = object.map_or(0, |object| object.sub);
    let is_its = move |case: &&str| match (situation.id, *case) {
        (SituationId::ReadOnlyWritten, "2.3") | (SituationId::NoSubIndex, "2.5") => index == 0x1000,
        (SituationId::ReadOnlyWritten, _) => index != 0x1000,
        (SituationId::NoSubIndex, "4.5") => sub == 255,
        (SituationId::NoObject, "2.6") => index == 0x1004,
        (SituationId::NoObject, _) => (0x1201..=0x12FF).contains(&index),
        _ => true,
    };
    situation.ctt.iter().map(String::as_str).filter(is_its)
}

impl Rule for SdoAbortCode {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::SdoTransfer(transfer) => self.on_aborted(event, transfer, context),
            EventKind::Malformed { error, .. } if error.is_of_sdo() && error.needed == 0 => {
                if let Some(frame) = event.node.and_then(|node| self.unknown.entry(node)) {
                    *frame = event.frames.last;
                }
            }
            _ => {}
        }
    }
}
