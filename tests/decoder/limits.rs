//! Exceeds every limit of the session with a generated capture, and checks the event that reports it. The
//! captures are too large for the repository.

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::frame::{CanId, Frame, FrameFlags, Timestamp};
use cobscope_decoder::session::{
    ACTIVE_ERROR_LIMIT, ADDRESSLESS_LIMIT, CHANNEL_LIMIT, EXCHANGE_LIMIT, EXTENDED_ID_LIMIT, OBJECT_LIMIT,
    OPEN_DATA_LIMIT, SessionOptions, TRANSFER_DATA_LIMIT, TRANSPORT_LIMIT,
};
use serde_json::Value;

use crate::harness::observe::Checker;

/// A bus with frames of this test, 0.1 ms apart.
struct Scene {
    decoder: Decoder,
    checker: Checker,
    names: BusNames,
}

impl Scene {
    /// A bus with one heartbeat, so that it is detected as CANopen.
    fn new() -> Self {
        let mut names = BusNames::default();
        names.index_of(b"can0");
        let decoder = Decoder::new(SessionOptions::default());
        let mut scene = Self { decoder, checker: Checker::keeping(), names };
        scene.standard(0x77F, &[5]);
        scene
    }

    fn frame(&mut self, mut frame: Frame) {
        frame.number = self.checker.last_frame + 1;
        frame.time =
            Some(Timestamp(1_700_000_000_000_000_000).plus(i64::try_from(frame.number).unwrap() * 100_000));
        self.checker.last_frame = frame.number;
        self.decoder.push(&frame, &self.names, &mut self.checker);
    }

    fn standard(&mut self, id: u16, data: &[u8]) {
        self.frame(Frame::data_frame(CanId::from_standard(id), data));
    }

    /// A client writes four bytes, and the server confirms.
    fn write(&mut self, node: u8, index: u16, sub: u8, value: u32) {
        let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
        self.standard(0x600 + u16::from(node), &[0x23, low, high, sub, a, b, c, d]);
        self.standard(0x580 + u16::from(node), &[0x60, low, high, sub, 0, 0, 0, 0]);
    }

    /// A segment of a segmented download on a default channel, confirmed.
    fn segment(&mut self, node: u8, number: usize) {
        let toggle = if number.is_multiple_of(2) { 0 } else { 0x10 };
        self.standard(0x600 + u16::from(node), &[toggle, 1, 2, 3, 4, 5, 6, 7]);
        self.standard(0x580 + u16::from(node), &[0x20 | toggle, 0, 0, 0, 0, 0, 0, 0]);
    }

    /// A J1939 frame of a group with a destination.
    fn group(&mut self, group: u8, source: u8, destination: u8, data: &[u8]) {
        let id = u32::from_be_bytes([0x1C, group, destination, source]);
        self.frame(Frame::data_frame(CanId::from_extended(id), data));
    }

    fn evicted(&self, what: &str) -> usize {
        self.checker.evicted.iter().filter(|evicted| **evicted == what).count()
    }

