//! Rules on annotated captures: `fixtures/rules/<rule>.log` contains marks for all findings of a rule, and no
//! other finding may occur. Captures for devices, `fixtures/rules/devices/<profile>.<topic>.log`, cover
//! several rules each.
//!
//! ```text
//! #! --node 5=wandfluh-md2:amplifier     options; also --protocol canopen; --dbc dbc/signals.dbc
//! #| [node.5]                            lines of a bus file
//! (1700000000.000000) can0 705#05
//! #~ node-lost node=5 severity=error     a finding that opens at the frame above (or a deadline before it)
//! #- node-lost                           a finding that closes
//! ```

#![expect(clippy::panic, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cobscope_decoder::Reading;
use cobscope_decoder::bus_file::BusFile;
use cobscope_decoder::capture::{Batch, BusNames, CaptureReader, ReadOptions};
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::{CaptureFindings, FindingCause};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::profile::dbc::{self, Database};
use cobscope_decoder::reading::{FrameDemand, ReadingPart};
use cobscope_decoder::rules::{HEADINGS, RuleSetup, all_declarations, section_text};
use cobscope_decoder::session::{AssignedBy, Assignment, Bus, ProtocolChoice, SessionOptions};

use crate::support::workspace;

/// A capture with its marks.
pub struct Annotated {
    /// Name of the file.
    pub name: String,
    /// The frames only.
    pub frames: String,
    /// Options and bus file of the session.
    pub options: SessionOptions,
    /// Text of the bus file.
    pub bus_text: String,
    /// Setup of the rules.
    pub setup: RuleSetup,
    /// For each mark: number of the frame above, whether the finding closes, rule, keys.
    marks: Vec<(u64, bool, String, BTreeMap<String, String>)>,
}

fn folder() -> PathBuf {
    workspace().join("fixtures").join("rules")
}

/// Reads an annotated capture.
pub fn read(path: &Path) -> Annotated {
    let text = fs::read_to_string(path).unwrap();
    parse(&path.file_name().unwrap().to_string_lossy(), &text)
}

/// Parses an annotated capture.
pub fn parse(name: &str, text: &str) -> Annotated {
    let name = name.to_owned();
    let mut bus_file = String::new();
    let mut options = SessionOptions::default();
    let mut catalogue = Catalogue::default();
    let mut frames = String::new();
    let (mut marks, mut number, mut given) = (Vec::new(), 0, Vec::new());
    for line in text.lines() {
        if let Some(text) = line.strip_prefix("#|") {
            writeln!(bus_file, "{}", text.strip_prefix(' ').unwrap_or(text)).unwrap();
        } else if let Some(text) = line.strip_prefix("#!") {
            given.push(text.trim());
        } else if let Some(text) = line.strip_prefix("#~").or_else(|| line.strip_prefix("#-")) {
            let mut words = text.split_whitespace();
            let rule = words.next().unwrap().to_owned();
            let keys = words
                .map(|word| word.split_once('=').unwrap())
                .map(|(key, value)| (key.into(), value.into()));
            marks.push((number, line.starts_with("#-"), rule, keys.collect()));
        } else if line.starts_with('(') {
            number += 1;
            writeln!(frames, "{line}").unwrap();
        }
    }
    options.bus_file = BusFile::parse(&bus_file).unwrap_or_else(|error| panic!("{name}: {error}"));
    for (profile, rule, key, value) in options.bus_file.device_tolerances() {
        catalogue.set_tolerance(profile, rule, key, value);
    }
    for given in given {
        option(given, &mut options, &mut catalogue);
    }
    for (bus, node, profile) in options.bus_file.devices() {
        let device = catalogue.device(&profile.text).unwrap();
        let bus = bus.map(Into::into);
        options.assignments.push(Assignment { bus, node, device, by: AssignedBy::BusFile });
    }
    options.catalogue = Arc::new(catalogue);
    let setup = RuleSetup::new(&options.bus_file, &bus_file, Some("2026-06-01".into()));
    let setup = setup.unwrap_or_else(|error| panic!("{name}: {error}"));
    Annotated { name, frames, options, bus_text: bus_file, setup, marks }
}

