//! Description of a device rule for output.

use std::sync::Arc;

use crate::finding::{MergedFindings, RuleInfo, RuleOrigin};
use crate::profile::DeviceProfile;
use crate::profile::device::{DeviceRule, RuleKind};
use crate::rules::ledger::RuleRelations;

/// Name of a device rule in output: `rexroth-sydfec:mapping-is-static`.
fn rule_name(device: &DeviceProfile, rule: &str) -> Arc<str> {
    format!("{}:{rule}", device.id).into()
}

/// Description of a rule of a single node.
pub(in crate::rules) fn node_rule_info(rule: &DeviceRule) -> RuleInfo {
    describe_rule(
        rule,
        rule.name.as_str().into(),
        if rule.source.is_empty() { "the bus file" } else { &rule.source },
    )
}

/// Relations of a rule of a single node; it names other rules in full.
pub(super) fn node_rule_relations(rule: &DeviceRule) -> RuleRelations {
    let full = |names: &[String]| names.iter().map(|name| name.as_str().into()).collect();
    RuleRelations { takes_in: full(&rule.takes_in), follows: full(&rule.follows) }
}

/// Full names of the rules in `takes_in` and `follows`: of the same profile, else general rules.
pub(super) fn rule_relations(device: &DeviceProfile, rule: &DeviceRule) -> RuleRelations {
    let is_own = |wanted: &str| device.rules.iter().any(|own| own.name == wanted);
    let full =
        |wanted: &String| if is_own(wanted) { rule_name(device, wanted) } else { wanted.as_str().into() };
    RuleRelations {
        takes_in: rule.takes_in.iter().map(full).collect(),
        follows: rule.follows.iter().map(full).collect(),
    }
}

/// Description of a device rule.
pub(super) fn rule_info(device: &DeviceProfile, rule: &DeviceRule) -> RuleInfo {
    describe_rule(rule, rule_name(device, &rule.name), &device.cite_section(&rule.source))
}

fn describe_rule(rule: &DeviceRule, name: Arc<str>, source: &str) -> RuleInfo {
    let note = if rule.note.is_empty() { String::new() } else { format!("\n# Assumption\n{}\n", rule.note) };
    let next = if rule.next.is_empty() {
        String::new()
    } else {
        format!("\n# What to look at first\n{}.\n", rule.next)
    };
    let (text, kind) = (&rule.text, kind_text(rule.kind));
    let explanation = format!("# What it checks\n{text}. {kind}\n{note}\n# Source\n{source}\n{next}");
    RuleInfo {
        name,
        severity: rule.severity,
        title: rule.text.as_str().into(),
        explanation: explanation.into(),
        needs: needs_text(rule).into(),
        cases: Vec::new(),
        shows: Vec::new(),
        origin: RuleOrigin::Device,
        is_timing: matches!(rule.kind, RuleKind::MinInterval | RuleKind::MaxInterval | RuleKind::Follow),
        merge: MergedFindings::Index,
        is_on: true,
        word: event_word(rule.kind),
        source: Some(source.into()),
        next_step: (!rule.next.is_empty()).then(|| rule.next.as_str().into()),
    }
}

/// What a capture must contain for a verdict of the rule.
fn needs_text(rule: &DeviceRule) -> String {
    let objects = || {
        let all: Vec<_> = rule.object.iter().chain(&rule.objects).map(|it| it.object.to_string()).collect();
        all.join(", ")
    };
    let event = match rule.kind {
        RuleKind::Limit | RuleKind::Forbidden | RuleKind::Permitted | RuleKind::Ascending => {
            format!("a value of {}", objects())
        }
        RuleKind::Sequence => rule.steps.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
        RuleKind::ReservedId | RuleKind::NodeId | RuleKind::SourceAddress => "a frame of the device".into(),
        RuleKind::Expedited => "an SDO transfer".into(),
        RuleKind::RemoteLength => "a remote frame for a PDO".into(),
        RuleKind::EmcyLength | RuleKind::EmcyCode | RuleKind::EmcyRegister => "an EMCY".into(),
        RuleKind::AbortCode => "an SDO abort of the device".into(),
        RuleKind::OnRequest => "a group that is sent on request".into(),
        RuleKind::UdsServices => "a UDS request".into(),
        RuleKind::Constant => format!("{} with fixed bits", rule.on),
        _ => rule.on.to_string(),
    };
    let event = if event.is_empty() { "a message of the device".to_owned() } else { event };
    let is_bound = rule.is_scoped() && !rule.since.0.is_empty();
    let event = if is_bound { format!("{event} after {}", rule.since) } else { event };
    if rule.during.0.is_empty() { event } else { format!("{event}, while {}", rule.during) }
}

