//! Tests that all items are in the capture, in the requested parts.

use super::*;

/// One frame of each kind.
fn kinds() -> Vec<Frame> {
    let with = |flags: FrameFlags, data: &[u8]| Frame {
        flags,
        ..Frame::data_frame(CanId::from_extended(0x18FE_CA80), data)
    };
    let mut all = vec![
        Frame::data_frame(CanId::from_standard(0x185), &[1, 2, 3]),
        with(FrameFlags::TRANSMITTED, &[0xFF; 8]),
        with(FrameFlags::RECEIVED, &[]),
        with(FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH).with(FrameFlags::ERROR_STATE), &[9; 64]),
        Frame { length: 4, ..with(FrameFlags::REMOTE, &[]) },
        Frame { raw_dlc: 11, ..with(FrameFlags(0), &[7; 8]) },
        Frame { id: CanId::from_extended(0x20), ..with(FrameFlags::ERROR, &[0, 0, 0, 0, 0, 0, 0, 5]) },
    ];
    for (number, frame) in (1..).zip(&mut all) {
        frame.time = Some(time(number));
    }
    all
}

#[test]
fn what_was_recorded_is_read_again() {
    for format in WRITABLE {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("run.{}", format.suffix));
        let mut recorder = Recorder::open(&options(&path), day()).unwrap();
        let holds = format.holds;
        let mut stated = Vec::new();
        for (number, frame) in (0_u32..).zip(kinds()) {
            let bus = if number % 3 == 1 { "can1" } else { "can0" };
            recorder.frame(&frame, bus);
            stated.extend(holds.kept_frame(&frame).map(|frame| RecordedItem::Frame(bus.to_owned(), frame)));
            for notice in [link(number, LinkState::Down), lost(2), link(number, LinkState::Up)] {
                recorder.notice(&notice, bus);
                stated.push(RecordedItem::Notice(bus.to_owned(), notice));
            }
            recorder.notice(&Notice::Quiet(time(number)), bus);
            stated.push(RecordedItem::Notice(String::new(), Notice::Quiet(time(number))));
        }
        stated.retain(|stated| holds.notices || matches!(stated, RecordedItem::Frame(..)));
        let status = recorder.finish();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(read(&bytes), stated, "{}", format.name);
        assert_eq!((status.path, status.parts, status.frames), (path, 1, 7));
        assert_eq!((status.bytes, status.missing, status.failure), (bytes.len() as u64, 0, None));
        let unheld: &[_] = if holds.notices { &[] } else { &[UnstoredKind::Links, UnstoredKind::Losses] };
        assert_eq!(status.unheld, unheld, "{}", format.name);
        assert_eq!(
            status.losses.is_empty(),
            holds.kept_frame(&kinds()[6]) == Some(kinds()[6]),
            "{:?}",
            status.losses
        );
    }
}

#[test]
fn nothing_is_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.log");
    std::fs::write(&path, "mine").unwrap();
    let error = Recorder::open(&options(&path), day()).err().unwrap().to_string();
    let shown = path.display();
    assert!(error.starts_with(&format!("{shown}: file exists; files are never overwritten")), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"mine");
}

#[test]
fn a_crash_leaves_what_was_given_to_the_system() {
    for format in WRITABLE {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("run.{}", format.suffix));
        let mut recorder = Recorder::open(&options(&path), day()).unwrap();
        let begin = Instant::now();
        (0..10).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.tick(begin);
        wait(&recorder, |status| status.frames == 10);
        (10..20).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.tick(begin + Duration::from_millis(200));
        wait(&recorder, |status| status.frames == 20);
        (20..30).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.tick(begin + Duration::from_millis(210));
        let after_a_crash = std::fs::read(&path).unwrap();
        assert_eq!(frames(&read(&after_a_crash)), kept(format, 0..20), "{}", format.name);
        // A recorder that is dropped early writes the rest.
        drop(recorder);
        assert_eq!(frames(&read(&std::fs::read(&path).unwrap())), kept(format, 0..30), "{}", format.name);
    }
}

