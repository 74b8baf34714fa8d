//! SDO requests and responses that do not alternate. A response that contains an object belongs to the first request for
//! it (CiA 301 §7.2.4.3: index and sub-index in initiate messages); segments contain none.

use std::fmt::Write as _;

use cobscope_decoder::event::{Event, EventKind, SdoOutcome, SdoTransfer};
use cobscope_decoder::{Bus, Reading};
use proptest::prelude::*;

/// First and last frame of each transfer, and the transfer.
type Transfers = Vec<((u64, u64), SdoTransfer)>;

/// Transfers with the frames of each, and the rules with findings. Lines are milliseconds, identifier and data.
fn decode(lines: &[(f64, &str)]) -> (Transfers, Vec<String>) {
    let mut text = String::from("(100.000000) can0 705#05\n");
    for (time, frame) in lines {
        writeln!(text, "({:.6}) can0 {frame}", 100.0 + time / 1_000.0).unwrap();
    }
    let mut transfers = Vec::new();
    let mut reading = Reading::new(|event: &Event, _: &Bus| {
        if let EventKind::SdoTransfer(transfer) = &event.kind {
            transfers.push(((event.frames.first, event.frames.last), (**transfer).clone()));
        }
    });
    reading.run(text.as_bytes()).unwrap();
    let findings = reading.finish().findings;
    let rules = findings.reported_groups().map(|group| group.rule.to_string()).collect();
    (transfers, rules)
}

fn outcomes(transfers: &[((u64, u64), SdoTransfer)]) -> Vec<(u64, u64, &'static str)> {
    transfers.iter().map(|((first, last), it)| (*first, *last, it.outcome.name())).collect()
}

#[test]
fn responses_in_another_order_belong_to_their_requests() {
    let (transfers, rules) = decode(&[
        (1.0, "605#4018100100000000"),
        (2.1, "605#4018100200000000"),
        (4.2, "585#4318100222000000"),
        (5.0, "585#4318100111000000"),
    ]);
    assert_eq!(outcomes(&transfers), [(3, 4, "complete"), (2, 5, "complete")]);
    assert_eq!((transfers[0].1.data[0], transfers[1].1.data[0]), (0x22, 0x11));
    assert_eq!(transfers[1].1.overlap, Some(1_100_000));
    assert!(transfers.iter().all(|(_, it)| !it.cut_start && !it.is_unrequested));
    assert_eq!(rules, ["sdo-client-does-not-wait"]);
}

#[test]
fn equal_requests_have_their_responses_in_order() {
    let (transfers, rules) = decode(&[
        (1.0, "605#4041600000000000"),
        (2.1, "605#4041600000000000"),
        (3.0, "585#4B41600001000000"),
        (4.2, "585#4B41600002000000"),
    ]);
    assert_eq!(outcomes(&transfers), [(2, 4, "complete"), (3, 5, "complete")]);
    assert_eq!((transfers[0].1.data[0], transfers[1].1.data[0]), (1, 2));
    assert_eq!((transfers[0].1.retries, transfers[1].1.retries), (0, 0));
    assert_eq!(rules, ["sdo-client-does-not-wait"]);
}

/// The client repeats its request after 300 ms: one exchange. The server responds to both requests, or to one.
#[test]
fn a_retry_is_one_exchange() {
    let once =
        [(0.0, "605#4018100100000000"), (300.0, "605#4018100100000000"), (302.5, "585#4318100111000000")];
    let (transfers, rules) = decode(&once);
    assert_eq!(outcomes(&transfers), [(2, 4, "complete")]);
    assert_eq!((transfers[0].1.retries, transfers[0].1.overlap), (1, None));
    assert_eq!(rules, ["sdo-no-response"], "302 ms are more than 200 ms");
    // The next request is another exchange.
    let next = [once[0], once[1], once[2], (400.0, "605#4018100100000000"), (401.0, "585#4318100111000000")];
    let (transfers, _) = decode(&next);
    assert_eq!(outcomes(&transfers), [(2, 4, "complete"), (5, 6, "complete")]);
    assert_eq!(transfers[1].1.duration, Some(1_000_000));
}

#[test]
fn retries_without_response_are_reported_once() {
    let (transfers, rules) = decode(&[
        (0.0, "605#4018100100000000"),
        (300.0, "605#4018100100000000"),
        (600.0, "605#4018100100000000"),
        (1_200.0, "705#05"),
        (1_500.0, "705#05"),
        (1_800.0, "705#05"),
        (2_500.0, "705#05"),
    ]);
    assert_eq!(outcomes(&transfers), [(2, 4, "timeout")]);
    assert_eq!((transfers[0].1.retries, transfers[0].1.frame_count), (2, 3));
    assert_eq!(rules, ["sdo-no-response"]);
}

