//! Field tables for the frames of standard services, selected by the first byte.
//!
//! ```text
//! SDO request  23 00 20 01 E8 03 00 00
//!              ╰┬╯ ╰─┬─╯ ╰┬ ╰────┬────╯
//!        specifier index  sub  data         CiA 301 §7.2.4.3.3
//! ```

mod canopen;
mod j1939;
mod uds;

use cobscope_decoder::profile::BitOrder;

pub(super) use canopen::*;
pub(super) use j1939::*;
pub(super) use uds::*;

/// Presentation of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FieldPresentation {
    /// Decimal number.
    Number,
    /// Hexadecimal number.
    Hex,
    /// Bytes.
    Bytes,
    /// Names of the values.
    Names(&'static [(u64, &'static str)]),
    /// NMT command.
    NmtCommand,
    /// NMT state.
    NmtState,
    /// EMCY error code.
    EmcyCode,
    /// Error register (1001:00).
    Register,
    /// Index and sub-index: 24 bits.
    Object,
    /// SDO abort code.
    Abort,
    /// LSS command specifier.
    Lss,
    /// PGN.
    Group,
    /// UDS service identifier of a request or response.
    UdsService,
    /// UDS negative response code.
    UdsCode,
    /// UDS data or routine identifier.
    UdsIdentifier,
    /// Failure mode (FMI) of a trouble code.
    FailureMode,
}

/// A field of a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ServiceField {
    /// Name of the field.
    pub(super) name: &'static str,
    /// First bit.
    pub(super) bit: u16,
    /// Number of bits; 0 for all remaining bits.
    pub(super) bits: u16,
    /// Byte order.
    pub(super) order: BitOrder,
    /// Presentation of the value.
    pub(super) read: FieldPresentation,
}

/// A frame type, selected by the first byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ServiceFrame {
    /// Name of the frame type.
    pub(super) name: &'static str,
    /// Bits of the first byte that select it.
    pub(super) mask: u8,
    /// Their value.
    pub(super) value: u8,
    /// Fields of the frame.
    pub(super) slots: &'static [ServiceField],
}

/// A service: its frame types and their source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ServiceDescription {
    /// Document and clause.
    pub(super) source: &'static str,
    /// Frame types; the first match is used.
    pub(super) shapes: &'static [ServiceFrame],
    /// Fields repeated up to the end of the payload, with their distance in bits.
    pub(super) again: Option<(&'static [ServiceField], u16)>,
}

const fn intel_slot(name: &'static str, bit: u16, bits: u16, read: FieldPresentation) -> ServiceField {
    ServiceField { name, bit, bits, order: BitOrder::LittleEndian, read }
}

const fn motorola_slot(name: &'static str, bit: u16, bits: u16, read: FieldPresentation) -> ServiceField {
    ServiceField { name, bit, bits, order: BitOrder::BigEndian, read }
}

const fn define_shape(
    name: &'static str,
    mask: u8,
    value: u8,
    slots: &'static [ServiceField],
) -> ServiceFrame {
    ServiceFrame { name, mask, value, slots }
}

const fn define_service(source: &'static str, shapes: &'static [ServiceFrame]) -> ServiceDescription {
    ServiceDescription { source, shapes, again: None }
}

