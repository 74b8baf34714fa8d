//! Limits of number and size, and disks that are full.

use super::*;

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
    assert!(bench.writer.status().failure.as_ref().unwrap().reason.contains("(os error 28)"));
    // The frames wait in the ring until there is room.
    memory.set(|inner| inner.room = 100_000);
    bench.now += RETRY_AFTER;
    bench.frame(2);
    assert_eq!(bench.files(), [[1, 2, 3]]);
    assert!(!bench.writer.status().is_incomplete());
    memory.set(|inner| inner.room = 0);
    (3..13).for_each(|milliseconds| bench.frame(milliseconds));
    let status = bench.finish();
    assert_eq!((status.frames, status.missing), (3, 10));
    assert!(status.is_incomplete());
    // The text of the number is that of the system.
    assert!(status.remark_texts()[0].contains("(os error 28): 10 frames not written"));

    // Never any room: all frames of the window are missing.
    let mut bench = Bench::on(Memory::new(0), options(1_000, 60_000));
    bench.fault(0);
    bench.frame(1);
    let status = bench.finish();
    assert_eq!((status.frames, status.missing), (0, 2));
    assert!(status.remark_texts()[0].contains("2 frames not written"), "{:?}", status.remark_texts());
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
