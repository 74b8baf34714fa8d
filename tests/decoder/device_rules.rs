//! Rules of devices: their start, the nodes they follow, and their relation to general rules.

use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::finding::{CaptureFindings, FindingCause, Severity};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::session::{AssignedBy, Assignment};
use cobscope_decoder::wire::NodeId;

use crate::rules::{judge, parse};

/// Findings in frames with intervals of 10 ms and some microseconds; `head` as in annotated captures.
fn judged(head: &str, frames: &[&str]) -> CaptureFindings {
    let mut text = format!("{head}\n");
    for (number, frame) in frames.iter().enumerate() {
        let micros = number * 10_000 + number * 37 % 89;
        writeln!(text, "(1700000000.{micros:06}) can0 {frame}").unwrap();
    }
    findings(&text)
}

fn findings(text: &str) -> CaptureFindings {
    let capture = parse("a capture", text);
    judge(&capture.frames, &capture.options, capture.setup.clone()).1
}

/// Rule, node and severity of effective findings of device rules.
fn of_devices(findings: &CaptureFindings) -> Vec<(String, u8, Severity)> {
    let of_device = findings.reported_groups().filter(|group| group.rule.contains(':'));
    of_device
        .map(|group| (group.rule.to_string(), group.key.node.map_or(0, NodeId::number), group.severity))
        .collect()
}

const PVE: &str = "#! --node 32=danfoss-pve-ci";

/// 1017 is written with 105, not a multiple of 10 ms.
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
    // LSS: present node-ID 32, new node-ID 33, effective from the boot-up on.
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
    // 1010:01 is written with "SAVE" and refused; then 2001:00, which has no rule.
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
    assert_eq!(explained, [(true, Some(FindingCause::Group(taker[0].id))), (false, None)]);
}

/// SYNC every 50 ms, and one more 1.5 ms after the third.
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
    // Integer milliseconds: 200 and 201 may be almost 2 ms apart.
    assert_eq!(syncs(|micros| format!("1700000000.{:06}", micros / 1_000 * 1_000)), []);
}

#[test]
fn what_must_never_happen_is_exercised_by_what_is_compared_with_it() {
    let tally = |frames: &[&str]| {
        let findings = judged(PVE, frames);
        let of = |name: &str| findings.rules.iter().position(|rule| *rule.name == *name).unwrap();
        findings.tallies[of("danfoss-pve-ci:heartbeat-step")].passed
    };
    assert_eq!((tally(&["080#"]), tally(&["620#2B17100064000000", "5A0#6017100000000000"])), (0, 1));
    let findings = judged("#! --node 2=rexroth-sydfec", &["080#"]);
    let of = |findings: &CaptureFindings, name: &str| {
        let place = findings.rules.iter().position(|rule| *rule.name == *name).unwrap();
        findings.tallies[place].passed
    };
    assert_eq!(of(&findings, "rexroth-sydfec:mapping-is-static"), 0);
    // The presence of the device alone compares nothing; a write of any object does.
    let findings = judged("#! --node 2=rexroth-sydfec", &["082#", "080#"]);
    assert_eq!(of(&findings, "rexroth-sydfec:mapping-is-static"), 0);
    let write = ["082#", "602#2B17100064000000", "582#6017100000000000"];
    let findings = judged("#! --node 2=rexroth-sydfec", &write);
    assert_eq!(of(&findings, "rexroth-sydfec:mapping-is-static"), 1);
}

/// PVE waives abort codes of the history (1003:01 to 08) only: CiA 301 does not define 1122_3344.
#[test]
fn a_waiver_of_some_objects_holds_for_these_only() {
    let refused = |object: &str| [format!("620#40{object}00000000"), format!("5A0#80{object}44332211")];
    let frames: Vec<String> =
        ["031001", "031008", "031009", "012000"].into_iter().flat_map(refused).collect();
    let mut head = PVE.to_owned();
    let rule = "sdo-abort-code";
    let reported = |head: &str| {
        let findings = judged(head, &frames.iter().map(String::as_str).collect::<Vec<_>>());
        let groups = findings.groups.iter().filter(|group| *group.rule == *rule);
        let about: Vec<_> = groups.map(|group| group.key.about.to_string()).collect();
        let place = findings.rules.iter().position(|info| *info.name == *rule).unwrap();
        (about.join(" "), findings.tallies[place].waived)
    };
    assert_eq!(reported(&head), ("1003:09 2001:00".to_owned(), 2));
    head.push_str("\n#! --protocol canopen");
    assert_eq!(reported(&head.replace(PVE, "")), ("1003:01 1003:08 1003:09 2001:00".to_owned(), 0));
}

/// AVC 350 ms after the preceding one (manual: 250 ms); TPDO1 of VPCD after 250 ms (event timer 100 ms);
/// three RPDO1 of SYDFEC within one SYNC interval.
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

