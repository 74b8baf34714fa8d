//! A part of a capture, decoded with the bus file of the state before it, gives the events of the whole capture.
//!
//! A part starts where no transfer is open. These differences remain, because no bus file states them:
//!
//! - The first state, mode, bits and value of each device, set point and trouble code are reported as new.
//! - Silences that started before the part, and toggle bits of the frames before it, are unknown.
//! - Frames before the part have no number in it.
//! - Rules on orders, rates and intervals of frames start again.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cobscope_decoder::bus_file::{BaseFile, BusFile};
use cobscope_decoder::capture::{Batch, BusNames, CaptureReader, ReadOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{Frame, FrameFlags};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::rules::{RuleEngine, RuleSetup};
use cobscope_decoder::session::{AssignedBy, Assignment, Bus, BusSnapshot, SessionOptions};
use cobscope_decoder::sink::EventSink as _;
use cobscope_decoder::sink::jsonl::JsonlSink;
use serde_json::Value;

use crate::rules::plain_setup;
use crate::scene::{Expected, captures};
use crate::support::{corpus, is_readable, skip, workspace};
use crate::{devices, rules};

/// Maximum size of a capture of the corpus, in bytes.
const LARGEST: u64 = 1 << 20;

/// Maximum number of frames of a capture of the corpus.
const MOST_FRAMES: usize = 3_000;

/// Kinds of events that report a change since the last report, each with the keys of the reported values.
const CHANGES: [(&str, &[&str]); 8] = [
    ("device-state", &["node", "machine", "channel"]),
    ("bits-changed", &["node", "object"]),
    ("mode", &["node", "object"]),
    ("set-point", &["node", "object"]),
    ("dtc", &["node", "spn", "fmi", "action"]),
    ("guard-reply", &["node"]),
    ("sync", &["counter"]),
    ("bus-silent", &[]),
];

/// Fields with frames and times before the part, and origins.
const EARLIER: [&str; 10] = [
    "after",
    "boot",
    "byte_order_origin",
    "cause_frame",
    "deviation",
    "first_frame",
    "last_frame",
    "sign",
    "since",
    "usual",
];

/// Fields of a change of a device state that frames before the part contribute to.
const PATH: [&str; 8] = ["cause", "code", "control", "duration", "from", "leave", "path", "path_frames"];

/// Kinds of events that depend on frames long before the part: notes are printed once, procedures have started, and the
/// usual gaps of the bus are measured again.
const IGNORED: [&str; 3] = ["note", "procedure", "bus-silent"];

/// Captures about states that no bus file contains.
const OTHER_STATES: [&str; 17] = [
    // Node-ID changes.
    "identity-move",
    "lss_node_id",
    "node-id-unchanged",
    "pve_lss_node_id",
    "pve_uds_node_id",
    // Devices without an address.
    "cannot-claim",
    "nm_contention",
    // A reset of nodes that were never seen; EMCY right after a boot-up.
    "danfoss-pve-ci.services",
    "reset_all",
    // Toggle bits of guarding.
    "guard-toggle",
    // Silences across the start of the part.
    "command-gap-j1939",
    "nm_dm1",
    "nmt_heartbeat",
    // Fast packets of proprietary groups, and other parts of transfers.
    "fast_packet",
    "nmea2000/canboat__candumpSample3",
    "sdo-unrequested-response",
    "sdo_start_cut",
];

/// Frames of a capture with the names of its buses.
struct Frames {
    list: Vec<Frame>,
    names: BusNames,
}

impl Frames {
    fn of(bytes: &[u8]) -> Option<Self> {
        let mut reader = CaptureReader::open(bytes, &ReadOptions::default()).ok()?;
        let mut batch = Batch::new();
        let mut list = Vec::new();
        while let Ok(true) = reader.read(&mut batch) {
            list.extend_from_slice(batch.frames());
        }
        let names = reader.buses().clone();
        (list.len() > 4).then_some(Self { list, names })
    }
}

/// Events and findings of frames as JSON. Rules and decoder are separate, because the rules continue from part to part.
fn decoded(
    (decoder, engine): (&mut Decoder, &mut RuleEngine),
    frames: &[Frame],
    names: &BusNames,
) -> Vec<Value> {
    let mut all = Vec::new();
    let mut add = |event: &Event, bus: &Bus| {
        let mut line = Vec::new();
        JsonlSink::new(&mut line).write_event(event, bus);
        all.push(serde_json::from_slice(&line).unwrap());
    };
    for frame in frames {
        engine.on_frame(frame);
        decoder.push(frame, names, &mut |event: &Event, bus: &Bus| {
            add(event, bus);
            engine.on_event(event, bus, &mut add);
        });
    }
    all
}

fn number(event: &Value, place: usize) -> u64 {
    event["frames"][place].as_u64().unwrap_or(0)
}

/// First place from `start` on at which no event extends over the frames before and after.
fn quiet_place(events: &[Value], frames: &[Frame], start: usize) -> Option<usize> {
    (start..frames.len()).find(|place| {
        let first = frames[*place].number;
        // A guarding request may wait for its response.
        let is_open =
            place.checked_sub(1).is_some_and(|before| frames[before].flags.contains(FrameFlags::REMOTE));
        !is_open && !events.iter().any(|event| number(event, 0) < first && number(event, 1) >= first)
    })
}

/// Decoder for a part, with a bus file of the state before it.
fn decoder_of_part(whole: &Decoder, base: &str, options: &SessionOptions) -> Decoder {
    let base = BaseFile { text: base, rename: &str::to_owned };
    let text = BusSnapshot::snapshot_of(whole.buses()).bus_file_text(&base, "State before a part").unwrap();
    let bus_file = BusFile::parse(&text).unwrap();
    let assignments = bus_file.devices().map(|(bus, node, device)| Assignment {
        bus: bus.map(str::to_owned),
        node,
        device: options.catalogue.device(&device.text).unwrap(),
        by: AssignedBy::BusFile,
    });
    let part = SessionOptions {
        assignments: assignments.collect(),
        bus_file,
        catalogue: Arc::clone(&options.catalogue),
        protocol: options.protocol,
        database: Arc::clone(&options.database),
        ..SessionOptions::default()
    };
    Decoder::new(part)
}

/// Whether the protocol of each bus is known.
fn is_settled(whole: &Decoder) -> bool {
    BusSnapshot::snapshot_of(whole.buses()).buses.iter().all(|(_, settings)| settings.protocol.is_some())
}

/// Subject of an event that reports a change; `None` for other events.
fn subject(event: &Value) -> Option<String> {
    let kind = event["kind"].as_str()?;
    let (_, keys) = CHANGES.iter().find(|(known, _)| *known == kind)?;
    Some(keys.iter().fold(kind.to_owned(), |text, key| format!("{text} {}", event[*key])))
}

/// Events that must be equal: from the first report of each change in the part on.
fn comparable(
    events: &[Value],
    known: &mut BTreeSet<String>,
    firsts: Option<&[(String, u64)]>,
    cut: u64,
) -> Vec<String> {
    let mut lines = Vec::new();
    for event in events {
        let is_given = event["kind"] == "nmt-state" && event["cause"] == "bus-file";
        let is_earlier = is_given || number(event, 1) < cut || event.get("cut").is_some();
        if is_earlier || IGNORED.iter().any(|kind| event["kind"] == *kind) {
            continue;
        }
        if let Some(subject) = subject(event) {
            let is_first = match firsts {
                Some(firsts) => firsts
                    .iter()
                    .find(|(known, _)| *known == subject)
                    .is_none_or(|(_, frame)| number(event, 1) <= *frame),
                None => known.insert(subject),
            };
            if is_first {
                continue;
            }
        }
        let last = event["last_frame"].as_u64().unwrap_or(u64::MAX);
        if last < cut {
            continue;
        }
        let mut event = event.clone();
        let kind = event["kind"].as_str().unwrap_or_default().to_owned();
        if kind == "finding-closed" {
            continue;
        }
        if kind == "finding-opened" {
            let (rule, node) = (&event["rule"], &event["node"]);
            lines.push(format!("{FINDING}{rule} of {node} in frame {}", number(&event, 1)));
            continue;
        }
        let is_state = event["kind"] == "device-state";
        let fields = event.as_object_mut().unwrap();
        fields.retain(|key, value| {
            // Long values are not in the bus file.
            let is_left_out =
                key == "from" && (value.is_null() || value.as_str().is_some_and(|text| text.len() > 512));
            let is_of_path = is_state && PATH.contains(&key.as_str());
            !is_left_out && !is_of_path && !EARLIER.contains(&key.as_str())
        });
        lines.push(event.to_string());
    }
    lines
}

/// Start of the line of a finding.
const FINDING: &str = "finding ";

/// Numbers of equal events and findings, and all that differ.
#[derive(Default)]
struct Comparison {
    events: usize,
    findings: usize,
    other_events: String,
    other_findings: Vec<String>,
}

impl Comparison {
    fn add(&mut self, place: &str, line: &str, is_equal: bool) {
        match (line.starts_with(FINDING), is_equal) {
            (true, true) => self.findings += 1,
            (true, false) => self.other_findings.push(format!("{place}{line}")),
            (false, true) => self.events += 1,
            (false, false) => writeln!(self.other_events, "{place}{line}").unwrap(),
        }
    }

    /// Requires equal events, at least these numbers of them, and at most one of `most_others` findings that differs.
    fn assert(&self, (events, findings): (usize, usize), most_others: usize) {
        assert!(self.other_events.is_empty(), "\n{}", self.other_events);
        assert!(self.events >= events && self.findings >= findings, "{} {}", self.events, self.findings);
        let others = self.other_findings.len();
        let text = self.other_findings.join("\n");
        assert!(others * most_others <= self.findings, "{others} of {}\n{text}", self.findings);
    }
}

/// A capture with its options.
struct Case<'a> {
    name: &'a str,
    frames: &'a Frames,
    base: &'a str,
    options: &'a SessionOptions,
    setup: &'a dyn Fn() -> RuleSetup,
}

