//! One event of every kind, and more of kinds with different fields; every optional field is set at least
//! once.

use std::sync::Arc;

use crate::capture::BusNames;
use crate::decoder::Decoder;
use crate::event::{
    BitsChanged, BootCause, ByteOrderSource, ChangeOrigin, CrcCheck, DataRange, DecodedPdo, DeviceCause,
    DeviceState, EffectiveState, EmcyAction, Emergency, Event, EventKind, EventProtocol, EvictedState,
    ExchangeOutcome, FindingNews, FrameRange, IsoTpTransfer, MessageOutcome, MisplacedResponse, ModeChange,
    MonitoringMethod, NodeIdSource, NodeIdentified, NodeSilence, ObjectChange, PowerSign, ProcedureEvent,
    ProcedurePhase, Quantity, SdoAbort, SdoDirection, SdoIrregularity, SdoIrregularityKind, SdoMode,
    SdoOutcome, SdoTransfer, SetPoint, SourceConflict, StateCause, StateCertainty, StateChange, StatePath,
    UdsEndpoints, UdsExchange, UdsMessage, UndecodedFrame,
};
use crate::finding::Severity;
use crate::frame::{BusIndex, CanId, Frame, FrameFlags, LinkState, MAX_DATA, Timestamp};
use crate::profile::dbc::{self, Database};
use crate::profile::device::ProcedureStatus;
use crate::profile::{
    BitName, BitNames, Catalogue, DataType, LayoutOrigin, ObjectMeaning, PayloadLayout, PdoDirection,
    PdoName, Persistence, RawConversion, SignalField, ValueCarrier, ValueNames, WriteEffect,
};
use crate::session::{AssignedBy, Assignment, Bus, SessionOptions};
use crate::wire::MalformedPayload;
use crate::wire::canopen::emcy::EmcyByteOrder;
use crate::wire::canopen::lss::LssContent;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::test_marker::{TestMarker, TestResult};
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::error_frame;
use crate::wire::uds::UdsSubFunction;

use super::j1939;

/// A device with its own text for an abort code.
const PROFILE: &str = "id = \"acme-pump\"\ntitle = \"PUMP\"\n[[abort]]\ncode = 0x06020000\ntext = \"gone\"\n\
                       [[j1939.dtc]]\nspn = 298985\nfmi = 19\ntext = \"time guarding\"\n\
                       [[uds.nrc]]\ncode = 0x31\ntext = \"no such thing\"\n\
                       [emcy]\nvendor = [{ byte = 3, bytes = 2, name = \"channel\" }]\n\
                       code = [{ code = 0x8130, text = \"no guarding\", reaction = \"stops\" }]\n";

const DBC: &str = "VERSION \"\"\nBO_ 2566844926 M: 8 N\n SG_ Guard : 0|8@1+ (1,0) [0|250] \"\" N\n\
                   BA_DEF_ SG_ \"SPN\" INT 0 524287;\nBA_ \"SPN\" SG_ 2566844926 Guard 298985;\n";

/// A bus with node 2, named `ABCD`, which is an `acme-pump`.
pub fn bus() -> Bus {
    let mut catalogue = Catalogue::default();
    catalogue.add_text("pump.toml", PROFILE).unwrap();
    let device = catalogue.device("acme-pump").unwrap();
    let mut database = Database::default();
    database.add_file(dbc::parse_database(DBC.as_bytes()).unwrap());
    let options = SessionOptions {
        database: Arc::new(database),
        node_names: vec![(2.into(), "ABCD".into())],
        assignments: vec![Assignment { bus: None, node: 2.into(), device, by: AssignedBy::Option }],
        ..SessionOptions::default()
    };
    let mut decoder = Decoder::new(options);
    let mut frame = Frame::data_frame(CanId::from_standard(0x702), &[0]);
    frame.number = 1;
    frame.time = Some(Timestamp(0));
    decoder.push(&frame, &BusNames::default(), &mut |_: &Event, _: &Bus| {});
    decoder.buses().first().unwrap().clone()
}

/// An event of node 2 at 1.5 s in frames 3 to 4.
pub fn event(kind: EventKind) -> Event {
    Event {
        time: Some(Timestamp(1_500_000_000)),
        bus: BusIndex(0),
        frames: FrameRange { first: 3, last: 4 },
        protocol: EventProtocol::Canopen,
        node: Some(2.into()),
        presumed: true,
        routine: false,
        kind,
    }
}

