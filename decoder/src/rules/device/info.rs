//! What output says of a device's rule.

use std::sync::Arc;

use crate::finding::{RuleInfo, RuleOrigin};
use crate::profile::Device;
use crate::profile::device::{DeviceRule, RuleKind};

/// Name of a device's rule as output writes it: `rexroth-sydfec:mapping-is-static`.
fn name(device: &Device, rule: &str) -> Arc<str> {
    format!("{}:{rule}", device.id).into()
}

/// Names of the rules whose findings have the same cause: of the same profile, else general ones.
pub(super) fn takes_in(device: &Device, rule: &DeviceRule) -> Vec<Arc<str>> {
    let is_own = |wanted: &str| device.rules.iter().any(|own| own.name == wanted);
    let full = |wanted: &String| if is_own(wanted) { name(device, wanted) } else { wanted.as_str().into() };
    rule.takes_in.iter().map(full).collect()
}

/// What is known of a device's rule.
pub(super) fn of(device: &Device, rule: &DeviceRule) -> RuleInfo {
    let source = source(device, &rule.source);
    let note = if rule.note.is_empty() { String::new() } else { format!("\n# Assumption\n{}\n", rule.note) };
    let explanation =
        format!("# What it checks\n{}. {}\n{note}\n# Source\n{source}\n", rule.text, kind(rule.kind));
    RuleInfo {
        name: name(device, &rule.name),
        severity: rule.severity,
        title: rule.text.as_str().into(),
        explanation: explanation.into(),
        cases: Vec::new(),
        shows: Vec::new(),
        origin: RuleOrigin::Device,
        is_timing: matches!(rule.kind, RuleKind::MinInterval | RuleKind::MaxInterval | RuleKind::Follow),
        is_on: true,
        word: word(rule.kind),
        source: Some(source.into()),
    }
}

/// Where the manual says it: `RE 30027-Z/11.06 §9`.
fn source(device: &Device, section: &str) -> String {
    let manual = if device.source.is_empty() { &device.title } else { &device.source };
    match section.as_bytes().first() {
        None => manual.clone(),
        Some(first) if first.is_ascii_digit() => format!("{manual} §{section}"),
        Some(_) => format!("{manual}, {section}"),
    }
}

/// KIND of its line in text.
const fn word(kind: RuleKind) -> &'static str {
    match kind {
        RuleKind::Limit | RuleKind::Forbidden | RuleKind::Permitted | RuleKind::Ascending => "VALUE",
        RuleKind::Never | RuleKind::Precondition => "RULE",
        RuleKind::MinInterval => "FAST",
        RuleKind::MaxInterval => "GAP",
        RuleKind::MaxCount => "COUNT",
        RuleKind::Follow => "ANSWER",
        RuleKind::Order => "ORDER",
        RuleKind::ReservedId => "ID",
        RuleKind::Expedited => "SDO",
        RuleKind::RemoteLength => "PDO",
    }
}

/// What a kind of statement comes to.
const fn kind(kind: RuleKind) -> &'static str {
    match kind {
        RuleKind::Limit => "Each value that comes is compared with the limits of the manual.",
        RuleKind::Forbidden => {
            "Each value that is sent to the device is compared with those the manual excludes."
        }
        RuleKind::Permitted => {
            "Each value that is sent to the device is compared with those the manual permits."
        }
        RuleKind::Never => "It does not happen.",
        RuleKind::MinInterval => "The time between two of them is not shorter than the manual says.",
        RuleKind::MaxInterval => "The time between two of them is not longer than the manual says.",
        RuleKind::MaxCount => "They are counted.",
        RuleKind::Precondition => "When it happens, what the manual demands is not proven to be missing.",
        RuleKind::Follow => "What must follow does so within the time.",
        RuleKind::Order => "What must come first was seen before.",
        RuleKind::Ascending => "Each value that was seen is compared with its neighbour.",
        RuleKind::ReservedId => {
            "The identifiers have no other owner, and frames on them have the right shape."
        }
        RuleKind::Expedited => "Each transfer of another object is expedited.",
        RuleKind::RemoteLength => "The length a remote frame asks for is that of the PDO.",
    }
}
