//! `[[rule]]` and `[[expect]]` in bus files and in profiles: each grammar is judged in each file.

use std::sync::Arc;

use cobscope_decoder::bus_file::BusFile;
use cobscope_decoder::finding::{CaptureFindings, RuleOutcome, Severity};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::profile::device::ProfileFile;
use cobscope_decoder::rules::{RuleSetup, check_names};
use cobscope_decoder::session::{AssignedBy, Assignment, SessionOptions};
use cobscope_decoder::wire::NodeId;

use crate::rules::{judge, parse};

/// Node 5 is read at 10 ms (answer 0), stopped at 30 ms and writes 2000:01 = 9 at 50 ms; node 6 sends a heartbeat.
const FRAMES: &str = "\
(1700000000.000100) can0 705#05
(1700000000.001300) can0 706#05
(1700000000.010200) can0 605#4000200100000000
(1700000000.011100) can0 585#4F00200100000000
(1700000000.030300) can0 000#0205
(1700000000.050700) can0 605#2F00200109000000
(1700000000.051900) can0 585#6000200100000000
(1700000000.100400) can0 705#04
(1700000000.101300) can0 706#05
";

/// A profile with expectations, and one with an expression that cannot match.
const PROFILE: &str = r#"
id = "acme-pump"
title = "pump"
source = "manual 1"

[[object]]
index = 0x2000
name = "speed"
sub = [{ sub = 1, name = "speed", type = "UNSIGNED8", access = "rw" }]

[[expect]]
id = "never-stopped"
kind = "never"
when = 'kind == nmt-command && command == stop'
severity = "warning"
reason = "a stopped pump keeps its flow"

[[expect]]
id = "speed-max"
kind = "bounds"
signal = "2000:01"
max = 5
reason = "speed 6 and above damages the seal"
"#;

fn texts(findings: &CaptureFindings) -> Vec<(String, Option<NodeId>, Severity, u64)> {
    let groups = findings.groups.iter();
    groups
        .map(|it| (it.rule.to_string(), it.key.node, it.severity, it.first[0].frames.first))
        .filter(|(rule, ..)| rule != "operational-lost")
        .collect()
}

fn outcome(findings: &CaptureFindings, rule: &str) -> RuleOutcome {
    let place = findings.rules.iter().position(|known| *known.name == *rule).unwrap();
    findings.tallies[place].verdict()
}

/// Findings with a bus file.
fn with_bus_file(text: &str) -> CaptureFindings {
    let lines: String = text.lines().flat_map(|line| ["#| ", line, "\n"]).collect();
    let capture = parse("a capture", &format!("{lines}{FRAMES}"));
    judge(&capture.frames, &capture.options, capture.setup.clone()).1
}

/// Findings with a profile of some nodes, and settings in the bus file.
fn with_profile(profile: &str, nodes: &[u8], bus_file: &str) -> CaptureFindings {
    let mut catalogue = Catalogue::default();
    catalogue.add_text("pump.toml", profile).unwrap();
    let device = catalogue.device("acme-pump").unwrap();
    let assignment = |node: &u8| Assignment {
        bus: None,
        node: NodeId::Canopen(*node),
        device: Arc::clone(&device),
        by: AssignedBy::Option,
    };
    let file = BusFile::parse(bus_file).unwrap();
    let setup = RuleSetup::new(&file, bus_file, None).unwrap();
    let assignments = nodes.iter().map(assignment).collect();
    let options = SessionOptions {
        assignments,
        catalogue: Arc::new(catalogue),
        bus_file: file,
        ..SessionOptions::default()
    };
    judge(FRAMES, &options, setup).1
}

const NODE: Option<NodeId> = Some(NodeId::Canopen(5));

/// `[[rule]]` in a bus file applies to its node, without any profile.
#[test]
fn a_rule_of_the_bus_file_is_judged_at_its_node() {
    let rules = "
[[rule]]
node = 5
name = 'speed'
kind = 'permitted'
severity = 'error'
object = '2000:01'
values = [0, 1]
text = 'speed above 1'
[[rule]]
node = 6
name = 'other-node'
kind = 'never'
severity = 'error'
on = { write = '2000:01' }
text = 'speed written'
[[rule]]
node = 5
name = 'start'
kind = 'follow'
severity = 'note'
on = { nmt = 'stop' }
then = { write = '2000:01' }
ms = 25
text = 'no speed after stop'
";
    let findings = with_bus_file(rules);
    assert_eq!(texts(&findings), [("speed".into(), NODE, Severity::Error, 6)]);
    assert_eq!(findings.groups[0].text, "speed above 1 (9h written)");
    assert_eq!(outcome(&findings, "start"), RuleOutcome::Pass);
    // The response arrives 21.6 ms after the command.
    let findings = with_bus_file(&rules.replace("ms = 25", "ms = 20"));
    assert_eq!(outcome(&findings, "start"), RuleOutcome::Fail);
    let findings = with_bus_file(&format!("{rules}[rules.speed]\nseverity = 'note'\n"));
    assert_eq!(texts(&findings), [("speed".into(), NODE, Severity::Note, 6)]);
    let findings = with_bus_file(&format!("{rules}[rules.speed]\nseverity = 'off'\n"));
    assert_eq!(texts(&findings), []);
    let findings =
        with_bus_file(&rules.replace("node = 5\nname = 'speed'", "node = 5\nbus = 'can1'\nname = 'speed'"));
    assert_eq!(texts(&findings), []);
}