fn option(text: &str, options: &mut SessionOptions, catalogue: &mut Catalogue) {
    match text.split_whitespace().collect::<Vec<_>>()[..] {
        ["--node", given] => {
            let (node, profile) = given.split_once('=').unwrap();
            let device = catalogue.device(profile).unwrap();
            let node = node.parse().unwrap();
            options.assignments.push(Assignment { bus: None, node, device, by: AssignedBy::Option });
        }
        ["--dbc", file] => {
            let text = fs::read(workspace().join("fixtures").join(file)).unwrap();
            let mut database = Database::default();
            database.add_file(dbc::parse_database(&text).unwrap());
            options.database = Arc::new(database);
        }
        ["--protocol", "canopen"] => options.protocol = ProtocolChoice::Canopen,
        _ => panic!("no option of a fixture: {text}"),
    }
}

/// A setup without any settings.
pub fn plain_setup() -> RuleSetup {
    RuleSetup::new(&BusFile::default(), "", None).unwrap()
}

/// Events of findings with the number of the frame that caused them, and all findings.
pub fn judge(
    frames: &str,
    options: &SessionOptions,
    setup: RuleSetup,
) -> (Vec<(u64, Event)>, CaptureFindings) {
    judge_capture(frames.as_bytes(), options, setup)
}

/// The only finding of node 5 by its EMCY 8100: text, time and duration in ms, and its first frame.
fn emcy_8100(frames: &str) -> (String, i64, i64, u64) {
    let findings = judge(frames, &SessionOptions::default(), plain_setup()).1;
    let all: Vec<_> = findings.groups.iter().filter(|group| *group.rule == *"emcy-raised").collect();
    let [group] = all.as_slice() else { panic!("{} findings", all.len()) };
    let at = group.first[0];
    (group.text.clone(), at.time.unwrap().0 / 1_000_000, group.lasted.unwrap() / 1_000_000, at.frames.first)
}

#[test]
fn an_emcy_at_power_on_is_one_within_5_s_of_the_boot() {
    let plain = "EMCY 8100 communication";
    // 0.310 s after the boot-up, in pre-operational until the end at 9 s.
    let at_boot = "(0.000000) can0 705#00\n(0.100000) can0 705#7F\n(0.310000) can0 085#0081110000000000\n\
                   (0.400000) can0 705#7F\n(9.000000) can0 705#7F\n";
    let late = format!("{plain}; reported at power-on, not cleared within 5 s");
    assert_eq!(emcy_8100(at_boot), (late, 310, 8690, 3));
    // 100.31 s after the boot-up, or after the first heartbeat of a capture without it.
    for first in ["00", "7F"] {
        let frames = format!(
            "(0.000000) can0 705#{first}\n(0.100000) can0 705#7F\n(100.300000) can0 705#7F\n\
             (100.310000) can0 085#0081110000000000\n(100.400000) can0 705#7F\n(101.000000) can0 705#7F\n"
        );
        assert_eq!(emcy_8100(&frames), (plain.to_owned(), 100_310, 690, 4));
    }
    // Operational 0.29 s after its EMCY.
    let started = at_boot.replace("(0.400000) can0 705#7F", "(0.600000) can0 705#05");
    let until = format!("{plain}; reported before the node was operational, not cleared since");
    assert_eq!(emcy_8100(&started), (until, 310, 8690, 3));
}

/// Like [`judge`], for a capture in any format.
pub fn judge_capture(
    capture: &[u8],
    options: &SessionOptions,
    setup: RuleSetup,
) -> (Vec<(u64, Event)>, CaptureFindings) {
    let mut reader = CaptureReader::open(capture, &ReadOptions::default()).unwrap();
    let mut reading = Reading::of_options(options.clone(), Some(Arc::new(setup)), FindingNewsList::default());
    let mut batch = Batch::new();
    while reader.read(&mut batch).unwrap() {
        reading.take(&batch, reader.buses());
    }
    reading.close(reader.buses());
    let summary = reading.finish();
    (summary.part.news, summary.findings)
}

