//! Tests with pipes and growing files.

use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::PathBuf;

use cobscope_decoder::capture::TimeStyle;
use cobscope_decoder::frame::{BusIndex, CanId, Frame, Timestamp};

use super::*;

/// Time limit, far longer than any step takes.
const LIMIT: Duration = Duration::from_secs(30);

/// Receives until there are `count` items.
fn receive(source: &mut dyn LiveSource, count: usize) -> Arrivals {
    let (begin, mut arrivals) = (Instant::now(), Arrivals::default());
    while arrivals.items.len() < count {
        assert!(begin.elapsed() < LIMIT, "{:?}", arrivals.items);
        source.receive_items(&mut arrivals, Duration::from_millis(100)).unwrap();
    }
    arrivals
}

/// Receives until the source ends.
fn end(source: &mut dyn LiveSource) -> SourceEnd {
    let mut arrivals = Arrivals::default();
    let begin = Instant::now();
    loop {
        assert!(begin.elapsed() < LIMIT);
        match source.receive_items(&mut arrivals, Duration::from_millis(100)) {
            Ok(()) => assert!(arrivals.items.is_empty(), "{arrivals:?}"),
            Err(ended) => return ended,
        }
    }
}

/// Asserts that nothing arrives during several checks of the file.
fn nothing(source: &mut dyn LiveSource) {
    let (begin, mut arrivals) = (Instant::now(), Arrivals::default());
    let wait = Duration::from_millis(200);
    source.receive_items(&mut arrivals, wait).unwrap();
    assert!(arrivals.items.is_empty(), "{arrivals:?}");
    assert!(begin.elapsed() >= wait);
}

fn frames(arrivals: &Arrivals) -> Vec<Frame> {
    let frame = |item: &Arrival| match item {
        Arrival::Frame(frame) => Some(*frame),
        Arrival::Notice(_) => None,
    };
    arrivals.items.iter().filter_map(frame).collect()
}

fn notices(arrivals: &Arrivals) -> Vec<String> {
    let notice = |item: &Arrival| match item {
        Arrival::Frame(_) => None,
        Arrival::Notice(notice) => Some(notice.to_string()),
    };
    arrivals.items.iter().filter_map(notice).collect()
}

/// A growing file and the source that follows it.
struct Followed {
    _folder: tempfile::TempDir,
    path: PathBuf,
    source: Box<dyn LiveSource>,
}

impl Followed {
    fn new(begin: Option<&str>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("growing.log");
        if let Some(begin) = begin {
            std::fs::write(&path, begin).unwrap();
        }
        let source = follow(&path, ReadOptions::default()).unwrap();
        Self { _folder: folder, path, source }
    }

    fn append(&self, text: &str) {
        OpenOptions::new().append(true).open(&self.path).unwrap().write_all(text.as_bytes()).unwrap();
    }
}

#[test]
fn a_pipe_gives_each_line_when_it_is_complete_and_ends_with_its_writer() {
    let (pipe, mut writer) = std::io::pipe().unwrap();
    let mut source = Lines::read(pipe, ReadOptions::default()).unwrap();
    nothing(&mut source);
    writer.write_all(b"(1700000000.000001) can1 701#05\n(1700000000.000002) can0 18A#0102\n(17000").unwrap();
    let arrivals = receive(&mut source, 2);
    assert_eq!(arrivals.names.names(), ["can1", "can0"]);
    let found = frames(&arrivals);
    assert_eq!((found[0].id, found[0].bus, found[0].data()), (CanId::Standard(0x701), BusIndex(0), &[5][..]));
    assert_eq!(found[0].time, Some(Timestamp(1_700_000_000_000_001_000)));
    assert_eq!((found[1].id, found[1].bus), (CanId::Standard(0x18A), BusIndex(1)));
    nothing(&mut source);
    writer
        .write_all(b"00001.000000) can1 8G#\n(1700000002.000000) can0 080#\n(1700000003.000000) can0 081#")
        .unwrap();
    let arrivals = receive(&mut source, 2);
    assert_eq!(frames(&arrivals).len(), 1);
    let [notice] = &notices(&arrivals)[..] else { panic!("{arrivals:?}") };
    assert!(notice.starts_with("line 3: expected an identifier of 1 to 8 hex digits"), "{notice}");
    assert_eq!(source.max_lag(), Duration::from_secs(1));
    // The rest of a pipe is a line, with or without a line end.
    drop(writer);
    assert_eq!(frames(&receive(&mut source, 1))[0].id, CanId::Standard(0x81));
    assert!(matches!(end(&mut source), SourceEnd::Complete));
    assert!(matches!(end(&mut source), SourceEnd::Complete));
    let status = source.bus_status();
    assert_eq!(status.iter().map(|bus| bus.name.as_str()).collect::<Vec<_>>(), ["can1", "can0"]);
    assert!(status.iter().all(|bus| bus.stamps == SourceClock::Recorded && bus.lost == 0));
}

