//! J1939 captures of other projects: counts from independent readers (README of the corpus), from tshark and
//! from a script.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::Command;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind, J1939Transfer, SdoOutcome, TransportMode};
use cobscope_decoder::frame::{CanId, Frame, Timestamp};
use cobscope_decoder::session::{Bus, SessionOptions};
use cobscope_decoder::wire::j1939::{J1939Id, Pgn};

use crate::corpus::decode;
use crate::support;

const TRUCK: &str = "j1939/remora_ctrl_proto__candump-2021-07-21_220402-15-seconds-engine-on-big-truck.log";

fn path(name: &str) -> Option<PathBuf> {
    let path = support::corpus().join(name);
    if !path.exists() {
        support::skip("corpus", &format!("{} is not there", path.display()));
        return None;
    }
    Some(path)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02X}").unwrap();
        text
    })
}

/// 9,950 frames: 6 announcements and 27 packets, 132 DM1 of one frame, 7 requests; 105 groups, including
/// those of the transport and the transported ones; 15 addresses.
#[test]
fn a_truck_with_every_transfer_accounted_for() {
    let mut counts = BTreeMap::new();
    let (mut groups, mut addresses) = (BTreeSet::new(), BTreeSet::new());
    let mut transfers: Vec<J1939Transfer> = Vec::new();
    let decoder = decode(TRUCK, |event, _| {
        *counts.entry(event.kind.name()).or_insert(0_u64) += 1;
        match &event.kind {
            EventKind::J1939Message(message) => {
                groups.insert(message.id.pgn);
                addresses.insert(message.id.source);
                if message.id.pgn == Pgn::DM1 {
                    *counts.entry("DM1").or_insert(0) += 1;
                }
            }
            EventKind::J1939Request(request) => {
                groups.insert(Pgn::REQUEST);
                addresses.insert(request.source);
            }
            EventKind::J1939Transfer(transfer) => {
                groups.extend([Pgn::TP_CM, Pgn::TP_DT]);
                addresses.insert(transfer.source);
                transfers.push((**transfer).clone());
            }
            EventKind::Acknowledgement(_) => {
                groups.insert(Pgn::ACKNOWLEDGEMENT);
            }
            _ => {}
        }
    });
    if decoder.is_none() {
        return;
    }
    assert_eq!((counts.get("DM1"), counts.get("j1939-request")), (Some(&132), Some(&7)), "{counts:?}");
    assert_eq!((groups.len(), addresses.len()), (105, 15), "{counts:?}");
    assert_eq!(transfers.len(), 6);
    assert_eq!(transfers.iter().map(|it| it.packets.unwrap_or(0)).sum::<u32>(), 27);
    assert_eq!(transfers.iter().map(|it| it.frame_count).sum::<u64>(), 33);
    for transfer in &transfers {
        assert_eq!(transfer.mode, Some(TransportMode::Broadcast));
        assert!(transfer.outcome == SdoOutcome::Complete && !transfer.truncated, "{transfer:?}");
    }
    let odd = ["transport-irregularity", "malformed", "evicted", "frame"];
    assert!(odd.iter().all(|kind| !counts.contains_key(kind)), "{counts:?}");
    // Each frame is a message, a request, an acknowledgement, or part of a transfer.
    let reported = ["j1939-message", "j1939-request", "acknowledgement"];
    let reported: u64 = reported.iter().filter_map(|kind| counts.get(kind)).sum();
    assert_eq!(reported + 33, 9_950, "{counts:?}");
}

#[test]
fn a_script_puts_the_same_broadcasts_together() {
    let Some(log) = path(TRUCK) else { return };
    let Some(python) = support::python() else { return support::skip("python", "no Python for oracles") };
    let script = support::workspace().join("tests/oracles/bam_reassembly.py");
    let output = Command::new(python).arg(script).arg(log).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let theirs = String::from_utf8(output.stdout).unwrap();
    let mut ours = String::new();
    decode(TRUCK, |event, _| {
        if let EventKind::J1939Transfer(it) = &event.kind {
            let pgn = it.pgn.unwrap_or_default().number();
            writeln!(ours, "{} {pgn} {}", it.source, hex(&it.data)).unwrap();
        }
    });
    assert_eq!(theirs.lines().count(), 6);
    assert_eq!(ours, theirs);
}

#[test]
fn tshark_reads_the_same_identifiers() {
    let Some(log) = path(TRUCK) else { return };
    let fields = ["j1939.can_id", "j1939.pgn", "j1939.priority", "j1939.src_addr", "j1939.dst_addr"];
    let mut command = Command::new("tshark");
    command.arg("-r").arg(log).args(["-d", "can.subdissector,j1939", "-T", "fields"]);
    for field in fields {
        command.args(["-e", field]);
    }
    let Ok(output) = command.output() else { return support::skip("tshark", "the program is missing") };
    let lines = String::from_utf8(output.stdout).unwrap();
    let mut compared = 0;
    for line in lines.lines() {
        let mut columns = line.split('\t');
        let mut column = || columns.next().unwrap();
        let id = u32::from_str_radix(column().trim_start_matches("0x"), 16).unwrap();
        let ours = J1939Id::from_identifier(id).unwrap();
        let number = |text: &str| text.parse::<u32>().unwrap();
        assert_eq!(number(column()), ours.pgn.number(), "{line}");
        assert_eq!(number(column()), u32::from(ours.priority), "{line}");
        assert_eq!(number(column()), u32::from(ours.source), "{line}");
        // For a group without destination, tshark prints nothing or 255.
        let destination = column();
        assert_eq!(
            if destination.is_empty() { 255 } else { number(destination) },
            u32::from(ours.destination)
        );
        compared += 1;
    }
    assert_eq!(compared, 9_950);
}

