//! Lines of both programs; expected identifiers were derived by hand from SAE J1939-21: priority in bits 26 to 28, PGN in
//! bits 8 to 25, source in bits 0 to 7.

use super::*;
use crate::capture::testing::{read_capture, read_in_pieces};
use crate::words::UNKNOWN_ZONE;

#[test]
fn messages_of_actisense() {
    // PGN 1F805h (129029), 43 bytes: 6 + 5 × 7 + 2.
    let long = std::array::from_fn::<_, 43, _>(|byte| format!("{byte:02X}")).concat();
    let text = format!(
        "A173321.107 23FF7 1F112 012F3070002F30FF\r\nA173321.108 23FF3 1F805 {long}\r\nA000000.000 23056 0EA00 14F001\r\n"
    );
    let whole = read_capture(text.as_bytes());
    assert_eq!(whole, read_in_pieces(text.as_bytes(), &[3, 1, 40]));
    assert_eq!(
        whole.items[..7],
        [
            OF_DAY,
            "{1} (63201.107000000) bus0 1DF11223#012F3070002F30FF flags=00 dlc=0",
            BUILT,
            "{2} (63201.108000000) bus0 0DF80523#002B000102030405 flags=00 dlc=0",
            "{3} (63201.108000000) bus0 0DF80523#01060708090A0B0C flags=00 dlc=0",
            "{4} (63201.108000000) bus0 0DF80523#020D0E0F10111213 flags=00 dlc=0",
            "{5} (63201.108000000) bus0 0DF80523#031415161718191A flags=00 dlc=0",
        ]
    );
    assert_eq!(
        whole.items[7..],
        [
            "{6} (63201.108000000) bus0 0DF80523#041B1C1D1E1F2021 flags=00 dlc=0",
            "{7} (63201.108000000) bus0 0DF80523#0522232425262728 flags=00 dlc=0",
            "{8} (63201.108000000) bus0 0DF80523#06292AFFFFFFFFFF flags=00 dlc=0",
            // Destination 05, and the next midnight.
            "{9} (86400.000000000) bus0 18EA0523#14F001 flags=00 dlc=0",
        ]
    );
}

#[test]
fn lines_of_canboat() {
    let text = "# format=FAST\n2011-11-24-22:42:04.388,2,127251,36,255,8,7d,0b,7d,02,00,ff,ff,ff\n\
                2011-11-24T22:42:04.390Z,6,59904,1,36,3,14,f0,01\n\
                2011-11-24Z22:42:05.000,3,129029,36,255,9,00,01,02,03,04,05,06,07,08\n\
                2011-11-24Z22:42:06.000,3,129029,36,255,9,00,01,02,03,04,05,06,07,08\n";
    // `date -u -d '2011-11-24 22:42:04.388' +%s.%N`
    assert_eq!(
        read_capture(text.as_bytes()).items,
        [
            UNKNOWN_ZONE,
            "{1} (1322174524.388000000) bus0 09F11324#7D0B7D0200FFFFFF flags=00 dlc=0",
            "{2} (1322174524.390000000) bus0 18EA2401#14F001 flags=00 dlc=0",
            BUILT,
            "{3} (1322174525.000000000) bus0 0DF80524#0009000102030405 flags=00 dlc=0",
            "{4} (1322174525.000000000) bus0 0DF80524#01060708FFFFFFFF flags=00 dlc=0",
            "{5} (1322174526.000000000) bus0 0DF80524#2009000102030405 flags=00 dlc=0",
            "{6} (1322174526.000000000) bus0 0DF80524#21060708FFFFFFFF flags=00 dlc=0",
        ]
    );
}

#[test]
fn broken_lines_say_what_was_expected() {
    for (line, expected) in [
        ("B173321.107 23FF7 1F513 01", "time"),
        ("A17332.107 23FF7 1F513 01", "time"),
        ("A173321.107 23FF 1F513 01", "addresses"),
        ("A173321.107 23FF8 1F513 01", "addresses"),
        ("A173321.107 23FF7 4F513 01", "PGN"),
        ("A173321.107 23FF7 1F513 012", "data"),
        ("A173321.107 23FF7 1F513", "data"),
        ("A173321.107 23FF7 1F513 01 x", "expected nothing"),
    ] {
        assert!(parse_actisense(line.as_bytes()).unwrap_err().starts_with(expected), "{line}");
    }
    let longest = format!("A173321.107 23FF7 1F513 {}", "00".repeat(223));
    assert!(parse_actisense(longest.as_bytes()).is_ok());
    assert!(parse_actisense(format!("{longest}00").as_bytes()).is_err());
    for (line, expected) in [
        ("2011-11-24 x,2,127251,36,255,1,7d", "time"),
        ("2011-02-30-22:42:04.388,2,127251,36,255,1,7d", "time"),
        ("2011-11-24-22:42:04.388,8,127251,36,255,1,7d", "addresses"),
        ("2011-11-24-22:42:04.388,2,362144,36,255,1,7d", "PGN"),
        ("2011-11-24-22:42:04.388,2,127251,256,255,1,7d", "addresses"),
        ("2011-11-24-22:42:04.388,2,127251,36,255,2,7d", "length"),
        ("2011-11-24-22:42:04.388,2,127251,36,255,1,7", "data"),
    ] {
        assert!(parse_text(line.as_bytes()).unwrap_err().starts_with(expected), "{line}");
    }
}

#[test]
fn other_texts_are_not_messages() {
    for other in
        ["", "hello\n", "2011-11-24-22:42:04.388,2,3\n", "time,bus,id\n", "A173321 is a part number\n"]
    {
        assert!(!(ACTISENSE.detect)(other.as_bytes()) && !(CANBOAT.detect)(other.as_bytes()), "{other}");
    }
}
