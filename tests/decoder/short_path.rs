//! Frames without an event change no result: captures are decoded and judged with and without the short path.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cobscope_decoder::capture::{Batch, BatchItem, BusNames, CaptureReader, Notice, ReadOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::rules::{RuleEngine, RuleSetup};
use cobscope_decoder::session::{AssignedBy, Assignment, Bus, MessagePreview, Observer, SessionOptions};
use cobscope_decoder::statistics::Statistics;

use crate::machine::devices::{DEVICES, Devices};
use crate::machine::engine::Engine as J1939Machine;
use crate::machine::faults::Faulty;
use crate::machine::formats::Format;
use crate::machine::{Machine, Message, Options};
use crate::mutator::Dice;
use crate::rules::{plain_setup, read};
use crate::support::{corpus, is_readable, skip, workspace};

/// Frames of a generated capture.
const GENERATED: usize = 12_000;

/// Frames of a batch.
const BATCH: usize = 256;

/// Maximum size of a capture of the corpus, in bytes.
const LARGEST: u64 = 2 << 20;

/// Items of a capture, in order, and the names of its buses.
struct Recording {
    items: Vec<Result<Frame, Notice>>,
    names: BusNames,
}

impl Recording {
    /// Readable part of a capture; `None` if its format is unknown or it has no frames.
    fn of(capture: &[u8]) -> Option<Self> {
        let mut reader = CaptureReader::open(capture, &ReadOptions::default()).ok()?;
        let mut batch = Batch::new();
        let mut items = Vec::new();
        while let Ok(true) = reader.read(&mut batch) {
            items.extend(batch.items().map(|item| match item {
                BatchItem::Frame(frame) => Ok(*frame),
                BatchItem::Notice(notice) => Err(notice.clone()),
            }));
        }
        let names = reader.buses().clone();
        items.iter().any(Result::is_ok).then_some(Self { items, names })
    }

    /// Frames from a place up to the next notice, as many as a batch may have.
    fn frames(&self, place: usize) -> Vec<Frame> {
        self.items[place..].iter().map_while(|item| item.as_ref().ok().copied()).take(BATCH).collect()
    }

    fn push(&self, decoder: &mut Decoder, place: usize, out: &mut dyn Observer) {
        match &self.items[place] {
            Ok(frame) => decoder.push(frame, &self.names, out),
            Err(notice) => decoder.on_notice(notice, &self.names, out),
        }
    }
}

/// Runs the rules and keeps all events; with `takes_all` it needs the event of each frame.
struct Judging {
    engine: RuleEngine,
    takes_all: bool,
    events: Vec<(bool, String)>,
    skipped: usize,
}

impl Observer for Judging {
    fn on_event(&mut self, event: &Event, bus: &Bus) {
        let events = &mut self.events;
        keep(event, events);
        self.engine.on_event(event, bus, &mut |event: &Event, _: &Bus| keep(event, events));
    }

    fn needs_event(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.takes_all || self.engine.needs_event(preview, bus)
    }

    fn skip_event(&mut self, preview: &MessagePreview, bus: &Bus) -> bool {
        // Both answers must be the same.
        let is_needed = self.needs_event(preview, bus);
        let is_skipped = !self.takes_all && self.engine.skip_event(preview, bus);
        assert_eq!(is_skipped, !is_needed);
        self.skipped += usize::from(is_skipped);
        is_skipped
    }

    fn is_selective(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.engine.is_selective(preview, bus)
    }
}

/// Keeps an event, and whether its frame may have none.
fn keep(event: &Event, events: &mut Vec<(bool, String)>) {
    let may_be_missing = matches!(event.kind, EventKind::Pdo(_) | EventKind::J1939Message(_));
    events.push((may_be_missing, format!("{event:?}")));
}

/// Needs no event.
#[derive(Default)]
struct EventlessObserver(usize);

impl Observer for EventlessObserver {
    fn on_event(&mut self, _event: &Event, _bus: &Bus) {}

    fn needs_event(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        false
    }

    fn skip_event(&mut self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        self.0 += 1;
        true
    }
}

