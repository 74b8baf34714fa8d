//! A capture without the reads of the PDO mapping has the same findings about values, marked as assumed.

use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::finding::{FindingGroup, Severity};
use cobscope_decoder::profile::device::{DeviceRule, ProfileTrigger, RuleKind};
use cobscope_decoder::session::{AssignedBy, Assignment, SessionOptions};
use cobscope_decoder::wire::NodeId;

use crate::rules::{captures, judge, plain_setup, read};

/// Whether a line is a read of a PDO mapping, or the response to it.
fn is_mapping_read(line: &str) -> bool {
    let Some((id, body)) = line.rsplit(' ').next().and_then(|frame| frame.split_once('#')) else {
        return false;
    };
    let id = u16::from_str_radix(id, 16).unwrap_or(0);
    let is_sdo = (0x581..=0x5FF).contains(&id) || (0x601..=0x67F).contains(&id);
    let high = body.get(4..6).and_then(|digits| u8::from_str_radix(digits, 16).ok());
    is_sdo && body.starts_with('4') && high.is_some_and(|high| matches!(high, 0x16..=0x17 | 0x1A..=0x1B))
}

/// Whether a rule judges each value of a PDO on its own.
fn judges_values(rule: &DeviceRule) -> bool {
    let is_value = |trigger: &ProfileTrigger| matches!(trigger, ProfileTrigger::Set(set) | ProfileTrigger::Shows(set) if !set.changed);
    let is_free = rule.during.0.is_empty() && rule.since.0.is_empty();
    is_free
        && match rule.kind {
            RuleKind::Never => rule.on.0.iter().all(is_value),
            RuleKind::Limit | RuleKind::Permitted | RuleKind::Forbidden => true,
            _ => false,
        }
}

fn findings(frames: &str, options: &SessionOptions) -> Vec<FindingGroup> {
    let findings = judge(frames, options, plain_setup()).1;
    let rules: Vec<String> = options
        .assignments
        .iter()
        .flat_map(|it| it.device.rules.iter().map(|rule| (Arc::clone(&it.device), rule.clone())))
        .filter(|(_, rule)| judges_values(rule))
        .map(|(device, rule)| format!("{}:{}", device.id, rule.name))
        .collect();
    let is_meant = |group: &FindingGroup| {
        *group.rule == *"value-out-of-range" || rules.iter().any(|rule| *group.rule == **rule)
    };
    findings.groups.into_iter().filter(is_meant).collect()
}

#[test]
fn findings_about_values_do_not_depend_on_reads_of_the_mapping() {
    let (mut report, mut lowered) = (String::new(), 0);
    for path in captures().iter().filter(|path| path.parent().unwrap().ends_with("devices")) {
        let capture = read(path);
        let lines = || capture.frames.lines().map(|line| format!("{line}\n"));
        let twin: String = lines().filter(|line| !is_mapping_read(line.trim())).collect();
        if twin == capture.frames {
            continue;
        }
        let found = findings(&twin, &capture.options);
        for group in findings(&capture.frames, &capture.options) {
            let same = found.iter().find(|it| {
                (&it.rule, &it.key) == (&group.rule, &group.key)
                    || it.rule == group.rule
                        && it.key.node == group.key.node
                        && it.key.about == group.key.about
            });
            let Some(same) = same else {
                writeln!(report, "{}: {} {} {}", capture.name, group.rule, group.key.about, group.text)
                    .unwrap();
                continue;
            };
            let reason = same.downgraded.as_deref().unwrap_or_default();
            assert!(same.severity <= group.severity, "{}: {}", capture.name, group.rule);
            assert!(same.severity == group.severity || reason.starts_with("mapping assumed"), "{reason}");
            lowered += usize::from(same.severity < group.severity || reason.starts_with("mapping assumed"));
        }
    }
    assert!(report.is_empty(), "\n{report}");
    assert!(lowered > 0, "no finding depends on an assumed mapping");
}

/// Frames from 0 on each 10 ms; node 1 or 5 with a profile.
fn with_profile(profile: &str, node: u8, frames: &[&str]) -> Vec<(String, Severity, String)> {
    let mut text = String::new();
    for (number, frame) in frames.iter().enumerate() {
        writeln!(text, "(1700000000.{:06}) can0 {frame}", number * 10_000 + number * 37 % 89).unwrap();
    }
    let mut options = SessionOptions::default();
    let device = options.catalogue.device(profile).unwrap();
    let node = NodeId::Canopen(node);
    options.assignments.push(Assignment { bus: None, node, device, by: AssignedBy::Option });
    let groups = findings(&text, &options).into_iter();
    groups.map(|it| (it.rule.to_string(), it.severity, it.downgraded.unwrap_or_default())).collect()
}

/// MD2, DSP-408 3 §5.4.36: set point −16384 to 16384; §5.4.20: bit 7 of the status word is reserved. Without reads, the
/// mapping is that of the default control mode; a PDO of another length disproves it.
#[test]
fn set_points_and_reserved_bits_with_the_default_mapping() {
    const ASSUMED: &str = "mapping assumed: default of the profile";
    let start = ["701#00", "701#7F", "000#0101", "701#05"];
    let judged = |frames: &[&str]| with_profile("wandfluh-md2", 1, &[&start[..], frames].concat());
    let note = |rule: &str| (rule.to_owned(), Severity::Note, ASSUMED.to_owned());
    assert_eq!(judged(&["201#0700204E"]), [note("value-out-of-range")]);
    assert_eq!(judged(&["201#07000040", "181#0F00"]), []);
    assert_eq!(judged(&["201#07000140"]), [note("value-out-of-range")]);
    assert_eq!(judged(&["181#8F00"]), [note("wandfluh-md2:reserved-status-bits")]);
    assert_eq!(judged(&["201#0700204E00", "181#8F0000"]), []);
}
