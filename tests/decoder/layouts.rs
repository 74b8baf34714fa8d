//! Text without a known format: `fixtures/layouts/` has the same frames in many layouts, `fixtures/not-captures/` has text
//! without frames. Damaged lines must be reported, each with its reason.

use std::fs;
use std::path::PathBuf;

use cobscope_decoder::capture::{Batch, BatchItem, CaptureReader, FORMATS, Notice, ReadOptions};
use cobscope_decoder::frame::{Frame, FrameFlags};

/// The frames of all layouts: time in ms, identifier and data, whether they are transmitted.
const FRAMES: [(i64, &str, bool); 8] = [
    (100, "701#05", false),
    (120, "601#4041600000000000", true),
    (125, "581#4B41600037020000", false),
    (200, "181#3702", false),
    (250, "18FEF100#FFFFFF7DA00FFFFF", false),
    (300, "085#3081110000000000", false),
    (310, "181#3706", false),
    (400, "701#05", false),
];

/// Layouts without times, or with times whose unit the lines do not state.
const WITHOUT_TIMES: [&str; 6] = [
    "chinese-head",
    "identifier-bytes",
    "lines-per-frame",
    "log-prefix",
    "one-digit-bytes",
    "serial-monitor",
];

fn folder(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../fixtures").join(name)
}

/// Names and contents of the files of a folder, by name.
fn files(name: &str) -> Vec<(String, Vec<u8>)> {
    let entries = fs::read_dir(folder(name)).unwrap().map(|entry| entry.unwrap().path());
    let mut all: Vec<_> = entries
        .map(|path| (path.file_stem().unwrap().to_string_lossy().into_owned(), fs::read(&path).unwrap()))
        .collect();
    all.sort();
    all
}

/// Frames and notices of a capture; the reason if it is refused.
fn read(text: &[u8]) -> Result<(Vec<Frame>, Vec<Notice>), String> {
    let mut reader = CaptureReader::open(text, &ReadOptions::default()).map_err(|error| error.to_string())?;
    let (mut batch, mut frames, mut notices) = (Batch::new(), Vec::new(), Vec::new());
    while reader.read(&mut batch).unwrap() {
        for item in batch.items() {
            match item {
                BatchItem::Frame(frame) => frames.push(*frame),
                BatchItem::Notice(notice) => notices.push(notice.clone()),
            }
        }
    }
    Ok((frames, notices))
}

fn essence(frame: &Frame) -> String {
    let data = frame.data().iter().fold(String::new(), |text, byte| format!("{text}{byte:02X}"));
    format!("{}#{data}", frame.id)
}