/// Events and findings of a recording, and the number of frames without an event.
fn judged(
    recording: &Recording,
    options: &SessionOptions,
    setup: RuleSetup,
    takes_all: bool,
) -> (Vec<(bool, String)>, String, usize) {
    let mut decoder = Decoder::new(options.clone());
    let engine = RuleEngine::new(Arc::new(setup));
    let mut judging = Judging { engine, takes_all, events: Vec::new(), skipped: 0 };
    // Frames are also counted in advance, as a command does with those of a batch.
    let mut counted = 0;
    for (place, item) in recording.items.iter().enumerate() {
        match item {
            Ok(frame) if takes_all => judging.engine.on_frame(frame),
            Ok(_) if counted == 0 => counted = judging.engine.on_frames(&recording.frames(place)),
            _ => {}
        }
        counted = counted.saturating_sub(usize::from(item.is_ok()));
        recording.push(&mut decoder, place, &mut judging);
    }
    decoder.finish_capture(&recording.names, &mut judging);
    let Judging { engine, mut events, skipped, .. } = judging;
    let findings =
        engine.finish_capture(decoder.buses(), &mut |event: &Event, _: &Bus| keep(event, &mut events));
    (events, format!("{findings:#?}"), skipped)
}

/// Checks that the short path changes neither events nor findings; frames without an event.
fn assert_same_verdicts(
    name: &str,
    recording: &Recording,
    options: &SessionOptions,
    setup: impl Fn() -> RuleSetup,
) -> usize {
    let (all, wanted, none) = judged(recording, options, setup(), true);
    let (some, found, skipped) = judged(recording, options, setup(), false);
    assert_eq!(none, 0);
    let differs = wanted.lines().zip(found.lines()).position(|(wanted, found)| wanted != found);
    assert_eq!(
        differs.map(|line| (wanted.lines().nth(line), found.lines().nth(line))),
        None,
        "{name}: findings"
    );
    let mut rest = some.iter().peekable();
    for event in &all {
        if rest.peek() == Some(&event) {
            rest.next();
        } else {
            assert!(event.0, "{name}: {} is missing; next is {:?}", event.1, rest.peek());
        }
    }
    assert_eq!(rest.next(), None, "{name}");
    assert_eq!(all.len() - some.len(), skipped, "{name}");
    skipped
}

/// Checks that the events after a frame do not depend on whether those before it were needed; frames without an event.
fn assert_same_continuation(
    name: &str,
    recording: &Recording,
    options: &SessionOptions,
    dice: &mut Dice,
) -> usize {
    let start = dice.roll(recording.items.len());
    let mut whole = Decoder::new(options.clone());
    let mut quiet = Decoder::new(options.clone());
    let mut eventless = EventlessObserver::default();
    for place in 0..start {
        recording.push(&mut whole, place, &mut |_: &Event, _: &Bus| {});
        recording.push(&mut quiet, place, &mut eventless);
    }
    let mut quiet = quiet.clone();
    let (mut wanted, mut found) = (Vec::new(), Vec::new());
    for place in start..recording.items.len() {
        recording.push(&mut whole, place, &mut |event: &Event, _: &Bus| wanted.push(format!("{event:?}")));
        recording.push(&mut quiet, place, &mut |event: &Event, _: &Bus| found.push(format!("{event:?}")));
        assert_eq!(found, wanted, "{name}, item {place}, quiet before {start}");
        wanted.clear();
        found.clear();
    }
    eventless.0
}

/// Counts frames and events; with `takes_all` it needs the event of each frame.
#[derive(Default)]
struct Counting {
    statistics: Statistics,
    takes_all: bool,
}

impl Observer for Counting {
    fn on_event(&mut self, event: &Event, _bus: &Bus) {
        self.statistics.count_event(event);
    }

    fn needs_event(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        self.takes_all
    }

    fn skip_event(&mut self, preview: &MessagePreview, bus: &Bus) -> bool {
        if !self.takes_all {
            self.statistics.skip_event(preview, bus);
        }
        !self.takes_all
    }
}

/// Checks that the short path changes no statistics.
fn assert_same_statistics(name: &str, recording: &Recording, options: &SessionOptions) {
    let [wanted, found] = [true, false].map(|takes_all| {
        let mut counting = Counting { takes_all, ..Counting::default() };
        let mut decoder = Decoder::new(options.clone());
        let mut counted = 0;
        for (place, item) in recording.items.iter().enumerate() {
            match item {
                Ok(frame) if takes_all => counting.statistics.count_frame(frame),
                Ok(_) if counted == 0 => {
                    let frames = recording.frames(place);
                    counting.statistics.count_frames(&frames);
                    counted = frames.len();
                }
                _ => {}
            }
            counted = counted.saturating_sub(usize::from(item.is_ok()));
            recording.push(&mut decoder, place, &mut counting);
        }
        decoder.finish_capture(&recording.names, &mut counting);
        counting.statistics.withdraw_canopen(decoder.buses());
        format!("{:#?}", counting.statistics)
    });
    // The place of the next search is not a result.
    let lines = |text: &str| {
        text.lines().filter(|line| !line.contains("next_pdo_id")).map(str::to_owned).collect::<Vec<_>>()
    };
    let (wanted, found) = (lines(&wanted), lines(&found));
    let differs = wanted.iter().zip(&found).find(|(wanted, found)| wanted != found);
    assert_eq!((differs, wanted.len()), (None, found.len()), "{name}: statistics");
}

