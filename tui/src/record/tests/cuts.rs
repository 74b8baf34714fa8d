//! Tests of captures around triggers.

use std::sync::mpsc::{Receiver, channel};

use cobscope_decoder::wire::NodeId;
use proptest::prelude::*;

use super::*;
use crate::record::backend::Backend as _;
use crate::record::cuts::{CutNews, CutOptions, CutWriter, RefusalReason, StateFollower, StateText};
use crate::record::trigger::Trigger;
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
        let maker = Box::new(move || Box::new(disk.clone()) as Box<dyn Disk>);
        let writer = CutWriter::open(maker, options, state, sender, day()).unwrap();
        Self { memory, writer, news, frames: 0, now: Instant::now() }
    }

    fn take(&mut self, what: RecordItem) {
        self.writer.take(vec![Item { bus: 0, what }], &can0(), Some(self.now));
    }

    /// The next frame, `milliseconds` after the start.
    fn frame(&mut self, milliseconds: i64) {
        self.frames += 1;
        let number = self.frames;
        self.take(RecordItem::Frame(Frame {
            number: number.into(),
            time: Some(at(milliseconds)),
            ..Frame::data_frame(CanId::standard(0x185), &number.to_le_bytes())
        }));
    }

    /// A heartbeat of node 5 as the next frame.
    fn heartbeat(&mut self, milliseconds: i64) {
        self.frames += 1;
        let frame = Frame::data_frame(CanId::standard(0x705), &[5]);
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
        self.take(RecordItem::Trigger(Box::new(Trigger {
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
        self.writer.finish(&can0());
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
fn the_bus_file_has_the_state_before_the_first_frame() {
    let mut bench = Bench::with_state(Memory::new(usize::MAX), options(1_000, 0));
    // For an hour, so that most frames have left the ring.
    for second in 0..3_600 {
        bench.heartbeat(second * 1_000);
    }
    // Triggered by frame 3,601 at 3,600 s; the window starts with frame 3,600 at 3,599 s.
    bench.trigger(3_600_000, 3_601);
    bench.heartbeat(3_600_000);
    let name = bench.memory.names()[0].replace("pcapng", "toml");
    let title = format!("State before the first frame of {}", name.replace("toml", "pcapng"));
    assert_eq!(bench.bus_files(), [format!("# {name} {title}\n3599\n")]);
    // An earlier cause, of frame 3,571: the capture starts with frame 3,570.
    bench.trigger(3_600_000, 3_571);
    bench.heartbeat(3_600_000);
    assert_eq!(bench.bus_files(), [format!("# {name} {title}\n3569\n")]);
    bench.heartbeat(3_602_000);
    let complete = bench.complete();
    assert_eq!(complete[0].bus_file.as_deref(), Some(Path::new(&name)));
    assert_eq!(complete[0].frames, 33);
    // At the start of the recording there is no state.
    let mut bench = Bench::with_state(Memory::new(usize::MAX), options(1_000, 0));
    bench.trigger(0, 1);
    bench.heartbeat(0);
    assert!(bench.bus_files()[0].ends_with("\n0\n"), "{:?}", bench.bus_files());
}

#[test]
fn a_bus_file_that_cannot_be_written_is_a_failure() {
    // Room for the header of the capture only.
    let memory = Memory::new(28);
    let mut bench = Bench::with_state(memory.clone(), options(1_000, 0));
    bench.trigger(0, 1);
    bench.heartbeat(0);
    let failure = bench.writer.status().other_failure.clone().unwrap();
    assert!(failure.path.to_str().unwrap().ends_with("_node2_emcy.toml"), "{failure:?}");
    memory.set(|inner| inner.room = 10_000);
    let status = bench.finish();
    assert!(status.is_incomplete());
    assert!(memory.names().iter().all(|name| name.ends_with(".pcapng")), "{:?}", memory.names());
    assert_eq!(bench.complete()[0].bus_file, None);
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

#[test]
fn a_full_ring_is_reported() {
    let mut bench = Bench::new(CutOptions { ring_bytes: 1 << 20, ..options(30_000, 0) });
    for milliseconds in 0..20_000 {
        bench.frame(milliseconds);
    }
    bench.fault(20_000);
    let first = bench.files()[0][0];
    let Some(CutNews::Triggered { late, .. }) = bench.news.try_iter().next() else { panic!() };
    // The window starts 10 s before frame 1, the file at frame `first`.
    assert_eq!(late, (i64::from(first) - 1 + 10_000) * 1_000_000);
    assert!(first > 10_000, "{first}");
}

#[test]
fn the_number_of_files_is_limited() {
    let mut bench = Bench::new(CutOptions { files: 2, ..options(100, 100) });
    for fault in 0..4 {
        bench.fault(fault * 10_000);
    }
    bench.finish();
    assert_eq!(bench.files(), [[1], [2]]);
    let refused = |news: &CutNews| matches!(news, CutNews::Refused { reason: RefusalReason::Files, .. });
    assert_eq!(bench.news.try_iter().filter(refused).count(), 2);
}

#[test]
fn the_size_of_all_files_is_limited() {
    let limit = 10_000;
    let mut bench = Bench::new(CutOptions { bytes: limit, ..options(100, 60_000) });
    bench.fault(0);
    for milliseconds in 1..1_000 {
        bench.frame(milliseconds);
    }
    let complete = bench.complete();
    assert_eq!(complete.len(), 1);
    assert_eq!(complete[0].end, CutEnd::Bytes);
    // Frames arrive one by one here, so that it is exceeded by one frame at most.
    assert!(complete[0].bytes >= limit && complete[0].bytes < limit + 100, "{}", complete[0].bytes);
    assert_eq!(complete[0].bytes, bench.memory.bytes(&bench.memory.names()[0]).len() as u64);
    bench.fault(1_000);
    let refused = |news: &CutNews| matches!(news, CutNews::Refused { reason: RefusalReason::Bytes, .. });
    assert!(bench.news.try_iter().any(|news| refused(&news)));
    assert_eq!(bench.memory.names().len(), 1);
}

#[test]
fn a_full_disk_is_tried_again_and_missing_frames_are_counted() {
    let memory = Memory::new(0);
    let mut bench = Bench::on(memory.clone(), options(1_000, 60_000));
    bench.frame(0);
    bench.fault(1);
    assert!(memory.names().is_empty());
    assert!(bench.writer.status().failure.as_ref().unwrap().reason.contains("No space left"));
    // The frames wait in the ring until there is room.
    memory.set(|inner| inner.room = 100_000);
    bench.now += RETRY_AFTER;
    bench.frame(2);
    assert_eq!(bench.files(), [[1, 2, 3]]);
    memory.set(|inner| inner.room = 0);
    (3..13).for_each(|milliseconds| bench.frame(milliseconds));
    let status = bench.finish();
    assert_eq!((status.frames, status.missing), (3, 10));
    assert!(status.is_incomplete());
    assert!(status.remarks()[0].contains("No space left on device (os error 28): 10 frames not written"));

    // Never any room: all frames of the window are missing.
    let mut bench = Bench::on(Memory::new(0), options(1_000, 60_000));
    bench.fault(0);
    bench.frame(1);
    let status = bench.finish();
    assert_eq!((status.frames, status.missing), (0, 2));
    assert!(status.remarks()[0].contains("2 frames not written"), "{:?}", status.remarks());
}

#[test]
fn a_replacement_that_fails_leaves_the_file() {
    let memory = Memory::new(usize::MAX / 2);
    let mut bench = Bench::on(memory.clone(), options(1_000, 10_000));
    for milliseconds in (0..5_000).step_by(100) {
        bench.frame(milliseconds);
    }
    bench.fault(5_000);
    memory.set(|inner| inner.room = 200);
    bench.trigger(5_100, 11);
    bench.frame(5_100);
    assert_eq!(memory.names().len(), 1);
    // Room for the last frame remains.
    assert_eq!(bench.files(), [(41..=52).collect::<Vec<_>>()]);
    let late = bench.news.try_iter().filter_map(|news| match news {
        CutNews::Triggered { late, .. } => Some(late),
        _ => None,
    });
    // 1.0 s minus 1.0 s instead of 5.0 s minus 1.0 s.
    assert_eq!(late.collect::<Vec<_>>(), [0, 4 * SECOND]);
}

#[test]
fn files_are_never_overwritten() {
    let mut bench = Bench::new(options(10, 10));
    bench.fault(0);
    // The same millisecond again, after a clock was set back.
    bench.frame(5_000);
    bench.fault(0);
    bench.finish();
    let names = bench.memory.names();
    assert_eq!(names.len(), 2, "{names:?}");
    assert!(names.iter().any(|name| name.ends_with("_node2_emcy-2.pcapng")), "{names:?}");
    let mut files = bench.files();
    files.sort();
    assert_eq!(files, [vec![1], vec![2, 3]]);
}

#[test]
fn a_ring_on_disk_is_limited_and_removed_at_the_end() {
    let ring = CutOptions { ring_files: Some(1 << 20), ..options(100, 100) };
    let mut bench = Bench::new(ring);
    for milliseconds in 0..40_000 {
        bench.frame(milliseconds);
    }
    let names = bench.memory.names();
    assert!((8..=9).contains(&names.len()), "{names:?}");
    assert!(names.iter().all(|name| name.starts_with("ring-2026-11-22_073051-00")), "{names:?}");
    let size: usize = names.iter().map(|name| bench.memory.bytes(name).len()).sum();
    assert!(size <= 9 << 17, "{size}");
    // All frames up to the last one.
    let all = bench.files().concat();
    assert_eq!(all.last(), Some(&40_000));
    assert!(all.is_sorted() && all.len() > 15_000, "{}", all.len());
    bench.fault(40_000);
    bench.finish();
    assert_eq!(bench.memory.names().len(), 1, "only the capture remains");
}

/// The ring in memory does not reach from one window to the next.
#[test]
fn windows_with_a_gap_between_them_are_separate_files() {
    let small = CutOptions { ring_bytes: 1, ..options(100_000, 0) };
    let mut bench = Bench::new(small);
    bench.fault(0);
    (1..=50).for_each(|second| bench.frame(second * 1_000));
    bench.fault(50_500);
    assert_eq!(bench.files().len(), 2);
    let late: Vec<_> = bench
        .news
        .try_iter()
        .filter_map(|news| match news {
            CutNews::Triggered { late, .. } => Some(late),
            _ => None,
        })
        .collect();
    // The second window starts 49.5 s before frame 1; its file at frame 51, at 50 s.
    assert_eq!(bench.files(), [vec![1], vec![51, 52]]);
    assert_eq!(late, [0, 99_500_000_000]);
}

#[test]
fn a_window_reaches_back_into_the_ring_on_disk() {
    // 500 s before; one file has 64 KiB, about 1,365 frames. Memory has about 9,000 frames.
    let ring = CutOptions { ring_files: Some(8 << 16), ring_bytes: 1 << 20, ..options(500_000, 0) };
    let mut bench = Bench::with_state(Memory::new(usize::MAX), ring);
    for second in 0..10_000 {
        bench.heartbeat(second * 100);
    }
    bench.trigger(1_000_000, 10_001);
    bench.heartbeat(1_000_000);
    let name = bench.memory.names().into_iter().find(|name| name.ends_with("_node2_emcy.pcapng")).unwrap();
    // 500 s are 5,000 frames; both bounds are inclusive: frames 5,001 to 10,001.
    let (bytes, state) = (bench.memory.bytes(&name), bench.bus_files());
    let written = frames(&read(&bytes));
    assert_eq!(written.len(), 5_001);
    let times: Vec<_> = written.iter().map(|frame| frame.time.unwrap()).collect();
    assert_eq!(times, (5_000..=10_000).map(|tenth| at(tenth * 100)).collect::<Vec<_>>());
    assert!(state[0].ends_with("\n5000\n"), "{state:?}");
    let Some(CutNews::Triggered { late, .. }) = bench.news.try_iter().next() else { panic!() };
    assert_eq!(late, 0);
    // At the first frame, and at that of the trigger.
    assert_eq!(comments(&bytes).len(), 2);
}

#[test]
fn a_full_ring_on_disk_is_reported() {
    // Neither memory nor files have 10,000 s.
    let ring = CutOptions { ring_files: Some(8 << 16), ring_bytes: 1 << 18, ..options(10_000_000, 0) };
    let mut bench = Bench::with_state(Memory::new(usize::MAX), ring);
    for second in 0..30_000 {
        bench.heartbeat(second * 100);
    }
    bench.trigger(3_000_000, 30_001);
    bench.heartbeat(3_000_000);
    let name = bench.memory.names().into_iter().find(|name| name.ends_with("_node2_emcy.pcapng")).unwrap();
    let written = frames(&read(&bench.memory.bytes(&name)));
    // 7 to 8 files of 1,365 frames, without a gap.
    assert!((9_000..11_000).contains(&written.len()), "{}", written.len());
    let first = written[0].time.unwrap();
    let times = written.iter().map(|frame| frame.time.unwrap().0 - first.0);
    assert!(times.eq((0..).map(|tenth| tenth * 100_000_000).take(written.len())));
    let Some(CutNews::Triggered { late, .. }) = bench.news.try_iter().next() else { panic!() };
    assert_eq!(late, first.0 - at(3_000_000 - 10_000_000).0);
    let state: u64 = bench.bus_files()[0].lines().last().unwrap().parse().unwrap();
    assert_eq!(state, 30_001 - written.len() as u64);
}

/// A frame: time since the one before in ms, and for a trigger how many frames earlier its first frame is.
type FrameStep = (i64, Option<u32>);

/// Frames of each capture by a filter of all frames.
fn expected_files(steps: &[FrameStep], before: i64, after: i64) -> Vec<Vec<u32>> {
    let times: Vec<i64> = steps
        .iter()
        .scan(0, |time, (step, _)| {
            *time += step;
            Some(*time)
        })
        .collect();
    let mut windows: Vec<(i64, i64)> = Vec::new();
    for (place, (_, trigger)) in steps.iter().enumerate() {
        let Some(earlier) = trigger else { continue };
        let first = place.saturating_sub(*earlier as usize);
        let (begin, end) = (times[first] - before, times[place] + after);
        let earlier_time = place.checked_sub(1).map_or(0, |place| times[place]);
        match windows.last_mut() {
            Some(last) if begin <= last.1 && earlier_time <= last.1 + before => {
                *last = (last.0.min(begin), last.1.max(end));
            }
            _ => windows.push((begin, end)),
        }
    }
    let within = |&(begin, end): &(i64, i64)| {
        (1..)
            .zip(&times)
            .filter(|(_, time)| (begin..=end).contains(*time))
            .map(|(number, _)| number)
            .collect()
    };
    windows.iter().map(within).collect()
}

/// Frames of each capture as written, in order of the captures.
fn written_files(steps: &[FrameStep], options: CutOptions) -> Vec<Vec<u32>> {
    let mut bench = Bench::new(options);
    let mut time = 0;
    for (step, trigger) in steps {
        time += step;
        if let Some(earlier) = trigger {
            let first = (bench.frames + 1).saturating_sub(*earlier).max(1);
            bench.trigger(time, first);
        }
        bench.frame(time);
    }
    bench.finish();
    let complete = bench.complete();
    complete.iter().map(|cut| bench.file(cut.paths[0].to_str().unwrap())).collect()
}

fn steps(longest: i64, most: usize) -> impl Strategy<Value = Vec<FrameStep>> {
    let trigger = prop_oneof![8 => Just(None), 1 => Just(Some(0)), 1 => (0_u32..20).prop_map(Some)];
    prop::collection::vec((0..longest, trigger), 1..most)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// With causes up to 20 frames earlier, within the reach of the ring.
    #[test]
    fn captures_are_a_filter_of_all_frames(
        steps in steps(300, 150), before in 0_u64..3_000, after in 0_u64..3_000,
    ) {
        let expected = expected_files(&steps, before.cast_signed(), after.cast_signed());
        prop_assert_eq!(written_files(&steps, options(before, after)), expected);
    }

    /// Over hours, while the ring loses its oldest frames.
    #[test]
    fn captures_of_long_runs_are_a_filter_of_all_frames(
        steps in steps(100_000, 150), before in 0_u64..100_000, after in 0_u64..100_000,
    ) {
        let own: Vec<FrameStep> = steps.iter().map(|(step, trigger)| (*step, trigger.map(|_| 0))).collect();
        let expected = expected_files(&own, before.cast_signed(), after.cast_signed());
        prop_assert_eq!(written_files(&own, options(before, after)), expected);
    }

    /// With a ring in memory that is too small, and a cause before it.
    #[test]
    fn captures_from_files_are_a_filter_of_all_frames(
        steps in steps(100_000, 150), before in 0_u64..500_000, after in 0_u64..100_000,
    ) {
        let own: Vec<FrameStep> = steps.iter().map(|(step, trigger)| (*step, trigger.map(|_| 0))).collect();
        let expected = expected_files(&own, before.cast_signed(), after.cast_signed());
        let small = CutOptions { ring_files: Some(1 << 20), ring_bytes: 1, ..options(before, after) };
        prop_assert_eq!(written_files(&own, small), expected);
    }

    /// Clocks that are set, hostile times, notices and triggers in any order.
    #[test]
    fn any_input_gives_files_without_duplicates(
        input in prop::collection::vec((0_u8..8, any_time(), 0_u64..200), 1..200),
        (before, after, ring) in (0_u64..5_000, 0_u64..5_000, any::<bool>()),
    ) {
        let ring_files = ring.then_some(1 << 20);
        let mut bench = Bench::new(CutOptions { ring_files, ring_bytes: 1 << 14, ..options(before, after) });
        for (kind, time, first) in input {
            let time = Timestamp(time);
            match kind {
                0 => bench.take(RecordItem::Notice(Notice::Quiet(time))),
                1 => bench.take(RecordItem::Notice(Notice::ClockSet { bus: BusIndex(0), time, step: time.0 / 2 })),
                2 => bench.take(RecordItem::Trigger(Box::new(Trigger {
                    bus: String::new(),
                    subject: String::new(),
                    node: None,
                    cause: "any".to_owned(),
                    text: String::new(),
                    time: Some(time),
                    first_frame: first,
                    last_frame: first,
                }))),
                _ => {
                    bench.frames += 1;
                    let frame = Frame::data_frame(CanId::standard(0x185), &bench.frames.to_le_bytes());
                    bench.take(RecordItem::Frame(Frame {
                        number: bench.frames.into(),
                        time: Some(time),
                        ..frame
                    }));
                }
            }
        }
        bench.finish();
        for numbers in bench.files() {
            prop_assert!(numbers.is_sorted_by(|one, next| one < next), "{:?}", numbers);
        }
    }
}

/// Times of one minute, or any.
fn any_time() -> impl Strategy<Value = i64> {
    prop_oneof![9 => (0_i64..60_000).prop_map(|milliseconds| at(milliseconds).0), 1 => any::<i64>()]
}
