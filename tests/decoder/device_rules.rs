//! How the rules of devices come to life, follow their nodes, and stand beside the general ones.

use std::fmt::Write as _;

use cobscope_decoder::finding::{Cause, Findings, Severity};
use cobscope_decoder::wire::NodeId;

use crate::rules::{judge, parse};

/// Everything judged of frames that come 10 ms and some microseconds apart; `head` as in annotated captures.
fn judged(head: &str, frames: &[&str]) -> Findings {
    let mut text = format!("{head}\n");
    for (number, frame) in frames.iter().enumerate() {
        let micros = number * 10_000 + number * 37 % 89;
        writeln!(text, "(1700000000.{micros:06}) can0 {frame}").unwrap();
    }
    findings(&text)
}

fn findings(text: &str) -> Findings {
    let capture = parse("a capture", text);
    judge(&capture.frames, &capture.options, capture.setup.clone()).1
}

/// Rule, node and severity of what counts, of rules of devices.
fn of_devices(findings: &Findings) -> Vec<(String, u8, Severity)> {
    let of_device = findings.counting().filter(|group| group.rule.contains(':'));
    of_device
        .map(|group| (group.rule.to_string(), group.key.node.map_or(0, NodeId::number), group.severity))
        .collect()
}

const PVE: &str = "#! --node 32=danfoss-pve-ci";

/// 1017 is written with 105, no step of 10 ms.
const STEP: [&str; 2] = ["620#2B17100069000000", "5A0#6017100000000000"];

fn step(node: u8, severity: Severity) -> (String, u8, Severity) {
    ("danfoss-pve-ci:heartbeat-step".to_owned(), node, severity)
}

#[test]
fn a_node_that_is_recognised_has_the_rules_of_its_device_from_then_on() {
    let identity = [
        "720#00",
        "620#4000100000000000",
        "5A0#4300100098010000",
        "620#4018100100000000",
        "5A0#4318100119000001",
        "620#4018100200000000",
        "5A0#4318100200003653",
        "620#4018100300000000",
        "5A0#431810031F000100",
        "620#4008100000000000",
        "5A0#4308100050564541",
    ];
    let after: Vec<&str> = identity.iter().chain(&STEP).copied().collect();
    assert_eq!(of_devices(&judged("", &after)), [step(32, Severity::Note)]);
    let before: Vec<&str> = STEP.iter().chain(&identity).copied().collect();
    let findings = judged("", &before);
    assert_eq!(of_devices(&findings), []);
    assert!(findings.rules.iter().any(|rule| *rule.name == *"danfoss-pve-ci:heartbeat-step"));
    assert!(judged("", &STEP).rules.iter().all(|rule| !rule.name.contains(':')));
}

#[test]
fn rules_go_with_the_node_to_its_new_number() {
    // LSS: present node-ID 32, new node-ID 33, in force from the boot-up on.
    let moved = [
        "720#00",
        "7E5#0401000000000000",
        "7E5#5E00000000000000",
        "7E4#5E20000000000000",
        "7E5#1121000000000000",
        "7E4#1100000000000000",
        "7E5#0400000000000000",
        "000#8220",
        "721#00",
        "621#2B17100069000000",
        "5A1#6017100000000000",
    ];
    assert_eq!(of_devices(&judged(PVE, &moved)), [step(33, Severity::Note)]);
}

#[test]
fn the_bus_file_speaks_of_rules_of_devices_too() {
    let rules = |severity: &str| {
        format!("{PVE}\n#| [rules.\"danfoss-pve-ci:heartbeat-step\"]\n#| severity = \"{severity}\"")
    };
    assert_eq!(of_devices(&judged(PVE, &STEP)), [step(32, Severity::Note)]);
    assert_eq!(of_devices(&judged(&rules("error"), &STEP)), [step(32, Severity::Error)]);
    assert_eq!(of_devices(&judged(&rules("off"), &STEP)), []);
    let suppressed = format!(
        "{PVE}\n#| [[suppress]]\n#| rule = \"danfoss-pve-ci:heartbeat-step\"\n#| about = \"1017:00\"\n\
         #| reason = \"rounded by the device\""
    );
    let findings = judged(&suppressed, &STEP);
    let met: Vec<_> = findings.suppressions.iter().map(|one| one.met).collect();
    assert_eq!((of_devices(&findings), met), (vec![], vec![1]));
    let group = findings.groups.iter().find(|group| group.rule.contains(':')).unwrap();
    assert_eq!(group.suppressed.as_deref(), Some("rounded by the device"));
}

#[test]
fn a_refused_write_is_one_finding_where_the_manual_tells_why() {
    // 1010:01 is written with "SAVE" and refused; then 2001:00, of which no rule speaks.
    let frames = [
        "720#00",
        "620#2310100153415645",
        "5A0#8010100120000008",
        "620#2B01200000000000",
        "5A0#8001200002000106",
    ];
    let findings = judged(PVE, &frames);
    let of = |rule: &str| findings.groups.iter().filter(|group| *group.rule == *rule).collect::<Vec<_>>();
    let taker = of("danfoss-pve-ci:store-signature");
    assert_eq!(taker.len(), 1);
    let refused = of("sdo-download-refused");
    let explained: Vec<_> = refused.iter().map(|group| (group.is_absorbed, group.cause.clone())).collect();
    assert_eq!(explained, [(true, Some(Cause::Group(taker[0].id))), (false, None)]);
}

