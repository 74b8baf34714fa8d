//! Tests of captures around triggers.

mod limits;
mod properties;
mod ring;

use std::sync::mpsc::{Receiver, channel};

use cobscope_decoder::wire::NodeId;

use super::*;
use crate::record::backend::RecorderBackend as _;
use crate::record::cuts::{CutNews, CutOptions, CutWriter, RefusalReason, StateFollower, StateText};
use crate::record::trigger::CaptureTrigger;
use crate::record::{CompleteCut, CutEnd};

const SECOND: i64 = 1_000_000_000;

/// Ring time 0 of the tests.
const START: i64 = 1_700_000_000 * SECOND;

fn options(before: u64, after: u64) -> CutOptions {
    CutOptions {
        folder: PathBuf::new(),
        before: Duration::from_millis(before),
        after: Duration::from_millis(after),
        ring_bytes: 64 << 20,
        ring_files: None,
        files: 100,
        bytes: 1 << 30,
    }
}

/// A writer on a disk in memory.
struct Bench {
    memory: Memory,
    writer: CutWriter,
    news: Receiver<CutNews>,
    frames: u32,
    now: Instant,
}

impl Bench {
    fn new(options: CutOptions) -> Self {
        Self::on(Memory::new(usize::MAX), options)
    }

    fn on(memory: Memory, options: CutOptions) -> Self {
        Self::with(memory, options, None)
    }

    /// A writer of captures with bus files, which contain the number of the last frame of node 5.
    fn with_state(memory: Memory, options: CutOptions) -> Self {
        let text: StateText = Box::new(|buses, path, title| {
            let node = buses.iter().next().and_then(|bus| bus.node(NodeId::Canopen(5)));
            let last = node.map_or(0, |node| node.last_seen().0);
            Ok(format!("# {} {title}\n{last}\n", path.display()))
        });
        Self::with(memory, options, Some(StateFollower::new(SessionOptions::default(), text)))
    }

    fn with(memory: Memory, options: CutOptions, state: Option<StateFollower>) -> Self {
        let (sender, news) = channel();
        let disk = memory.clone();
        let maker = Box::new(move || Box::new(disk.clone()) as Box<dyn RecordDisk>);
        let writer = CutWriter::open_writer(maker, options, state, sender, day()).unwrap();
        Self { memory, writer, news, frames: 0, now: Instant::now() }
    }

    fn take(&mut self, what: RecordItem) {
        self.writer.take_items(vec![PendingItem { bus: 0, what }], &can0(), Some(self.now));
    }

    /// The next frame, `milliseconds` after the start.
    fn frame(&mut self, milliseconds: i64) {
        self.frames += 1;
        let number = self.frames;
        self.take(RecordItem::Frame(Frame {
            number: number.into(),
            time: Some(at(milliseconds)),
            ..Frame::data_frame(CanId::from_standard(0x185), &number.to_le_bytes())
        }));
    }

    /// A heartbeat of node 5 as the next frame.
    fn heartbeat(&mut self, milliseconds: i64) {
        self.frames += 1;
        let frame = Frame::data_frame(CanId::from_standard(0x705), &[5]);
        let (number, time) = (self.frames.into(), Some(at(milliseconds)));
        self.take(RecordItem::Frame(Frame { number, time, ..frame }));
    }

    /// Bus files in order of their names.
    fn bus_files(&self) -> Vec<String> {
        let names = self
            .memory
            .names()
            .into_iter()
            .filter(|name| Path::new(name).extension().is_some_and(|it| it == "toml"));
        names.map(|name| String::from_utf8(self.memory.bytes(&name)).unwrap()).collect()
    }

