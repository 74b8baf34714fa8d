//! Commands that other programs call (`cobscope::embedded`): their results equal the output of the program.
#![expect(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use std::ffi::OsString;

use cobscope::ExitStatus;
use cobscope::embedded::{self, CaptureSource};
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::reading::{FrameDemand, ReadingPart};
use cobscope_decoder::session::Bus;
use serde_json::Value;

use crate::cli::run;
use crate::support::step;

const SYDFEC: [&str; 2] = ["--node=2=rexroth-sydfec", "fixtures/devices/sydfec.log"];

/// Arguments with paths in the workspace: these tests run in a folder of a crate.
fn words(arguments: &[&str]) -> Vec<OsString> {
    let root = crate::support::workspace();
    let word = |word: &&str| if word.starts_with("fixtures/") { root.join(word).into() } else { word.into() };
    arguments.iter().map(word).collect()
}

#[derive(Default)]
struct Counter {
    kinds: Vec<&'static str>,
    frames: u64,
    last: u64,
    limit: Option<usize>,
}

impl ReadingPart for Counter {
    fn event(&mut self, event: &Event, _: &Bus) {
        self.kinds.push(event.kind.name());
    }

    fn is_done(&self) -> bool {
        self.limit.is_some_and(|limit| self.kinds.len() >= limit)
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Each
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) {
        assert_eq!(names.name_of(frame.bus), "can0");
        (self.frames, self.last) = (self.frames + 1, frame.number);
    }
}

#[test]
fn a_pass_has_all_events_and_frames() {
    let source = CaptureSource::open(&words(&SYDFEC)).unwrap().value;
    for (has_rules, option) in [(true, "--all"), (false, "--no-findings")] {
        let expected = run(&[&["decode", "-f", "jsonl", option][..], &SYDFEC].concat(), "").stdout;
        let kind = |line: &str| serde_json::from_str::<Value>(line).unwrap()["kind"].clone();
        let mut counter = Counter::default();
        let end = source.read(has_rules, &mut counter).unwrap();
        assert_eq!(end.failure, None);
        assert_eq!(counter.kinds, expected.lines().map(kind).collect::<Vec<_>>());
        assert!(counter.frames > 100 && counter.frames == counter.last);
    }
    let mut counter = Counter { limit: Some(1), ..Counter::default() };
    source.read(true, &mut counter).unwrap();
    let whole = run(&[&["decode", "-f", "jsonl"][..], &SYDFEC].concat(), "").stdout.lines().count();
    assert!(counter.kinds.len() < whole, "{}", counter.kinds.len());
}

#[test]
fn errors_have_the_status_of_the_command() {
    let exit = |arguments: &[&str]| {
        let error = CaptureSource::open(&words(arguments)).map(|_| ()).unwrap_err();
        (error.exit, error.text)
    };
    let absent = (
        ExitStatus::Capture,
        "absent.log: cannot be opened: No such file or directory (os error 2)".to_owned(),
    );
    assert_eq!(exit(&["absent.log"]), absent);
    let (status, text) = exit(&["--node=2=rexroth-sydfek", "fixtures/devices/sydfec.log"]);
    assert_eq!(status, ExitStatus::Profile);
    assert!(text.contains("did you mean 'rexroth-sydfec'?"), "{text}");
    let (status, text) = exit(&["--protocol=morse", "fixtures/devices/sydfec.log"]);
    assert_eq!(status, ExitStatus::Usage);
    assert!(text.starts_with("invalid value 'morse' for '--protocol"), "{text}");
    let (status, text) = exit(&["fixtures/devices/sydfec.log", "fixtures/machine/machine.log"]);
    assert_eq!(status, ExitStatus::Usage);
    assert!(text.starts_with("the 2 files are 2 captures"), "{text}");
    let (status, text) = exit(&["--select=node-losst", "fixtures/devices/sydfec.log"]);
    assert_eq!(status, ExitStatus::Usage);
    assert!(text.starts_with("--select: unknown rule 'node-losst'"), "{text}");
}

#[test]
fn results_equal_the_output_of_the_commands() {
    let program = run(&[&["check", "-f", "jsonl"][..], &SYDFEC].concat(), "").stdout;
    let own = embedded::check(&words(&SYDFEC)).unwrap();
    let root = format!("{}/", crate::support::workspace().display());
    assert_eq!(own.value.0.replace(&root, ""), program);
    assert!(own.messages.is_empty(), "{:?}", own.messages);
    assert_eq!(
        embedded::explain(&words(&["06090031"])).unwrap().value,
        run(&["explain", "06090031"], "").stdout
    );
    assert_eq!(embedded::explain(&words(&["nothing"])).unwrap_err().exit, ExitStatus::Usage);
    let pair = ["fixtures/devices/sydfec.log", "fixtures/rules/node-lost.log"];
    let program = run(&[&["diff", "-f", "json"][..], &pair].concat(), "").stdout;
    assert_eq!(embedded::diff(&words(&pair)).unwrap().value.replace(&root, ""), program);
}

/// All captures of candump text in the fixtures; `page.rs` and `mcp.rs` compare theirs with the commands, too.
#[test]
fn each_answer_is_that_of_its_command() {
    let captures = crate::support::captures_below("fixtures");
    assert!(captures.len() > 200, "{}", captures.len());
    for capture in captures.iter().step_by(step(4)) {
        compare_answers(capture);
    }
}

fn compare_answers(capture: &str) {
    let lines = |command: &str, format: &str, options: &[&str]| -> Vec<Value> {
        let output = run(&[&[command, "-f", format][..], options, &[capture]].concat(), "").stdout;
        output.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    };
    let Ok(source) = CaptureSource::open(&words(&[capture])) else {
        assert!(lines("stats", "json", &[]).is_empty(), "{capture}");
        return;
    };
    let results = source.value.results().unwrap();
    assert_eq!([results.statistics], *lines("stats", "json", &[]), "{capture}");
    assert_eq!([results.why], *lines("why", "json", &[]), "{capture}");
    let is_of_capture = |line: &Value| line["kind"] == "finding";
    let findings = results.findings.into_iter().filter(is_of_capture).collect::<Vec<_>>();
    let printed = lines("check", "jsonl", &[]).into_iter().filter(is_of_capture).collect::<Vec<_>>();
    assert_eq!(findings, printed, "{capture}");
    for node in lines("objects", "json", &[]) {
        let is_of_node = |object: &&Value| object["bus"] == node["bus"] && object["node"] == node["node"];
        let own: Vec<_> = results.objects.iter().filter(is_of_node).cloned().collect();
        let chosen = format!("{}:{}", node["bus"].as_str().unwrap(), node["node"]);
        assert_eq!(own, lines("objects", "json", &["--node", &chosen]), "{capture}: {node}");
    }
}