/// The profile has a rule about EMCY 0000 and one about EMCY 3422.
#[test]
fn an_emcy_without_error_is_a_trigger_as_any_code() {
    const PROFILE: &str = "id = \"acme-pump\"\ntitle = \"PUMP\"\n\
        [[emcy.code]]\ncode = 0x3422\ntext = \"undervoltage\"\n\
        [[rule]]\nname = \"error-ends\"\nseverity = \"note\"\nkind = \"never\"\non = { emcy = 0 }\n\
        text = \"end\"\nnext = \"check\"\nsource = \"1\"\n\
        [[rule]]\nname = \"error-begins\"\nseverity = \"note\"\nkind = \"never\"\non = { emcy = 0x3422 }\n\
        text = \"begin\"\nnext = \"check\"\nsource = \"1\"\n";
    let mut catalogue = Catalogue::default();
    catalogue.add_text("pump.toml", PROFILE).unwrap();
    let device = catalogue.device("acme-pump").unwrap();
    let count = |frames: &str| {
        let mut capture = parse("a capture", frames);
        let node = 5.into();
        let device = Arc::clone(&device);
        capture.options.assignments.push(Assignment { bus: None, node, device, by: AssignedBy::Option });
        let findings = judge(&capture.frames, &capture.options, capture.setup).1;
        ["acme-pump:error-begins", "acme-pump:error-ends"]
            .map(|rule| findings.groups.iter().filter(|group| *group.rule == *rule).count())
    };
    let begin = "(1700000000.000000) can0 705#00\n(1700000000.100000) can0 085#2234050000000000\n";
    let end = "(1700000000.300000) can0 085#0000000000000000\n";
    assert_eq!((count(begin), count(&format!("{begin}{end}"))), ([1, 0], [1, 1]));
}

const PUMP: &str = "#! --node 2=rexroth-sydfec";

/// Rules of the findings about a pump; those of its profile without its id.
fn names(frames: &[&str]) -> Vec<String> {
    let findings = judged(PUMP, frames);
    findings
        .reported_groups()
        .map(|group| group.rule.trim_start_matches("rexroth-sydfec:").to_owned())
        .collect()
}