    /// A trigger of the next frame, whose first frame is `first`.
    fn trigger(&mut self, milliseconds: i64, first: u32) {
        let last_frame = u64::from(self.frames) + 1;
        self.take(RecordItem::Trigger(Box::new(CaptureTrigger {
            bus: "can0".to_owned(),
            node: Some(NodeId::Canopen(2)),
            subject: "2/02".to_owned(),
            cause: "emcy".to_owned(),
            text: format!("8130 in frame {last_frame}"),
            time: Some(at(milliseconds)),
            first_frame: first.into(),
            last_frame,
        })));
    }

    /// A frame with a trigger.
    fn fault(&mut self, milliseconds: i64) {
        self.trigger(milliseconds, self.frames + 1);
        self.frame(milliseconds);
    }

    fn quiet(&mut self, milliseconds: i64) {
        self.take(RecordItem::Notice(Notice::Quiet(at(milliseconds))));
    }

    fn finish(&mut self) -> RecordStatus {
        self.writer.finish_recording(&can0());
        self.writer.status().clone()
    }

    /// Numbers of the frames in each file, in order of the names.
    fn files(&self) -> Vec<Vec<u32>> {
        self.memory.names().iter().map(|name| self.file(name)).collect()
    }

    fn file(&self, name: &str) -> Vec<u32> {
        let number = |frame: &Frame| u32::from_le_bytes(*frame.bytes.first_chunk().unwrap());
        frames(&read(&self.memory.bytes(name))).iter().map(number).collect()
    }

    fn complete(&self) -> Vec<CompleteCut> {
        let news = self.news.try_iter();
        news.filter_map(|news| if let CutNews::Complete(cut) = news { Some(cut) } else { None }).collect()
    }
}

fn at(milliseconds: i64) -> Timestamp {
    Timestamp(START + milliseconds * 1_000_000)
}

/// Comments of a pcapng file: all texts that start like one.
fn comments(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    let starts = text.match_indices("trigger ").map(|(at, _)| at);
    starts.map(|at| text[at..].split(['\0', '\n', '\u{1}']).next().unwrap().to_owned()).collect()
}

#[test]
fn a_capture_has_the_frames_of_its_window() {
    let mut bench = Bench::new(options(1_000, 500));
    for milliseconds in (0..5_000).step_by(100) {
        bench.frame(milliseconds);
    }
    // Frame 51. Both bounds are inclusive: 4.0 s is frame 41, 5.5 s is frame 56.
    bench.fault(5_000);
    for milliseconds in (5_100..10_000).step_by(100) {
        bench.frame(milliseconds);
    }
    // Complete since no later window can overlap: 5.5 s + 1.0 s.
    let complete = bench.complete();
    assert_eq!(complete.len(), 1);
    let CompleteCut { frames, missing, triggers, duration, end, .. } = complete[0];
    assert_eq!((frames, missing, triggers, duration), (16, 0, 1, 1_500_000_000));
    assert_eq!((end, complete[0].last_time), (CutEnd::Window, Some(at(5_500))));
    assert_eq!(bench.files(), [(41..=56).collect::<Vec<_>>()]);
    let names = bench.memory.names();
    assert!(names[0].ends_with("_node2_emcy.pcapng"), "{names:?}");
    // At the first frame, and at that of the trigger.
    let text = "trigger emcy: node 2/02: 8130 in frame 51";
    assert_eq!(comments(&bench.memory.bytes(&names[0])), [text, text]);
    let status = bench.finish();
    assert_eq!((status.parts, status.frames, status.missing), (1, 16, 0));
    assert!(!status.is_incomplete());
}