/// All samples.
pub fn all() -> Vec<Event> {
    let kinds = [
        nodes(),
        states_and_set_points(),
        words_and_procedures(),
        messages(),
        transfers(),
        diagnostics(),
        layer_setting(),
        findings(),
        bus_and_capture(),
        j1939::all(&layout()),
    ]
    .concat();
    kinds.into_iter().map(event).collect()
}

fn nodes() -> Vec<EventKind> {
    let change = StateChange {
        from: Some(NmtState::PreOperational),
        to: NmtState::Operational,
        cause: StateCause::Heartbeat,
        cause_frame: 1,
        after: Some(20_000_000),
        certainty: StateCertainty::Confirmed,
    };
    let silence = NodeSilence {
        last_frame: 2,
        last_state: Some(NmtState::Operational),
        last_emcy: Some(0x8130),
        gap: 3_000_000_000,
        monitored_by: MonitoringMethod::Heartbeat,
        others_continue: true,
        boot_frame: Some(1),
    };
    let mut object_change = ObjectChange {
        object: ObjectAddress::new(0x1017, 0),
        from: Some(vec![0xE8, 3]),
        to: Some(vec![0xF4, 1]),
        origin: ChangeOrigin::Download,
        effect: Some(WriteEffect::ResetNode),
        persists: Some(Persistence::Yes),
    };
    let known = EventKind::ObjectChange(Box::new(object_change.clone()));
    object_change.from = None;
    object_change.to = None;
    vec![
        EventKind::NmtCommand {
            service: NmtService::Start,
            target: 2,
            from: Some(NmtState::PreOperational),
            to: Some(NmtState::Operational),
        },
        EventKind::NmtCommand { service: NmtService::Unknown(7), target: 2, from: None, to: None },
        EventKind::NmtState(change),
        EventKind::NmtState(StateChange { from: None, after: None, ..change }),
        EventKind::BootUp { cause: BootCause::Commanded { frame: 1 }, lost: 2 },
        EventKind::BootUp {
            cause: BootCause::PresumedPowerOn { sign: Some(PowerSign::BusWasSilent) },
            lost: 0,
        },
        EventKind::Heartbeat { state: Some(NmtState::Stopped), code: 4 },
        EventKind::Heartbeat { state: None, code: 9 },
        EventKind::GuardRequest,
        EventKind::GuardReply { state: None, code: 9, toggle: true, toggle_error: true },
        EventKind::NodeLost(silence),
        EventKind::NodeBack(NodeSilence {
            last_state: None,
            last_emcy: None,
            others_continue: true,
            ..silence
        }),
        EventKind::NodeIdChange { from: Some(1), to: 2, by: NodeIdSource::Lss },
        EventKind::NodeIdChange { from: None, to: 2, by: NodeIdSource::Lss },
        known,
        EventKind::ObjectChange(Box::new(object_change)),
    ]
}

fn states_and_set_points() -> Vec<EventKind> {
    let state = DeviceState {
        machine: "device".into(),
        channel: Some(1),
        from: None,
        to: "FAULT".into(),
        fault: true,
        cause: DeviceCause::Emcy,
        cause_frame: 3,
        emcy: Some(0x8130),
        leave: Some("send 03, then 0B".into()),
        control: Some(0x0F),
        path: Some(Box::new(StatePath {
            states: vec!["INIT".into(), "ACTIVE".into()],
            frames: vec![1, 2],
            duration: Some(200_000_000),
        })),
    };
    let known = DeviceState { from: Some("ACTIVE".into()), path: None, ..state.clone() };
    let point = SetPoint {
        object: ObjectAddress::new(0x6300, 1),
        signal: "Position set point".into(),
        short: None,
        channel: Some(1),
        carrier: ValueCarrier::Pdo(PdoName { direction: PdoDirection::Receive, number: 1 }),
        from: Some(Quantity { number: Some(0.5), text: "0.5 %".into() }),
        to: Quantity { number: None, text: "float".into() },
        unit: "%".into(),
        assumed: true,
        effective: EffectiveState::No,
        gates: vec!["ACTIVE reported".into()],
        invisible: vec!["hardware enable".into()],
        sync_after: Some(1_000_000),
    };
    vec![
        EventKind::DeviceState(Box::new(state)),
        EventKind::DeviceState(Box::new(known)),
        EventKind::SetPoint(Box::new(SetPoint {
            from: None,
            to: Quantity { number: Some(1.0), text: "1.0 %".into() },
            carrier: ValueCarrier::Message("AVC".into()),
            ..point.clone()
        })),
        EventKind::SetPoint(Box::new(point)),
    ]
}

