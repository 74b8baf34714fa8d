//! Decoding on from a checkpoint gives what decoding from the start gives.

use std::fs;
use std::path::Path;

use cobscope_decoder::capture::{Batch, Item, ReadOptions, Reader};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{Index, Mark};
use cobscope_decoder::session::{Bus, SessionOptions};
use cobscope_decoder::sink::jsonl::Jsonl;

/// All fixture captures one behind the other: every service, times that go back, silences.
fn capture() -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/canopen");
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "log"));
    files.sort();
    files.iter().flat_map(|path| fs::read(path).unwrap()).collect()
}

/// Reads on to the end; gives each event as a JSON line, with the number of frames before its batch.
fn read_on(
    mut reader: Reader<&[u8]>,
    mut decoder: Decoder,
    mut frames: u64,
    mut between: impl FnMut(u64, &Reader<&[u8]>, &Decoder),
) -> Vec<(u64, String)> {
    let mut batch = Batch::new();
    let mut lines = Vec::new();
    loop {
        between(frames, &reader, &decoder);
        if !reader.read(&mut batch).unwrap() {
            break;
        }
        let mut see = |event: &Event, bus: &Bus| lines.push((frames, line(event, bus)));
        for item in batch.items() {
            match item {
                Item::Frame(frame) => decoder.push(frame, reader.buses(), &mut see),
                Item::Notice(notice) => decoder.notice(notice, reader.buses(), &mut see),
            }
        }
        frames += batch.frames().len() as u64;
    }
    decoder.finish(reader.buses(), &mut |event: &Event, bus: &Bus| lines.push((frames, line(event, bus))));
    lines
}

fn line(event: &Event, bus: &Bus) -> String {
    let mut text = Vec::new();
    Jsonl::new(&mut text).write(event, bus);
    String::from_utf8(text).unwrap()
}

#[test]
fn decoding_on_from_any_mark_equals_decoding_from_the_start() {
    let bytes = capture();
    let reader = Reader::open(&bytes[..], &ReadOptions::default()).unwrap();
    let mut index = Index::every(1);
    let all = read_on(reader, Decoder::new(SessionOptions::default()), 0, |frames, reader, decoder| {
        if index.is_due(frames) {
            let (position, decoder) = (reader.position(), decoder.clone());
            index.add(Mark { frames, time: None, position, decoder });
        }
    });
    assert!(index.marks().len() >= 6, "{}", index.marks().len());
    for mark in index.marks() {
        let rest = &bytes[usize::try_from(mark.position.offset).unwrap()..];
        let reader = Reader::resume(rest, &mark.position);
        let again = read_on(reader, mark.decoder.clone(), mark.frames, |_, _, _| ());
        // Batches are cut elsewhere, so only the lines themselves are compared.
        let lines = |from: &[(u64, String)]| from.iter().map(|(_, line)| line.clone()).collect::<Vec<_>>();
        let expected: Vec<_> = all.iter().filter(|(before, _)| *before >= mark.frames).cloned().collect();
        assert_eq!(lines(&again), lines(&expected), "from frame {}", mark.frames);
    }
}

#[test]
fn a_checkpoint_is_small() {
    let bytes = capture();
    let reader = Reader::open(&bytes[..], &ReadOptions::default()).unwrap();
    let mut largest = 0;
    read_on(reader, Decoder::new(SessionOptions::default()), 0, |_, _, decoder| {
        largest = largest.max(decoder.footprint());
    });
    assert!(largest > 1_000 && largest <= 256 * 1024, "{largest}");
}

#[test]
fn marks_are_found_by_frame_and_time_and_thinned_out() {
    let bytes = capture();
    let reader = Reader::open(&bytes[..], &ReadOptions::default()).unwrap();
    let decoder = Decoder::new(SessionOptions::default());
    let mut index = Index::every(10);
    for frames in (0..10_000_u32).step_by(10) {
        let time = (frames > 0).then(|| Timestamp(i64::from(frames)));
        let (position, decoder) = (reader.position(), decoder.clone());
        if index.is_due(frames.into()) {
            index.add(Mark { frames: frames.into(), time, position, decoder });
        }
    }
    assert!(index.marks().len() <= 512);
    let mark = index.before_frame(5_005).unwrap();
    assert!((4_960..=5_005).contains(&mark.frames), "{}", mark.frames);
    assert_eq!(index.before_frame(0).unwrap().frames, 0);
    assert!(index.before_time(Timestamp(5_005)).unwrap().frames <= 5_004);
    assert_eq!(index.before_time(Timestamp(-1)).unwrap().frames, 0);
}
