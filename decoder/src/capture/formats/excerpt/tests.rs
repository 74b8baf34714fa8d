//! Rows of every pattern, text around them, and text that is not an excerpt.

use crate::capture::testing::{ParsedCapture, read_capture, read_in_pieces};
use crate::capture::{CaptureReader, ReadOptions};

/// The frame of a row, without its number.
fn frames(content: &ParsedCapture) -> Vec<String> {
    let text = |frame: &crate::frame::Frame| {
        let time = frame.time.map_or("-".into(), |time| time.to_string());
        let bus = &content.buses[usize::from(frame.bus.0)];
        let mut data = Vec::new();
        crate::ascii::push_hex(&mut data, frame.data());
        format!("{time} {bus} {}#{} {:02X}", frame.id, String::from_utf8(data).unwrap(), frame.flags.0)
    };
    content.frames.iter().map(text).collect()
}

/// One row of each pattern, and its frame: expected values follow from the columns that the note names.
#[test]
fn a_row_of_every_pattern() {
    let (rx, tx) = (FLAGS.0, FLAGS.1);
    for (row, expected) in [
        ("  228     18235.579 DT     0670 Rx 2  23 47", format!("18.235579000 1 670#2347 {rx}")),
        ("      3      1298.945 DT 2      0601 Tx -  2    40 18", format!("1.298945000 2 601#4018 {tx}")),
        ("     3)      1298.945 1  Tx        0601 -  2    40 18", format!("1.298945000 1 601#4018 {tx}")),
        ("     3)      1298.945  1  Tx         0601  2  40 18", format!("1.298945000 1 601#4018 {tx}")),
        ("     3)      1298.9  Tx         0601  2  40 18", format!("1.298900000 1 601#4018 {tx}")),
        ("     1)      1841      0601  2  40 18", "1.841000000 1 601#4018 00".into()),
        ("(1700000000.000001) 601#4018", "1700000000.000001000 1 601#4018 00".into()),
        ("  601   [2]  40 18", "- 1 601#4018 00".into()),
        ("701#R", "- 1 701# 01".into()),
        (
            "Timestamp:        1.500000    ID: 0181    S Rx                DL:  2    40 18    '@.'  Channel: can0",
            format!("1.500000000 can0 181#4018 {rx}"),
        ),
        ("67F Tx SD  2  23 14", format!("- 1 67F#2314 {tx}")),
        ("CAN1  67F Tx XD  2  23 14", format!("- CAN1 0000067F#2314 {tx}")),
        ("0.1234 601h Tx Data 2 40 18", format!("0.123400000 1 601#4018 {tx}")),
        ("1,5 0x601 rx 2 40 18", format!("1.500000000 1 601#4018 {rx}")),
        ("0.5 18FEF100 2 40 18", "0.500000000 1 18FEF100#4018 00".into()),
        ("181h 2 40 18 100.1 12", "- 1 181#4018 00".into()),
        ("12.250 601: 40 18", "12.250000000 1 601#4018 00".into()),
        ("601: 40 18", "- 1 601#4018 00".into()),
        ("23:59:59.5 601: 40 18", "86399.500000000 1 601#4018 00".into()),
    ] {
        let content = read_capture(row.as_bytes());
        assert_eq!(frames(&content), [expected], "{row}");
        assert!(content.items[0].contains("rows read as"), "{row}: {:?}", content.items);
        assert_eq!(content.items.len(), 2, "{row}: {:?}", content.items);
    }
}

const FLAGS: (&str, &str) = ("40", "20");

fn is_read(text: &str) -> bool {
    CaptureReader::open(text.as_bytes(), &ReadOptions::default()).is_ok()
}

#[test]
fn every_line_must_fit_one_pattern() {
    for text in [
        "67F Tx SD 2 23 14\nhello\n",
        "67F Tx SD 2 23 14\n601: 40 18\n",
        "67F Tx SD 3 23 14\n",
        "67F Tx SD 2 23 14 00\n",
        "67F Tx SD 2 2 14\n",
        "800h Tx SD 2 23 14\n",
        "00000010: 40 18 10 01\n00000020: 40 18 10 01\n",
        "1 2 3 4 5\n",
        "12 601: 40\n",
        "one two\n",
        "Time ID Data\n",
        "```\n```\n",
        "12:30: 40\n",
    ] {
        assert!(!is_read(text), "{text}");
    }
}

#[test]
fn text_around_the_rows_is_skipped_and_counted() {
    let text = "\u{feff}```\r\n> CAN-ID Rx/Tx Type Length Data\r\n> 67F Tx SD 2 23 14\n\n>> 5FF Rx SD 1 60\n$ dmesg\n~~~\n";
    let content = read_capture(text.as_bytes());
    assert_eq!(frames(&content), [format!("- 1 67F#2314 {}", FLAGS.1), format!("- 1 5FF#60 {}", FLAGS.0)]);
    let last = content.items.last().unwrap();
    assert_eq!(last, "3 lines of a shell prompt or Markdown skipped (first: line 1)");
    for sizes in [&[1][..], &[7, 3], &[1_000_000]] {
        assert_eq!(read_in_pieces(text.as_bytes(), sizes), content, "{sizes:?}");
    }
}

#[test]
fn a_row_that_does_not_fit_after_the_first_lines_is_reported() {
    let mut text = "67F Tx SD 2 23 14\n".repeat(8_000);
    text.push_str("67F Tx SD 2 23 1G\n67F Tx SD 2 23 15\n");
    let content = read_capture(text.as_bytes());
    assert_eq!(content.frames.len(), 8_001);
    let bad = content.items.iter().find(|item| item.starts_with("line")).unwrap();
    assert_eq!(bad, "line 8001: row: expected the pattern of the first lines; found \"67F Tx SD 2 23 1G\"");
}

#[test]
fn times_of_day_pass_midnight() {
    let content = read_capture(b"23:59:59.9 601: 40\n00:00:00.1 601: 40\n");
    assert_eq!(content.frames[1].time.unwrap().since(content.frames[0].time.unwrap()), 200_000_000);
}