#[test]
fn each_layout_has_the_same_frames() {
    let expected: Vec<&str> = FRAMES.iter().map(|(_, frame, _)| *frame).collect();
    for (name, text) in files("layouts") {
        let (frames, _) = read(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(frames.iter().map(essence).collect::<Vec<_>>(), expected, "{name}");
        if WITHOUT_TIMES.contains(&name.as_str()) {
            assert!(frames.iter().all(|frame| frame.time.is_none()), "{name}");
            continue;
        }
        let start = frames[0].time.unwrap_or_else(|| panic!("{name}: no times"));
        let times: Vec<i64> =
            frames.iter().map(|frame| frame.time.unwrap().since(start) / 1_000_000).collect();
        assert_eq!(times, FRAMES.map(|(time, ..)| time - 100), "{name}");
        let sent: Vec<bool> =
            frames.iter().map(|frame| frame.flags.contains(FrameFlags::TRANSMITTED)).collect();
        assert!(sent == FRAMES.map(|(.., sent)| sent) || !sent.contains(&true), "{name}: {sent:?}");
    }
}

#[test]
fn text_without_frames_is_refused() {
    let all = files("not-captures");
    assert!(all.len() >= 40, "{}", all.len());
    let read: Vec<String> = all
        .iter()
        .filter_map(|(name, text)| read(text).ok().map(|(_, notices)| format!("{name}: {notices:?}")))
        .collect();
    assert!(read.is_empty(), "{}", read.join("\n"));
}

/// Number of lines that the notices account for.
fn skipped_lines(notices: &[Notice]) -> usize {
    let lines = |notice: &Notice| match notice {
        Notice::Unreadable { .. } | Notice::LostFrames { .. } => 1,
        Notice::Assumption(text) => text
            .split_once(" skipped (first: line ")
            .and_then(|(count, _)| count.split(' ').next()?.parse().ok())
            .unwrap_or(0),
        _ => 0,
    };
    notices.iter().map(lines).sum()
}

/// Frames and skipped lines together are all lines that are not blank.
#[track_caller]
fn accounts_for(text: &[u8], name: &str) -> Option<(Vec<Frame>, Vec<Notice>)> {
    let (frames, notices) = read(text).ok()?;
    let is_line = |line: &&[u8]| !line.trim_ascii().is_empty();
    let lines = text.split(|byte| matches!(byte, b'\n' | b'\r')).filter(is_line).count();
    assert_eq!(frames.len() + skipped_lines(&notices), lines, "{name}: {notices:?}");
    Some((frames, notices))
}

/// A layout of one line per frame, long enough that a damaged line does not spoil it.
fn long_layouts() -> Vec<(String, Vec<Vec<u8>>)> {
    let mut all = files("layouts");
    all.retain(|(name, _)| name != "lines-per-frame" && name != "delta");
    let repeat = |(name, text): (String, Vec<u8>)| {
        let lines: Vec<Vec<u8>> = text
            .split(|byte| *byte == b'\n')
            .filter(|line| !line.is_empty())
            .map(|line| line.strip_suffix(b"\r").unwrap_or(line).to_vec())
            .collect();
        let head = lines.len() - FRAMES.len();
        // Equal times are no step back; whole numbers without a unit stay without one.
        let mut long = lines[..head].to_vec();
        for line in &lines[head..] {
            long.extend(std::iter::repeat_n(line.clone(), 8));
        }
        (name, long)
    };
    all.into_iter().map(repeat).collect()
}

#[test]
fn damaged_lines_are_counted_and_the_others_are_read() {
    for (name, lines) in long_layouts() {
        let whole = lines.join(&b"\n"[..]);
        let Some((frames, _)) = accounts_for(&whole, &name) else { panic!("{name}: refused") };
        let middle = lines.len() / 2;
        let with = |line: &[u8]| {
            let mut damaged = lines.clone();
            damaged[middle] = line.to_vec();
            damaged
        };
        let long_line = vec![b'7'; 1_000_000];
        for (what, line) in [
            ("broken", &b"%&/ 11 22 33 44 zz 55 66"[..]),
            ("text", b"the controller was restarted"),
            ("1 MB", &long_line),
            ("identifier of nine digits", b"0x123456789 8 11 22 33 44 55 66 77 88"),
            ("terminal escapes", b"\x1b[31mred\x1b[0m \x07\x1b]0;title\x07"),
            ("invalid UTF-8", b"\xff\xfe\xff 11 22"),
            ("ellipsis", b"..."),
        ] {
            let text = with(line).join(&b"\n"[..]);
            let Some((found, _)) = accounts_for(&text, &format!("{name}, {what}")) else {
                panic!("{name}, {what}: refused: {:?}", read(&text).err())
            };
            // The line of 1 MB hides the later lines from the inference, also those with bit 31.
            assert!(found.len() == frames.len() - 1 || name == "bit-31" && what == "1 MB", "{name}, {what}");
        }
        let crlf = lines.join(&b"\r\n"[..]);
        assert_eq!(accounts_for(&crlf, &name).unwrap().0, frames, "{name}: CRLF");
        // The last line lacks its second half.
        let last = lines.last().unwrap();
        let mut cut = lines.clone();
        cut[lines.len() - 1] = last[..last.len() / 2].to_vec();
        let (found, _) = accounts_for(&cut.join(&b"\n"[..]), &format!("{name}, cut")).unwrap();
        assert_eq!(found[..frames.len() - 1], frames[..frames.len() - 1], "{name}: truncated");
    }
}

/// Formats whose frames have several lines, or in whose captures any text may be a comment.
const FREE_TEXT: [&str; 4] = ["tshark", "ros-echo", "ctt", "csv"];

/// Texts of all formats and programs.
fn known_texts() -> Vec<(String, Vec<u8>)> {
    let formats = FORMATS.iter().filter(|format| format.is_text && !FREE_TEXT.contains(&format.name));
    let samples = formats.filter_map(|format| {
        let all = files(&format!("fuzz/{}", format.name));
        all.into_iter().find(|(name, _)| name == "sample").map(|(_, text)| (format.name.to_owned(), text))
    });
    // A frame on several lines, and excerpts of a few equal rows, which other lines make unclear.
    let others = ["esp32-twai", "cansend-frames", "python-can-printer"];
    let programs = files("programs").into_iter().filter(|(name, _)| !others.contains(&name.as_str()));
    samples.chain(programs).collect()
}

#[test]
fn a_bad_line_in_any_format_is_counted_once_and_the_others_are_read() {
    let (mut found, mut tested) = (Vec::new(), 0);
    for (name, text) in known_texts() {
        let (frames, _) = read(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        let end = text.iter().rposition(|byte| !matches!(byte, b'\r' | b'\n')).unwrap() + 1;
        let line_end: &[u8] = if text.contains(&b'\n') { b"\n" } else { b"\r" };
        for (what, line) in [
            ("broken", &b"%&/ 11 22 33 44 zz 55 66"[..]),
            ("1 MB", &vec![b'7'; 1_000_000][..]),
            ("identifier of nine digits", b"0x123456789 8 11 22 33 44 55 66 77 88"),
            ("terminal escapes", b"\x1b[31mred\x1b[0m \x07\x1b]0;title\x07 zz"),
        ] {
            // Repeated, so that one line is less than a tenth of an inferred layout.
            let whole = [&text[..end], line_end].concat().repeat(12);
            let bad = [&whole[..], line, line_end, &text[..end], line_end].concat();
            // Times that start again are refused without a name of the format.
            let Ok((all, before)) = read(&whole) else { continue };
            let Ok((read_frames, after)) = read(&bad) else {
                found.push(format!("{name}, {what}: refused"));
                continue;
            };
            tested += 1;
            // Rows that no longer fit their format may still be read by their columns.
            let is_same = read_frames.len() == all.len() + frames.len();
            // The header of a further part may be text, too.
            let (before, after) = (skipped_lines(&before), skipped_lines(&after));
            if !is_same || !(before + 1..=before + before / 12 + 2).contains(&after) {
                found.push(format!(
                    "{name}, {what}: {} of {} frames, {before} lines skipped, then {after}",
                    read_frames.len(),
                    all.len() + frames.len()
                ));
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
    assert!(tested >= 80, "{tested}");
}

#[test]
fn two_layouts_in_one_file_are_not_mixed() {
    let all = long_layouts();
    for (first, lines) in &all {
        for (second, other) in &all {
            let text = [&lines[..], &other[..]].concat().join(&b"\n"[..]);
            let Some((frames, _)) = accounts_for(&text, &format!("{first}, {second}")) else { continue };
            // Frames of the second layout are read only if they are the same ones.
            for frame in &frames {
                let known = FRAMES.iter().any(|(_, expected, _)| *expected == essence(frame));
                assert!(known, "{first}, {second}: {frame:?}");
            }
        }
    }
}

#[test]
fn utf_16_is_refused_with_the_remedy() {
    for (name, text) in files("layouts") {
        let text = String::from_utf8(text).unwrap();
        let mut encoded = vec![0xFF, 0xFE];
        encoded.extend(text.encode_utf16().flat_map(u16::to_le_bytes));
        let error = read(&encoded).unwrap_err();
        assert!(error.contains("UTF-16; save it as UTF-8"), "{name}: {error}");
    }
}

#[test]
fn equal_lines_are_frames_too() {
    let (frames, _) = read("0.100 Rx 701 1 05\n".repeat(500).as_bytes()).unwrap();
    assert_eq!(frames.len(), 500);
}

#[test]
fn ambiguous_lines_are_refused_with_the_guess() {
    for (text, reason) in [
        // ISO-TP: the first byte is the number of bytes that follow, or a length.
        ("7DF 02 01 0C\n7E8 04 41 0C 1A F8\n7DF 02 01 0D\n7E8 03 41 0D 00\n", "another layout fits"),
        // Digits of both bases.
        ("id 181 len 2 data 37 2\nid 182 len 2 data 38 12\nid 601 len 2 data 40 9\n", "data:hex or data:dec"),
        ("id 1409 len 2 data 3A 2\nid 1410 len 2 data 3B 12\n", "id:hex or id:dec"),
    ] {
        let error = read(text.as_bytes()).unwrap_err();
        assert!(error.contains(reason) && error.contains("nearest layout: --columns '"), "{error}");
    }
}

#[test]
fn stated_columns_take_precedence() {
    let text = "7DF 02 01 0C\n7E8 04 41 0C 1A F8\n";
    let frames = |columns: &str| {
        let options = ReadOptions { columns: Some(columns.parse().unwrap()), ..ReadOptions::default() };
        let mut reader = CaptureReader::open(text.as_bytes(), &options).unwrap();
        let (mut batch, mut found) = (Batch::new(), Vec::new());
        while reader.read(&mut batch).unwrap() {
            found.extend(batch.frames().iter().map(essence));
        }
        found
    };
    assert_eq!(frames("id data"), ["7DF#02010C", "7E8#04410C1AF8"]);
    assert_eq!(frames("id len data"), ["7DF#010C", "7E8#410C1AF8"]);
}
