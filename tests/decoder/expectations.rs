//! Expectations of the bus file: a fixture for each kind, errors with their positions, and the same findings
//! for a live bus and its capture.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::sync::Arc;

use cobscope_decoder::bus_file::{BusFile, ExpectCondition};
use cobscope_decoder::finding::{CaptureFindings, RuleOutcome};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use proptest::prelude::*;

use crate::harness;
use crate::harness::expectations::{differences, judge, verdicts};
use crate::rules::{Annotated, captures, read};
use crate::support::{step, workspace};

/// All kinds of expectations.
const KINDS: [&str; 8] = ["always", "never", "within", "every", "count", "order", "bounds", "rate"];

fn recorded(capture: &Annotated) -> CaptureFindings {
    judge(&capture.frames, &capture.options, &Arc::new(capture.setup.clone()), |_| 0)
}

fn verdict(findings: &CaptureFindings, id: &str) -> RuleOutcome {
    let place = findings.rules.iter().position(|rule| *rule.name == *id).unwrap();
    findings.tallies[place].verdict()
}

#[test]
fn every_kind_has_a_fixture_in_which_it_is_broken_and_met() {
    for kind in KINDS {
        let capture = read(&workspace().join(format!("fixtures/rules/expect-{kind}.log")));
        let findings = recorded(&capture);
        let expectations = &capture.options.bus_file.judgement.expectations;
        let own = expectations.iter().filter(|one| one.demand.name() == kind);
        let tallies: Vec<_> = own
            .map(|one| findings.rules.iter().position(|rule| *rule.name == *one.id.text).unwrap())
            .map(|place| findings.tallies[place])
            .collect();
        assert!(tallies.iter().any(|tally| tally.failed > 0), "{kind} is never broken: {tallies:?}");
        assert!(tallies.iter().any(|tally| tally.passed > 0), "{kind} is never met: {tallies:?}");
    }
}

#[test]
fn unknown_names_are_not_judged_and_are_reported() {
    let capture = read(&workspace().join("fixtures/rules/expect-bounds.log"));
    let findings = recorded(&capture);
    assert_eq!(verdict(&findings, "raw-position"), RuleOutcome::NotExercised);
    assert_eq!(findings.quality, ["raw-position is not exercised: signal '6063:00' did not occur"]);
    let capture = read(&workspace().join("fixtures/rules/expect-never.log"));
    let findings = recorded(&capture);
    assert_eq!(verdict(&findings, "no-own-code"), RuleOutcome::Pass);
    assert_eq!(verdict(&findings, "absent"), RuleOutcome::NotExercised);
    assert_eq!(findings.quality, ["absent is not exercised: node 9/09 sent no frame"]);
}

fn setup(text: &str) -> Result<(BusFile, RuleSetup), String> {
    let file = BusFile::parse(text).map_err(|error| error.to_string())?;
    let setup = RuleSetup::new(&file, text, Some("2026-06-01".into())).map_err(|error| error.to_string())?;
    Ok((file, setup))
}

/// Judges a fixture with another bus file.
fn judged(fixture: &str, text: &str) -> CaptureFindings {
    let (bus_file, setup) = setup(text).unwrap();
    let frames = fs::read_to_string(workspace().join("fixtures/rules").join(fixture)).unwrap();
    judge(&frames, &SessionOptions { bus_file, ..SessionOptions::default() }, &Arc::new(setup), |_| 0)
}

#[test]
fn severity_and_suppression_apply_to_expectations_as_to_rules() {
    let expect = "[[expect]]\nid = \"no-sync\"\nkind = \"never\"\nwhen = 'kind == sync'\nreason = \"r\"\n";
    let findings = judged("expect-within.log", expect);
    assert_eq!(findings.groups[0].severity.name(), "error");
    let findings = judged("expect-within.log", &format!("{expect}[rules.no-sync]\nseverity = \"note\"\n"));
    assert_eq!(findings.groups[0].severity.name(), "note");
    let findings = judged("expect-within.log", &format!("{expect}[rules.no-sync]\nseverity = \"off\"\n"));
    assert!(findings.groups.is_empty());
    let suppress = "[[suppress]]\nrule = \"no-sync\"\nreason = \"the new master\"\n";
    let findings = judged("expect-within.log", &format!("{expect}{suppress}"));
    assert_eq!((findings.reported_groups().count(), findings.groups.len()), (0, 1));
    assert_eq!(findings.groups[0].suppressed.as_deref(), Some("the new master"));
    let findings = judged("expect-within.log", &expect.replace("kind = ", "bus = \"can1\"\nkind = "));
    assert!(findings.groups.is_empty());
}

