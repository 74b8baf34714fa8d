//! SDO dialogues on identifiers of PDOs that are not configured.

use std::fmt::Write as _;

use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::{Bus, Reading};

/// Notes and kinds of the events on 1A3 and 223.
fn decode(frames: &[&str]) -> (Vec<String>, Vec<(u64, &'static str)>) {
    let mut text = String::from("(100.000000) can0 723#05\n");
    for (place, frame) in frames.iter().enumerate() {
        writeln!(text, "(100.{:06}) can0 {frame}", 1_000 + place * 1_300 + place % 3).unwrap();
    }
    let (mut notes, mut kinds) = (Vec::new(), Vec::new());
    let mut reading = Reading::new(|event: &Event, _: &Bus| match &event.kind {
        EventKind::Note { text } => notes.push(text.clone()),
        EventKind::Pdo(_) | EventKind::Frame(_) => kinds.push((event.frames.last, event.kind.name())),
        _ => {}
    });
    reading.run(text.as_bytes()).unwrap();
    drop(reading);
    (notes, kinds)
}

/// Reads of 1000:00, 1018:01, a write of 1017:00, and another read: the third response is frame 7.
#[test]
fn a_dialogue_is_reported_and_no_longer_decoded_as_pdos() {
    let (notes, kinds) = decode(&[
        "223#4000100000000000",
        "1A3#4300100091010300",
        "223#4018100100000000",
        "1A3#4318100119030000",
        "223#2B171000E8030000",
        "1A3#6017100000000000",
        "223#4008100000000000",
        "1A3#4108100010000000",
    ]);
    let note = notes.iter().find(|note| note.contains("like an SDO server")).unwrap();
    assert!(
        note.contains("id = [{ id = \"223\", service = \"sdo-request\", node = 35 }, { id = \"1A3\", "),
        "{note}"
    );
    let before: Vec<_> = (2..=6).map(|frame| (frame, "pdo")).collect();
    assert_eq!(kinds[..5], before);
    assert_eq!(kinds[5..], [(7, "frame"), (8, "frame"), (9, "frame")]);
}

/// A TPDO in response to an RPDO (type 255 of a valve): control and status words, and set points whose second half
/// happens to repeat.
#[test]
fn a_tpdo_in_response_to_an_rpdo_is_a_pdo() {
    let mut frames = Vec::new();
    for _ in 0..6 {
        frames.extend([
            "223#4000104000000000",
            "1A3#0F00104000000000",
            "223#0F00100012340000",
            "1A3#3700100012340000",
        ]);
    }
    let (notes, kinds) = decode(&frames);
    assert!(!notes.iter().any(|note| note.contains("like an SDO server")), "{notes:?}");
    assert!(kinds.iter().all(|(_, kind)| *kind == "pdo") && kinds.len() == frames.len());
}

/// A PDO that was configured by SDO stays a PDO, whatever its bytes are.
#[test]
fn a_configured_identifier_stays_a_pdo() {
    let (notes, kinds) = decode(&[
        "623#23001801A3010000",
        "5A3#6000180100000000",
        "623#2300140123020000",
        "5A3#6000140100000000",
        "223#4000100000000000",
        "1A3#4300100091010300",
        "223#4000100000000000",
        "1A3#4300100091010300",
        "223#4000100000000000",
        "1A3#4300100091010300",
    ]);
    assert!(!notes.iter().any(|note| note.contains("like an SDO server")), "{notes:?}");
    assert_eq!(kinds.len(), 6);
    assert!(kinds.iter().all(|(_, kind)| *kind == "pdo"), "{kinds:?}");
}
