//! Lines from the manual and from the driver's comments, and invalid lines.

use super::*;

/// Replies parsed from `text` in pieces of `size` bytes.
fn replies(text: &[u8], size: usize) -> Vec<SlcanReply> {
    let (mut reader, mut found) = (SlcanReader::default(), Vec::new());
    for piece in text.chunks(size) {
        reader.read_input(piece, |reply| found.push(reply));
    }
    found
}

/// The single frame in `line`, as text, and its milliseconds.
fn one_frame(line: &str) -> (Frame, Option<u16>) {
    let found = replies(line.as_bytes(), usize::MAX);
    let [SlcanReply::Frame(frame, milliseconds)] = &found[..] else { panic!("{line:?} gave {found:?}") };
    (*frame, *milliseconds)
}

#[test]
fn the_frames_of_the_manual() {
    // CAN232 manual, commands t, T, r, R and the notes on Z1.
    let (frame, milliseconds) = one_frame("t10021133\r");
    assert_eq!(
        (frame.id, frame.data(), frame.flags),
        (CanId::Standard(0x100), &[0x11, 0x33][..], FrameFlags(0))
    );
    assert_eq!((frame.length, frame.raw_dlc, frame.time, milliseconds), (2, 0, None, None));
    let (frame, milliseconds) = one_frame("T0000010021133EA5F\r");
    assert_eq!((frame.id, frame.data()), (CanId::Extended(0x100), &[0x11, 0x33][..]));
    assert_eq!(milliseconds, Some(59_999));
    let (frame, milliseconds) = one_frame("r1002\r");
    assert_eq!((frame.id, frame.length, frame.flags), (CanId::Standard(0x100), 2, FrameFlags::REMOTE));
    assert_eq!(milliseconds, None);
    let (frame, milliseconds) = one_frame("R18fef1000001a\r");
    assert_eq!((frame.id, frame.length), (CanId::Extended(0x18FE_F100), 0));
    assert_eq!(milliseconds, Some(26));
    assert_eq!(one_frame("t7FF0\r").0.id, CanId::Standard(0x7FF));
}

#[test]
fn fd_frames_have_dlc_codes() {
    let (frame, milliseconds) = one_frame("d1239000102030405060708090A0B\r");
    assert_eq!(frame.flags, FrameFlags::FD);
    assert_eq!((frame.length, milliseconds), (12, None));
    assert_eq!(frame.data(), (0..12).collect::<Vec<u8>>());
    let line = format!("B1FFFFFFFF{}0001\r", "A5".repeat(64));
    let (frame, milliseconds) = one_frame(&line);
    assert_eq!(frame.flags, FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH));
    assert_eq!((frame.id, frame.length), (CanId::Extended(0x1FFF_FFFF), 64));
    assert_eq!((frame.data(), milliseconds), (&[0xA5; 64][..], Some(1)));
    for (dlc, length) in [('A', 16), ('B', 20), ('C', 24), ('D', 32), ('E', 48)] {
        assert_eq!(one_frame(&format!("b001{dlc}{}\r", "00".repeat(length))).0.data().len(), length);
    }
    assert_eq!(one_frame("D000000010\r").0.length, 0);
}

#[test]
fn a_classic_dlc_above_eight_carries_eight_bytes() {
    let (frame, _) = one_frame("t123F0011223344556677\r");
    assert_eq!((frame.length, frame.raw_dlc), (8, 15));
    let (frame, _) = one_frame("r1239\r");
    assert_eq!((frame.length, frame.raw_dlc), (8, 9));
}

#[test]
fn answers_between_frames() {
    let found = replies(b"\r\x07t0010\rF29\r\nF00\r\n", usize::MAX);
    let frame = Frame::data_frame(CanId::from_standard(1), &[]);
    assert_eq!(
        found,
        [
            SlcanReply::Done,
            SlcanReply::Refused,
            SlcanReply::Frame(frame, None),
            SlcanReply::Flags(StatusFlags(0x29)),
            SlcanReply::Flags(StatusFlags(0)),
        ]
    );
}