/// `[[expect]]` with four lines for id, kind and reason, followed by `lines`.
fn broken(kind: &str, lines: &str) -> String {
    let text = format!("[[expect]]\nid = \"a-b\"\nkind = \"{kind}\"\nreason = \"r\"\n{lines}\n");
    match setup(&text) {
        Ok(_) => "understood".into(),
        Err(error) => error.lines().next().unwrap().to_owned(),
    }
}

#[test]
fn an_error_in_the_table_is_reported_with_its_place() {
    let all = [
        ("never", "when = 'sync'\nwehn = 'x'", "6:1: unknown field `wehn`, expected one of"),
        ("nevr", "when = 'x'", "3:8: unknown kind 'nevr'; expected always, never, within, every, count"),
        ("never", "", "3:8: when is missing; kind never requires it"),
        ("within", "when = 'kind'\nseconds = 1", "3:8: expect is missing; kind within requires it"),
        ("never", "when = 'kind'\nseconds = 1", "6:11: seconds is not valid for kind never; expected when"),
        (
            "always",
            "when = 'kind'\nexpect = 't'\nper = \"node\"",
            "7:7: per is not valid for kind always; expected when, expect",
        ),
        ("every", "when = 'kind'\nseconds = 0", "6:11: time out of range; expected seconds > 0"),
        ("every", "when = 'kind'\nseconds = inf", "6:11: time out of range; expected seconds > 0"),
        ("every", "when = 'kind'\nseconds = 1e9", "6:11: time out of range; expected seconds > 0"),
        ("every", "when = 'kind'\nseconds = \"1\"", "6:11: found \"1\", expected a number"),
        (
            "every",
            "when = 'kind'\nseconds = 1\ntolerance = \"10\"",
            "7:13: invalid tolerance; expected a number of seconds",
        ),
        (
            "every",
            "when = 'kind'\nseconds = 1\ntolerance = -1",
            "7:13: invalid tolerance; expected a number of seconds",
        ),
        ("every", "when = 'kind'\nseconds = 1\nper = \"bus\"", "7:7: unknown per; expected \"node\""),
        (
            "every",
            "when = 'kind'\nseconds = 1\nnode = 5\nper = \"node\"",
            "8:7: per = \"node\" has no effect with a single node",
        ),
        ("every", "when = 'kind'\nseconds = 1\nnode = 128", "7:8: expected a node-ID 1 to 127"),
        ("count", "when = 'kind'", "3:8: min and max are missing; expected at least one"),
        ("count", "when = 'kind'\nmin = 1.5", "6:7: invalid count; expected an integer ≥ 0"),
        ("count", "when = 'kind'\nmin = 3\nmax = 2", "3:8: min > max; expected min ≤ max"),
        ("order", "steps = ['kind']", "5:9: step count 1; expected 2 to 64"),
        ("order", "steps = 'kind'", "5:9: found \"kind\", expected a list"),
        ("bounds", "signal = ' '\nmin = 1", "5:10: empty signal; expected a name"),
        ("bounds", "signal = 'a'", "3:8: min and max are missing; expected at least one"),
        ("bounds", "signal = 'a'\nmax = nan", "6:7: the limit is not finite; expected a number"),
        (
            "rate",
            "signal = 'a'\nmax_per_second = 0",
            "6:18: max_per_second is invalid; expected a number > 0",
        ),
        (
            "never",
            "when = 'kind'\nseverity = \"bad\"",
            "6:12: unknown severity; expected \"error\", \"warning\" or \"note\"",
        ),
    ];
    for (kind, lines, message) in all {
        let error = broken(kind, lines);
        assert!(error.starts_with(message), "{kind} {lines}:\n{error}\n{message}");
    }
}

#[test]
fn an_error_in_an_expression_is_reported_with_its_place() {
    let all = [
        ("never", "when = 'nod == 5'", "5:9: unknown field 'nod'; did you mean node?"),
        ("never", "when = \"nod == 5\"", "5:9: unknown field 'nod'"),
        ("never", "when = 'node == five'", "5:17: node is a number; found 'five'"),
        ("never", "when = \"node_name == \\\"x\\\" && nod\"", "5:31: unknown field 'nod'"),
        ("never", "when = \"\\u006eode == 5 && nod\"", "5:27: unknown field 'nod'"),
        ("never", "when = '''\nnode == 5\n  && nod'''", "7:6: unknown field 'nod'"),
        ("never", "when = \"\"\"node == 5 \\\n    && nod\"\"\"", "6:8: unknown field 'nod'"),
        ("never", "when = 'node =='", "5:16: expected a value"),
        ("never", "when = ''", "5:9: empty filter"),
        ("always", "when = 'kind'\nexpect = 'node = 5'", "6:16: use == to compare"),
        ("order", "steps = [\n'kind',\n'nod'\n]", "7:2: unknown field 'nod'"),
        ("never", "when = 'capture == \"a\"'", "5:8: 'capture' is not available in expectations"),
        ("never", "when = 'kind == pdo && abort.code'", "5:8: expression never matches"),
        ("never", "when = 'kind == finding-opened'", "5:8: finding events are not available in expectations"),
        (
            "rate",
            "signal = 'a'\nmax_per_second = 1\nwhen = 'kind == sync'",
            "7:8: expression matches no event with values",
        ),
    ];
    for (kind, lines, message) in all {
        let error = broken(kind, lines);
        assert!(error.starts_with(message), "{kind} {lines}:\n{error}\n{message}");
    }
}

