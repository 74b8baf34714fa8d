//! Text without a known format on the command line.

use crate::cli::run;

/// Read requests and responses of ISO-TP, in which the first byte may be a length.
const OPEN: &str = "7DF 02 01 0C\n7E8 04 41 0C 1A F8\n7DF 02 01 0D\n7E8 03 41 0D 00\n";

#[test]
fn one_line_states_the_columns() {
    let text = "13:22:10.100 Rx 701 [1] 05\n13:22:10.120 Tx 601 [2] 40 41\nrestarted\n13:22:10.200 Rx 181 [2] 37 02\n";
    let output = run(&["decode", "-f", "jsonl", "-"], text);
    assert_eq!(output.code, 0, "{}", output.stderr);
    let stated =
        "no known format: columns: time of day, identifier, length, 1 to 2 bytes; 3 of the first 4 lines";
    assert!(output.stdout.contains(stated), "{}", output.stdout);
    assert!(output.stdout.contains("1 line without a frame skipped (first: line 3)"), "{}", output.stdout);
}

#[test]
fn a_refusal_prints_the_guess() {
    let output = run(&["decode", "-"], OPEN);
    assert_eq!(output.code, 3, "{}", output.stderr);
    assert!(
        output.stderr.contains("nearest layout: --columns 'id data' (4 of 4 lines): ambiguous"),
        "{}",
        output.stderr
    );
}

#[test]
fn stated_columns_correct_it() {
    let output = run(&["stats", "--columns", "id data", "-"], OPEN);
    assert_eq!(output.code, 0, "{}", output.stderr);
    assert!(output.stdout.contains("4 frames"), "{}", output.stdout);
    let output = run(&["stats", "--columns", "id bytes", "-"], OPEN);
    assert_eq!(output.code, 2);
    assert!(
        output.stderr.contains("unknown column \"bytes\"; expected time, delta, date, id, len, data"),
        "{}",
        output.stderr
    );
}