#[test]
fn the_system_has_it_soon_and_the_disk_within_a_second() {
    let memory = Memory::new(usize::MAX);
    let mut recorder =
        Recorder::open_on(Box::new(memory.clone()), &options(Path::new("run.log")), day(), QUEUE).unwrap();
    let begin = Instant::now();
    let mut count = 0;
    // Ticks 50 ms apart with a frame before each; checks the system and the disk.
    for step in 0..40_u32 {
        recorder.frame(&frame(step), "can0");
        recorder.tick(begin + Duration::from_millis(50) * step);
        let held = u64::try_from(recorder.items.len()).unwrap();
        assert!(held <= 1, "{held} at {step}");
        count += 1;
        wait(&recorder, |status| status.frames == count - held);
        // The first sync at once, then at 750 ms and 1,500 ms.
        let syncs = 1 + usize::from(step >= 15) + usize::from(step >= 30);
        assert_eq!(memory.lock().syncs, syncs, "at {step}");
    }
    // Without frames there is only one more sync.
    for step in 40..100_u32 {
        recorder.tick(begin + Duration::from_millis(50) * step);
    }
    assert_eq!(recorder.finish().frames, count);
    assert_eq!(memory.lock().syncs, 4);
}

#[test]
fn parts_are_as_large_as_allowed_and_miss_nothing() {
    let memory = Memory::new(usize::MAX);
    let limits = RecordLimits { bytes: 10 * LINE as u64, ..UNLIMITED };
    let mut log = parts(&memory, "run.log", true, limits);
    for start in (0..35).step_by(7) {
        log.take_items(items(start..start + 7), &can0(), None);
    }
    log.finish_recording();
    assert_eq!(memory.names(), ["run-0001.log", "run-0002.log", "run-0003.log", "run-0004.log"]);
    for (part, numbers) in [(1, 0..10), (2, 10..20), (3, 20..30), (4, 30..35)] {
        let bytes = memory.bytes(&format!("run-000{part}.log"));
        assert_eq!(bytes.len(), numbers.len() * LINE);
        assert_eq!(frames(&read(&bytes)), expected(numbers));
    }
    let status = log.status();
    assert_eq!((status.parts, status.frames, status.missing), (4, 35, 0));
    assert_eq!(status.path, Path::new("run-0004.log"));
    assert_eq!(status.bytes, 35 * LINE as u64);
}

#[test]
fn each_part_is_a_whole_capture() {
    let memory = Memory::new(usize::MAX);
    let mut pcapng = parts(&memory, "run.pcapng", true, RecordLimits { bytes: 400, ..UNLIMITED });
    let buses = ["can0".to_owned(), "can1".to_owned()];
    for number in 0..40 {
        let bus = usize::from(number % 4 == 3);
        let down = PendingItem { bus, what: RecordItem::Notice(link(number, LinkState::Down)) };
        pcapng.take_items(
            vec![PendingItem { bus, what: RecordItem::Frame(frame(number)) }, down],
            &buses,
            None,
        );
    }
    pcapng.finish_recording();
    let names = memory.names();
    assert!(names.len() > 4, "{names:?}");
    let mut stated = Vec::new();
    for name in names {
        let bytes = memory.bytes(&name);
        // A notice does not start a part.
        assert!(bytes.len() <= 400 + 60, "{name}: {}", bytes.len());
        stated.extend(read(&bytes));
    }
    let expected = (0..40).flat_map(|number| {
        let bus = buses[usize::from(number % 4 == 3)].clone();
        [
            RecordedItem::Frame(bus.clone(), frame(number)),
            RecordedItem::Notice(bus, link(number, LinkState::Down)),
        ]
    });
    assert_eq!(stated, expected.collect::<Vec<_>>());
}

