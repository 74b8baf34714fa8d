//! The same frames in every text form of candump: `fixtures/dialects/`.

use std::fs;
use std::path::Path;

use cobscope_decoder::capture::{Batch, CaptureReader, Notice, ReadOptions};
use cobscope_decoder::frame::{Frame, FrameFlags};

/// Content of a capture that every dialect can express.
struct Content {
    frames: Vec<Frame>,
    notices: Vec<Notice>,
    buses: Vec<String>,
    format: &'static str,
}

fn read(name: &str) -> Content {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/dialects").join(name);
    let bytes = fs::read(&path).unwrap();
    let mut reader = CaptureReader::open(&bytes[..], &ReadOptions::default()).unwrap();
    let mut batch = Batch::new();
    let (mut frames, mut notices) = (Vec::new(), Vec::new());
    while reader.read(&mut batch).unwrap() {
        frames.extend_from_slice(batch.frames());
        notices.extend(batch.notices().iter().map(|(_, notice)| notice.clone()));
    }
    Content { frames, notices, buses: reader.buses().names().to_vec(), format: reader.format().name }
}

/// Identifier, kind, length, data and bus number, without time, direction and bus name.
fn essence(frame: &Frame) -> String {
    let kind = frame.flags.0 & !(FrameFlags::TRANSMITTED.0 | FrameFlags::RECEIVED.0);
    format!("{} {} {kind:02X} {} {:02X?}", frame.bus.0, frame.id, frame.length, frame.data())
}

/// Without the bit rate switch and error state of FD frames, which the screen forms do not show.
fn screen_essence(frame: &Frame) -> String {
    let mut frame = *frame;
    let shown = FrameFlags::REMOTE.0 | FrameFlags::ERROR.0 | FrameFlags::FD.0;
    frame.flags = FrameFlags(frame.flags.0 & shown);
    essence(&frame)
}

fn essences(name: &str, of: fn(&Frame) -> String) -> Vec<String> {
    let content = read(name);
    assert_eq!(content.format, "candump", "{name}");
    let bad: Vec<_> = content.notices.iter().filter(|n| matches!(n, Notice::Unreadable { .. })).collect();
    assert!(bad.is_empty(), "{name}: {bad:?}");
    content.frames.iter().map(of).collect()
}

#[test]
fn log_forms_hold_the_same_frames() {
    let source = essences("candump_L.log", essence);
    assert_eq!(source.len(), 33);
    for name in [
        "candump_L_ns.log",
        "candump_L_x.log",
        "lower_case.log",
        "dotted.log",
        "crlf.log",
        "cr_only.log",
        "bom.log",
        "bom_crlf.log",
        "no_last_newline.log",
        "blank_lines.log",
        "candump_l.log",
        "candump_L_real.log",
        "pasted_L.log",
    ] {
        assert_eq!(essences(name, essence), source, "{name}");
    }
}

#[test]
fn screen_forms_hold_the_same_frames() {
    let source = essences("candump_L.log", screen_essence);
    for name in [
        "candump.txt",
        "candump_a.txt",
        "candump_c.txt",
        "candump_c_c_ta.txt",
        "candump_c_c_c_ta.txt",
        "candump_e.txt",
        "candump_e_new.txt",
        "candump_i.txt",
        "candump_S.txt",
        "candump_S_a.txt",
        "candump_ta.txt",
        "candump_ta_a.txt",
        "candump_tA.txt",
        "candump_td.txt",
        "candump_tz.txt",
        "log2long.txt",
        "pasted_ta.txt",
    ] {
        assert_eq!(essences(name, screen_essence), source, "{name}");
    }
    // With direction marks, the screen forms also show BRS and ESI.
    let source = essences("candump_L.log", essence);
    for name in ["candump_x.txt", "candump_ta_x.txt", "candump_ta_x_e_a.txt"] {
        assert_eq!(essences(name, essence), source, "{name}");
        assert!(
            read(name).frames.iter().all(|frame| frame.flags.contains(FrameFlags::TRANSMITTED)),
            "{name}"
        );
    }
}