#[test]
fn ids_are_names_of_nothing_else() {
    let table = |id: &str| {
        format!("[[expect]]\nid = \"{id}\"\nkind = \"never\"\nwhen = 'kind == sync'\nreason = \"r\"\n")
    };
    for id in ["", "A", "a_b", "a-", "-a", "a--b", "a:b", "a b", "ä"] {
        assert!(
            setup(&table(id))
                .unwrap_err()
                .starts_with("2:6: invalid id; expected a-z, 0-9 and single hyphens"),
            "{id}"
        );
    }
    let error = setup(&table("sdo-no-response")).unwrap_err();
    assert!(error.starts_with("2:6: duplicate rule name 'sdo-no-response'"), "{error}");
    let error = setup(&format!("{}{}", table("a"), table("a"))).unwrap_err();
    assert!(error.starts_with("7:6: duplicate id 'a'"), "{error}");
    let error = setup(&table("a").replace("\"r\"", "\" \"")).unwrap_err();
    assert!(error.starts_with("5:10: empty reason; expected a text"), "{error}");
    let error = setup(&table("a").replace("reason = \"r\"\n", "")).unwrap_err();
    assert!(error.starts_with("1:1: missing field `reason`"), "{error}");
}

#[test]
fn a_tolerance_is_a_time_or_a_share() {
    let tolerance = |line: &str| {
        let text = format!(
            "[[expect]]\nid = \"a\"\nkind = \"every\"\nwhen = 'kind == sync'\nseconds = 2\nreason = \"r\"\n{line}"
        );
        match &setup(&text).unwrap().0.judgement.expectations[0].demand {
            ExpectCondition::Every { tolerance, .. } => *tolerance,
            _ => 0,
        }
    };
    assert_eq!(tolerance(""), 200_000_000);
    assert_eq!(tolerance("tolerance = 0.05"), 50_000_000);
    assert_eq!(tolerance("tolerance = \"5 %\""), 100_000_000);
    assert_eq!(tolerance("tolerance = 0"), 0);
}

/// A bus with 20 s of silence while everything waits: SYNC every 10 ms, each followed by a PDO, heartbeats, a
/// request without a response.
fn silent_bus(has_heartbeats: bool) -> String {
    let mut frames = String::new();
    for number in 0..600_u32 {
        let silence = if number >= 400 { 20_000_000 } else { 0 };
        let time = number * 10_000 + number % 7 * 13 + silence;
        let mut line = |after: u32, frame: &str| {
            let time = time + after;
            let (seconds, rest) = (1_700_000_000 + time / 1_000_000, time % 1_000_000);
            writeln!(frames, "({seconds}.{rest:06}) can0 {frame}").unwrap();
        };
        line(0, "080#");
        if number % 50 != 49 && number != 399 {
            line(1_100, "185#0102");
        }
        // The third periodic producer, which makes a gap of all a silence.
        if number % 10 == 1 {
            line(1_200, "186#00");
        }
        if has_heartbeats && number % 10 == 3 && number % 130 != 3 {
            line(2_300, "705#05");
        }
        if number % 100 == 77 {
            line(3_100, "605#4018100100000000");
        }
    }
    frames
}

const OF_THE_SILENT_BUS: &str = "
[[expect]]
id = \"answers\"
kind = \"within\"
when = 'kind == sync'
expect = 'kind == pdo'
seconds = 0.005
reason = \"r\"
[[expect]]
id = \"cyclic\"
kind = \"every\"
when = 'kind == heartbeat'
seconds = 0.1
per = \"node\"
reason = \"r\"
[[expect]]
id = \"often\"
kind = \"count\"
when = 'kind == pdo'
min = 110
per_seconds = 1
reason = \"r\"
[[expect]]
id = \"lost\"
kind = \"never\"
when = 'kind == node-lost || kind == sdo-transfer && outcome == timeout'
reason = \"r\"
[[expect]]
id = \"steps\"
kind = \"order\"
steps = ['kind == heartbeat', 'kind == sdo-transfer']
seconds = 0.3
reason = \"r\"
";

