//! Reach of the ring in memory and on disk, and the state before a capture.

use super::*;

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
