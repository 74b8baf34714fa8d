//! Wire parsers: fields are read at their positions, and errors about missing bytes are consistent.

use cobscope_decoder::profile::{self, lamp_names};
use cobscope_decoder::wire::canopen::emcy::{EmcyByteOrder, EmcyMessage};
use cobscope_decoder::wire::canopen::sdo::{InitiateData, SdoMessage, SdoSide, TransferPhase};
use cobscope_decoder::wire::isotp::{IsoTpAddresses, IsoTpFrame};
use cobscope_decoder::wire::j1939::{
    self as messages, ConnectionManagement, J1939Id, J1939Name, Pgn, SpnConversion, TroubleCodeList,
};
use cobscope_decoder::wire::uds::UdsPdu;
use cobscope_decoder::wire::{
    MalformedPayload, canopen, error_frame as error_frames, isotp as transport, uds as diagnostics,
};

/// Payload of a frame, cut to the maximum of CAN FD.
fn payload(data: &[u8]) -> &[u8] {
    data.get(..64).unwrap_or(data)
}

/// Checks that the error needs more bytes than available, counted from the same offset.
fn is_consistent(error: MalformedPayload, data: &[u8]) {
    let MalformedPayload { offset, needed, available, .. } = error;
    assert_eq!(usize::from(offset) + usize::from(available), data.len(), "{error:?} of {data:02X?}");
    assert!(needed > available, "{error:?} of {data:02X?}");
}

/// Fuzzes NMT commands.
pub fn nmt(data: &[u8]) {
    let data = payload(data);
    match canopen::nmt::parse(data) {
        Ok(command) => assert_eq!(command.target, data[1]),
        Err(error) => is_consistent(error, data),
    }
}

/// Fuzzes heartbeat, boot-up and guarding.
pub fn error_control(data: &[u8]) {
    let data = payload(data);
    match canopen::error_control::parse(data) {
        Ok(message) => assert_eq!(u8::from(message.toggle) << 7 | message.code, data[0]),
        Err(error) => is_consistent(error, data),
    }
}

/// Fuzzes DM1 and DM2 of any length, with all SPN conversions.
pub fn trouble_codes(data: &[u8]) {
    // Maximum message size of the J1939-21 transport protocol.
    let data = data.get(..1785).unwrap_or(data);
    let list = match TroubleCodeList::read(data) {
        Ok(list) => list,
        Err(error) => return is_consistent(error, data),
    };
    for version in 0..=3 {
        let conversion = SpnConversion::try_from(version).ok();
        for code in list.codes(conversion) {
            assert!(code.spn < 1 << 19 && code.fmi < 32 && code.count.is_none_or(|count| count < 127));
            assert!(!(code.is_assumed && conversion.is_some()), "{code:?}");
        }
        assert!(list.codes(conversion).count() <= (data.len() - 2) / 4);
    }
    assert!(lamp_names(list.lamps).count() <= 4);
}

/// Fuzzes SYNC.
pub fn sync(data: &[u8]) {
    assert_eq!(canopen::sync::parse(payload(data)), data.first().copied());
}

/// Fuzzes TIME.
pub fn time(data: &[u8]) {
    let data = payload(data);
    match canopen::time::parse(data) {
        Ok(time) => assert!(time.milliseconds < 1 << 28 && data.len() >= 6),
        Err(error) => is_consistent(error, data),
    }
}

/// Fuzzes EMCY in both byte orders.
pub fn emcy(data: &[u8]) {
    let data = payload(data);
    let [first, second] =
        [EmcyByteOrder::LsbFirst, EmcyByteOrder::MsbFirst].map(|order| canopen::emcy::parse(data, order));
    match (first, second) {
        (
            Ok(EmcyMessage::Error { code, vendor_length, .. }),
            Ok(EmcyMessage::Error { code: swapped, .. }),
        ) => {
            assert_eq!(code, swapped.swap_bytes());
            assert_eq!(usize::from(vendor_length), data.len().saturating_sub(3).min(5));
        }
        (Ok(EmcyMessage::Ready), Ok(EmcyMessage::Ready)) => assert!(data.is_empty()),
        (Err(error), Err(other)) => {
            assert_eq!(error, other);
            is_consistent(error, data);
        }
        (first, second) => panic!("{first:?} and {second:?}"),
    }
}

/// Fuzzes SDO of client and server in both phases.
pub fn sdo(data: &[u8]) {
    let data = payload(data);
    for side in [SdoSide::Client, SdoSide::Server] {
        for phase in [TransferPhase::Commands, TransferPhase::BlockSegments] {
            match canopen::sdo::parse(data, side, phase) {
                Ok(message) => sdo_message(message, data, phase),
                Err(error) => is_consistent(error, data),
            }
        }
    }
}

fn sdo_message(message: SdoMessage<'_>, data: &[u8], phase: TransferPhase) {
    match message {
        SdoMessage::InitiateDownload { payload: InitiateData::Expedited { data: value, .. }, .. }
        | SdoMessage::UploadInitiated { payload: InitiateData::Expedited { data: value, .. }, .. } => {
            assert_eq!(data.get(4..4 + value.len()), Some(value));
            assert!(value.len() <= 4);
        }
        SdoMessage::DownloadSegment(segment) | SdoMessage::UploadSegment(segment) => {
            assert_eq!(data.get(1..=segment.data.len()), Some(segment.data));
            assert!(segment.data.len() <= 7);
        }
        SdoMessage::BlockSegment { sequence, data: value, .. } => {
            assert!(phase == TransferPhase::BlockSegments && sequence < 128);
            assert_eq!(data.get(1..), Some(value));
        }
        SdoMessage::Abort { .. } => assert!(data[0] == 0x80 && data.len() >= 8),
        SdoMessage::Unknown { command } => assert_eq!(command, data[0]),
        _ => {}
    }
}