impl Case<'_> {
    fn engine(&self) -> RuleEngine {
        RuleEngine::new(Arc::new((self.setup)()))
    }

    /// Compares parts with the whole capture.
    fn compare(&self, result: &mut Comparison) {
        let Self { name, frames: Frames { list, names }, base, options, .. } = self;
        if OTHER_STATES.iter().any(|known| name.starts_with(known)) {
            return;
        }
        let mut whole = Decoder::new((*options).clone());
        let all = decoded((&mut whole, &mut self.engine()), list, names);
        for quarter in 1..4 {
            let Some(cut) = quiet_place(&all, list, list.len() * quarter / 4) else { continue };
            let (mut whole, mut engine) = (Decoder::new((*options).clone()), self.engine());
            let (before, after) = list.split_at(cut);
            decoded((&mut whole, &mut engine), before, names);
            // Without a settled protocol, the evidence starts again.
            if !is_settled(&whole) {
                continue;
            }
            let mut part = decoder_of_part(&whole, base, options);
            let wanted = decoded((&mut whole, &mut engine), after, names);
            let found = decoded((&mut part, &mut self.engine()), after, names);
            let first = after.first().map_or(0, |frame| frame.number);
            let firsts: Vec<_> =
                found.iter().filter_map(|event| Some((subject(event)?, number(event, 1)))).collect();
            let mut rest = comparable(&found, &mut BTreeSet::new(), None, first);
            let wanted = comparable(&wanted, &mut BTreeSet::new(), Some(&firsts), first);
            for line in wanted {
                let at = rest.iter().position(|one| *one == line);
                at.map(|at| rest.remove(at));
                result.add(&format!("- {name} {first}: "), &line, at.is_some());
            }
            for line in rest {
                result.add(&format!("+ {name} {first}: "), &line, false);
            }
        }
    }
}