/// RE 30027-Z, 17.4: type, measuring range, selection in the parameter sets; only the first of each counts.
#[test]
fn a_sequence_compares_the_first_occurrences_since_the_start() {
    let range = ["602#2B0052019001", "582#6000520100000000"];
    let kind = ["602#2B0052000100", "582#6000520000000000"];
    let refused = ["602#2B0052000100", "582#8000520000000108"];
    let order = |parts: &[&[&'static str]]| {
        let all = judged(PUMP, &parts.concat());
        all.reported_groups()
            .filter(|group| group.rule.contains("set-up-order"))
            .map(|group| group.count)
            .sum::<u64>()
    };
    let start: &[&str] = &["082#"];
    assert_eq!(order(&[start, &kind, &range]), 0);
    assert_eq!(order(&[start, &range, &kind]), 1);
    // The second time is not a set-up, and a refused write is not a step.
    assert_eq!(order(&[start, &kind, &range, &kind]), 0);
    assert_eq!(order(&[start, &range, &kind, &kind]), 1);
    assert_eq!(order(&[start, &range, &refused]), 0);
    // Unknown before the first start, and again after a restart.
    assert_eq!(order(&[&range, &kind]), 0);
    assert_eq!(order(&[start, &range, start, &kind]), 0);
}

/// RE 30027-Z, 18.3.1: the offset is 0 after an error (status 1000), until the next calibration or reset (18.5).
#[test]
fn a_limit_applies_from_since_to_until() {
    let offset = ["602#4001520000000000", "582#4B0152001E000000"];
    let failed = ["602#4001520200000000", "582#4B01520200100000"];
    let start = ["602#2B0152010100", "582#6001520100000000"];
    let refused = ["602#2B0152010100", "582#8001520122000008"];
    let reset = ["602#2BFF52005555", "582#60FF520000000000"];
    let found = |parts: &[&[&'static str]]| {
        let names = names(&parts.concat());
        ["failed-angle-offset", "reset-offsets"].map(|rule| names.iter().any(|name| name == rule))
    };
    assert_eq!(found(&[&offset]), [false, false]);
    assert_eq!(found(&[&offset, &failed]), [false, false]);
    assert_eq!(found(&[&failed, &offset]), [true, false]);
    assert_eq!(found(&[&failed, &start, &offset]), [false, false]);
    assert_eq!(found(&[&failed, &refused, &offset]), [true, false]);
    assert_eq!(found(&[&failed, &reset, &offset]), [false, true]);
    assert_eq!(found(&[&reset, &start, &offset]), [false, false]);
    // The stored value after a restart is unknown.
    assert_eq!(found(&[&failed, &["082#"], &offset]), [false, false]);
}

/// RE 30027-Z, 19.2.1: bit 1 of the status byte shows the function 1 (slave) of 5300:00. TPDO1 each 100 ms.
#[test]
fn a_precondition_with_ms_must_be_false_for_this_time() {
    let found = |status: &dyn Fn(usize) -> u8| {
        let mut text = format!("{PUMP}\n(1700000000.000013) can0 082#\n(1700000000.010041) can0 000#0102\n");
        for (place, frame) in ["602#4000530000000000", "582#4B00530001000000"].iter().enumerate() {
            writeln!(text, "(1700000000.02{place}017) can0 {frame}").unwrap();
        }
        for number in 1..25 {
            let micros = 1_000_000 + number * 100_000 + number * 37 % 89;
            let (seconds, micros) = (1_700_000_000 + micros / 1_000_000, micros % 1_000_000);
            writeln!(text, "({seconds}.{micros:06}) can0 182#{:02X}00000000", status(number)).unwrap();
        }
        findings(&text).reported_groups().any(|group| &*group.rule == "rexroth-sydfec:status-shows-slave")
    };
    assert!(found(&|_| 0));
    assert!(!found(&|_| 2));
    assert!(!found(&|number| if number < 10 { 0 } else { 2 }));
    assert!(found(&|number| if number < 13 { 0 } else { 2 }));
    // Two short deviations do not add up to a long one.
    assert!(!found(&|number| if number % 8 == 0 { 2 } else { 0 }));
}

/// RE 30027-Z, 19.5: power-on switches the angle controller on. A reset by NMT is not a power-on.
#[test]
fn a_power_on_is_a_start_without_a_command() {
    let rule = "angle-controller-on-after-power-on".to_owned();
    let off: &[&str] = &["000#0102", "182#4000000000"];
    let calibration = ["602#2B0152010100", "582#6001520100000000"];
    assert!(names(&[&["082#"], off].concat()).contains(&rule));
    assert!(!names(&[&["082#", "000#0102"], &calibration[..], &off[1..]].concat()).contains(&rule));
    assert!(!names(&[&["082#", "000#8102", "082#"], off].concat()).contains(&rule));
    assert!(!names(off).contains(&rule));
}

/// RE 30027-Z, 14: after the initialisation, an empty EMCY or one with the error, here 3102.
#[test]
fn an_error_in_place_of_the_ready_message_is_a_boot_sign() {
    let found = |sign: &str| {
        let mut text = format!("{PUMP}\n(1700000000.000013) can0 082#\n(1700000000.100041) can0 000#8102\n");
        write!(text, "(1700000000.400017) can0 {sign}\n(1700000003.400017) can0 080#\n").unwrap();
        findings(&text).reported_groups().any(|group| &*group.rule == "boot-up-missing")
    };
    assert!(!found("082#"));
    assert!(!found("082#3102040000000000"));
    assert!(found("083#"));
}

const IFB: &str = "#! --node 5=rexroth-ifb-iac";

fn ifb(rule: &str) -> (String, u8, Severity) {
    (format!("rexroth-ifb-iac:{rule}"), 5, Severity::Note)
}

/// RE 29015-01-Z/09.06 §4: in each controller mode, the control word is at the start of RPDO1 and the status word at that
/// of TPDO1. The mode (6043) is unknown here.
#[test]
fn a_field_at_the_same_place_in_all_layouts_is_judged_in_an_unknown_mode() {
    let frames = ["705#00", "000#0105", "205#07000010", "185#0F000010", "205#17000010", "185#0F200010"];
    assert_eq!(
        of_devices(&judged(IFB, &frames)),
        [ifb("reserved-control-bits"), ifb("reserved-status-bits")]
    );
    assert_eq!(of_devices(&judged(IFB, &frames[..4])), []);
}

/// RE 29015-01-Z/09.06 §1.2: one RPDO and one TPDO. 285 is the predefined identifier of TPDO2, unless another node has
/// it.
#[test]
fn a_pdo_that_another_node_has_on_the_identifier_is_not_of_the_device() {
    let other = ["709#00", "609#2300180185020000", "589#6000180100000000"];
    let own = ["705#00", "000#0100", "285#0102"];
    let both: Vec<&str> = other.iter().chain(&own).copied().collect();
    assert_eq!(of_devices(&judged(IFB, &own)), [ifb("one-pdo-pair")]);
    assert_eq!(of_devices(&judged(IFB, &both)), []);
    let command = ["705#00", "000#0100", "305#0102"];
    assert_eq!(of_devices(&judged(IFB, &command)), [ifb("one-pdo-pair")]);
}

/// RE 29015-01-Z/09.06 §3: a response that was sent before the reset took effect does not show the state after it.
#[test]
fn a_state_is_judged_only_some_time_after_a_reset_command() {
    let until = |frames: usize| {
        let wait = std::iter::repeat_n("080#", frames);
        let frames: Vec<&str> =
            ["705#00", "000#0105", "705#05", "000#8105"].into_iter().chain(wait).chain(["705#05"]).collect();
        let all = of_devices(&judged(IFB, &frames));
        all.into_iter().filter(|(rule, ..)| rule.ends_with("pre-operational-after-start")).count()
    };
    assert_eq!((until(10), until(25)), (0, 1));
}
