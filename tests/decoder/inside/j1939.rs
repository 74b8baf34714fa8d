//! Events of J1939 and of transport sessions; every optional field is set at least once.

use std::sync::Arc;

use crate::event::{
    AddressClaim, AddressConflict, ClaimAction, CommandedAddress, Dtc, DtcAction, EventKind,
    IrregularityKind, J1939Acknowledgement, J1939Message, J1939Request, J1939Transfer, MessageGap,
    SdoOutcome, TransferIrregularity, TransportAbort, TransportMode, TransportTimer,
};
use crate::frame::{CanId, MAX_DATA};
use crate::profile::ValueNames;
use crate::profile::{DataType, ObjectMeaning, PayloadLayout, SignalField, SignalId};
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::{ALL, Acknowledgement, J1939Id, J1939Name, Pgn};

/// The lower NAME wins.
const NAMES: [J1939Name; 2] = [J1939Name(0x8000_0000_0000_0001), J1939Name(0xA322_810A_0721_2345)];

/// One event of every kind; `layout` is longer than one byte.
pub fn all(layout: &Arc<PayloadLayout>) -> Vec<EventKind> {
    let names =
        |name: &str| Some(Arc::new(ValueNames([(0x32, name.to_owned()), (1, name.to_owned())].into())));
    let meaning = ObjectMeaning {
        name: "state".into(),
        values: names("extend"),
        range: Some([90, 95]),
        ..ObjectMeaning::default()
    };
    let spn = SignalField {
        id: SignalId::Spn(1908),
        meaning: Some(Arc::new(meaning)),
        ..SignalField::of_object(ObjectAddress::default(), 0, 8, DataType::Unsigned8)
    };
    let mut layout = PayloadLayout::clone(layout);
    layout.fields.push(spn);
    let layout = Arc::new(layout);
    [messages(&layout), transfers(&layout), management(), faults()].concat()
}

fn messages(layout: &Arc<PayloadLayout>) -> Vec<EventKind> {
    let message = |id: u32, length| {
        EventKind::J1939Message(J1939Message {
            id: J1939Id::from_identifier(id).unwrap(),
            can_id: CanId::from_extended(id),
            name: Some("auxiliary valve 0 command".into()),
            length,
            bytes: [0x32; MAX_DATA],
            layout: Some(Arc::clone(layout)),
        })
    };
    let gap = MessageGap {
        message: "AVC valve 0".into(),
        pgn: Pgn::new(0xFE30),
        source: 0xF1,
        gap: 312_000_000,
        limit: 250_000_000,
        usual: Some((100_000_000, 3_000_000)),
        has_returned: true,
    };
    vec![message(0x0CFE_30F1, 8), message(0x0CEF_8021, 1), EventKind::MessageGap(Box::new(gap))]
}

fn transfers(layout: &Arc<PayloadLayout>) -> Vec<EventKind> {
    let transfer = J1939Transfer {
        mode: Some(TransportMode::Connection),
        pgn: Some(Pgn::DM2),
        name: Some("DM2 previously active faults".into()),
        priority: 6,
        source: 0x80,
        destination: 0xF1,
        announced: Some(20),
        packets: Some(3),
        size: 14,
        missing: 1,
        repeated: 1,
        spacing: Some((51_000_000, 180_000_000)),
        data: vec![1; 14],
        truncated: true,
        layout: Some(Arc::clone(layout)),
        duration: Some(1_000_000),
        outcome: SdoOutcome::Aborted,
        timer: Some(TransportTimer::T1),
        abort: Some(TransportAbort { reason: 3, by_sender: false }),
        cut_start: true,
        cut_end: false,
        frame_count: 5,
    };
    let unknown = J1939Transfer {
        mode: None,
        pgn: None,
        duration: None,
        data: vec![1],
        abort: None,
        outcome: SdoOutcome::Incomplete,
        ..transfer.clone()
    };
    let irregularity = TransferIrregularity {
        what: IrregularityKind::Late,
        message: "TP.CM_CTS",
        pgn: Some(Pgn::DM2),
        source: Some(0xF1),
        destination: Some(0x80),
        packet: Some(3),
        expected: Some(2),
        timer: Some(TransportTimer::Tr),
        delay: Some(230_000_000),
    };
    vec![
        EventKind::J1939Transfer(Box::new(transfer)),
        EventKind::J1939Transfer(Box::new(unknown)),
        EventKind::TransportIrregularity(Box::new(irregularity)),
    ]
}

fn management() -> Vec<EventKind> {
    let [lower, higher] = NAMES;
    let message = Acknowledgement { control: 1, group_function: 255, address: 0xF1, pgn: Pgn::DM2 };
    let claim = AddressClaim {
        action: ClaimAction::Lost,
        name: higher,
        source: 0x80,
        from: Some(0x81),
        contention: Some(AddressConflict { other: lower, winner: lower }),
        commanded: 7,
    };
    vec![
        EventKind::J1939Request(J1939Request {
            pgn: Pgn::ADDRESS_CLAIMED,
            name: Some("address claimed".into()),
            source: 0xF1,
            destination: ALL,
        }),
        EventKind::Acknowledgement(J1939Acknowledgement {
            message,
            name: Some("DM2 previously active faults".into()),
            source: 0x80,
            destination: ALL,
        }),
        EventKind::AddressClaim(claim),
        EventKind::CommandedAddress(CommandedAddress {
            name: higher,
            address: 0x82,
            source: 0xF1,
            present: Some(0x80),
        }),
    ]
}

fn faults() -> Vec<EventKind> {
    let dtc = Dtc {
        spn: 298_985,
        fmi: 19,
        count: Some(2),
        action: DtcAction::NoLongerReported,
        source: 0x80,
        is_old_coding: true,
        lamps: vec!["amber-warning-slow"],
        first_frame: 1,
        last_frame: 2,
        since: Some(2_000_000_000),
        may_be_hidden: true,
        by_silence: true,
    };
    let plain = Dtc { count: None, since: None, action: DtcAction::Raised, ..dtc.clone() };
    vec![EventKind::Dtc(Box::new(dtc)), EventKind::Dtc(Box::new(plain))]
}