/// A BUSMASTER log without another reader for it: 55 requests for PGN 0 to address 20, on both channels.
#[test]
fn requests_recorded_by_busmaster() {
    let Some(log) = path("j1939/busmaster__TestLogToExcel_J1939.log") else { return };
    let bytes = std::fs::read(log).unwrap();
    let mut names = BusNames::default();
    let buses = [names.index_of(b"1").unwrap(), names.index_of(b"2").unwrap()];
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut requests = BTreeMap::new();
    let mut observer = |event: &Event, _: &Bus| {
        if let EventKind::J1939Request(request) = &event.kind {
            *requests.entry((event.bus, request.pgn.number(), request.destination)).or_insert(0) += 1;
        }
    };
    let mut number = 0;
    for line in String::from_utf8_lossy(&bytes).lines().filter(|line| !line.starts_with('*')) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [_, channel, id, _, _, _, _, _, _, length, data @ ..] = &words[..] else { continue };
        assert_eq!(length.parse::<usize>().unwrap(), data.len(), "{line}");
        let data: Vec<u8> = data.iter().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
        let id = CanId::from_extended(u32::from_str_radix(id, 16).unwrap());
        number += 1;
        let bus = buses[usize::from(*channel == "2")];
        let frame = Frame { number, bus, ..Frame::data_frame(id, &data) };
        decoder.push(&frame, &names, &mut observer);
    }
    decoder.finish_capture(&names, &mut observer);
    assert_eq!(number, 110);
    assert_eq!(requests.values().copied().collect::<Vec<u32>>(), [55, 55]);
    assert!(requests.keys().all(|(_, pgn, destination)| (*pgn, *destination) == (0, 0x20)));
}

/// Decodes frames with these 29-bit identifiers, `rounds` times, one per millisecond; whether the bus is J1939 then.
fn is_j1939(ids: &[u32], rounds: u8) -> bool {
    let mut names = BusNames::default();
    names.index_of(b"can0");
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut number = 0;
    for round in 0..rounds {
        for id in ids {
            number += 1;
            let time = Some(Timestamp(i64::try_from(number).unwrap() * 1_000_000 + i64::from(round)));
            let frame = Frame { number, time, ..Frame::data_frame(CanId::from_extended(*id), &[round; 8]) };
            decoder.push(&frame, &names, &mut |_: &Event, _: &Bus| {});
        }
    }
    decoder.buses().first().is_some_and(|bus| bus.protocols().is_j1939())
}

#[test]
fn a_truck_without_management_messages_is_j1939_and_cars_are_not() {
    let Some(log) = path(TRUCK) else { return };
    let management =
        [Pgn::REQUEST, Pgn::ACKNOWLEDGEMENT, Pgn::TP_CM, Pgn::TP_DT, Pgn::DM1, Pgn::ADDRESS_CLAIMED];
    let text = std::fs::read_to_string(log).unwrap();
    let ids = text.lines().filter_map(|line| line.split_whitespace().nth(2)?.split_once('#'));
    let mut ids: Vec<u32> = ids.map(|(id, _)| u32::from_str_radix(id, 16).unwrap()).collect();
    ids.retain(|id| !management.contains(&J1939Id::from_identifier(*id).unwrap().pgn));
    assert!(is_j1939(&ids, 1));
    let mut cars = 0;
    for entry in std::fs::read_dir(support::corpus().join("dbc")).unwrap() {
        let file = entry.unwrap();
        let name = file.file_name().to_string_lossy().into_owned();
        if !name.starts_with("opendbc__") && !name.starts_with("SavvyCAN__") {
            continue;
        }
        let bytes = std::fs::read(file.path()).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        let words = text.lines().filter_map(|line| line.strip_prefix("BO_ ")?.split_whitespace().next());
        // Bit 31 marks 29-bit identifiers; 3221225472 is the pseudo message of signals without one.
        let ids: Vec<u32> = words
            .filter_map(|id| id.parse::<u32>().ok())
            .filter(|id| id >> 31 == 1 && *id != 0xC000_0000)
            .map(|id| id & 0x1FFF_FFFF)
            .collect();
        assert!(!is_j1939(&ids, 20), "{name}");
        cars += usize::from(!ids.is_empty());
    }
    assert!(cars >= 1, "no database with 29-bit identifiers");
    // ISO 15765: 18DB33F1 to all, 18DAxxF1 and 18DAF1xx.
    let diagnostics: Vec<u32> = (0..16).flat_map(|ecu| [0x18DA_00F1 | ecu << 8, 0x18DA_F100 | ecu]).collect();
    assert!(!is_j1939(&diagnostics, 20));
}