/// SYNC each 50 ms, and one more 1.5 ms behind the third.
fn syncs(stamp: impl Fn(usize) -> String) -> Vec<(String, u8, Severity)> {
    let mut text = "#! --node 2=rexroth-sydfec\n".to_owned();
    let times = [0, 50_029, 100_013, 150_041, 200_024, 201_524, 250_037];
    for (number, micros) in times.into_iter().enumerate() {
        let frame = ["082#", "000#0102"].get(number).unwrap_or(&"080#");
        writeln!(text, "({}) can0 {frame}", stamp(micros)).unwrap();
    }
    of_devices(&findings(&text))
}

#[test]
fn the_step_of_the_stamps_counts_in_favour_of_the_device() {
    let exact = syncs(|micros| format!("1700000000.{micros:06}"));
    let rule = "rexroth-sydfec:sync-not-closer-than-2-ms".to_owned();
    assert_eq!(exact, [(rule, 2, Severity::Error)]);
    // Whole milliseconds: 200 and 201 may be almost 2 ms apart.
    assert_eq!(syncs(|micros| format!("1700000000.{:06}", micros / 1_000 * 1_000)), []);
}

#[test]
fn what_must_never_happen_is_exercised_once_the_device_is_there() {
    let tally = |frames: &[&str]| {
        let findings = judged(PVE, frames);
        let of = |name: &str| findings.rules.iter().position(|rule| *rule.name == *name).unwrap();
        findings.tallies[of("danfoss-pve-ci:heartbeat-step")].passed
    };
    assert_eq!((tally(&["080#"]), tally(&["620#2B17100064000000", "5A0#6017100000000000"])), (0, 1));
    let findings = judged("#! --node 2=rexroth-sydfec", &["080#"]);
    let of = |findings: &Findings, name: &str| {
        let place = findings.rules.iter().position(|rule| *rule.name == *name).unwrap();
        findings.tallies[place].passed
    };
    assert_eq!(of(&findings, "rexroth-sydfec:mapping-is-static"), 0);
    let findings = judged("#! --node 2=rexroth-sydfec", &["082#", "080#"]);
    assert_eq!(of(&findings, "rexroth-sydfec:mapping-is-static"), 1);
}

/// PVE waives abort codes of the history (1003:01 to 08) alone: 1122_3344 is none of CiA 301.
#[test]
fn a_waiver_of_some_objects_holds_for_these_only() {
    let refused = |object: &str| [format!("620#40{object}00000000"), format!("5A0#80{object}44332211")];
    let frames: Vec<String> =
        ["031001", "031008", "031009", "012000"].into_iter().flat_map(refused).collect();
    let mut head = PVE.to_owned();
    let rule = "sdo-abort-code";
    let told = |head: &str| {
        let findings = judged(head, &frames.iter().map(String::as_str).collect::<Vec<_>>());
        let groups = findings.groups.iter().filter(|group| *group.rule == *rule);
        let about: Vec<_> = groups.map(|group| group.key.about.to_string()).collect();
        let place = findings.rules.iter().position(|info| *info.name == *rule).unwrap();
        (about.join(" "), findings.tallies[place].waived)
    };
    assert_eq!(told(&head), ("1003:09 2001:00".to_owned(), 2));
    head.push_str("\n#! --protocol canopen");
    assert_eq!(told(&head.replace(PVE, "")), ("1003:01 1003:08 1003:09 2001:00".to_owned(), 0));
}

/// AVC comes 350 ms behind the one before, where the manual permits 250 ms; TPDO1 of VPCD 250 ms behind, with an
/// event timer of 100 ms; SYDFEC has three RPDO1 within a SYNC.
#[test]
fn the_bus_file_sets_times_and_counts_of_rules_of_devices() {
    let fired = |capture: &str, rule: &str, lines: &str| {
        let path = crate::support::workspace().join("fixtures/rules/devices").join(capture);
        let text = std::fs::read_to_string(path).unwrap();
        let settings = format!("#| [rules.\"{rule}\"]\n#| {lines}\n");
        let findings = findings(&format!("{text}{settings}"));
        findings.groups.iter().filter(|group| *group.rule == *rule).count()
    };
    let cases = [
        ("danfoss-pve-ci.isobus.log", "danfoss-pve-ci:avc-gap", "severity = \"error\"", "ms = 400"),
        ("rexroth-vpcd.start.log", "rexroth-vpcd:tpdo1-at-its-event-timer", "times = 2.4", "times = 2.6"),
        ("rexroth-sydfec.commands.log", "rexroth-sydfec:several-commands-per-sync", "count = 2", "count = 3"),
    ];
    for (capture, rule, strict, lenient) in cases {
        assert_eq!((fired(capture, rule, strict), fired(capture, rule, lenient)), (1, 0), "{rule}");
    }
}