/// Events about findings, each with the number of the frame that it follows.
#[derive(Default)]
struct FindingNewsList {
    news: Vec<(u64, Event)>,
    number: u64,
}

impl ReadingPart for FindingNewsList {
    fn event(&mut self, _event: &Event, _bus: &Bus) {}

    fn finding(&mut self, event: &Event, _bus: &Bus) {
        self.news.push((self.number, event.clone()));
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Each
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) {
        self.number = frame.number;
    }
}

/// Keys of a finding that a mark may contain.
fn keys(event: &Event) -> (bool, String, BTreeMap<String, String>) {
    let (EventKind::FindingOpened(news) | EventKind::FindingClosed(news)) = &event.kind else {
        panic!("no finding")
    };
    let about = news.object.map(|object| object.to_string());
    let about = about.or(news.pgn.map(|pgn| format!("pgn:{pgn}"))).or(news.about.clone());
    let mut keys = BTreeMap::new();
    keys.insert("node".to_owned(), event.node.map_or_else(|| "-".to_owned(), |node| node.to_string()));
    keys.insert("severity".to_owned(), news.severity.name().to_owned());
    keys.insert("about".to_owned(), about.unwrap_or_else(|| "-".to_owned()).replace(' ', "_"));
    keys.insert("count".to_owned(), news.count.to_string());
    keys.insert("frames".to_owned(), format!("{}-{}", event.frames.first, event.frames.last));
    (matches!(event.kind, EventKind::FindingClosed(_)), news.rule.to_string(), keys)
}

/// Whether a finding with this evidence counts with another one, whose rule is the value of `same`.
fn is_absorbed(
    findings: &CaptureFindings,
    number: u64,
    rule: &str,
    wanted: &BTreeMap<String, String>,
) -> bool {
    findings.groups.iter().any(|group| {
        let cause = match group.cause {
            Some(FindingCause::Group(id)) => findings.group_by_id(id).map(|cause| cause.rule.to_string()),
            _ => None,
        };
        let node = group.key.node.map(|node| node.to_string());
        group.is_absorbed
            && *group.rule == *rule
            && group.first_occurrence().frames.last <= number
            && cause.as_ref() == wanted.get("same")
            && node.as_ref() == wanted.get("node")
    })
}

/// Compares findings with marks: every mark needs its finding, every opening its mark; closings need no mark.
fn compare(capture: &Annotated, report: &mut String) {
    let (news, findings) = judge(&capture.frames, &capture.options, capture.setup.clone());
    let mut reported: Vec<_> = news.iter().map(|(number, event)| (*number, keys(event))).collect();
    let (absorbed, marks): (Vec<_>, Vec<_>) =
        capture.marks.iter().partition(|(_, _, _, wanted)| wanted.contains_key("same"));
    for (number, _, rule, wanted) in absorbed {
        if !is_absorbed(&findings, *number, rule, wanted) {
            writeln!(report, "{}: behind frame {number}: no absorbed {rule} {wanted:?}", capture.name)
                .unwrap();
        }
    }
    for (number, closes, rule, wanted) in marks {
        let found = reported.iter().position(|(at, (is_over, name, keys))| {
            at == number
                && is_over == closes
                && name == rule
                && wanted.iter().all(|(key, value)| keys.get(key) == Some(value))
        });
        match found {
            Some(place) => {
                reported.remove(place);
            }
            None => {
                writeln!(report, "{}: behind frame {number}: no {rule} {wanted:?}", capture.name).unwrap();
            }
        }
    }
    for (number, (is_over, rule, keys)) in reported.iter().filter(|(_, (is_over, ..))| !is_over) {
        writeln!(report, "{}: behind frame {number}: unmarked {rule} {keys:?} {is_over}", capture.name)
            .unwrap();
    }
}