#[test]
fn a_silence_of_the_whole_bus_breaks_nothing() {
    let (bus_file, setup) = setup(OF_THE_SILENT_BUS).unwrap();
    let options = SessionOptions { bus_file, ..SessionOptions::default() };
    let setup = Arc::new(setup);
    let count = |findings: &CaptureFindings, rule: &str| {
        findings.groups.iter().filter(|group| *group.rule == *rule).map(|group| group.count).sum::<u64>()
    };
    // Of 600 SYNC, every fiftieth has no PDO. The one before the silence is judged after the silence; nothing
    // follows the last one.
    let findings = judge(&silent_bus(false), &options, &setup, |_| 0);
    assert_eq!(count(&findings, "answers"), 10);
    // Four heartbeats are missing after the first; neither the silence nor its effect on the clock adds one.
    let findings = judge(&silent_bus(true), &options, &setup, |_| 0);
    assert_eq!(count(&findings, "cyclic"), 4);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, failure_persistence: None, ..ProptestConfig::default() })]

    /// Ticks of a live bus at random intervals.
    #[test]
    fn a_live_bus_is_judged_as_its_recording(steps in prop::collection::vec(1_i64..400, 1..8)) {
        let mut all: Vec<(String, String, SessionOptions, RuleSetup)> = captures()
            .iter()
            .step_by(step(3))
            .map(|path| read(path))
            .map(|capture| (capture.name, capture.frames, capture.options, capture.setup))
            .collect();
        let (bus_file, setup) = setup(OF_THE_SILENT_BUS).unwrap();
        let options = SessionOptions { bus_file, ..SessionOptions::default() };
        all.push(("silent".into(), silent_bus(true), options.clone(), setup.clone()));
        all.push(("silent, without heartbeats".into(), silent_bus(false), options, setup));
        for (name, frames, options, setup) in all {
            let setup = Arc::new(setup);
            let recorded = verdicts(&judge(&frames, &options, &setup, |_| 0));
            let mut next = steps.iter().cycle();
            let step = |gap: i64| (gap / 40).max(next.next().unwrap() * 500_000);
            let live = verdicts(&judge(&frames, &options, &setup, step));
            prop_assert!(recorded == live, "{}: {:#?}", name, differences(&recorded, &live));
        }
    }
}

fn expression() -> impl Strategy<Value = String> {
    let test = prop::sample::select(vec![
        "node == 5",
        "kind == pdo",
        "kind in {sync, heartbeat}",
        "signals.name == \"x\"",
        "value > 3",
        "t > 0.5",
        "frames == 3",
        "kind matches \"e\"",
        "code",
        "nod",
        "node ==",
        "object == 0x1017:00",
        "\"",
        "\\u00e4",
    ]);
    let join = prop::sample::select(vec!["&&", "or", "", "&& !", "(", ")"]);
    (test.clone(), prop::collection::vec((join, test), 0..3)).prop_map(|(first, rest)| {
        rest.into_iter().fold(first.to_owned(), |all, (join, test)| format!("{all} {join} {test}"))
    })
}

fn table() -> impl Strategy<Value = String> {
    let kind = prop::sample::select(KINDS.to_vec());
    let keys = prop::collection::btree_map(
        prop::sample::select(vec![
            "when",
            "expect",
            "signal",
            "seconds",
            "per_seconds",
            "tolerance",
            "min",
            "max",
            "max_per_second",
            "per",
            "node",
            "severity",
            "bus",
            "steps",
        ]),
        (expression(), -1.0..5.0_f64),
        0..7,
    );
    let quote = prop::sample::select(vec!["'", "\"", "'''", "\"\"\""]);
    (kind, keys, quote, 0..4_u8).prop_map(|(kind, keys, quote, id)| {
        let mut text = format!("[[expect]]\nid = \"x-{id}\"\nkind = \"{kind}\"\nreason = \"r\"\n");
        let keys: BTreeMap<_, _> = keys;
        for (key, (expression, number)) in keys {
            let value = match key {
                "when" | "expect" => format!("{quote}{expression}{quote}"),
                "steps" => format!("[{quote}{expression}{quote}, {quote}kind == sync{quote}]"),
                "signal" => "'6041:00'".to_owned(),
                "per" => "'node'".to_owned(),
                "node" => "5".to_owned(),
                "severity" => "'note'".to_owned(),
                "bus" => "'can0'".to_owned(),
                _ => format!("{number:.2}"),
            };
            let _ = writeln!(text, "{key} = {value}");
        }
        text
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_table_breaks_it(tables in prop::collection::vec(table(), 1..3)) {
        harness::expectations(tables.concat().as_bytes());
    }
}