#[test]
fn a_part_ends_after_its_time_when_a_frame_comes() {
    let memory = Memory::new(usize::MAX);
    let limits = RecordLimits { time: Duration::from_mins(10), ..UNLIMITED };
    let mut log = parts(&memory, "run.pcapng", true, limits);
    let begin = Instant::now();
    let at = |seconds| Some(begin + Duration::from_secs(seconds));
    let quiet = |number| vec![PendingItem { bus: 0, what: RecordItem::Notice(Notice::Quiet(time(number))) }];
    log.take_items(items(0..3), &can0(), at(0));
    log.take_items(items(3..5), &can0(), at(599));
    log.take_items(quiet(5), &can0(), at(1_000));
    log.take_items(items(5..6), &can0(), at(1_300));
    log.take_items(items(6..7), &can0(), at(1_899));
    log.take_items(items(7..9), &can0(), at(1_900));
    log.finish_recording();
    let stated: Vec<_> = (1..=3).map(|part| read(&memory.bytes(&format!("run-000{part}.pcapng")))).collect();
    assert_eq!(frames(&stated[0]), expected(0..5));
    assert_eq!(stated[0].last(), Some(&RecordedItem::Notice(String::new(), Notice::Quiet(time(5)))));
    assert_eq!(frames(&stated[1]), expected(5..7));
    assert_eq!(frames(&stated[2]), expected(7..9));
    assert_eq!(memory.names().len(), 3);
}

#[test]
fn only_so_many_parts_are_kept() {
    let memory = Memory::new(usize::MAX);
    // A part contains at least one frame.
    let limits = RecordLimits { bytes: 1, files: 2, ..UNLIMITED };
    let mut log = parts(&memory, "run.log", true, limits);
    log.take_items(items(0..5), &can0(), None);
    log.finish_recording();
    assert_eq!(memory.names(), ["run-0004.log", "run-0005.log"]);
    let status = log.status();
    assert_eq!((status.parts, status.removed, status.frames), (5, 3, 5));
}

#[test]
fn parts_are_looked_at_as_one_recording() {
    let folder = tempfile::tempdir().unwrap();
    for (name, max_bytes) in [("a.log", Some(100)), ("b.pcapng", Some(300)), ("c.log", None)] {
        let path = folder.path().join(name);
        let mut recorder = Recorder::open(&RecordOptions { max_bytes, ..options(&path) }, day()).unwrap();
        (0..9).for_each(|number| recorder.frame(&frame(number), "can0"));
        recorder.finish();
        let stem = name.split('.').next().unwrap();
        if max_bytes.is_none() {
            // The name of a part after a failure of the first one.
            let name = folder.path().join("c-0002.log");
            std::fs::write(name, "(1700000001.000000) can0 185#00\n").unwrap();
        }
        let of_record = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().starts_with(stem);
        let paths = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
        let mut paths: Vec<_> = paths.filter(of_record).collect();
        paths.sort();
        assert!(paths.len() > 1, "{name}");
        let captures = TimelineCaptures {
            paths,
            align: false,
            join: cobscope_decoder::series::JoinOptions::USUAL,
            read: ReadOptions::default(),
            session: SessionOptions::default(),
            rules: Arc::default(),
            live: None,
        };
        let (news, inbox) = channel();
        let timeline = Timeline::open(captures, news).unwrap();
        while !matches!(inbox.recv_timeout(LIMIT).unwrap(), TimelineNews::Indexed) {}
        let end = timeline.end_state().unwrap();
        assert_eq!(end.frames(), if max_bytes.is_none() { 10 } else { 9 }, "{name}");
        assert_eq!(end.buses().len(), 1, "{name}");
    }
}

#[test]
fn names_that_are_taken_meanwhile_are_passed_by() {
    let memory = Memory::new(usize::MAX);
    let limits = RecordLimits { bytes: LINE as u64, ..UNLIMITED };
    let mut log = parts(&memory, "run.log", true, limits);
    memory.set(|inner| drop(inner.files.insert("run-0002.log".into(), b"others".to_vec())));
    log.take_items(items(0..2), &can0(), None);
    assert_eq!(memory.names(), ["run-0001.log", "run-0002.log", "run-0003.log"]);
    assert_eq!(memory.bytes("run-0002.log"), b"others");
    assert_eq!(frames(&read(&memory.bytes("run-0003.log"))), expected(1..2));
}
