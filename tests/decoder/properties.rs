//! Properties for any input: no bytes break a reader or a wire parser, both ways of reading candump agree,
//! and neither the division of the input nor checkpoints change the result.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{
    Batch, BatchItem, BusNames, CaptureReader, FORMATS, LARGEST_RECORD, Notice, ReadOptions, ReaderPosition,
    decompress,
};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::SessionOptions;
use proptest::prelude::*;

use crate::harness::observe::Checker;
use crate::harness::reader::{self, Content};
use crate::harness::{TARGETS, Target};
use crate::support::{corpus, skip, step, workspace};

/// Max memory of a checkpoint, for any capture.
const CHECKPOINT_LIMIT: usize = 256 * 1024;

/// Max frames of a corpus capture that are decoded here, so that the tests stay fast.
const CORPUS_FRAMES: usize = 20_000;

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// All files below a folder that are captures in a known format, decompressed.
fn captures(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        let mut paths: Vec<PathBuf> =
            fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        for path in paths {
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let packed = fs::read(&path).unwrap();
            let mut bytes = Vec::new();
            let unpacked =
                decompress(&packed[..]).is_ok_and(|mut source| source.read_to_end(&mut bytes).is_ok());
            if unpacked && CaptureReader::open(&bytes[..], &ReadOptions::default()).is_ok() {
                found.push((path.display().to_string(), bytes));
            }
        }
    }
    found
}

fn fixtures(folder: &str) -> Vec<(String, Vec<u8>)> {
    captures(&workspace().join("fixtures").join(folder))
}

fn corpus_captures() -> Vec<(String, Vec<u8>)> {
    if !corpus().join("README.md").exists() {
        skip("corpus", &format!("{} is not there", corpus().display()));
        return Vec::new();
    }
    captures(&corpus())
}

// Readers and wire parsers.

/// Text that is more often nearly valid than random bytes.
fn text() -> impl Strategy<Value = Vec<u8>> {
    let words = prop::sample::select(vec![
        "(1700000000.123456)",
        "can0",
        "vcan1",
        "123#1122",
        "18FEF100##1AA",
        "701#R",
        "20000004#0004",
        " ",
        "  ",
        "\n",
        "\r\n",
        "\r",
        "[8]",
        "11 22 33",
        "1)",
        "17.5",
        "Rx",
        "DT",
        "0601",
        "d 8",
        "CANFD",
        "\t",
        "_9",
        ";$FILEVERSION=2.1\n",
        "base hex  timestamps absolute\n",
        "\u{FEFF}",
        "ErrorFrame",
        "(0.5)",
        "\x1b[31m",
    ]);
    prop::collection::vec(words, 0..60).prop_map(|words| words.concat().into_bytes())
}

/// Output of adapters and servers that is more often nearly valid than random bytes.
fn words_of_adapters() -> impl Strategy<Value = Vec<u8>> {
    let words = prop::sample::select(vec![
        "t123",
        "T18FEF100",
        "r080",
        "D00000001",
        "b7FF",
        "0",
        "2",
        "8",
        "F",
        "1122",
        "EA5F",
        "A5A5A5A5A5A5A5A5",
        "F08",
        "sp130005",
        "e2ac",
        "\r",
        "\r",
        "\n",
        "\x07",
        "< ",
        " >",
        " ",
        "frame ",
        "fdframe ",
        "rtr ",
        "error ",
        "ok",
        "hi",
        "123 ",
        "18FEF100 ",
        "05 ",
        "1700000000.123456 ",
        "\x1b[2J",
        "xxxxxxxxxxxxxxxxxxxxxxxx",
    ]);
    prop::collection::vec(words, 0..60).prop_map(|words| words.concat().into_bytes())
}

fn target(name: &str) -> Target {
    *TARGETS.iter().find(|(known, _)| *known == name).unwrap()
}

proptest! {
    #![proptest_config(config(300))]

    #[test]
    fn any_bytes_into_any_reader(
        bytes in prop_oneof![prop::collection::vec(any::<u8>(), 0..3_000), text()],
        magic in prop::sample::select(vec![&b""[..], b"\n\r\r\n", b"\xD4\xC3\xB2\xA1", b"\x1F\x8B\x08"]),
    ) {
        let bytes = [magic, &bytes].concat();
        for format in FORMATS {
            reader::holds_its_contract(format.name, &bytes);
        }
        target("any").1(&bytes);
    }

    #[test]
    fn what_adapters_and_servers_say_in_any_pieces(text in words_of_adapters()) {
        target("slcan").1(&text);
        target("socketcand").1(&text);
    }

    #[test]
    fn any_bytes_into_any_wire_parser_and_the_session(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        for (_, target) in TARGETS {
            target(&bytes);
        }
    }
}

