//! Captures of other projects: counts from independent readers (README of the corpus).

use std::collections::BTreeMap;
use std::fs;

use cobscope_decoder::capture::{Batch, BatchItem, CaptureReader, ReadOptions, decompress};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{CrcCheck, Event, EventKind, SdoDirection, SdoMode, SdoOutcome, SdoTransfer};
use cobscope_decoder::session::{Bus, SessionOptions};

use crate::support;

/// Events of a capture, counted by the result of `name`.
struct Tally {
    counts: BTreeMap<String, u64>,
    is_canopen: bool,
}

impl Tally {
    fn get(&self, name: &str) -> u64 {
        self.counts.get(name).copied().unwrap_or(0)
    }

    fn sum(&self, prefix: &str) -> u64 {
        self.counts.iter().filter(|(name, _)| name.starts_with(prefix)).map(|(_, count)| count).sum()
    }
}

/// The kind of an event; for SDO transfers also mode and result.
fn name(event: &Event) -> String {
    match &event.kind {
        EventKind::SdoTransfer(transfer) => sdo_name(transfer),
        EventKind::Pdo(pdo) => format!("pdo {:?}", pdo.name.direction),
        kind => kind.name().to_owned(),
    }
}

fn sdo_name(transfer: &SdoTransfer) -> String {
    let abort = transfer.abort.map_or(String::new(), |abort| {
        format!(" {:08X}{}", abort.code, if abort.by_client { " by client" } else { "" })
    });
    format!("sdo {:?} {:?} {:?}{abort}", transfer.mode, transfer.direction, transfer.outcome)
}

/// Decodes a capture of the corpus; `None` with a message if it is missing.
pub fn decode(path: &str, see: impl FnMut(&Event, &Bus)) -> Option<Decoder> {
    decode_with(SessionOptions::default(), path, see)
}

/// Like [`decode`], with options.
pub fn decode_with(
    options: SessionOptions,
    path: &str,
    mut see: impl FnMut(&Event, &Bus),
) -> Option<Decoder> {
    let path = support::corpus().join(path);
    let Ok(bytes) = fs::read(&path) else {
        support::skip("corpus", &format!("{} is not there", path.display()));
        return None;
    };
    let source = decompress(&bytes[..]).unwrap();
    let mut reader = CaptureReader::open(source, &ReadOptions::default()).unwrap();
    let mut decoder = Decoder::new(options);
    let mut batch = Batch::new();
    while reader.read(&mut batch).unwrap() {
        for item in batch.items() {
            match item {
                BatchItem::Frame(frame) => decoder.push(frame, reader.buses(), &mut see),
                BatchItem::Notice(notice) => decoder.on_notice(notice, reader.buses(), &mut see),
            }
        }
    }
    decoder.finish_capture(reader.buses(), &mut see);
    Some(decoder)
}

fn tally(path: &str) -> Option<Tally> {
    let mut counts = BTreeMap::new();
    let decoder = decode(path, |event, _| *counts.entry(name(event)).or_default() += 1)?;
    Some(Tally { counts, is_canopen: decoder.buses().iter().any(|bus| bus.protocols().is_canopen()) })
}

/// 4,314 frames on 584 and 604 start with 0x80; the 6 block segments 0x81 and above are not aborts.
#[test]
fn the_conformance_run_has_its_aborts_and_no_other() {
    let Some(tally) = tally("canopen/CANopenDemo__ctt_3.0.3.10_run.log") else { return };
    let aborted = tally.counts.iter().filter(|(name, _)| name.contains("Aborted"));
    let (mut by_client, mut all) = (0, 0);
    for (name, count) in aborted {
        all += count;
        by_client += if name.contains("by client") { *count } else { 0 };
    }
    assert_eq!((all, by_client), (4_314, 1));
    // One frame has an undefined command specifier; the server responds outside any transfer.
    assert_eq!(tally.get("malformed"), 1);
    assert_eq!(tally.get("sdo None None Aborted 05040001"), 1);
}

#[test]
fn the_conformance_run_has_whole_block_transfers() {
    let mut blocks = Vec::new();
    let decoder = decode("canopen/CANopenDemo__ctt_3.0.3.10_run.log", |event, _| {
        if let EventKind::SdoTransfer(transfer) = &event.kind
            && transfer.mode == Some(SdoMode::Block)
        {
            blocks.push((**transfer).clone());
        }
    });
    if decoder.is_none() {
        return;
    }
    let complete: Vec<_> = blocks.iter().filter(|block| block.outcome == SdoOutcome::Complete).collect();
    assert_eq!(complete.len(), 5);
    for block in complete {
        assert!(!block.truncated && block.crc != Some(CrcCheck::Wrong), "{block:?}");
        assert_eq!(block.data.len() as u64, block.size);
        assert!(block.announced.is_none_or(|announced| u64::from(announced) == block.size), "{block:?}");
    }
}

