//! Properties of all parsers, for any payload.

use proptest::collection::vec;
use proptest::prelude::*;

use super::canopen::emcy::EmcyByteOrder;
use super::canopen::sdo::{SdoSide, TransferPhase};
use super::canopen::{emcy, error_control, lss, nmt, sdo, sync, test_marker, time};
use super::error_frame::ErrorFrameFields;
use super::isotp::IsoTpAddresses;
use super::j1939::{Acknowledgement, J1939Id, J1939Name, SpnConversion, TroubleCodeList};
use super::uds::{IdentifierPlace, ServiceLayout};
use super::{MalformedPayload, error_frame, isotp, j1939, uds};

type MessageParser = fn(&[u8]) -> Result<(), MalformedPayload>;

/// All parsers that can fail.
const PARSERS: [MessageParser; 22] = [
    |data| nmt::parse(data).map(drop),
    |data| error_control::parse(data).map(drop),
    |data| time::parse(data).map(drop),
    |data| emcy::parse(data, EmcyByteOrder::LsbFirst).map(drop),
    |data| emcy::parse(data, EmcyByteOrder::MsbFirst).map(drop),
    |data| lss::parse(data, true).map(drop),
    |data| lss::parse(data, false).map(drop),
    |data| sdo::parse(data, SdoSide::Client, TransferPhase::Commands).map(drop),
    |data| sdo::parse(data, SdoSide::Client, TransferPhase::BlockSegments).map(drop),
    |data| sdo::parse(data, SdoSide::Server, TransferPhase::Commands).map(drop),
    |data| sdo::parse(data, SdoSide::Server, TransferPhase::BlockSegments).map(drop),
    |data| isotp::parse(data, 8).map(drop),
    |data| isotp::parse(data, 64).map(drop),
    |data| uds::parse(data).map(drop),
    |data| j1939::parse_management(data, false).map(drop),
    |data| j1939::parse_management(data, true).map(drop),
    |data| j1939::parse_packet(data, false).map(drop),
    |data| j1939::parse_packet(data, true).map(drop),
    |data| j1939::parse_request(data).map(drop),
    |data| Acknowledgement::read(data).map(drop),
    |data| j1939::commanded_address(data).map(drop),
    |data| TroubleCodeList::read(data).map(drop),
];

/// End of the missing bytes, counted from the start of the payload.
fn end(error: MalformedPayload) -> usize {
    usize::from(error.offset) + usize::from(error.needed)
}

fn payload() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![vec(any::<u8>(), 0..=9), vec(any::<u8>(), 0..=64)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, failure_persistence: None, ..Default::default() })]

    /// An error persists until the last missing byte is added, and no longer.
    #[test]
    fn an_error_states_the_missing_bytes(data in payload()) {
        for parse in PARSERS {
            let Err(error) = parse(&data) else { continue };
            prop_assert_eq!(usize::from(error.offset) + usize::from(error.available), data.len());
            prop_assert!(error.needed > error.available, "{:?}", error);
            let mut longer = data.clone();
            longer.resize(end(error) - 1, 0);
            prop_assert_eq!(parse(&longer).map_err(end), Err(end(error)), "{:?}", error);
            longer.push(0);
            prop_assert_ne!(parse(&longer).map_err(end), Err(end(error)), "{:?}", error);
        }
    }

    /// The error of a fast packet counts from the start of the frame.
    #[test]
    fn a_fast_frame_is_split_into_its_fields(data in payload()) {
        let first = data.first().copied();
        match j1939::fast_frame(&data) {
            Ok(frame) => {
                prop_assert_eq!(Some(frame.sequence << 5 | frame.number), first);
                prop_assert_eq!(frame.data.len() + if frame.number == 0 { 2 } else { 1 }, data.len());
                prop_assert_eq!(frame.length, if frame.number == 0 { data[1] } else { 0 });
                prop_assert_eq!(frame.full, if frame.number == 0 { 6 } else { 7 });
            }
            Err(error) => {
                prop_assert_eq!(usize::from(error.available), data.len());
                prop_assert!(data.get(1).map_or(error.needed > error.available, |length| *length > 223));
            }
        }
    }

    #[test]
    fn missing_bytes_of_an_error_frame_are_0(data in payload(), id in 0_u32..=0x3FFF_FFFF) {
        let byte = |index: usize| data.get(index).copied().unwrap_or(0);
        let frame = ErrorFrameFields {
            classes: id & 0x1FFF_FFFF,
            arbitration_bit: byte(0),
            controller: byte(1),
            protocol: byte(2),
            location: byte(3),
            transceiver: byte(4),
            transmit_errors: byte(6),
            receive_errors: byte(7),
        };
        prop_assert_eq!(error_frame::parse_error_frame(id, &data), frame);
    }

    #[test]
    fn identifiers_of_uds_are_read_at_their_offset(data in payload(), offset in 0_u8..=64, high: Option<u8>) {
        let layout = ServiceLayout { sub_function: false, identifier: Some(IdentifierPlace { offset, high }) };
        let rest = data.get(usize::from(offset)..).unwrap_or_default();
        let expected = match (high, rest) {
            (Some(high), [low, ..]) => Some([high, *low]),
            (None, [high, low, ..]) => Some([*high, *low]),
            _ => None,
        };
        let big = expected.map(u16::from_be_bytes);
        prop_assert_eq!(layout.identifier(&data, EmcyByteOrder::MsbFirst), big);
        // A high byte of the standard is not swapped.
        let little = if high.is_some() { big } else { big.map(u16::swap_bytes) };
        prop_assert_eq!(layout.identifier(&data, EmcyByteOrder::LsbFirst), little);
    }

    /// Parsers that have no error accept any payload.
    #[test]
    fn any_payload_is_accepted(data in payload(), id in 0_u32..=0x3FFF_FFFF) {
        prop_assert_eq!(sync::parse(&data), data.first().copied());
        let name = data.first_chunk().map(|bytes| J1939Name(u64::from_le_bytes(*bytes)));
        prop_assert_eq!(J1939Name::read(&data), name);
        let is_marker = matches!(data[..], [1, _, _, 0, 0, 0] | [2, _, _, 0, _, 0]);
        prop_assert_eq!(test_marker::parse(&data).is_some(), is_marker);
        if let Ok(list) = TroubleCodeList::read(&data) {
            let codes = list.codes(Some(SpnConversion::Version1));
            prop_assert!(codes.count() <= (data.len() - 2) / 4);
        }
        prop_assert_eq!(J1939Id::from_identifier(id).is_some(), id & 1 << 25 == 0);
        let priority = IsoTpAddresses::from_identifier(id).map(|addresses| u32::from(addresses.priority));
        prop_assert!(priority.is_none_or(|priority| priority == id >> 26 & 7));
    }
}