/// The longest input of which a reader must consume some bytes, and one byte less and more, of every byte
/// with a meaning for a reader.
#[test]
fn readers_take_some_of_the_largest_record() {
    for format in FORMATS {
        for byte in *b"x;0\r \t\xFF\x00\n(" {
            for length in [LARGEST_RECORD - 1, LARGEST_RECORD, LARGEST_RECORD + 1] {
                let mut bytes = vec![byte; length];
                reader::parse(&mut *(format.parser)(&ReadOptions::default()), &bytes, || usize::MAX);
                *bytes.last_mut().unwrap() = b'\r';
                reader::parse(&mut *(format.parser)(&ReadOptions::default()), &bytes, || LARGEST_RECORD / 3);
            }
        }
    }
}

// The fast path for candump's common line form, compared with the general path.

/// A line of the common form, or one similar to it.
fn line() -> impl Strategy<Value = String> {
    let seconds = prop_oneof![9 => 1_699_999_998_u64..1_700_000_002, 1 => 0..10_000_000_000_u64];
    let bus = prop::sample::select(vec!["can0", "can1", "vcan0", "c", "elevenchars", "seven77", "eight888"]);
    let id = prop_oneof![
        4 => (0..0x810_u32).prop_map(|id| format!("{id:03X}")),
        2 => (0..0x4000_0000_u32).prop_map(|id| format!("{id:08X}")),
        1 => (0..0x1000_u32).prop_map(|id| format!("{id:08x}")),
    ];
    // Mostly pairs of digits, up to one more than a frame has.
    let pairs = prop::collection::vec(0..16_u8, 0..19).prop_map(|mut digits| {
        digits.truncate(digits.len() / 2 * 2);
        digits
    });
    let data = prop_oneof![9 => pairs, 1 => prop::collection::vec(0..16_u8, 0..19)];
    let upper = any::<bool>();
    (seconds, 0..1_000_000_u32, bus, id, data, upper).prop_map(|(seconds, micros, bus, id, data, upper)| {
        let digit = |nibble: &u8| char::from_digit(u32::from(*nibble), 16).unwrap();
        let data: String = data.iter().map(digit).collect();
        let data = if upper { data.to_uppercase() } else { data };
        format!("({seconds:010}.{micros:06}) {bus} {id}#{data}")
    })
}

/// Frames and positions of notices; the reason of a notice differs if a blank ends the line.
fn candump(text: &[u8]) -> (Vec<Frame>, Vec<(usize, String)>, Vec<String>) {
    let format = reader::format("candump");
    let content = reader::parse(&mut *(format.parser)(&ReadOptions::default()), text, || usize::MAX);
    let texts = |notice: &Notice| notice.to_string().split(':').next().unwrap().to_owned();
    let notices = content.notices.iter().map(|(at, notice)| (*at, texts(notice))).collect();
    (content.frames, notices, content.buses)
}

proptest! {
    #![proptest_config(config(1_500))]

    #[test]
    fn the_fast_path_reads_what_the_general_path_reads(
        lines in prop::collection::vec(line(), 1..12),
        edits in prop::collection::vec((any::<prop::sample::Index>(), 0x20_u8..), 0..4),
    ) {
        let mut text = lines.join("\n").into_bytes();
        for (at, byte) in edits {
            let at = at.index(text.len());
            // The number of lines stays the same, because the other text is derived line by line.
            if text[at] != b'\n' {
                text[at] = byte;
            }
        }
        text.push(b'\n');
        // The window of the fast path must not reach beyond the end, not even for the last lines.
        text.extend(b"* a comment that is long enough to keep the window of the fast path full *\n");
        let general = |end: &str| {
            let lines = text.split_inclusive(|byte| *byte == b'\n');
            lines.flat_map(|line| [&line[..line.len() - 1], end.as_bytes()].concat()).collect::<Vec<u8>>()
        };
        let fast = candump(&text);
        prop_assert_eq!(&fast, &candump(&general(" \n")));
        prop_assert_eq!(&fast, &candump(&general("\r\n")));
    }
}

// Division of the input, and positions.

/// The remaining output of a reader.
fn rest(reader: &mut CaptureReader<impl Read>) -> Content {
    let mut content = Content::default();
    let mut batch = Batch::new();
    loop {
        match reader.read(&mut batch) {
            Ok(true) => {}
            Ok(false) => break,
            Err(error) => {
                content.error = Some(error.to_string());
                break;
            }
        }
        let before = content.frames.len();
        content.notices.extend(batch.notices().iter().map(|(at, notice)| (before + at, notice.clone())));
        content.frames.extend_from_slice(batch.frames());
    }
    content.buses = reader.buses().names().to_vec();
    content
}

#[test]
fn pieces_of_any_size_read_as_the_whole() {
    for (name, bytes) in ["dialects", "canopen", "malformed", "recorders"].into_iter().flat_map(fixtures) {
        let format = CaptureReader::open(&bytes[..], &ReadOptions::default()).unwrap().format();
        let parse = |piece: &mut dyn FnMut() -> usize| {
            reader::parse(&mut *(format.parser)(&ReadOptions::default()), &bytes, piece)
        };
        let whole = parse(&mut || usize::MAX);
        // Byte by byte takes quadratic time if the reader needs many lines to decide.
        let smallest = if bytes.len() < 16 << 10 { 1 } else { 4_093 };
        for size in [smallest, 7_919] {
            assert_eq!(parse(&mut || size), whole, "{name} in pieces of {size}");
        }
    }
}