/// Fuzzes LSS of master and slave.
pub fn lss(data: &[u8]) {
    let data = payload(data);
    for from_master in [false, true] {
        match canopen::lss::parse(data, from_master) {
            Ok(message) => assert_eq!(message.command, data[0]),
            Err(error) => is_consistent(error, data),
        }
    }
}

/// Fuzzes ISO-TP with normal and with extended addressing, and the addresses of an identifier built from the
/// same bytes.
pub fn isotp(data: &[u8]) {
    let frame = payload(data);
    for data in [frame, frame.get(1..).unwrap_or_default()] {
        match transport::parse(data, frame.len()) {
            Ok(message) => isotp_message(message, data),
            Err(error) => is_consistent(error, data),
        }
    }
    if let Some(id) = data.first_chunk()
        && let Some(found) = IsoTpAddresses::from_identifier(u32::from_le_bytes(*id) & 0x1FFF_FFFF)
    {
        assert!(found.source < 1 << 11 && found.target < 1 << 11 && found.priority < 8);
    }
}

fn isotp_message(message: IsoTpFrame<'_>, data: &[u8]) {
    match message {
        IsoTpFrame::Single { data: message } => {
            let begin = if data[0] == 0 { 2 } else { 1 };
            assert_eq!(data.get(begin..begin + message.len()), Some(message));
            assert!(!message.is_empty());
        }
        IsoTpFrame::First { size, data: begun } => {
            assert!(data.ends_with(begun) && !begun.is_empty());
            assert!(usize::try_from(size).unwrap() > begun.len());
        }
        IsoTpFrame::Consecutive { sequence, data: more } => {
            assert!(sequence < 16 && data.get(1..) == Some(more) && !more.is_empty());
        }
        IsoTpFrame::FlowControl(control) => {
            assert!((100_000..=127_000_000).contains(&control.separation_time().max(100_000)));
        }
        IsoTpFrame::Unknown { control } => assert_eq!(control, data[0]),
    }
}

/// Fuzzes UDS messages, with their entries in the table of services.
pub fn uds(data: &[u8]) {
    let (service, rest, is_response) = match diagnostics::parse(data) {
        Ok(UdsPdu::Request { service, data: rest }) => (service, rest, false),
        Ok(UdsPdu::Positive { service, data: rest }) => (service, rest, true),
        Ok(UdsPdu::Negative { service, code }) => {
            return assert_eq!(data.get(..3), Some(&[0x7F, service, code][..]));
        }
        Err(error) => return is_consistent(error, data),
    };
    assert_eq!((data[0] & 0xBF, data[0] & 0x40 != 0), (service, is_response));
    assert_eq!(data.get(1..), Some(rest));
    let Some(entry) = profile::uds_names().service_by_id(service) else { return };
    let shape = if is_response { entry.response() } else { entry.request() };
    assert!(rest.ends_with(shape.record(rest)));
    let [first, second] =
        [EmcyByteOrder::MsbFirst, EmcyByteOrder::LsbFirst].map(|order| shape.identifier(rest, order));
    assert_eq!(first.is_some(), second.is_some());
    if let Some(sub_function) = shape.sub_function(rest) {
        assert_eq!(sub_function.value | u8::from(sub_function.suppress_response) << 7, rest[0]);
    }
}

/// Fuzzes J1939: identifiers, NAMEs, and all parsed messages; the first four bytes are the identifier.
pub fn j1939(data: &[u8]) {
    let Some((id, rest)) = data.split_first_chunk() else { return };
    let payload = payload(rest);
    if let Some(id) = J1939Id::from_identifier(u32::from_le_bytes(*id) & 0x1FFF_FFFF) {
        assert!(id.priority < 8 && id.pgn == Pgn::new(id.pgn.number()));
        assert!(!id.pgn.is_addressed() || id.pgn.number().is_multiple_of(0x100));
    }
    if let Some(name) = J1939Name::read(payload) {
        assert!(name.fields().manufacturer_code < 1 << 11 && name.fields().identity_number < 1 << 21);
    }
    let errors = [
        messages::parse_request(payload).err(),
        messages::Acknowledgement::read(payload).err(),
        messages::commanded_address(payload).err(),
        messages::parse_packet(payload, false).err(),
        messages::parse_packet(payload, true).err(),
        messages::parse_management(payload, false).err(),
        messages::parse_management(payload, true).err(),
    ];
    errors.into_iter().flatten().for_each(|error| is_consistent(error, payload));
    for is_extended in [false, true] {
        match messages::parse_management(payload, is_extended) {
            Ok((ConnectionManagement::RequestToSend { size, packets }, _)) if is_extended => {
                assert!(u64::from(packets) * 7 >= u64::from(size));
            }
            Ok((message, _)) => assert!(message.name(is_extended).contains("TP.")),
            Err(_) => {}
        }
    }
}

/// Fuzzes SocketCAN error frames; the first four bytes are the identifier.
pub fn error_frame(data: &[u8]) {
    let Some((id, rest)) = data.split_first_chunk() else { return };
    let frame = error_frames::parse_error_frame(u32::from_le_bytes(*id), payload(rest));
    assert!(frame.classes < 1 << 29);
    assert_eq!(frame.controller, rest.get(1).copied().unwrap_or(0));
}
