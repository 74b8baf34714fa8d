//! Tokens, names of columns, units and stated columns. Whole layouts are in `tests/decoder/layouts.rs`.

use std::fmt::Write as _;

use super::facts::infer_unit;
use super::token::{Dialect, TokenKind, Tokens};
use super::words::{column_name, is_bus_name};
use crate::capture::column_list::ColumnList;
use crate::capture::column_list::{ColumnRole, ColumnUnit};
use crate::capture::testing::{read_capture, read_in_pieces};

/// Types and texts of the tokens of a line.
fn split(line: &str, dialect: Dialect) -> Vec<(TokenKind, String)> {
    let mut tokens = Tokens::default();
    tokens.split_line(line.as_bytes(), dialect);
    let text =
        |token: &super::token::Token| String::from_utf8_lossy(token.text(line.as_bytes())).into_owned();
    tokens.list().iter().map(|token| (token.kind, text(token))).collect()
}

#[test]
fn numbers_are_found_between_marks_and_names() {
    use TokenKind::{Clock, Date, Fraction, Hex, Quantity, Word};
    for (line, expected) in [
        ("[12:01:22.5] ID=0x181", vec![(Clock, "12:01:22.5"), (Word, "ID"), (Hex, "181")]),
        ("Time:12:01:22.5 18FEF100x", vec![(Word, "Time"), (Clock, "12:01:22.5"), (Hex, "18FEF100")]),
        ("181h: {37,02}", vec![(Hex, "181"), (Hex, "37"), (Hex, "02")]),
        ("37-02-A0 2024-05-01", vec![(Hex, "37"), (Hex, "02"), (Hex, "A0"), (Date, "2024-05-01")]),
        ("2024-05-01T08:17:32.5Z", vec![(Date, "2024-05-01T08:17:32.5Z")]),
        ("-0.5 12ms -> $7FF", vec![(Fraction, "-0.5"), (Quantity, "12ms"), (Word, "->"), (Hex, "7FF")]),
        ("DLC:8 can0 Rx.", vec![(Word, "DLC"), (Hex, "8"), (Word, "can0"), (Word, "Rx")]),
        ("37:02:A0:FF", vec![(Hex, "37"), (Hex, "02"), (Hex, "A0"), (Hex, "FF")]),
    ] {
        let found = split(line, Dialect::default());
        let expected: Vec<_> = expected.into_iter().map(|(kind, text)| (kind, text.to_owned())).collect();
        assert_eq!(found, expected, "{line}");
    }
}

#[test]
fn a_dialect_decides_about_commas_and_colons() {
    let decimal = Dialect { decimal_comma: true, ..Dialect::default() };
    assert_eq!(split("12,5 181", decimal)[0], (TokenKind::Fraction, "12,5".into()));
    assert_eq!(split("12,5 181", Dialect::default()).len(), 3);
    assert_eq!(split("0A,5", decimal).len(), 2);
    let bytes = Dialect { colon_bytes: true, ..Dialect::default() };
    assert_eq!(split("12:01:22", bytes).len(), 3);
    assert_eq!(split("12:01:22.5", bytes).len(), 1);
}

#[test]
fn names_of_columns_state_units_and_bases() {
    let of = |text: &str| column_name(text.as_bytes());
    let role = |text: &str| of(text).map(|name| name.role);
    for (text, expected) in [
        ("CAN-ID", ColumnRole::Id),
        ("Message ID (hex)", ColumnRole::Id),
        ("Kennung", ColumnRole::Id),
        ("帧ID", ColumnRole::Id),
        ("Länge", ColumnRole::Length),
        ("Data Bytes", ColumnRole::Data),
        ("D3", ColumnRole::Data),
        ("Rx/Tx", ColumnRole::Direction),
        ("Zeit [ms]", ColumnRole::Time),
        ("Nr.", ColumnRole::Counter),
    ] {
        assert_eq!(role(text), Some(expected), "{text}");
    }
    assert_eq!(of("Time (us)").unwrap().unit, Some(ColumnUnit::Microseconds));
    assert_eq!(of("id dec").unwrap().is_decimal, Some(true));
    assert_eq!(of("data[7]").unwrap().byte, Some(7));
    for text in ["", "pressure", "ids", "temperature", "181"] {
        assert_eq!(role(text), None, "{text}");
    }
    assert!(is_bus_name(b"can0") && is_bus_name(b"CAN_1") && !is_bus_name(b"canopen") && !is_bus_name(b"x1"));
}

/// Times of [`infer_unit`] are billionths of a unit.
fn unit_of(values: &[i64], digits: usize) -> Option<ColumnUnit> {
    let values: Vec<i128> = values.iter().map(|value| i128::from(*value) * 1_000_000).collect();
    infer_unit(&values, digits)
}

