//! Decoding from a checkpoint gives the same events as decoding from the start.

use std::fs;
use std::path::Path;

use cobscope_decoder::capture::{Batch, CaptureReader, MergedCapture, MergedReader, ReadOptions};
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{
    Checkpoint, CheckpointIndex, EventPosition, MOST_MARKS, PlacedEvent, ReplayState,
};
use cobscope_decoder::session::{Bus, SessionOptions};
use cobscope_decoder::sink::EventSink as _;
use cobscope_decoder::sink::jsonl::JsonlSink;

/// All fixture captures, concatenated: every service, times that step back, silences.
fn capture() -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/canopen");
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "log"));
    files.sort();
    files.iter().flat_map(|path| fs::read(path).unwrap()).collect()
}

fn open(bytes: &[u8]) -> MergedReader<&[u8]> {
    let reader = CaptureReader::open(bytes, &ReadOptions::default()).unwrap();
    MergedReader::new(vec![MergedCapture { reader, group: 0, shift: 0, continues: false }])
}

/// Reads to the end; returns each event as its position and a JSON line.
fn read_on(
    mut reader: MergedReader<&[u8]>,
    mut world: ReplayState,
    mut between: impl FnMut(&MergedReader<&[u8]>, &ReplayState),
) -> Vec<(EventPosition, String)> {
    let mut batch = Batch::new();
    let mut lines = Vec::new();
    let mut see = |reported: PlacedEvent<'_>| lines.push((reported.spot, line(reported.event, reported.bus)));
    loop {
        between(&reader, &world);
        if !reader.read(&mut batch).unwrap() {
            break;
        }
        for item in batch.items() {
            world.take_item(&item, reader.buses(), &mut see);
        }
    }
    world.finish_capture(reader.buses(), &mut see);
    lines
}

fn line(event: &Event, bus: &Bus) -> String {
    let mut text = Vec::new();
    JsonlSink::new(&mut text).write_event(event, bus);
    String::from_utf8(text).unwrap()
}

#[test]
fn decoding_on_from_any_mark_equals_decoding_from_the_start() {
    let bytes = capture();
    let mut index = CheckpointIndex::with_interval(1);
    let all = read_on(open(&bytes), ReplayState::new(SessionOptions::default()), |reader, world| {
        if index.is_due(world.frames()) {
            let (position, world) = (reader.position(), world.clone());
            index.add_checkpoint(Checkpoint {
                frames: world.frames(),
                time: world.last_time(),
                position,
                world,
            });
        }
    });
    assert!(index.checkpoints().len() >= 6, "{}", index.checkpoints().len());
    for mark in index.checkpoints() {
        let offset = usize::try_from(mark.position.offsets().next().unwrap()).unwrap();
        let reader = MergedReader::resume(vec![&bytes[offset..]], &mark.position).unwrap();
        let again = read_on(reader, mark.world.clone(), |_, _| ());
        let expected: Vec<_> =
            all.iter().filter(|(spot, _)| *spot >= mark.world.next_position()).cloned().collect();
        assert_eq!(again, expected, "from frame {}", mark.frames);
    }
}

#[test]
fn a_checkpoint_is_small() {
    let bytes = capture();
    let mut largest = 0;
    read_on(open(&bytes), ReplayState::new(SessionOptions::default()), |_, world| {
        largest = largest.max(world.footprint());
    });
    assert!(largest > 1_000 && largest <= 256 * 1024, "{largest}");
}

#[test]
fn marks_are_found_by_frame_and_time_and_thinned_out() {
    let bytes = capture();
    let reader = open(&bytes);
    let world = ReplayState::new(SessionOptions::default());
    let mut index = CheckpointIndex::with_interval(10);
    for frames in (0..10_000_u32).step_by(10) {
        let time = (frames > 0).then(|| Timestamp(i64::from(frames)));
        if index.is_due(frames.into()) {
            let (position, world) = (reader.position(), world.clone());
            index.add_checkpoint(Checkpoint { frames: frames.into(), time, position, world });
        }
    }
    assert!(index.checkpoints().len() <= MOST_MARKS);
    let mark = index.before_frame(5_005).unwrap();
    assert!((4_600..=5_005).contains(&mark.frames), "{}", mark.frames);
    assert_eq!(index.before_frame(0).unwrap().frames, 0);
    assert!(index.before_time(Timestamp(5_005)).unwrap().frames <= 5_004);
    assert_eq!(index.before_time(Timestamp(-1)).unwrap().frames, 0);
}