#[test]
fn fixtures() {
    let catalogue = Catalogue::default();
    let mut result = Comparison::default();
    for name in captures("devices") {
        let expected = Expected::read(&name.with_extension("expected.txt"));
        let options = devices::options(&name, &expected, &catalogue);
        let base = fs::read_to_string(name.with_extension("bus.toml")).unwrap_or_default();
        let frames = Frames::of(&fs::read(name.with_extension("log")).unwrap()).unwrap();
        let name = &name.file_name().unwrap().to_string_lossy();
        let case = Case { name, frames: &frames, base: &base, options: &options, setup: &plain_setup };
        case.compare(&mut result);
    }
    for folder in ["canopen", "j1939", "uds", "rules", "rules/devices", "stories"] {
        for path in logs(&workspace().join("fixtures").join(folder)) {
            let annotated = rules::read(&path);
            let Some(frames) = Frames::of(annotated.frames.as_bytes()) else { continue };
            let case = Case {
                name: &path.file_name().unwrap().to_string_lossy(),
                frames: &frames,
                base: &annotated.bus_text,
                options: &annotated.options,
                setup: &|| rules::read(&path).setup,
            };
            case.compare(&mut result);
        }
    }
    result.assert((20_000, 1_000), 5);
}

#[test]
fn long_values_are_omitted_with_a_comment() {
    let capture = fs::read(workspace().join("fixtures/canopen/sdo_block_download.log")).unwrap();
    let frames = Frames::of(&capture).unwrap();
    let mut whole = Decoder::new(SessionOptions::default());
    decoded((&mut whole, &mut RuleEngine::new(Arc::new(plain_setup()))), &frames.list[..195], &frames.names);
    let base = BaseFile { text: "", rename: &str::to_owned };
    let text = BusSnapshot::snapshot_of(whole.buses()).bus_file_text(&base, "State\n[node.9]").unwrap();
    assert!(text.starts_with("# State [node.9]\n"), "{text}");
    assert!(text.contains("\n# omitted: can0 node 2/02 2010:00, 889 bytes (limit 256)\n"), "{text}");
    assert!(!text.contains("object = \"2010:00\""), "{text}");
    BusFile::parse(&text).unwrap();
}

#[test]
fn captures_of_the_corpus() {
    if !corpus().exists() {
        return skip("corpus", "no captures for parts");
    }
    let mut result = Comparison::default();
    for path in all_files(&corpus()) {
        if !is_readable(&path.to_string_lossy()) || fs::metadata(&path).unwrap().len() > LARGEST {
            continue;
        }
        let frames = Frames::of(&fs::read(&path).unwrap());
        let Some(frames) = frames.filter(|frames| frames.list.len() <= MOST_FRAMES) else { continue };
        let name = &path.strip_prefix(corpus()).unwrap().to_string_lossy();
        let options = SessionOptions::default();
        let case = Case { name, frames: &frames, base: "", options: &options, setup: &plain_setup };
        case.compare(&mut result);
    }
    result.assert((6_000, 15), 5);
}

fn all_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { found.extend(all_files(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

fn logs(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    all.retain(|path| path.extension().is_some_and(|extension| extension == "log"));
    all.sort();
    all
}