#[test]
fn status_flags_in_words() {
    assert_eq!(StatusFlags(0).to_string(), "");
    assert_eq!(StatusFlags(0xA4).to_string(), "error warning, error passive, bus error");
    assert!(StatusFlags(0x01).lost_frames() && StatusFlags(0x08).lost_frames());
    assert!(!StatusFlags(0xF6).lost_frames());
}

#[test]
fn a_state_is_reported_and_becomes_a_socketcan_error_frame() {
    let found = replies(b"sp130005\r", usize::MAX);
    let state = SlcanControllerState {
        confinement: SlcanConfinement::Passive,
        receive_errors: 130,
        transmit_errors: 5,
    };
    let mut frame = Frame::data_frame(CanId::from_extended(0x204), &[0, 0x10, 0, 0, 0, 0, 5, 130]);
    frame.flags = FrameFlags::ERROR;
    assert_eq!(found, [SlcanReply::State(state), SlcanReply::Frame(frame, None)]);
    assert_eq!(state.to_string(), "error passive, rx 130 tx 5");
    // Example from the driver: bus off.
    let [SlcanReply::State(state), SlcanReply::Frame(frame, None)] = &replies(b"sb256256\r", usize::MAX)[..]
    else {
        panic!("expected a state and its frame")
    };
    assert_eq!(state.to_string(), "bus-off, rx 256 tx 256");
    assert_eq!((frame.id, &frame.data()[6..]), (CanId::Extended(0x240), &[255, 255][..]));
}

#[test]
fn bus_errors_become_an_error_frame() {
    // Examples from the driver.
    let (frame, _) = one_frame("e1a\r");
    assert_eq!(frame.flags, FrameFlags::ERROR);
    assert_eq!((frame.id, frame.data()), (CanId::Extended(0xA8), &[0, 0, 0, 0x19, 0, 0, 0, 0][..]));
    let (frame, _) = one_frame("e3bcO\r");
    assert_eq!((frame.id, frame.data()), (CanId::Extended(0x8C), &[0, 2, 8, 8, 0, 0, 0, 0][..]));
}

#[test]
fn unreadable_input_is_reported_with_its_start() {
    for (line, reason) in [
        ("t12", "slcan: frame: ends before its identifier and DLC; found \"t12\""),
        ("t123", "slcan: frame: ends before its identifier and DLC; found \"t123\""),
        (
            "t80001",
            "slcan: identifier: expected at most 7FF, or 1FFFFFFF after a capital letter; found \"t80001\"",
        ),
        (
            "T200000000",
            "slcan: identifier: expected at most 7FF, or 1FFFFFFF after a capital letter; found \"T200000000\"",
        ),
        ("t12x0", "slcan: identifier: expected hex digits; found \"t12x0\""),
        ("t123g", "slcan: DLC: expected a hex digit; found \"t123g\""),
        ("t12321", "slcan: data: fewer bytes than the DLC; found \"t12321\""),
        ("t1231zz", "slcan: data: expected pairs of hex digits; found \"t1231zz\""),
        (
            "t1230123",
            "slcan: after the data: expected nothing or four hex digits of milliseconds; found \"t1230123\"",
        ),
        ("F1", "slcan: expected two hex digits of status flags after F; found \"F1\""),
        ("V1013", "slcan: expected a frame (t, T, r, R, d, D, b, B), F, s or e; found \"V1013\""),
        (
            "e2a",
            "slcan: expected e, a count and that number of letters of a, b, B, c, f, o, O, s; found \"e2a\"",
        ),
        (
            "sx000000",
            "slcan: expected s, then a, w, p or b, and two counters of three digits; found \"sx000000\"",
        ),
        ("\x1b[2J", "slcan: expected a frame (t, T, r, R, d, D, b, B), F, s or e; found \"\\x1b[2J\""),
    ] {
        let found = replies(format!("{line}\rt0010\r").as_bytes(), usize::MAX);
        assert_eq!(found.len(), 2, "{line}");
        assert_eq!(found[0], SlcanReply::Unreadable(reason.into()));
        assert!(matches!(found[1], SlcanReply::Frame(..)), "{line}");
    }
    let [SlcanReply::Unreadable(reason), SlcanReply::Refused] = &replies(b"t1232\x07", usize::MAX)[..] else {
        panic!("expected a broken line and a refusal")
    };
    assert_eq!(reason, "slcan: incomplete line; found \"t1232\"");
}