fn words_and_procedures() -> Vec<EventKind> {
    let object = ObjectAddress::new(0x6041, 0);
    let bits = BitsChanged {
        object,
        name: "Status word".into(),
        channel: Some(1),
        set: vec!["ready".into()],
        cleared: vec!["hold".into()],
        words: Vec::new(),
    };
    let mode = ModeChange {
        object,
        name: "Control mode".into(),
        channel: Some(1),
        from: None,
        to: "pressure".into(),
        consequence: "RPDO1 carries pressure".into(),
    };
    let procedure = ProcedureEvent {
        procedure: "store".into(),
        word: None,
        phase: ProcedurePhase::Finished,
        status: ProcedureStatus::Ok,
        duration: Some(1_000_000),
        nominal: None,
        text: "completed".into(),
        object: Some(object),
        takes_over: false,
    };
    let conflict = SourceConflict {
        object,
        name: "Status word".into(),
        sources: vec![("eds".into(), vec![1]), ("upload".into(), vec![2])],
        text: "the file is of another device".into(),
    };
    let identified =
        NodeIdentified { device: "acme-pump".into(), title: "PUMP".into(), by: AssignedBy::Identity };
    vec![
        EventKind::NodeIdentified(Box::new(identified)),
        EventKind::BitsChanged(Box::new(bits)),
        EventKind::Mode(Box::new(ModeChange { from: Some("position".into()), ..mode.clone() })),
        EventKind::Mode(Box::new(mode)),
        EventKind::Procedure(Box::new(procedure)),
        EventKind::Conflict(Box::new(conflict)),
    ]
}

/// A value with a name, one without, and the number of a parameter.
fn layout() -> Arc<PayloadLayout> {
    let field = |sub, name: Option<&str>, bit, data_type| SignalField {
        meaning: name.map(|name| Arc::new(meaning(name))),
        ..SignalField::of_object(ObjectAddress::new(0x2001, sub), bit, 8, data_type)
    };
    Arc::new(PayloadLayout {
        fields: vec![field(0, Some("speed"), 0, DataType::Unsigned8), field(1, None, 8, DataType::Integer8)],
        bits: 16,
        origin: LayoutOrigin::Wire,
        assumed: true,
        ..PayloadLayout::default()
    })
}

fn messages() -> Vec<EventKind> {
    let emergency = Emergency {
        cob_id: CanId::from_standard(0x85),
        code: Some(0x8130),
        register: Some(0x11),
        vendor: [1, 2, 3, 4, 5],
        vendor_length: 5,
        action: EmcyAction::Raised,
        active: 1,
        byte_order: EmcyByteOrder::LsbFirst,
        byte_order_by: ByteOrderSource::Standard,
        alternative: Some(0x3081),
        boot: None,
    };
    let ready = Emergency {
        code: None,
        register: None,
        vendor_length: 0,
        action: EmcyAction::Ready,
        boot: Some(BootCause::PresumedPowerOn { sign: Some(PowerSign::OtherNodesToo) }),
        ..emergency
    };
    let ready_commanded = Emergency { boot: Some(BootCause::Commanded { frame: 3 }), ..ready };
    let layout = layout();
    let mut pdo = DecodedPdo {
        name: PdoName { direction: PdoDirection::Transmit, number: 1 },
        cob_id: CanId::from_standard(0x182),
        is_request: false,
        length: 2,
        bytes: [0; MAX_DATA],
        layout: Some(layout),
    };
    pdo.bytes[..2].copy_from_slice(&[200, 0xFE]);
    vec![
        EventKind::Sync { counter: Some(5), expected: Some(4) },
        EventKind::Sync { counter: None, expected: None },
        EventKind::Time { milliseconds: 43_200_000, days: 14_610 },
        EventKind::Emcy(emergency),
        EventKind::Emcy(ready),
        EventKind::Emcy(ready_commanded),
        EventKind::Pdo(pdo.clone()),
        EventKind::Pdo(DecodedPdo { length: 1, ..pdo.clone() }),
        EventKind::Pdo(DecodedPdo { is_request: true, ..pdo }),
    ]
}