#[test]
fn a_unit_is_inferred_only_from_evidence() {
    // In thousandths: whole numbers with steps of 66 and 1,000 units.
    let whole = |values: &[i64]| unit_of(&values.iter().map(|value| value * 1_000).collect::<Vec<_>>(), 0);
    assert_eq!(whole(&[1_493_397_796, 1_493_397_862, 1_493_398_862]), Some(ColumnUnit::Milliseconds));
    assert_eq!(whole(&[10, 12, 12, 30]), Some(ColumnUnit::Milliseconds));
    // 250 µs and 250 ms are both possible.
    assert_eq!(whole(&[1_000, 1_250, 1_500]), None);
    // Seconds since 1970 without a fraction.
    assert_eq!(whole(&[1_714_550_000, 1_714_550_000, 1_714_550_001]), None);
    assert_eq!(whole(&[1_714_550_000_123, 1_714_550_000_423]), Some(ColumnUnit::Milliseconds));
    assert_eq!(unit_of(&[12, 25, 40], 3), Some(ColumnUnit::Seconds));
    // One frame in 10 s, or in 10 ms.
    assert_eq!(unit_of(&[1_298_945, 1_308_945, 1_318_945], 3), None);
}

#[test]
fn stated_columns_print_as_they_are_parsed() {
    for text in ["time:ms id len data", "delta:us bus id:dec data:dec", "skip date time id data dir"] {
        assert_eq!(text.parse::<ColumnList>().unwrap().to_string(), text);
    }
    assert_eq!("time,id,dlc,data".parse::<ColumnList>().unwrap().to_string(), "time id len data");
    for (text, part) in [
        ("time id", "0 columns data"),
        ("id id data", "2 columns id"),
        ("id data size", "unknown column \"size\""),
        ("time:h id data", "unknown unit \"h\""),
        ("id data len:hex", "len:hex"),
    ] {
        let error = text.parse::<ColumnList>().unwrap_err();
        assert!(error.contains(part), "{text}: {error}");
    }
    assert!(["skip"; 33].join(" ").parse::<ColumnList>().unwrap_err().contains("more than 32"));
}

#[test]
fn the_size_of_the_pieces_does_not_matter() {
    let mut text = String::from("started\n");
    for number in 0..4_000 {
        let _ = writeln!(text, "{}.{:03} Rx 181 2 {:02X} 02", number / 1_000, number % 1_000, number % 256);
    }
    text.push_str("ID 5\nend of the list\n");
    let whole = read_capture(text.as_bytes());
    assert_eq!(whole.frames.len(), 4_000);
    for sizes in [&[1_000_usize][..], &[7, 60_000], &[131_072, 1]] {
        assert_eq!(read_in_pieces(text.as_bytes(), sizes), whole, "{sizes:?}");
    }
}

#[test]
fn frames_on_several_lines_end_with_the_capture() {
    let content = read_capture(b"ID: 0x181\nDLC: 2\nData: 37 02\n\nID: 0x701\nDLC: 1\nData: 05");
    let frames: Vec<String> =
        content.frames.iter().map(|frame| format!("{}#{:?}", frame.id, frame.data())).collect();
    assert_eq!(frames, ["181#[55, 2]", "701#[5]"]);
}

#[test]
fn remote_and_error_frames_have_words() {
    let content = read_capture(
        b"0.1 Rx 181 2 data 37 02\n0.2 Rx 182 1 data 05\n0.3 Rx 701 1 remote\n0.4 Rx 184 3 data 05 02 07\n\
          0.5 error\n0.6 Tx 183 1 data 06\n0.7 Tx 185 1 data 06\n",
    );
    let flags: Vec<u8> = content.frames.iter().map(|frame| frame.flags.0).collect();
    // Received 40, remote 01, error 02, transmitted 20.
    assert_eq!(flags, [0x40, 0x40, 0x41, 0x40, 0x02, 0x20, 0x20], "{:?}", content.items);
}

#[test]
fn a_name_with_a_truth_value_is_not_a_frame_type() {
    let text = "RX EXT=0 RTR: 0 ID=181 DLC=2 DATA=37,02\nRX EXT=0 RTR: 0 ID=701 DLC=1 DATA=05\n\
                RX EXT=1 RTR: 0 ID=701 DLC=3 DATA=FF,FF,FF\n";
    let frames: Vec<String> = read_capture(text.as_bytes())
        .frames
        .iter()
        .map(|frame| format!("{}#{}", frame.id, frame.length))
        .collect();
    assert_eq!(frames, ["181#2", "701#1", "00000701#3"]);
}

#[test]
fn identifiers_with_a_mark_need_no_name_and_no_order() {
    for (text, expected) in [
        (
            "40 0A 10 00 00 00 00 00 603h\n41 0A 10 00 11 00 00 00 583h\n60 0A 10 00 00 00 00 00 603h\n",
            ["603", "583", "603"],
        ),
        (
            "MSG 0x705 S 1 05\nMSG 0x185 S 2 37 02\nMSG 0x18FEF100 X 8 FF FF FF FF FF FF FF FF\n",
            ["705", "185", "18FEF100"],
        ),
        (
            "0.1 CAN 00000705   1: 05\n0.2 CAN 00000185   2: 37 02\n0.3 CAN 18fef100x  3: ff ff ff\n",
            ["705", "185", "18FEF100"],
        ),
    ] {
        let ids: Vec<String> =
            read_capture(text.as_bytes()).frames.iter().map(|frame| frame.id.to_string()).collect();
        assert_eq!(ids, expected, "{text}");
    }
}