impl ServiceDescription {
    /// The frame type of a payload.
    pub(super) fn shape_for(&self, bytes: &[u8]) -> Option<&'static ServiceFrame> {
        let first = bytes.first()?;
        self.shapes.iter().find(|shape| first & shape.mask == shape.value)
    }

    /// Fields that fit into the payload; repeated fields have their number in the name.
    pub(super) fn slots_for(&self, bytes: &[u8]) -> Vec<(String, ServiceField)> {
        let length = u16::try_from(bytes.len() * 8).unwrap_or(u16::MAX);
        let fits = |slot: &ServiceField| match slot.order {
            BitOrder::LittleEndian if slot.bits == 0 => slot.bit < length,
            BitOrder::LittleEndian => slot.bit.saturating_add(slot.bits) <= length,
            BitOrder::BigEndian => (slot.bit ^ 7).saturating_add(slot.bits) <= length,
        };
        let own = self.shape_for(bytes).map_or(&[][..], |shape| shape.slots);
        let mut all: Vec<(String, ServiceField)> =
            own.iter().filter(|slot| fits(slot)).map(|slot| (slot.name.to_owned(), *slot)).collect();
        if let Some((slots, stride)) = self.again {
            for (number, shift) in (0..length).step_by(usize::from(stride)).enumerate() {
                let moved =
                    slots.iter().map(|slot| ServiceField { bit: slot.bit.saturating_add(shift), ..*slot });
                let moved: Vec<ServiceField> = moved.collect();
                if !moved.iter().all(fits) {
                    break;
                }
                let named = moved.into_iter().map(|slot| (format!("{}. {}", number + 1, slot.name), slot));
                all.extend(named);
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(service: &ServiceDescription, bytes: &[u8]) -> Vec<String> {
        service.slots_for(bytes).into_iter().map(|(name, _)| name).collect()
    }

    #[test]
    fn frames_are_recognised_by_their_first_byte() {
        let name = |service: &ServiceDescription, first| service.shape_for(&[first]).map(|shape| shape.name);
        assert_eq!(name(&SDO_REQUEST, 0x2B), Some("initiate download, expedited"));
        assert_eq!(name(&SDO_REQUEST, 0x21), Some("initiate download"));
        assert_eq!(name(&SDO_REQUEST, 0xA2), Some("block upload: acknowledge"));
        assert_eq!(name(&SDO_RESPONSE, 0xC1), Some("block upload: end"));
        assert_eq!(name(&SDO_RESPONSE, 0xE0), None);
        assert_eq!(name(&ISO_TP, 0x21), Some("consecutive frame"));
        assert_eq!(NMT.shape_for(&[]), None);
    }

    #[test]
    fn only_what_the_frame_has_room_for_is_there() {
        assert_eq!(names(&EMCY, &[0, 0, 0]), ["error code", "error register"]);
        assert_eq!(names(&EMCY_SWAPPED, &[0]), Vec::<String>::new());
        // Lamps, then four bytes per trouble code: one in eight bytes, two in ten.
        let [one, two] = [8, 10].map(|length| names(&TROUBLE_CODES, &vec![0; length]).len());
        assert_eq!((one, two), (10, 15));
        assert_eq!(names(&TROUBLE_CODES, &[0; 10])[14], "2. occurrences");
    }

    #[test]
    fn no_two_fields_of_a_frame_share_a_bit() {
        let all =
            [&SDO_REQUEST, &SDO_RESPONSE, &SDO_SEGMENT, &NMT, &ERROR_CONTROL, &SYNC, &TIME, &EMCY, &LSS];
        let more = [&EMCY_SWAPPED, &ISO_TP, &TP_CM, &TP_DT, &REQUEST, &ACKNOWLEDGEMENT, &ADDRESS_CLAIM];
        for service in all.iter().chain(&more).chain(&[&TROUBLE_CODES, &UDS]) {
            for first in 0..=255 {
                let bytes = [first, 0, 0, 0, 0, 0, 0, 0];
                let mut taken = [false; 64];
                for (name, slot) in service.slots_for(&bytes) {
                    let bits = if slot.bits == 0 { 64 - slot.bit } else { slot.bits };
                    for place in 0..bits {
                        let bit = match slot.order {
                            BitOrder::LittleEndian => slot.bit + place,
                            BitOrder::BigEndian => ((slot.bit ^ 7) + place) ^ 7,
                        };
                        let bit = &mut taken[usize::from(bit)];
                        assert!(!*bit, "{name} of {first:02X} in {}", service.source);
                        *bit = true;
                    }
                }
            }
        }
    }
}