/// Both reads are segmented, so the segment may belong to either.
#[test]
fn segments_of_two_open_transfers_are_ambiguous() {
    let (transfers, _) = decode(&[
        (0.0, "605#4008100000000000"),
        (1.1, "605#4009100000000000"),
        (2.0, "585#4108100004000000"),
        (3.2, "585#4109100004000000"),
        (4.0, "605#6000000000000000"),
        (5.1, "585#0741424344000000"),
    ]);
    assert_eq!(outcomes(&transfers), [(2, 4, "superseded"), (3, 7, "complete")]);
    assert!(transfers.iter().all(|(_, it)| it.is_ambiguous));
}

/// A client that sends the next request while a segment is open: the segment belongs to the first transfer.
#[test]
fn a_segment_belongs_to_the_transfer_that_has_segments() {
    let (transfers, _) = decode(&[
        (0.0, "605#4008100000000000"),
        (1.0, "585#4108100004000000"),
        (2.1, "605#6000000000000000"),
        (2.5, "605#4018100100000000"),
        (3.6, "585#0741424344000000"),
        (4.0, "585#4318100111000000"),
    ]);
    assert_eq!(outcomes(&transfers), [(2, 6, "complete"), (5, 7, "complete")]);
    assert_eq!(transfers[0].1.data, b"ABCD");
    assert!(transfers.iter().all(|(_, it)| !it.is_ambiguous));
}

#[test]
fn a_lone_abort_is_an_abort() {
    for frame in ["605#8000000000000405", "585#8000000000000405"] {
        let (transfers, rules) = decode(&[(0.0, frame)]);
        assert_eq!(outcomes(&transfers), [(2, 2, "aborted")]);
        assert_eq!((transfers[0].1.is_unrequested, transfers[0].1.waited), (true, None));
        assert!(rules.is_empty(), "{rules:?}");
    }
}

#[test]
fn a_flood_of_responses_invents_no_requests() {
    let lines: Vec<_> = (0..20).map(|place| (f64::from(place) * 1.3, "585#4318100111000000")).collect();
    let (transfers, rules) = decode(&lines);
    assert_eq!(transfers.len(), 20);
    assert!(transfers.iter().skip(1).all(|(_, it)| it.is_unrequested && it.outcome == SdoOutcome::Complete));
    assert_eq!(rules, ["sdo-unrequested-response"]);
    // Confirmations of segments, which contain no object.
    let lines: Vec<_> = (0..20).map(|place| (f64::from(place) * 1.3, "585#2000000000000000")).collect();
    let (transfers, rules) =
        decode(&[lines.as_slice(), &[(2_000.0, "705#05"), (3_000.0, "705#05")]].concat());
    assert!(transfers.iter().all(|(_, it)| it.waited.is_none() && it.cut_start), "{transfers:?}");
    assert!(rules.is_empty(), "{rules:?}");
}

/// 05030000 (toggle bit not alternated) as response to an expedited write: there is no toggle bit to blame.
#[test]
fn an_expedited_transfer_has_no_toggle_bit() {
    let (transfers, rules) = decode(&[(0.0, "605#2B171000E8030000"), (1.2, "585#8017100000000305")]);
    assert_eq!((outcomes(&transfers), transfers[0].1.irregularity), (vec![(2, 3, "aborted")], None));
    assert!(!rules.contains(&"sdo-toggle".to_owned()), "{rules:?}");
}

/// An abort belongs to the request for its object.
#[test]
fn an_abort_belongs_to_its_request() {
    let (transfers, _) = decode(&[
        (0.0, "605#4018100100000000"),
        (1.1, "605#4001200000000000"),
        (2.0, "585#8001200000000206"),
        (3.2, "585#4318100111000000"),
    ]);
    assert_eq!(outcomes(&transfers), [(3, 4, "aborted"), (2, 5, "complete")]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// Up to ten requests in flight, with responses in any order: each exchange is reported once, with its own value.
    #[test]
    fn each_exchange_is_reported_once(order in Just((0_u8..10).collect::<Vec<_>>()).prop_shuffle(), count in 2_usize..10) {
        let mut lines = Vec::new();
        for sub in 0..count {
            lines.push((f64::from(u8::try_from(sub).unwrap()) * 1.1, format!("605#400020{sub:02X}00000000")));
        }
        for (place, sub) in order.iter().filter(|sub| usize::from(**sub) < count).enumerate() {
            let time = 20.0 + f64::from(u8::try_from(place).unwrap()) * 0.7;
            lines.push((time, format!("585#4F0020{sub:02X}{:02X}000000", sub + 0x40)));
        }
        let lines: Vec<_> = lines.iter().map(|(time, frame)| (*time, frame.as_str())).collect();
        let (transfers, rules) = decode(&lines);
        prop_assert_eq!(transfers.len(), count);
        for (_, transfer) in &transfers {
            let sub = transfer.object.unwrap().sub;
            prop_assert_eq!(&transfer.data, &[sub + 0x40]);
            prop_assert_eq!((transfer.outcome, transfer.frame_count), (SdoOutcome::Complete, 2));
        }
        prop_assert_eq!(rules, ["sdo-client-does-not-wait"]);
    }
}