/// A meaning with all properties that the output shows.
fn meaning(name: &str) -> ObjectMeaning {
    let bit = BitName {
        bit: 0,
        width: 1,
        name: "ready".into(),
        text: None,
        off: None,
        values: None,
        reserved: false,
    };
    ObjectMeaning {
        name: name.to_owned(),
        data_type: Some(DataType::Unsigned16),
        unit: "ms".into(),
        values: Some(Arc::new(ValueNames([(200, "two hundred".to_owned())].into()))),
        special: Some(Arc::new(ValueNames([(1000, "one second".to_owned())].into()))),
        bits: Some(Arc::new(BitNames { list: vec![bit] })),
        range: Some([0, 1]),
        ..ObjectMeaning::default()
    }
}

/// A write of a heartbeat time.
fn write() -> SdoTransfer {
    SdoTransfer {
        request: CanId::from_standard(0x602),
        response: CanId::from_standard(0x582),
        client: Some(127),
        direction: Some(SdoDirection::Download),
        mode: Some(SdoMode::Block),
        object: Some(ObjectAddress::new(0x1017, 0)),
        meaning: Some(Arc::new(meaning("Producer heartbeat time"))),
        effect: Some(WriteEffect::AtOnce),
        persists: Some(Persistence::NeedsSave),
        size: 2,
        announced: Some(2),
        unseen: 0,
        data: vec![0xE9, 3],
        later_data: Vec::new(),
        missing_segments: 0,
        losses: 0,
        first_loss: None,
        truncated: false,
        previous: None,
        previous_assumed: false,
        duration: Some(1_000_000),
        waited: None,
        outcome: SdoOutcome::Complete,
        abort: None,
        crc: Some(CrcCheck::Correct),
        irregularity: None,
        overlap: None,
        retries: 0,
        is_ambiguous: false,
        is_unrequested: false,
        unrequested_responses: 0,
        misplaced: None,
        awaits_client: true,
        cut_start: false,
        cut_end: false,
        frame_count: 2,
    }
}

/// A transfer with segments that were not captured, and responses without a request.
fn with_gap(write: &SdoTransfer) -> SdoTransfer {
    SdoTransfer {
        meaning: None,
        size: 21,
        announced: None,
        unseen: 7,
        data: vec![1; 7],
        later_data: vec![DataRange { offset: 14, data: vec![2; 7] }],
        missing_segments: 1,
        losses: 1,
        first_loss: Some((2, Some(8))),
        overlap: Some(2_000_000),
        retries: 1,
        is_ambiguous: true,
        is_unrequested: true,
        unrequested_responses: 3,
        misplaced: Some(MisplacedResponse { id: CanId::from_standard(0x602), frame: 9 }),
        truncated: true,
        crc: Some(CrcCheck::Unchecked),
        ..write.clone()
    }
}

fn transfers() -> Vec<EventKind> {
    let write = write();
    let aborted = SdoTransfer {
        client: None,
        direction: None,
        mode: None,
        object: None,
        duration: None,
        outcome: SdoOutcome::Aborted,
        abort: Some(SdoAbort { code: 0x0602_0000, by_client: true }),
        irregularity: Some(SdoIrregularity { what: SdoIrregularityKind::Toggle, by_client: false, frame: 7 }),
        cut_start: true,
        truncated: true,
        ..write.clone()
    };
    let refused = SdoTransfer {
        outcome: SdoOutcome::Aborted,
        abort: Some(SdoAbort { code: 0x0602_0000, by_client: false }),
        data: 1000_u16.to_le_bytes().to_vec(),
        ..write.clone()
    };
    let plain = SdoTransfer {
        meaning: Some(Arc::new(ObjectMeaning {
            scale: Some(RawConversion { factor: 0.1, offset: 0.0, full_scale: None, is_reciprocal: false }),
            ..meaning("Pressure")
        })),
        ..refused.clone()
    };
    let text = SdoTransfer {
        direction: Some(SdoDirection::Upload),
        object: Some(ObjectAddress::new(0x1008, 0)),
        meaning: Some(Arc::new(ObjectMeaning {
            name: "Manufacturer device name".into(),
            data_type: Some(DataType::VisibleString),
            ..ObjectMeaning::default()
        })),
        data: b"ABCD".to_vec(),
        ..write.clone()
    };
    let with_gap = with_gap(&write);
    [write, aborted, refused, plain, text, with_gap]
        .map(|transfer| EventKind::SdoTransfer(Box::new(transfer)))
        .into()
}