#[test]
fn a_rule_of_the_bus_file_is_judged_in_addition_to_those_of_the_profile() {
    let rules = "[[rule]]\nnode = 5\nname = 'speed'\nkind = 'never'\nseverity = 'error'\n\
                 on = { write = '2000:01' }\ntext = 'speed written'\n";
    let own = "[[rule]]\nname = 'read'\nkind = 'never'\nseverity = 'note'\non = { read = '2000:01' }\n\
               text = 'speed read'\n";
    let profile = PROFILE.split("[[expect]]").next().unwrap().to_owned() + own;
    let findings = with_profile(&profile, &[5], rules);
    let expected =
        [("acme-pump:read".into(), NODE, Severity::Note, 3), ("speed".into(), NODE, Severity::Error, 6)];
    assert_eq!(texts(&findings), expected);
}

/// `[[expect]]` in a profile applies to the nodes with that profile only.
#[test]
fn an_expectation_of_a_profile_is_judged_at_its_nodes() {
    let expected = [("acme-pump:speed-max".into(), NODE, Severity::Error, 6)];
    let findings = with_profile(PROFILE, &[5], "");
    // The command to stop is an event of node 5.
    let stopped = ("acme-pump:never-stopped".into(), NODE, Severity::Warning, 5);
    assert_eq!(texts(&findings), [&[stopped][..], &expected].concat());
    assert_eq!(texts(&with_profile(PROFILE, &[6], "")), []);
    let off = "[rules.'acme-pump:never-stopped']\nseverity = 'off'\n";
    assert_eq!(texts(&with_profile(PROFILE, &[5, 6], off)), expected);
    assert!(!texts(&with_profile(PROFILE, &[], "")).iter().any(|(rule, ..)| rule.contains(':')));
}

/// The same requirement in both grammars has its finding at the same frame.
#[test]
fn both_grammars_mean_the_same() {
    let findings = with_bus_file(
        "
[[rule]]
node = 5
name = 'by-object'
kind = 'never'
severity = 'error'
on = { write = '2000:01' }
text = 'speed written'
[[expect]]
node = 5
id = 'by-expression'
kind = 'never'
when = 'kind == sdo-transfer && object == 2000:01 && direction == download'
reason = 'speed written'
",
    );
    let at = |rule: &str| (rule.to_owned(), NODE, Severity::Error, 6);
    assert_eq!(texts(&findings), [at("by-object"), at("by-expression")]);
}

#[test]
fn errors_have_their_place_in_both_files() {
    let bus_file = |text: &str| {
        let file = BusFile::parse(text).map_err(|error| error.to_string());
        let setup =
            file.and_then(|file| RuleSetup::new(&file, text, None).map_err(|error| error.to_string()));
        setup.err().map_or_else(String::new, |error| error.lines().next().unwrap().to_owned())
    };
    let rule =
        |keys: &str| format!("[[rule]]\nname = 'x'\nseverity = 'note'\nkind = 'never'\ntext = 't'\n{keys}\n");
    let on = "node = 5\non = { sync = true }";
    assert_eq!(bus_file(&rule(on)), "");
    let missing = "1:1: node is missing; a rule in a bus file applies to one node";
    assert_eq!(bus_file(&rule("on = { sync = true }")), missing);
    assert_eq!(bus_file(&rule("node = 5")), "1:1: a rule of this kind requires on");
    assert_eq!(
        bus_file(&rule(on).replace("'x'", "'a b'")),
        "1:1: invalid rule name 'a b'; expected a-z, 0-9 and hyphens"
    );
    assert_eq!(bus_file(&rule(on).replace("'x'", "'sync-period'")), "1:1: duplicate rule name 'sync-period'");
    assert_eq!(bus_file(&[rule(on), rule(on)].concat()), "8:1: duplicate rule 'x'");
    let profile = |text: &str| {
        ProfileFile::parse(text).map_or_else(
            |errors| errors[0].to_string(),
            |file| check_names(text, &file).first().map_or_else(String::new, ToString::to_string),
        )
    };
    assert_eq!(profile(PROFILE), "");
    let error = profile(&PROFILE.replace("max = 5", "max = 5\nnode = 5"));
    assert!(error.contains("bus, node and per are valid in bus files only"), "{error}");
    let error = profile(&PROFILE.replace("command == stop", "comand == stop"));
    assert!(error.starts_with("14:32: unknown field 'comand'"), "{error}");
    // The expression of a loaded profile that cannot be compiled is not exercised, with the reason.
    let findings = with_profile(&PROFILE.replace("command == stop", "comand == stop"), &[5], "");
    assert_eq!(outcome(&findings, "acme-pump:never-stopped"), RuleOutcome::NotExercised);
}