/// KIND column of findings of a rule kind.
const fn event_word(kind: RuleKind) -> &'static str {
    match kind {
        RuleKind::Limit | RuleKind::Forbidden | RuleKind::Permitted | RuleKind::Ascending => "VALUE",
        RuleKind::Never | RuleKind::Precondition => "RULE",
        RuleKind::MinInterval => "FAST",
        RuleKind::MaxInterval => "GAP",
        RuleKind::MaxCount => "COUNT",
        RuleKind::Follow => "ANSWER",
        RuleKind::Order | RuleKind::Sequence => "ORDER",
        RuleKind::ReservedId | RuleKind::NodeId | RuleKind::SourceAddress => "ID",
        RuleKind::Expedited | RuleKind::AbortCode => "SDO",
        RuleKind::RemoteLength => "PDO",
        RuleKind::EmcyLength | RuleKind::EmcyCode | RuleKind::EmcyRegister => "EMCY",
        RuleKind::MessageLength | RuleKind::Constant => "BYTES",
        RuleKind::OnRequest => "PGN",
        RuleKind::UdsServices => "UDS",
    }
}

/// Explanation of a rule kind, added to the text of the rule.
const fn kind_text(kind: RuleKind) -> &'static str {
    match kind {
        RuleKind::Limit => "Every transferred value is compared with the limits in the manual.",
        RuleKind::Forbidden => {
            "Every value sent to the device is compared with the values that the manual excludes."
        }
        RuleKind::Permitted => {
            "Every value sent to the device is compared with the values that the manual permits."
        }
        RuleKind::Never => "Every occurrence is a finding.",
        RuleKind::MinInterval => "The time between two events is compared with the minimum in the manual.",
        RuleKind::MaxInterval => "The time between two events is compared with the maximum in the manual.",
        RuleKind::MaxCount => "The number of events is compared with the limit.",
        RuleKind::Precondition => {
            "A finding opens if a condition of the manual is proven false at the event."
        }
        RuleKind::Follow => "The required reaction must follow within the time limit.",
        RuleKind::Order => "The required earlier event must have occurred before.",
        RuleKind::Sequence => {
            "The first occurrence of each step since the start of the node must precede those of later steps."
        }
        RuleKind::Ascending => "Every known value is compared with its neighbour.",
        RuleKind::ReservedId => {
            "The identifiers must have no other owner, and their frames must have the required format."
        }
        RuleKind::Expedited => "Every transfer of another object must be expedited.",
        RuleKind::RemoteLength => "The length of a remote frame must be that of the PDO.",
        RuleKind::EmcyLength => "The length of every EMCY is compared with 8 bytes.",
        RuleKind::EmcyCode => "The code of every EMCY is compared with the list in the manual.",
        RuleKind::EmcyRegister => {
            "The error register of every EMCY is compared with the bits that the manual gives for its code."
        }
        RuleKind::AbortCode => {
            "The code of every SDO abort of the device is compared with the list in the manual."
        }
        RuleKind::NodeId | RuleKind::SourceAddress => {
            "The number of the device is compared with the range in the manual, once."
        }
        RuleKind::MessageLength => "The length of every message is compared with that in the manual.",
        RuleKind::Constant => "The fixed bits of every PDO are compared with those in the manual.",
        RuleKind::OnRequest => "Every message of these groups must follow a request.",
        RuleKind::UdsServices => "The service of every UDS request is compared with the list in the manual.",
    }
}