#[test]
fn reading_resumes_at_any_position() {
    for (name, bytes) in ["dialects", "canopen", "malformed", "recorders"].into_iter().flat_map(fixtures) {
        let mut reader = CaptureReader::open(&bytes[..], &ReadOptions::default()).unwrap();
        let mut batch = Batch::new();
        let mut positions: Vec<(usize, usize, ReaderPosition)> = vec![(0, 0, reader.position())];
        let (mut frames, mut notices) = (0, 0);
        while reader.read(&mut batch).unwrap_or(false) {
            frames += batch.frames().len();
            notices += batch.notices().len();
            positions.push((frames, notices, reader.position()));
        }
        let whole = rest(&mut CaptureReader::open(&bytes[..], &ReadOptions::default()).unwrap());
        for (frames, notices, position) in positions {
            let source = &bytes[usize::try_from(position.offset).unwrap()..];
            let content = rest(&mut CaptureReader::resume(source, &position.clone()));
            assert_eq!(content.frames, whole.frames[frames..], "{name} from {}", position.offset);
            let texts =
                |notices: &[(usize, Notice)]| notices.iter().map(|(_, n)| n.clone()).collect::<Vec<_>>();
            assert_eq!(texts(&content.notices), texts(&whole.notices[notices..]), "{name}");
            assert_eq!((content.buses, content.error), (whole.buses.clone(), whole.error.clone()), "{name}");
        }
    }
}

// Checkpoints.

/// An item of a reader's output.
enum ReaderItem {
    Frame(Frame),
    Notice(Notice),
}

fn kept(bytes: &[u8], most: usize) -> (Vec<ReaderItem>, BusNames) {
    let mut reader = CaptureReader::open(bytes, &ReadOptions::default()).unwrap();
    let mut batch = Batch::new();
    let mut all = Vec::new();
    while all.len() < most && reader.read(&mut batch).unwrap_or(false) {
        all.extend(batch.items().map(|item| match item {
            BatchItem::Frame(frame) => ReaderItem::Frame(*frame),
            BatchItem::Notice(notice) => ReaderItem::Notice(notice.clone()),
        }));
    }
    (all, reader.buses().clone())
}

fn push(decoder: &mut Decoder, item: &ReaderItem, names: &BusNames, checker: &mut Checker) {
    match item {
        ReaderItem::Frame(frame) => {
            checker.last_frame = frame.number;
            decoder.push(frame, names, checker);
        }
        ReaderItem::Notice(notice) => decoder.on_notice(notice, names, checker),
    }
}

/// Continues decoding from a clone at each of `places`; the lines must equal those of the original decoder.
fn resumes_from(name: &str, items: &[ReaderItem], names: &BusNames, places: &[usize]) {
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut checker = Checker::keeping();
    let mut clones = Vec::new();
    for (index, item) in items.iter().enumerate() {
        if places.contains(&index) {
            clones.push((
                index,
                checker.last_frame,
                checker.kept.as_ref().map_or(0, Vec::len),
                decoder.clone(),
            ));
        }
        push(&mut decoder, item, names, &mut checker);
        assert!(decoder.footprint() <= CHECKPOINT_LIMIT, "{name}: {} bytes", decoder.footprint());
    }
    decoder.finish_capture(names, &mut checker);
    let whole = checker.kept.unwrap();
    for (index, last_frame, before, mut clone) in clones {
        let mut checker = Checker::keeping();
        checker.last_frame = last_frame;
        items[index..].iter().for_each(|item| push(&mut clone, item, names, &mut checker));
        clone.finish_capture(names, &mut checker);
        let after = checker.kept.unwrap();
        assert!(after == whole[before..], "{name}: from item {index} other events follow");
    }
}

#[test]
fn decoding_resumes_from_a_clone_at_any_frame_of_every_fixture() {
    for (name, bytes) in fixtures("canopen") {
        let (items, names) = kept(&bytes, usize::MAX);
        // Every position of short captures, 40 of long ones; not only multiples of the step.
        let step = (items.len() / 40).max(1);
        let places: Vec<_> =
            (0..=items.len()).step_by(step).map(|place| place.saturating_sub(place % 3)).collect();
        resumes_from(&name, &items, &names, &places);
    }
}

#[test]
fn checkpoints_of_corpus_captures_are_small_and_go_on() {
    for (name, bytes) in corpus_captures().into_iter().step_by(step(4)) {
        let (items, names) = kept(&bytes, CORPUS_FRAMES);
        resumes_from(&name, &items, &names, &[items.len() / 3, items.len() * 2 / 3]);
    }
}

proptest! {
    #![proptest_config(config(60))]

    /// Sessions with random frames, not only those of the fixtures.
    #[test]
    fn decoding_resumes_from_a_clone_in_any_session(bytes in prop::collection::vec(any::<u8>(), 1..2_000)) {
        target("session").1(&bytes);
    }
}