#[test]
fn a_line_without_end_is_thrown_away_up_to_the_next_end() {
    let mut text = vec![b't'; 1_000];
    text.extend_from_slice(b"\rt0010\r");
    for size in [1, 7, 160, 161, usize::MAX] {
        let found = replies(&text, size);
        let [SlcanReply::Unreadable(reason), SlcanReply::Frame(..)] = &found[..] else {
            panic!("{size}: {found:?}")
        };
        let start = "t".repeat(60);
        assert_eq!(reason, &format!("slcan: line too long (max 160 bytes); found \"{start}…\""));
    }
    let mut reader = SlcanReader::default();
    (0..1_000).for_each(|_| reader.read_input(&[b'x'; 1_000], |reply| panic!("{reply:?}")));
    assert_eq!(reader.begun.bytes.len(), LONGEST_LINE);
}

#[test]
fn pieces_do_not_matter() {
    let text = b"\r\x07t1232AABB0001\rT18FEF1001FF\r\nrubbish\rF08\rt12\x07e1a\rsw097000\rd1239";
    let whole = replies(text, usize::MAX);
    assert_eq!(whole.len(), 11);
    for size in 1..text.len() {
        assert_eq!(replies(text, size), whole, "pieces of {size}");
    }
}

#[test]
fn half_a_line_of_a_lost_connection_is_forgotten() {
    let (mut reader, mut found) = (SlcanReader::default(), Vec::new());
    reader.read_input(b"t12", |reply| found.push(reply));
    reader.reset();
    reader.read_input(b"t0010\r", |reply| found.push(reply));
    assert_eq!(found, [SlcanReply::Frame(Frame::data_frame(CanId::from_standard(1), &[]), None)]);
}

/// All commands.
fn commands() -> Vec<SlcanCommand> {
    let rates = SlcanBitRate::supported_rates()
        .map(|rate| SlcanCommand::SetBitRate(SlcanBitRate::for_rate(rate).unwrap()));
    let others =
        [SlcanCommand::Close, SlcanCommand::TimestampsOn, SlcanCommand::Listen, SlcanCommand::ReadFlags];
    rates.chain(others).collect()
}

#[test]
fn bit_rates_have_the_codes_of_the_manual() {
    let texts = |rate| SlcanBitRate::for_rate(rate).map(|rate| SlcanCommand::SetBitRate(rate).bytes());
    assert_eq!(texts(10_000), Some(&b"S0\r"[..]));
    assert_eq!(texts(125_000), Some(&b"S4\r"[..]));
    assert_eq!(texts(500_000), Some(&b"S6\r"[..]));
    assert_eq!(texts(1_000_000), Some(&b"S8\r"[..]));
    assert_eq!((texts(750_000), texts(0)), (None, None));
}

/// An adapter transmits on lines that begin with t, T, r, R, d, D, b or B, and acknowledges frames if it
/// was opened with `O`. No sequence of commands, even if cut at any byte, contains such a line.
#[test]
fn no_command_transmits_or_opens_a_channel_other_than_to_listen() {
    for first in commands() {
        for cut in 0..=first.bytes().len() {
            for second in commands() {
                let texts = [&first.bytes()[..cut], second.bytes()].concat();
                for line in texts.split(|byte| *byte == CR) {
                    assert!(!line.iter().any(|byte| b"tTrRdDbBO".contains(byte)), "{texts:?}");
                }
                assert!(texts.ends_with(b"\r") && second.bytes().len() >= 2);
            }
        }
    }
}