#[test]
fn an_empty_pipe_is_complete_and_one_without_frames_has_failed() {
    let mut source = Lines::read(std::io::empty(), ReadOptions::default()).unwrap();
    assert!(matches!(end(&mut source), SourceEnd::Complete));
    let mut source = Lines::read(&b"candump: command not found\n"[..], ReadOptions::default()).unwrap();
    let SourceEnd::Failed(error) = end(&mut source) else { panic!("expected a failure") };
    let text = format!("{error:#}");
    assert!(text.starts_with("standard input: not a capture in a known format"), "{text}");
}

#[test]
fn a_receive_gives_a_bounded_number_and_all_of_them_come() {
    let line = |number: u32| format!("(1700000000.{number:06}) can0 {:03X}#\n", number % 0x800);
    let text = (0..20_000).map(line).collect::<Vec<_>>().concat();
    let mut source = Lines::read(std::io::Cursor::new(text), ReadOptions::default()).unwrap();
    let mut numbers = Vec::new();
    loop {
        let mut arrivals = Arrivals::default();
        if source.receive_items(&mut arrivals, LIMIT).is_err() {
            break;
        }
        assert!((1..=MOST).contains(&arrivals.items.len()), "{}", arrivals.items.len());
        numbers.extend(frames(&arrivals).iter().map(|frame| frame.time.unwrap().0 / 1_000 % 1_000_000));
    }
    assert_eq!(numbers, (0..20_000).collect::<Vec<_>>());
}

#[test]
fn losses_that_the_text_tells_are_counted_on_their_bus() {
    let text = b"(1700000000.000000) can0 001#\n(1700000000.000000) can1 001#\n\
        DROPCOUNT: dropped 55 CAN frames on 'can1' socket (total drops 55)\n";
    let mut source = Lines::read(&text[..], ReadOptions::default()).unwrap();
    receive(&mut source, 3);
    assert_eq!(source.bus_status().iter().map(|bus| bus.lost).collect::<Vec<_>>(), [0, 55]);
}

#[test]
fn relative_timestamps_arrive_at_once_if_their_meaning_is_given() {
    let (pipe, mut writer) = std::io::pipe().unwrap();
    let options = ReadOptions { time_style: Some(TimeStyle::Delta), ..ReadOptions::default() };
    let mut source = Lines::read(pipe, options).unwrap();
    writer.write_all(b"(000.000000) can0 001#\n(000.500000) can0 001#\n(000.250000) can0 001#\n").unwrap();
    let times: Vec<_> = frames(&receive(&mut source, 3)).iter().map(|frame| frame.time.unwrap().0).collect();
    assert_eq!(times, [0, 500_000_000, 750_000_000]);
}

#[test]
fn a_file_is_read_from_its_beginning_and_then_as_it_grows() {
    let mut file = Followed::new(Some("(1700000000.000000) can0 001#\n(1700000001.000000) can0 0"));
    assert_eq!(frames(&receive(&mut *file.source, 1))[0].id, CanId::Standard(1));
    nothing(&mut *file.source);
    file.append("02#11");
    nothing(&mut *file.source);
    file.append("22\n(1700000002.000000) can1 003#\n");
    let found = frames(&receive(&mut *file.source, 2));
    assert_eq!((found[0].id, found[0].data()), (CanId::Standard(2), &[0x11, 0x22][..]));
    assert_eq!((found[1].id, found[1].bus), (CanId::Standard(3), BusIndex(1)));
}

#[test]
fn a_trace_of_peak_grows_too() {
    let mut file = Followed::new(Some(";$FILEVERSION=1.1\n;$STARTTIME=43008.5\n"));
    file.append("     1)      1000.0  Rx         0300  8  00 00 00 00 04 00 00 00\n");
    // A notice about the assumed meaning of the timestamps may precede the frame.
    let mut arrivals = Arrivals::default();
    while frames(&arrivals).is_empty() {
        arrivals = receive(&mut *file.source, 1);
    }
    let frame = frames(&arrivals)[0];
    // 2017-09-30 12:00:01 UTC.
    assert_eq!((frame.id, frame.time), (CanId::Standard(0x300), Some(Timestamp(1_506_772_801_000_000_000))));
}

