//! Kernel filters in candump's notation: the program receives the same frames as candump.

use crate::harness::{in_guest, send};
use crate::pair::Pair;

/// Filter part for the frame that marks start and end of a comparison.
const GREETING: &str = "1FFFFFFF:1FFFFFFF";

const SENT: [&str; 12] = [
    "123#01",
    "124#02",
    "00000123#03",
    "3FF#04",
    "400#05",
    "40F#06",
    "410#07",
    "123#R4",
    "123##108",
    "20000004#0010000000006000",
    "20000008#0000000000000000",
    "20000040#0000000000000000",
];

/// Error frames, received without an error mask.
const ERRORS: [&str; 3] =
    ["20000004#0010000000006000", "20000008#0000000000000000", "20000040#0000000000000000"];

/// Compares the frames that pass `filters` with those derived by hand.
fn passes(filters: &str, wanted: &[&str]) {
    if !in_guest() {
        return;
    }
    let pair = Pair::start(&format!("vcan0,{GREETING},{filters}"), "vcan0");
    send("vcan0", &SENT);
    let records = pair.end();
    let errors: &[&str] = if filters.contains('#') { &[] } else { &ERRORS };
    let wanted = [wanted, errors].concat();
    records.assert_same(wanted.len());
    assert_eq!(records.frames(), wanted);
}

#[test]
fn a_value_and_its_mask_let_pass_what_fits() {
    passes("123:7FF", &["123#01", "00000123#03", "123#R4", "123##108"]);
}

#[test]
fn the_bits_above_an_identifier_distinguish_standard_data_frames() {
    passes("123:C00007FF", &["123#01", "123##108"]);
}

#[test]
fn eight_digits_are_an_extended_identifier() {
    passes("00000123:9FFFFFFF", &["00000123#03"]);
}

#[test]
fn an_inverted_filter_lets_pass_what_does_not_fit() {
    let wanted = ["123#01", "124#02", "00000123#03", "3FF#04", "410#07", "123#R4", "123##108"];
    passes("400~7F0", &wanted);
}

#[test]
fn an_error_mask_of_nothing_lets_pass_no_errors() {
    passes("124:7FF,#0", &["124#02"]);
}

#[test]
fn an_error_mask_lets_pass_these_classes_of_errors() {
    passes("7EE:7FF,#00000044", &["20000004#0010000000006000", "20000040#0000000000000000"]);
}
