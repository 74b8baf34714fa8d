//! Rules about the number of a device: node-ID on CANopen, source address on J1939.

use crate::profile::device::RuleKind;
use crate::rules::RuleContext;
use crate::rules::device::case::RuleCase;
use crate::rules::device::describe::with_details;
use crate::wire::NodeId;

/// Checks the number of a device that is on the bus.
pub(in crate::rules::device) fn judge_address(case: &RuleCase<'_>, context: &mut RuleContext<'_>) {
    let (word, number) = match (case.rule.kind, case.facts.id) {
        (RuleKind::NodeId, NodeId::Canopen(number)) => ("node-ID", number),
        (RuleKind::SourceAddress, NodeId::J1939(number)) => ("address", number),
        _ => return,
    };
    let Some([least, most]) = case.rule.range else { return };
    if (least..=most).contains(&i64::from(number)) {
        return context.count_pass();
    }
    let node = Some(case.facts.id);
    let alarm = match case.event {
        Some(event) => context.start_finding(event).at_node(node),
        None => context.fail_at(context.now, node, case.frames),
    };
    alarm
        .report_finding(|| with_details(&case.rule.text, &format!("{word} {}", address_text(case.facts.id))));
}

/// Node-IDs are decimal, addresses hexadecimal.
fn address_text(id: NodeId) -> String {
    match id {
        NodeId::Canopen(number) => number.to_string(),
        NodeId::J1939(number) => format!("{number:02X}h"),
    }
}