fn messages_of_frames(ends: &UdsEndpoints) -> Vec<EventKind> {
    let message = IsoTpTransfer {
        ends: ends.clone(),
        id: CanId::from_extended(0x1BC7_8820),
        flow_control: Some(CanId::from_extended(0x1BC1_00F1)),
        address_byte: Some(0x12),
        announced: 20,
        size: 13,
        data: vec![0x2E, 0xF1, 0x90],
        truncated: true,
        is_single: false,
        waits: 2,
        frame_count: 5,
        duration: Some(1_000_000),
        outcome: MessageOutcome::NoFlowControl,
    };
    let single = IsoTpTransfer {
        address_byte: None,
        flow_control: None,
        is_single: true,
        waits: 0,
        truncated: false,
        duration: None,
        outcome: MessageOutcome::Complete,
        ..message.clone()
    };
    [message, single].map(|message| EventKind::IsoTpTransfer(Box::new(message))).into()
}

fn message(data: &[u8]) -> UdsMessage {
    UdsMessage {
        id: CanId::from_extended(0x1BC7_8802),
        data: data.to_vec(),
        size: 9000,
        truncated: false,
        frames: FrameRange { first: 3, last: 4 },
    }
}

/// A node-ID that is written by UDS.
fn written(ends: &UdsEndpoints) -> UdsExchange {
    UdsExchange {
        ends: ends.clone(),
        service: 0x2E,
        sub_function: Some(UdsSubFunction { value: 1, suppress_response: true }),
        identifier: Some(0x1001),
        meaning: Some(Arc::new(meaning("node-ID"))),
        effect: Some(WriteEffect::ResetNode),
        order: EmcyByteOrder::LsbFirst,
        request: Some(message(&[0x2E, 1, 0x10, 0xC9, 0])),
        response: Some(message(&[0x6E, 1, 0x10])),
        outcome: ExchangeOutcome::Positive,
        nrc: None,
        pending: 2,
        latency: Some(8_000_000),
        duration: Some(9_000_000),
    }
}

fn diagnostics() -> Vec<EventKind> {
    let ends = UdsEndpoints {
        source: Some(0x1F1),
        target: Some(0x102),
        functional: true,
        server: Some("ECU".into()),
    };
    let written = written(&ends);
    let named = UdsExchange { request: Some(message(&[0x2E, 1, 0x10, 200, 0])), ..written.clone() };
    let session = UdsExchange {
        service: 0x10,
        identifier: None,
        meaning: None,
        pending: 0,
        request: Some(message(&[0x10, 0x81])),
        outcome: ExchangeOutcome::Suppressed,
        response: None,
        latency: None,
        duration: None,
        ..written.clone()
    };
    let refused = UdsExchange {
        request: Some(UdsMessage { truncated: true, ..message(&[0x2E, 1]) }),
        response: Some(UdsMessage { truncated: true, ..message(&[0x7F, 0x2E, 0x31]) }),
        outcome: ExchangeOutcome::Negative,
        nrc: Some(0x31),
        ..written.clone()
    };
    let read = UdsExchange {
        ends: UdsEndpoints { source: None, target: None, functional: false, server: None },
        service: 0x22,
        identifier: Some(0xF190),
        meaning: None,
        request: None,
        response: Some(message(b"\x62\xF1\x90ABCDEF")),
        outcome: ExchangeOutcome::Unsolicited,
        ..written.clone()
    };
    let unknown = UdsExchange {
        service: 0x21,
        request: Some(message(&[0x21, 1])),
        response: None,
        outcome: ExchangeOutcome::NoAnswer,
        ..read.clone()
    };
    let exchanges = [written, named, session, refused, read, unknown];
    let exchanges = exchanges.map(|exchange| EventKind::UdsExchange(Box::new(exchange)));
    messages_of_frames(&ends).into_iter().chain(exchanges).collect()
}