#[test]
fn times_mean_the_same_in_all_styles() {
    let since_first = |name: &str| {
        let frames = read(name).frames;
        let first = frames[0].time.unwrap();
        frames.iter().map(|frame| frame.time.unwrap().since(first) / 1000).collect::<Vec<_>>()
    };
    let source = since_first("candump_l.log");
    for name in ["candump_L_real.log", "candump_ta.txt", "candump_tA.txt", "candump_tz.txt", "candump_td.txt"]
    {
        let times = since_first(name);
        // -t d prints differences, so rounding errors add up: 1 µs per frame.
        let close = times.iter().zip(&source).all(|(a, b)| (a - b).abs() <= 40);
        assert!(close && times.len() == source.len(), "{name}: {times:?} {source:?}");
    }
    assert!(read("candump.txt").frames.iter().all(|frame| frame.time.is_none()));
    let nanoseconds = read("candump_L_ns.log").frames;
    assert!(nanoseconds.iter().all(|frame| frame.time.unwrap().0 % 1000 == 123));
    assert!(
        read("candump_tA.txt")
            .notices
            .iter()
            .any(|n| matches!(n, Notice::Assumption(t) if t.contains("UTC")))
    );
}

#[test]
fn raw_dlc_survives() {
    let raw = |name: &str| {
        read(name).frames.iter().map(|frame| frame.raw_dlc).filter(|dlc| *dlc != 0).collect::<Vec<_>>()
    };
    assert!(raw("candump_L_8.log").starts_with(&[9, 10, 11, 12, 13, 14, 15]));
    assert!(raw("candump_ta_8.txt").starts_with(&[9, 10, 11, 12, 13, 14, 15]));
}

#[test]
fn can_xl_is_reported_as_unsupported() {
    for (name, count) in [("candump_L_xl.log", 5), ("candump_ta_xl.txt", 2)] {
        let content = read(name);
        assert_eq!(content.frames.len(), 2, "{name}");
        let xl = content.notices.iter().filter(|n| n.to_string().contains("CAN XL")).count();
        assert_eq!(xl, count, "{name}: {:?}", content.notices);
    }
}

#[test]
fn lost_frames_and_padded_names() {
    let content = read("dropped_ta_d.txt");
    assert_eq!(content.frames.len(), 12);
    assert!(content.notices.iter().any(|n| matches!(n, Notice::LostFrames { count: Some(55), .. })));
    for name in ["padded_L.log", "padded_ta.txt", "padded_two_sockets_ta.txt"] {
        let mut buses = read(name).buses;
        buses.sort();
        assert_eq!(buses, ["c9", "vcan0"], "{name}");
    }
    assert_eq!(read("two_sockets_ta.txt").frames.len(), 33);
}

#[test]
fn each_bad_line_is_named_and_the_rest_is_read() {
    let content = read("bad_lines.log");
    // Identifiers have 1 to 8 digits; one above 7FFh is extended.
    assert_eq!(content.frames.len(), 20);
    let lines: Vec<String> =
        content.notices.iter().map(|n| n.to_string().split(':').next().unwrap().to_owned()).collect();
    let expected: Vec<String> = (4..=16).map(|n| format!("line {}", 2 * n)).collect();
    assert_eq!(lines, expected, "{:?}", content.notices);
}

fn read_text(text: &str) -> crate::formats_text::Content {
    crate::formats_text::read(text.as_bytes()).unwrap()
}

/// Issues and mails indent, quote and fence what was copied from a terminal.
#[test]
fn pasted_lines_keep_their_frames_and_the_text_around_them_is_counted() {
    let text = "```\n\t(1.000000) can0 701#05\nuser@machine:~$ candump can0\n> (2.000000) can0 701#05\n\t can0  601   [2]  40 18\n\
                \tcontroller-problem{rx-overflow}\n^C\n```\n";
    let content = read_text(text);
    let frames: Vec<_> = content.frames.iter().map(essence).collect();
    assert_eq!(frames, ["0 701 00 1 [05]", "0 701 00 1 [05]", "0 601 00 2 [40, 18]"]);
    let notices: Vec<_> = content.notices.iter().map(ToString::to_string).collect();
    assert_eq!(notices, ["4 lines of a shell prompt or Markdown skipped (first: line 1)"]);
}

#[test]
fn broken_lines_after_a_tab_are_named() {
    let content = read_text("\t(1.000000) can0 701#05\n\t(2.000000) can0 701#0\n\tcan0 was restarted\n");
    let notices: Vec<_> = content.notices.iter().map(ToString::to_string).collect();
    assert_eq!(
        notices,
        [
            "line 2: data: expected pairs of hex digits; found \"\\t(2.000000) can0 701#0\"",
            "line 3: not a candump line; found \"\\tcan0 was restarted\"",
        ]
    );
}