    /// All events after this call, including those of `finish`.
    fn finish(mut self) -> Vec<Value> {
        self.checker.kept = Some(Vec::new());
        self.decoder.finish_capture(&self.names, &mut self.checker);
        self.checker.kept.iter().flatten().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

/// A valid COB-ID of 29 bits.
fn cob_id(number: u32) -> u32 {
    1 << 29 | number
}

#[test]
fn sdo_channels() {
    let mut scene = Scene::new();
    for node in 1..=3 {
        for index in 0x1201..0x1201 + 100 {
            let number = u32::from(node) << 16 | u32::from(index);
            scene.write(node, index, 1, cob_id(0x10_0000 + number));
            scene.write(node, index, 2, cob_id(0x20_0000 + number));
        }
    }
    // Three of the channels are the default channels of the nodes.
    assert_eq!(scene.evicted("SDO channel"), 300 + 3 - CHANNEL_LIMIT);
    assert!(scene.decoder.footprint() < 256 << 10);
}

#[test]
fn data_of_a_block_download_that_never_ends() {
    let mut scene = Scene::new();
    scene.standard(0x605, &[0xC2, 0x00, 0x20, 0, 0xFF, 0xFF, 0xFF, 0x7F]);
    scene.standard(0x585, &[0xA0, 0x00, 0x20, 0, 127, 0, 0, 0]);
    for _ in 0..100 {
        (1..=127).for_each(|sequence| scene.standard(0x605, &[sequence, 1, 2, 3, 4, 5, 6, 7]));
        scene.standard(0x585, &[0xA2, 127, 127, 0, 0, 0, 0, 0]);
    }
    assert!(scene.decoder.footprint() < 256 << 10);
    let events = scene.finish();
    let transfer = events.iter().find(|event| event["kind"] == "sdo-transfer").unwrap();
    assert_eq!((&transfer["truncated"], &transfer["outcome"]), (&true.into(), &"unfinished".into()));
    assert_eq!(transfer["size"].as_u64(), Some(100 * 127 * 7));
    assert_eq!(transfer["data"].as_str().unwrap().len(), 2 * TRANSFER_DATA_LIMIT);
}

#[test]
fn data_of_all_open_transfers() {
    let mut scene = Scene::new();
    let nodes = 1..=100;
    for node in nodes.clone() {
        scene.standard(0x600 + u16::from(node), &[0x20, 0x00, 0x20, 0, 0, 0, 0, 0]);
        scene.standard(0x580 + u16::from(node), &[0x60, 0x00, 0x20, 0, 0, 0, 0, 0]);
    }
    // Interleaved, so that no transfer times out; 100 transfers of 49 KB exceed the limit.
    for number in 0..7_000 {
        nodes.clone().for_each(|node| scene.segment(node, number));
    }
    assert!(scene.evicted("data of open SDO transfers") > 0);
    let footprint = scene.decoder.footprint();
    assert!(footprint < OPEN_DATA_LIMIT * 2, "{footprint}");
    let events = scene.finish();
    let transfers: Vec<_> = events.iter().filter(|event| event["kind"] == "sdo-transfer").collect();
    assert_eq!(transfers.len(), 100);
    let kept = |event: &&Value| event["data"].as_str().map_or(0, str::len) / 2;
    assert!(transfers.iter().map(kept).sum::<usize>() <= OPEN_DATA_LIMIT);
    // A transfer whose data was dropped keeps no data, because later data has no start.
    assert!(transfers.iter().all(|event| event["size"] == 49_000));
    assert!(transfers.iter().all(|event| matches!(kept(event), 0 | 49_000)));
    assert!(transfers.iter().all(|event| (event["truncated"] == true) == (kept(event) == 0)));
}

#[test]
fn active_errors() {
    let mut scene = Scene::new();
    for code in 0..200_u16 {
        let [low, high] = (0x1000 + code).to_le_bytes();
        scene.standard(0x085, &[low, high, 1, 0, 0, 0, 0, 0]);
    }
    assert_eq!(scene.evicted("active error"), 200 - ACTIVE_ERROR_LIMIT);
    assert_eq!(
        scene.decoder.buses().first().unwrap().node(5).unwrap().active_errors().len(),
        ACTIVE_ERROR_LIMIT
    );
}

#[test]
fn objects() {
    let mut scene = Scene::new();
    for number in 0..5_000 {
        scene.write(5, 0x2000 + number, 0, 7);
    }
    assert_eq!(scene.evicted("object"), 5_000 - OBJECT_LIMIT);
    assert_eq!(scene.decoder.buses().first().unwrap().node(5).unwrap().store().len(), OBJECT_LIMIT);
}

#[test]
fn extended_identifiers() {
    let mut scene = Scene::new();
    scene.checker.kept = Some(Vec::new());
    // From 40 addresses: with more than 48 the bus is not detected as a network.
    for number in 0..10_000 {
        scene.frame(Frame::data_frame(
            CanId::from_extended(0x18FF_0000 | (number / 40) << 8 | (number % 40)),
            &[1],
        ));
    }
    // Reported once, not again for each further identifier.
    assert_eq!(scene.evicted("29-bit identifier"), 1);

    // 4,096 prepared events, each identifier with its intervals and their history in 168 bytes.
    let footprint = scene.decoder.footprint();
    assert!(footprint < (2 << 20) + 4_096 * 168, "{footprint}");
    // Messages beyond the limit are reported all the same.
    let reported = scene.checker.kept.iter().flatten().filter(|line| line.contains("\"j1939-message\""));
    assert_eq!(reported.count(), 10_000);
}

/// Requests of 300 testers to one server.
fn tester(number: u32) -> CanId {
    CanId::from_extended(if number < 256 { 0x18DA_2000 | number } else { 0x18DA_2100 | number & 0xFF })
}

#[test]
fn open_iso_tp_messages() {
    let mut scene = Scene::new();
    for number in 0..300 {
        // 4 GB announced, two bytes sent.
        let data = [0x10, 0, 0xFF, 0xFF, 0xFF, 0xFF, 0x36, 1];
        scene.frame(Frame::data_frame(tester(number), &data));
    }
    assert_eq!(scene.evicted("open ISO-TP message"), 300 - TRANSPORT_LIMIT);
    assert!(scene.decoder.footprint() < 1 << 20);
    let events = scene.finish();
    let open = events.iter().filter(|event| event["kind"] == "isotp-transfer").count();
    assert_eq!(open, TRANSPORT_LIMIT);
}

#[test]
fn waiting_uds_requests() {
    let mut scene = Scene::new();
    for number in 0..300 {
        scene.frame(Frame::data_frame(tester(number), &[2, 0x11, 1]));
    }
    assert_eq!(scene.evicted("waiting UDS request"), 300 - EXCHANGE_LIMIT);
}

/// 80 interleaved messages of CAN FD frames, until the stored data exceeds the limit.
#[test]
fn data_of_open_iso_tp_messages() {
    let mut scene = Scene::new();
    let mut data = [0x55; 64];
    for round in 0..1_000_usize {
        for number in 0..80 {
            if round == 0 {
                data[..6].copy_from_slice(&[0x10, 0, 0xFF, 0xFF, 0xFF, 0xFF]);
            } else {
                data[0] = 0x20 | u8::try_from(round & 0x0F).unwrap();
            }
            let mut frame = Frame::data_frame(tester(number), &data);
            frame.flags = FrameFlags::FD;
            scene.frame(frame);
        }
    }
    assert!(scene.evicted("data of open ISO-TP messages") > 0);
    assert!(scene.decoder.footprint() < 2 * OPEN_DATA_LIMIT + (1 << 20));
    for event in scene.finish().iter().filter(|event| event["kind"] == "isotp-transfer") {
        assert!(event["data"].as_str().unwrap().len() <= 2 * TRANSFER_DATA_LIMIT);
        assert_eq!(event["announced"], u32::MAX);
    }
}

#[test]
fn learnt_identifiers() {
    let mut scene = Scene::new();
    for node in 1..=9 {
        for index in 0x1800..0x1800 + 500 {
            scene.write(node, index, 1, cob_id(u32::from(node) << 16 | u32::from(index)));
        }
    }
    assert_eq!(scene.evicted("learnt identifier"), 9 * 500 - EXTENDED_ID_LIMIT);
}

/// A boot-up drops learnt entries. With the max number of entries, it must not search all of them for each
/// identifier.
#[test]
fn boot_ups_of_a_node_with_many_writes() {
    let mut scene = Scene::new();
    for pdo in 0..500 {
        scene.write(5, 0x1800 + pdo, 1, cob_id(0x1000 + u32::from(pdo)));
        scene.frame(Frame::data_frame(CanId::from_extended(0x1000 + u32::from(pdo)), &[1]));
    }
    for _ in 0..2_000 {
        scene.standard(0x705, &[0]);
    }
    assert_eq!(scene.decoder.buses().first().unwrap().node(5).unwrap().boot_count(), 2_000);
}

/// Thousands of devices claim all addresses: each claim is one event, or two if a device is evicted.
#[test]
fn a_storm_of_address_claims() {
    let mut scene = Scene::new();
    scene.checker.kept = None;
    // Decreasing NAMEs, so that each one wins its address; then greater ones, which win none.
    let claims = 20_000_u64;
    for number in 0..claims {
        let name = if number < claims / 2 { claims - number } else { claims + number };
        let address = u32::try_from(number % 254).unwrap();
        scene.frame(Frame::data_frame(CanId::from_extended(0x18EE_FF00 | address), &name.to_le_bytes()));
    }
    // The first 254 addresses were free.
    let lost = usize::try_from(claims / 2).unwrap() - 254;
    assert_eq!(scene.evicted("device without address"), lost - ADDRESSLESS_LIMIT);
    assert!(scene.checker.events < 2 * 20_000 + 10, "{}", scene.checker.events);
    let footprint = scene.decoder.footprint();
    assert!(footprint < 2 << 20, "{footprint}");
}

/// A device with another fault in each DM1: one is active at a time, and the list of previous ones is
/// limited.
#[test]
fn a_flood_of_trouble_codes() {
    let mut scene = Scene::new();
    scene.checker.kept = None;
    for number in 1..=20_000_u32 {
        let [low, high, ..] = number.to_le_bytes();
        let source = number % 64;
        let dm1 = [0, 0xFF, low, high, 3, 1, 0xFF, 0xFF];
        scene.frame(Frame::data_frame(CanId::from_extended(0x18FE_CA00 | source), &dm1));
    }
    assert_eq!(scene.evicted("previously active trouble code"), 64);
    let footprint = scene.decoder.footprint();
    assert!(footprint < 2 << 20, "{footprint}");
}

/// Each identifier causes max one event per frame, with any payload.
#[test]
fn a_storm_of_every_identifier() {
    let mut scene = Scene::new();
    scene.checker.kept = None;
    for round in 0..8_u8 {
        for id in 0..0x800 {
            let mut frame = Frame::data_frame(CanId::from_standard(id), &[round.wrapping_mul(0x21); 8]);
            frame.flags = if round == 7 { FrameFlags::REMOTE } else { FrameFlags(0) };
            scene.frame(frame);
        }
    }
    assert!(scene.checker.events < 8 * 0x800 * 3, "{}", scene.checker.events);
    assert!(scene.decoder.footprint() < 1 << 20);
}

/// 255 packets are announced and never sent, between all pairs of 80 addresses: 6,400 transfers at once.
#[test]
fn transfers_announced_and_never_sent() {
    let mut scene = Scene::new();
    for source in 0..80 {
        for destination in 100..180 {
            // 1,785 bytes in 255 packets, of EF00.
            scene.group(0xEC, source, destination, &[16, 0xF9, 0x06, 255, 255, 0x00, 0xEF, 0x00]);
        }
    }
    // All within 0.64 s, before any time-out.
    assert_eq!(scene.evicted("J1939 transfer"), 6_400 - TRANSPORT_LIMIT);
    let footprint = scene.decoder.footprint();
    assert!(footprint < 3 << 20, "{footprint}");
    let events = scene.finish();
    let open: Vec<_> = events.iter().filter(|event| event["kind"] == "j1939-transfer").collect();
    assert_eq!(open.len(), TRANSPORT_LIMIT);
    assert!(open.iter().all(|event| event["outcome"] == "unfinished" && event["missing_packets"] == 255));
}

/// 100,000 packets of 117,440,505 announced bytes; memory does not grow after the first 64 KiB.
#[test]
fn the_largest_extended_transfer() {
    let mut scene = Scene::new();
    let pgn = [0x00, 0xCA, 0x00];
    scene.group(0xC8, 0x26, 0x80, &[&[20, 0xF9, 0xFF, 0xFF, 0x06][..], &pgn].concat());
    let mut footprints = Vec::new();
    for window in 0..500_u32 {
        let [low, middle, high, _] = (window * 200).to_le_bytes();
        let [next, carry, top, _] = (window * 200 + 1).to_le_bytes();
        scene.group(0xC8, 0x80, 0x26, &[&[21, 200, next, carry, top][..], &pgn].concat());
        scene.group(0xC8, 0x26, 0x80, &[&[22, 200, low, middle, high][..], &pgn].concat());
        (1..=200).for_each(|sequence| scene.group(0xC7, 0x26, 0x80, &[sequence, 1, 2, 3, 4, 5, 6, 7]));
        footprints.push(scene.decoder.footprint());
    }
    assert!(footprints[60] == footprints[499] && footprints[499] < 300 << 10, "{}", footprints[499]);
    let events = scene.finish();
    let transfer = events.iter().find(|event| event["kind"] == "j1939-transfer").unwrap();
    assert_eq!(transfer["size"], 700_000);
    assert_eq!((&transfer["announced"], &transfer["packets"]), (&117_440_505.into(), &16_777_215.into()));
    assert_eq!(transfer["missing_packets"], 16_777_215 - 100_000);
    assert_eq!((&transfer["truncated"], &transfer["outcome"]), (&true.into(), &"unfinished".into()));
    assert_eq!(transfer["data"].as_str().unwrap().len(), 2 * TRANSFER_DATA_LIMIT);
}

/// 80 extended transfers at once with 54,250 bytes each, in total over the limit.
#[test]
fn data_of_all_open_extended_transfers() {
    let mut scene = Scene::new();
    let pgn = [0x00, 0xCA, 0x00];
    for source in 0..80 {
        scene.group(0xC8, source, 0xF9, &[&[20, 0, 0, 2, 0][..], &pgn].concat());
    }
    // Interleaved, so that no transfer times out.
    for window in 0..31_u32 {
        let [low, middle, high, _] = (window * 250).to_le_bytes();
        for source in 0..80 {
            scene.group(0xC8, source, 0xF9, &[&[22, 250, low, middle, high][..], &pgn].concat());
        }
        for sequence in 1..=250 {
            (0..80).for_each(|source| scene.group(0xC7, source, 0xF9, &[sequence, 1, 2, 3, 4, 5, 6, 7]));
        }
    }
    assert!(scene.evicted("data of open J1939 transfers") > 0);
    let footprint = scene.decoder.footprint();
    assert!(footprint < OPEN_DATA_LIMIT * 2 + (1 << 20), "{footprint}");
    let events = scene.finish();
    let transfers: Vec<_> = events.iter().filter(|event| event["kind"] == "j1939-transfer").collect();
    assert_eq!(transfers.len(), 80);
    assert!(transfers.iter().all(|event| event["size"] == 54_250 && event["truncated"] == true));
    let kept = |event: &&Value| event["data"].as_str().map_or(0, str::len) / 2;
    assert!(transfers.iter().all(|event| matches!(kept(event), 0 | 54_250)));
    assert!(transfers.iter().map(kept).sum::<usize>() <= OPEN_DATA_LIMIT);
}

/// Random sizes and sequence numbers; each frame causes max two events.
#[test]
fn transport_frames_of_any_content() {
    let mut scene = Scene::new();
    scene.checker.kept = None;
    let before = scene.checker.events;
    for control in 0..=255 {
        for value in [0, 1, 2, 254, 255] {
            let data = [control, value, value, value, 255, 0x00, 0xEF, 0x00];
            for group in [0xEC, 0xEB, 0xC8, 0xC7] {
                scene.group(group, 1, 2, &data);
                scene.group(group, 2, 1, &data);
                scene.group(group, 1, 255, &data[..usize::from(control) % 9]);
            }
        }
    }
    let frames = 256 * 5 * 12;
    assert!(scene.checker.events - before < frames * 2, "{}", scene.checker.events);
    assert!(scene.decoder.footprint() < 1 << 20);
}