fn layer_setting() -> Vec<EventKind> {
    let contents = [
        (0x04, LssContent::Mode(1)),
        (0x04, LssContent::Mode(9)),
        (0x11, LssContent::NodeId(5)),
        (0x13, LssContent::BitTiming { table: 0, entry: 3 }),
        (0x15, LssContent::Delay(500)),
        (0x40, LssContent::Number(1)),
        (0x41, LssContent::Number(1)),
        (0x42, LssContent::Number(1)),
        (0x43, LssContent::Number(1)),
        (0x48, LssContent::Number(1)),
        (0x49, LssContent::Number(1)),
        (0x4A, LssContent::Number(1)),
        (0x4B, LssContent::Number(1)),
        (0xEE, LssContent::Number(1)),
        (0x17, LssContent::Result { code: 0, specific: 0 }),
        (0x17, LssContent::Result { code: 255, specific: 7 }),
        (0x51, LssContent::FastScan { number: 0xAB, bit: 31, sub: 0, next: 1 }),
        (0x4F, LssContent::Nothing),
    ];
    contents.map(|(command, content)| EventKind::Lss { command, from_master: true, content }).into()
}

/// A frame of a database: with unit and without, a name of a value, a suspect parameter.
fn described() -> EventKind {
    let text = "BO_ 291 STATE: 3 N\n SG_ Speed : 0|8@1+ (0.5,0) [0|100] \"km/h\" N\n \
                SG_ Gear : 8|8@1+ (1,0) [0|0] \"\" N\n SG_ Load : 16|8@1+ (1,0) [0|250] \"%\" N\n\
                VAL_ 291 Gear 2 \"second\" ;\nBA_ \"SPN\" SG_ 291 Load 520192;\n";
    let file = dbc::parse_database(text.as_bytes()).unwrap();
    let message = file.messages().next().map(|(_, message)| Arc::new(message.clone()));
    let frame = Frame::data_frame(CanId::from_standard(291), &[255, 2, 255]);
    EventKind::Frame(UndecodedFrame { frame, name: None, message })
}

fn findings() -> Vec<EventKind> {
    let news = FindingNews {
        id: 1,
        rule: "sdo-no-response".into(),
        severity: Severity::Warning,
        word: "SDO",
        text: "answered after 312 ms".into(),
        object: Some(ObjectAddress::new(0x1018, 1)),
        pgn: Some(65_226),
        about: Some("valve".into()),
        cause: Some(7),
        cause_frame: None,
        member_of: Some(4),
        downgraded: Some("the protocol is presumed only".into()),
        count: 3,
        is_at_end: true,
        source: Some("CiA 301 §7.2.4".into()),
        is_manual: false,
    };
    let plain = FindingNews {
        object: None,
        pgn: None,
        about: None,
        cause: None,
        member_of: None,
        downgraded: None,
        is_at_end: false,
        source: None,
        severity: Severity::Error,
        ..news.clone()
    };
    let (opened, closed) = (EventKind::FindingOpened, EventKind::FindingClosed);
    vec![
        opened(Box::new(FindingNews { is_at_end: false, ..news.clone() })),
        opened(Box::new(plain.clone())),
        closed(Box::new(news)),
        closed(Box::new(plain)),
    ]
}

fn bus_and_capture() -> Vec<EventKind> {
    let mut frame = Frame::data_frame(CanId::from_extended(0x18FE_CA00), &[1, 2, 3]);
    frame.flags = FrameFlags::REMOTE.with(FrameFlags::FD);
    let error = MalformedPayload { layer: "sdo", offset: 0, needed: 8, available: 3 };
    vec![
        EventKind::CanError(error_frame::parse_error_frame(0x2000_0204, &[0, 4, 0, 0, 0, 0, 96, 128])),
        EventKind::Frame(UndecodedFrame { frame, name: Some("dynamic SDO request"), message: None }),
        described(),
        EventKind::TestCase(TestMarker { group: 7, case: 101, result: Some(TestResult::Skipped) }),
        EventKind::TestCase(TestMarker { group: 7, case: 101, result: None }),
        EventKind::Malformed { error, reason: "too short" },
        EventKind::Evicted { what: EvictedState::Object, count: 1 },
        EventKind::ClockStep { step: -1_000_000 },
        EventKind::BusSilent { gap: 2_000_000_000 },
        EventKind::LostFrames { count: Some(3) },
        EventKind::LostFrames { count: None },
        EventKind::Link { state: LinkState::Up, bit_rate: Some(250_000) },
        EventKind::Link { state: LinkState::Gone, bit_rate: None },
        EventKind::Unreadable {
            file: Some("part2.log".into()),
            line: Some(7),
            offset: Some(99),
            count: 1,
            reason: "no frame".into(),
        },
        EventKind::Note { text: "times are taken for absolute".into() },
    ]
}