fn generated(messages: impl Iterator<Item = Message>) -> Recording {
    let mut text = Vec::new();
    for message in messages.take(GENERATED) {
        Format::Candump.write(&message, &mut text).unwrap();
    }
    Recording::of(&text).unwrap()
}

fn with_devices() -> SessionOptions {
    let mut options = SessionOptions::default();
    for (node, profile) in DEVICES {
        let device = options.catalogue.device(profile).unwrap();
        let node = node.into();
        options.assignments.push(Assignment { bus: None, node, device, by: AssignedBy::Option });
    }
    options
}

/// Checks a generated capture; the share of frames without an event, judged and unobserved, in percent.
fn assert_generated(
    name: &str,
    recording: &Recording,
    options: &SessionOptions,
    seed: u64,
) -> (usize, usize) {
    let mut dice = Dice::new(seed);
    let judged = assert_same_verdicts(name, recording, options, plain_setup);
    assert_same_statistics(name, recording, options);
    let mut unobserved = 0;
    for _ in 0..4 {
        unobserved += assert_same_continuation(name, recording, options, &mut dice);
    }
    // Half of the frames precede the checkpoint, on average.
    (judged * 100 / GENERATED, unobserved * 100 / (2 * GENERATED))
}

#[test]
fn a_machine() {
    let machine = |seed, mapping| Machine::new(Options { seed, storm: false, mapping });
    let options = SessionOptions::default();
    let (judged, _) = assert_generated("machine", &generated(machine(1, false)), &options, 1);
    assert!(judged >= 50, "{judged} % of the frames took the short path");
    assert_generated("mapped machine", &generated(machine(2, true)), &options, 2);
}

#[test]
fn a_machine_with_faults() {
    for seed in 1..=4 {
        let options = Options { seed, storm: false, mapping: seed % 2 == 0 };
        let recording = generated(Faulty::new(Machine::new(options), seed));
        assert_generated("faults", &recording, &SessionOptions::default(), seed);
    }
}

#[test]
fn devices_with_profiles() {
    assert_generated("devices", &generated(Devices::new(1)), &with_devices(), 1);
    let faulty = generated(Faulty::new(Devices::new(2), 2));
    assert_generated("devices with faults", &faulty, &with_devices(), 2);
}

#[test]
fn j1939() {
    assert_generated("J1939", &generated(J1939Machine::new(1)), &SessionOptions::default(), 1);
    let faulty = generated(Faulty::new(J1939Machine::new(2), 2));
    assert_generated("J1939 with faults", &faulty, &SessionOptions::default(), 2);
}

#[test]
fn fixtures_of_rules() {
    let mut paths = Vec::new();
    for folder in ["rules", "stories", "diagnosis"] {
        files(&workspace().join("fixtures").join(folder), &mut paths);
    }
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "log"));
    assert!(paths.len() > 100);
    let mut dice = Dice::new(1);
    for path in &paths {
        let annotated = read(path);
        let Some(recording) = Recording::of(annotated.frames.as_bytes()) else { continue };
        let name = path.to_string_lossy();
        assert_same_verdicts(&name, &recording, &annotated.options, || read(path).setup);
        assert_same_continuation(&name, &recording, &annotated.options, &mut dice);
    }
}

#[test]
fn captures_of_the_corpus() {
    if !corpus().exists() {
        return skip("corpus", "no captures for the short path");
    }
    let mut paths = Vec::new();
    files(&corpus(), &mut paths);
    let mut dice = Dice::new(1);
    let mut count = 0;
    for path in paths {
        let name = path.to_string_lossy();
        let is_small = fs::metadata(&path).is_ok_and(|file| file.len() <= LARGEST);
        if !is_small || !is_readable(&name) {
            continue;
        }
        let Some(recording) = Recording::of(&fs::read(&path).unwrap()) else { continue };
        let options = SessionOptions::default();
        assert_same_verdicts(&name, &recording, &options, plain_setup);
        assert_same_statistics(&name, &recording, &options);
        assert_same_continuation(&name, &recording, &options, &mut dice);
        count += 1;
    }
    assert!(count > 50, "{count} captures");
}

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() { files(&path, found) } else { found.push(path) }
    }
}