#[test]
fn a_file_that_is_not_there_yet_is_waited_for() {
    let mut file = Followed::new(None);
    let arrivals = receive(&mut *file.source, 1);
    assert_eq!(notices(&arrivals), [format!("{} does not exist yet; waiting for it", file.path.display())]);
    nothing(&mut *file.source);
    File::create(&file.path).unwrap();
    nothing(&mut *file.source);
    file.append("(1700000000.000000) can0 001#\n");
    assert_eq!(frames(&receive(&mut *file.source, 1)).len(), 1);
}

#[test]
fn a_file_that_is_cut_short_is_read_from_its_beginning() {
    let mut file = Followed::new(Some("(1700000000.000000) can0 001#\n(1700000001.000000) can1 002#\n(170"));
    receive(&mut *file.source, 2);
    std::fs::write(&file.path, "(1700000009.000000) can1 003#\n").unwrap();
    let arrivals = receive(&mut *file.source, 2);
    let shown = file.path.display();
    let cut = "; incomplete last line skipped";
    assert_eq!(notices(&arrivals), [format!("{shown} was truncated; reading from its start{cut}")]);
    // Buses keep their index.
    let found = frames(&arrivals);
    assert_eq!((found[0].id, found[0].bus), (CanId::Standard(3), BusIndex(1)));
    assert_eq!(arrivals.names.names(), ["can0", "can1"]);
    // Truncated first and written later, as copytruncate does.
    file.append("(1700000010.000000) can1 004#\n");
    receive(&mut *file.source, 1);
    File::create(&file.path).unwrap();
    let arrivals = receive(&mut *file.source, 1);
    assert_eq!(notices(&arrivals), [format!("{shown} was truncated; reading from its start")]);
    file.append("(1700000011.000000) can2 005#\n");
    assert_eq!(frames(&receive(&mut *file.source, 1))[0].bus, BusIndex(2));
}

#[test]
fn a_file_that_is_replaced_is_read_to_its_end_and_then_the_other() {
    let mut file = Followed::new(Some("(1700000000.000000) can0 001#\n"));
    receive(&mut *file.source, 1);
    let aside = file.path.with_extension("log.1");
    std::fs::rename(&file.path, &aside).unwrap();
    // The writer uses the old file until it reopens it.
    OpenOptions::new()
        .append(true)
        .open(&aside)
        .unwrap()
        .write_all(b"(1700000001.000000) can0 002#\n")
        .unwrap();
    assert_eq!(frames(&receive(&mut *file.source, 1))[0].id, CanId::Standard(2));
    // Longer than the part read of the first file.
    std::fs::write(&file.path, "(1700000002.000000) can0 003#\n".repeat(5)).unwrap();
    let arrivals = receive(&mut *file.source, 6);
    let shown = file.path.display();
    assert_eq!(notices(&arrivals), [format!("{shown} was replaced by another file; reading from its start")]);
    assert!(frames(&arrivals).iter().all(|frame| frame.id == CanId::Standard(3)));
}

#[test]
fn what_is_no_file_or_no_capture_has_failed() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = follow(folder.path(), ReadOptions::default()).unwrap();
    let SourceEnd::Failed(error) = end(&mut *source) else { panic!("expected a failure") };
    let text = format!("{error:#}");
    assert!(text.contains("found a folder, expected a file"), "{text}");
    let path = folder.path().join("photo.jpg");
    std::fs::write(&path, vec![0xD8; 200_000]).unwrap();
    let mut source = follow(&path, ReadOptions::default()).unwrap();
    let SourceEnd::Failed(error) = end(&mut *source) else { panic!("expected a failure") };
    let text = format!("{error:#}");
    assert!(text.contains("photo.jpg: not a capture in a known format"), "{text}");
}

#[test]
fn the_thread_ends_without_a_listener() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("growing.log");
    std::fs::write(&path, "(1700000000.000000) can0 001#\n").unwrap();
    let source = Lines::start({
        let path = path.clone();
        move |outlet| follow::follow_file(&path, &ReadOptions::default(), outlet)
    })
    .unwrap();
    let is_over = Arc::downgrade(&source.is_over);
    drop(source);
    let begin = Instant::now();
    while is_over.strong_count() > 0 {
        assert!(begin.elapsed() < LIMIT, "the thread still runs");
        std::thread::yield_now();
    }
}