#[test]
fn overlapping_windows_become_one_file() {
    let mut bench = Bench::new(options(1_000, 500));
    for second in 0..20 {
        for tenth in 0..10 {
            let milliseconds = second * 1_000 + tenth * 100;
            // 5.0 to 5.5 s and 6.5 to 7.0 s touch at 5.5 s; 10 s is separate.
            if [5_000, 6_500, 10_000].contains(&milliseconds) {
                bench.fault(milliseconds);
            } else {
                bench.frame(milliseconds);
            }
        }
    }
    let triggers: Vec<u64> = bench.complete().iter().map(|cut| cut.triggers).collect();
    assert_eq!(triggers, [2, 1]);
    assert_eq!(bench.files(), [(41..=71).collect::<Vec<_>>(), (91..=106).collect()]);
    // A millisecond more between them, and they do not overlap.
    let mut bench = Bench::new(options(1_000, 500));
    for milliseconds in [4_900, 5_000, 5_500, 5_501, 6_501, 9_000] {
        if [5_000, 6_501].contains(&milliseconds) {
            bench.fault(milliseconds);
        } else {
            bench.frame(milliseconds);
        }
    }
    assert_eq!(bench.files(), [vec![1, 2, 3], vec![4, 5]]);
}

#[test]
fn before_counts_from_the_first_frame_of_the_finding() {
    let mut bench = Bench::new(options(1_000, 0));
    for milliseconds in (0..5_000).step_by(100) {
        bench.frame(milliseconds);
    }
    // Judged at 5.0 s; its first frame is number 31, at 3.0 s.
    bench.trigger(5_000, 31);
    bench.frame(5_000);
    bench.frame(7_000);
    assert_eq!(bench.files(), [(21..=51).collect::<Vec<_>>()]);
}

#[test]
fn an_earlier_cause_extends_the_file_to_the_front() {
    let mut bench = Bench::new(options(1_000, 1_000));
    for milliseconds in (0..5_000).step_by(100) {
        bench.frame(milliseconds);
    }
    bench.fault(5_000);
    let first = bench.memory.names();
    bench.frame(5_100);
    bench.trigger(5_200, 11);
    bench.frame(5_200);
    // The name stays; no other file remains.
    assert_eq!(bench.memory.names(), first);
    assert_eq!(bench.files(), [(1..=53).collect::<Vec<_>>()]);
    bench.frame(6_200);
    bench.frame(6_201);
    bench.frame(7_300);
    let complete = bench.complete();
    assert_eq!((complete.len(), complete[0].triggers, complete[0].frames), (1, 2, 54));
    assert_eq!(bench.files(), [(1..=54).collect::<Vec<_>>()]);
    assert_eq!(comments(&bench.memory.bytes(&first[0])).len(), 3);
}

#[test]
fn a_bus_that_falls_silent_completes_the_capture() {
    let mut bench = Bench::new(options(1_000, 1_000));
    bench.frame(0);
    bench.trigger(500, 1);
    bench.quiet(500);
    assert_eq!(bench.files(), [[1]]);
    // 0.5 s + 1.0 s + 1.0 s, and 10 s for delayed frames.
    bench.quiet(12_500);
    assert!(bench.complete().is_empty());
    bench.quiet(12_501);
    assert_eq!(bench.complete().len(), 1);
}

/// Text over a network stops for 8 s, then arrives with its own timestamps.
#[test]
fn delayed_frames_belong_to_the_window() {
    let mut bench = Bench::new(options(1_000, 1_000));
    bench.frame(0);
    bench.fault(500);
    (750..8_000).step_by(250).for_each(|milliseconds| bench.quiet(milliseconds));
    for milliseconds in [600, 1_500, 1_501] {
        bench.frame(milliseconds);
    }
    bench.fault(2_400);
    bench.finish();
    assert_eq!(bench.files(), [(1..=6).collect::<Vec<_>>()]);
}

#[test]
fn a_stop_writes_the_frames_so_far() {
    let mut bench = Bench::new(options(1_000, 10_000));
    bench.frame(0);
    bench.fault(100);
    bench.frame(200);
    bench.finish();
    let complete = bench.complete();
    assert_eq!((complete[0].end, complete[0].frames), (CutEnd::Stopped, 3));
    assert_eq!(complete[0].duration, 200_000_000);
    let mut bench = Bench::new(options(1_000, 100));
    bench.fault(0);
    bench.frame(101);
    bench.finish();
    assert_eq!(bench.complete()[0].end, CutEnd::Window);
}