#[test]
fn a_real_machine_by_peak_trace() {
    let Some(tally) = tally("canopen/canopen-message-interpreter__pcan1.trc") else { return };
    assert_eq!(tally.get("nmt-command"), 348);
    assert_eq!(tally.get("heartbeat"), 521);
    assert_eq!(tally.get("boot-up"), 21);
    assert_eq!(tally.sum("pdo Transmit"), 204);
    // 789 requests; node 0F gets 8 of them twice, 0.2 to 0.4 s after the first, which has no response: retries.
    assert_eq!(tally.sum("sdo Some(Expedited) Some(Download)"), 789 - 8);
    assert_eq!(tally.sum("sdo Some(Expedited) Some(Upload)"), 2_249);
    assert_eq!(tally.sum("sdo Some(Segmented) Some(Upload)"), 67);
    let code = |code: &str| -> u64 {
        tally.counts.iter().filter(|(name, _)| name.contains(code)).map(|(_, count)| count).sum()
    };
    let codes = ["06020000", "06010000", "05040000", "06090030", "05000000", "05040001"];
    assert_eq!(codes.map(code), [68, 10, 6, 3, 1, 1]);
}

#[test]
fn a_real_start_up_with_guarding_in_both_containers() {
    for path in ["canopen-message-interpreter__pcan2.trc", "canopen-message-interpreter__pcan2.pcapng"] {
        let Some(tally) = tally(&format!("canopen/{path}")) else { return };
        assert_eq!((tally.get("guard-request"), tally.get("guard-reply")), (187, 187), "{path}");
        assert_eq!(tally.get("nmt-command"), 378, "{path}");
        assert_eq!((tally.get("heartbeat"), tally.get("boot-up")), (482, 1), "{path}");
        assert_eq!(tally.sum("pdo Transmit"), 396, "{path}");
        let aborts: u64 = tally.counts.iter().filter(|(n, _)| n.contains("Aborted")).map(|(_, c)| c).sum();
        assert_eq!(aborts, 3, "{path}");
    }
}

#[test]
fn drives_and_a_robot_by_script() {
    let Some(drives) = tally("canopen/canopen-lens__sample_cia402.log") else { return };
    assert_eq!((drives.get("sync"), drives.get("emcy"), drives.get("can-error")), (550, 4, 2));
    assert_eq!((drives.sum("pdo Transmit"), drives.sum("pdo Receive")), (2_255, 2_200));
    assert_eq!((drives.get("heartbeat"), drives.get("boot-up")), (209, 4));
    let Some(robot) = tally("canopen/canopen-lens__sample_amr_2wheel.log") else { return };
    assert_eq!((robot.get("sync"), robot.get("nmt-command"), robot.get("heartbeat")), (1_594, 2, 638));
    assert_eq!((robot.sum("pdo Transmit"), robot.sum("pdo Receive")), (6_376, 6_000));
}

#[test]
fn cars_boats_and_trucks_are_no_canopen_networks() {
    for path in [
        "formats/SavvyCAN__candump.log",
        "nmea2000/canboat__can0-1.pcap",
        "nmea2000/canboat__candumpSample3.txt",
        "nmea2000/canboat__sample3_PCAN-View.trc",
        "j1939/remora_ctrl_proto__candump-2021-07-21_220402-15-seconds-engine-on-big-truck.log",
        "uds/scapy__candump_uds_scanner.pcap.gz",
    ] {
        if !support::is_readable(path) {
            continue;
        }
        let Some(tally) = tally(path) else { return };
        assert!(!tally.is_canopen, "{path}: {:?}", tally.counts);
        assert_eq!(tally.sum("sdo"), 0, "{path}: {:?}", tally.counts);
    }
}

/// Frames of an SDO transfer are in order, and every event refers to frames of the capture.
#[test]
fn every_event_can_be_traced_to_its_frames() {
    for path in
        ["canopen/CANopenDemo__ctt_3.0.3.10_run.log", "canopen/canopen-message-interpreter__pcan1.trc"]
    {
        let mut last = 0;
        let decoder = decode(path, |event, _| {
            assert!(event.frames.first <= event.frames.last, "{event:?}");
            last = last.max(event.frames.last);
            if let EventKind::SdoTransfer(transfer) = &event.kind {
                assert!(event.frames.first > 0 && transfer.frame_count > 0);
                let upload = transfer.direction == Some(SdoDirection::Upload);
                assert!(!upload || transfer.outcome != SdoOutcome::Complete || transfer.frame_count > 1);
            }
        });
        if decoder.is_none() {
            return;
        }
        assert!(last > 10_000, "{path}: {last}");
    }
}
