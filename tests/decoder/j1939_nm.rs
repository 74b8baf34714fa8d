//! Network management and diagnostics of J1939: captures `nm_*` of `fixtures/j1939/` compared with the
//! hand-written events next to them, and captures of other projects.
//!
//! The notation is described in `fixtures/README.md`.

use std::collections::BTreeMap;

use cobscope_decoder::event::{ClaimAction, DtcAction, EventKind};
use cobscope_decoder::profile::Catalogue;

use crate::corpus::decode;
use crate::devices::options;
use crate::scene::{Expected, captures, events};

#[test]
fn every_capture_gives_the_events_written_beside_it() {
    let catalogue = Catalogue::default();
    let mut names = captures("j1939");
    names.retain(|name| name.file_name().unwrap().to_string_lossy().starts_with("nm_"));
    assert!(names.len() >= 7);
    let mut report = String::new();
    for name in &names {
        let expected = Expected::read(&name.with_extension("expected.txt"));
        let found = events(&name.with_extension("log"), options(name, &expected, &catalogue), 1);
        expected.compare(&name.file_name().unwrap().to_string_lossy(), &found, &mut report);
    }
    assert!(report.is_empty(), "\n{report}");
}

/// 33 claims of five devices, as counted by `grep 18EEFF`: each device has one claim event.
#[test]
fn claims_on_a_boat() {
    let mut claims: BTreeMap<(u8, u64), Vec<ClaimAction>> = BTreeMap::new();
    let decoder = decode("nmea2000/canboat__sample3_PCAN-View.trc", |event, _| {
        if let EventKind::AddressClaim(claim) = &event.kind {
            assert!(claim.contention.is_none() && claim.from.is_none(), "{claim:?}");
            claims.entry((claim.source, claim.name.0)).or_default().push(claim.action);
        }
    });
    let Some(decoder) = decoder else { return };
    let counts: Vec<_> = claims.iter().map(|((source, _), actions)| (*source, actions.len())).collect();
    assert_eq!(counts, [(1, 8), (3, 5), (4, 8), (6, 8), (9, 4)]);
    for actions in claims.values() {
        assert_eq!(actions[0], ClaimAction::Claimed);
        assert!(actions[1..].iter().all(|action| *action == ClaimAction::Confirmed));
    }
    // 80 AA A4 1C 00 96 50 C0 of address 1: 1CA4AA80 is manufacturer 0E5 (1CA4AA80 >> 21 = 229), number
    // 4AA80; function 96 = 150, class 50 >> 1 = 40, industry group C0 >> 4 & 7 = 4, marine.
    let name = decoder
        .buses()
        .first()
        .unwrap()
        .nodes()
        .find(|node| node.id().number() == 1)
        .unwrap()
        .j1939_name()
        .unwrap();
    let parts = name.fields();
    assert_eq!((parts.manufacturer_code, parts.identity_number), (229, 0x4_AA80));
    assert_eq!((parts.function, parts.device_class, parts.industry_group), (150, 40, 4));
}

/// 132 DM1 in one frame, of eleven addresses: none reports a fault.
#[test]
fn a_healthy_truck() {
    let mut dm1 = BTreeMap::new();
    let mut faults = Vec::new();
    let path = "j1939/remora_ctrl_proto__candump-2021-07-21_220402-15-seconds-engine-on-big-truck.log";
    let decoder = decode(path, |event, _| match &event.kind {
        EventKind::J1939Message(message) if message.id.pgn.number() == 0xFECA => {
            *dm1.entry(message.id.source).or_insert(0) += 1;
        }
        EventKind::Dtc(dtc) => faults.push(dtc.clone()),
        _ => {}
    });
    if decoder.is_none() {
        return;
    }
    assert_eq!((dm1.len(), dm1.values().sum::<u32>()), (11, 132));
    assert!(faults.is_empty(), "{faults:?}");
}

/// `40FF5B000301FFFF`: malfunction lamp, SPN 5B = 91, FMI 3, once.
#[test]
fn one_fault_of_an_engine() {
    let mut faults = Vec::new();
    let decoder = decode("j1939/pretty_j1939__test_dm1.log", |event, _| {
        if let EventKind::Dtc(dtc) = &event.kind {
            faults.push((dtc.action, dtc.spn, dtc.fmi, dtc.count, dtc.lamps.clone(), event.frames.last));
        }
    });
    if decoder.is_some() {
        assert_eq!(faults, [(DtcAction::Raised, 91, 3, Some(1), vec!["malfunction"], 2)]);
    }
}