/// All annotated captures.
pub fn captures() -> Vec<PathBuf> {
    let folders = [folder(), folder().join("devices")];
    let entries = folders.iter().flat_map(|folder| fs::read_dir(folder).unwrap());
    let mut all: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    all.retain(|path| path.extension().is_some_and(|extension| extension == "log"));
    all.sort();
    all
}

#[test]
fn findings_are_those_that_are_marked() {
    let mut report = String::new();
    for path in captures() {
        compare(&read(&path), &mut report);
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn every_rule_has_a_fixture_in_which_it_fires_and_others_in_which_it_is_silent() {
    let captures: Vec<_> = captures().iter().map(|path| read(path)).collect();
    let mut report = String::new();
    for rule in all_declarations() {
        let own = captures.iter().find(|capture| capture.name == format!("{}.log", rule.name));
        match own {
            None => writeln!(report, "fixtures/rules/{}.log is missing", rule.name).unwrap(),
            Some(own) if own.marks.iter().all(|(_, _, name, _)| name != rule.name) => {
                writeln!(report, "{}: the rule does not fire", own.name).unwrap();
            }
            Some(own) => {
                // The rule also passes in its own fixture, before or after the violation.
                let (_, findings) = judge(&own.frames, &own.options, own.setup.clone());
                let place = findings.rules.iter().position(|info| *info.name == *rule.name).unwrap();
                if findings.tallies[place].passed == 0 {
                    writeln!(report, "{}: the rule never passes", own.name).unwrap();
                }
            }
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

/// Rules of the bundled devices, by their names in the output.
pub fn device_rules() -> BTreeSet<String> {
    let catalogue = Catalogue::default();
    let mut names = BTreeSet::new();
    for id in catalogue.ids() {
        let device = catalogue.device(&id).unwrap();
        let variants = device.variants.iter().map(|variant| format!("{id}:{}", variant.id));
        let all = variants.map(|variant| catalogue.device(&variant).unwrap()).chain([Arc::clone(&device)]);
        names.extend(
            all.flat_map(|it| it.rules.iter().map(|rule| format!("{id}:{}", rule.name)).collect::<Vec<_>>()),
        );
    }
    names
}

#[test]
fn every_rule_of_a_device_fires_somewhere_and_passes_somewhere() {
    let (mut fired, mut passed) = (BTreeSet::new(), BTreeSet::new());
    for path in captures().iter().filter(|path| path.parent().unwrap().ends_with("devices")) {
        let capture = read(path);
        let (_, findings) = judge(&capture.frames, &capture.options, capture.setup.clone());
        for (rule, tally) in findings.rules.iter().zip(&findings.tallies) {
            if tally.failed > 0 {
                fired.insert(rule.name.to_string());
            }
            if tally.passed > 0 {
                passed.insert(rule.name.to_string());
            }
        }
    }
    let mut report = String::new();
    for name in device_rules() {
        if !fired.contains(&name) {
            writeln!(report, "{name} does not fire").unwrap();
        }
        if !passed.contains(&name) {
            writeln!(report, "{name} never passes").unwrap();
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn every_rule_explains_itself() {
    let mut report = String::new();
    for rule in all_declarations() {
        for heading in HEADINGS {
            if section_text(rule.explanation, heading).is_none_or(|text| text.trim().len() < 10) {
                writeln!(report, "{}: says nothing under {heading}", rule.name).unwrap();
            }
        }
        if rule.needs.is_empty() {
            writeln!(report, "{}: needs nothing", rule.name).unwrap();
        }
        if rule.word.is_empty() || rule.word.len() > 6 {
            writeln!(report, "{}: its word in lines has 1 to 6 letters", rule.name).unwrap();
        }
    }
    assert!(report.is_empty(), "\n{report}");
}
