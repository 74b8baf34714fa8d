//! What stands where in the frames of the standards' services: tables, found by the first byte.
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

/// How a field is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Read {
    /// As a number.
    Number,
    /// As a number in hexadecimal.
    Hex,
    /// As bytes.
    Bytes,
    /// By names of its values.
    Names(&'static [(u64, &'static str)]),
    /// As an NMT command.
    NmtCommand,
    /// As an NMT state.
    NmtState,
    /// As the code of an EMCY.
    EmcyCode,
    /// As the error register.
    Register,
    /// As index and sub-index: 24 bits.
    Object,
    /// As an SDO abort code.
    Abort,
    /// As an LSS command specifier.
    Lss,
    /// As a J1939 group.
    Group,
    /// As a service of UDS, or its answer.
    UdsService,
    /// As the code of a negative response.
    UdsCode,
    /// As a data or routine identifier.
    UdsIdentifier,
    /// As the failure mode of a trouble code.
    FailureMode,
}

/// A field of a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Slot {
    /// What it is called.
    pub(super) name: &'static str,
    /// Where it begins.
    pub(super) bit: u16,
    /// How many bits it has; 0: all that follow.
    pub(super) bits: u16,
    /// Order of its bits.
    pub(super) order: BitOrder,
    /// How it is told.
    pub(super) read: Read,
}

/// Frames of a service whose first byte is alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shape {
    /// What such a frame is.
    pub(super) name: &'static str,
    /// Bits of the first byte that tell it.
    pub(super) mask: u8,
    /// What they are.
    pub(super) value: u8,
    /// What stands in it.
    pub(super) slots: &'static [Slot],
}

/// A service: its frames, and where that stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Service {
    /// Document and clause.
    pub(super) source: &'static str,
    /// The first one that fits.
    pub(super) shapes: &'static [Shape],
    /// Fields that come again to the end, and after how many bits.
    pub(super) again: Option<(&'static [Slot], u16)>,
}

const fn slot(name: &'static str, bit: u16, bits: u16, read: Read) -> Slot {
    Slot { name, bit, bits, order: BitOrder::LittleEndian, read }
}

const fn motorola(name: &'static str, bit: u16, bits: u16, read: Read) -> Slot {
    Slot { name, bit, bits, order: BitOrder::BigEndian, read }
}

const fn shape(name: &'static str, mask: u8, value: u8, slots: &'static [Slot]) -> Shape {
    Shape { name, mask, value, slots }
}

const fn service(source: &'static str, shapes: &'static [Shape]) -> Service {
    Service { source, shapes, again: None }
}

impl Service {
    /// The shape of a frame.
    pub(super) fn shape(&self, bytes: &[u8]) -> Option<&'static Shape> {
        let first = bytes.first()?;
        self.shapes.iter().find(|shape| first & shape.mask == shape.value)
    }

    /// What stands in a frame of so many bytes: name with the number of its repeat, and the field.
    pub(super) fn slots(&self, bytes: &[u8]) -> Vec<(String, Slot)> {
        let length = u16::try_from(bytes.len() * 8).unwrap_or(u16::MAX);
        let fits = |slot: &Slot| match slot.order {
            BitOrder::LittleEndian if slot.bits == 0 => slot.bit < length,
            BitOrder::LittleEndian => slot.bit.saturating_add(slot.bits) <= length,
            BitOrder::BigEndian => (slot.bit ^ 7).saturating_add(slot.bits) <= length,
        };
        let own = self.shape(bytes).map_or(&[][..], |shape| shape.slots);
        let mut all: Vec<(String, Slot)> =
            own.iter().filter(|slot| fits(slot)).map(|slot| (slot.name.to_owned(), *slot)).collect();
        if let Some((slots, stride)) = self.again {
            for (number, shift) in (0..length).step_by(usize::from(stride)).enumerate() {
                let moved = slots.iter().map(|slot| Slot { bit: slot.bit.saturating_add(shift), ..*slot });
                let moved: Vec<Slot> = moved.collect();
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

    fn names(service: &Service, bytes: &[u8]) -> Vec<String> {
        service.slots(bytes).into_iter().map(|(name, _)| name).collect()
    }

    #[test]
    fn frames_are_told_by_their_first_byte() {
        let name = |service: &Service, first| service.shape(&[first]).map(|shape| shape.name);
        assert_eq!(name(&SDO_REQUEST, 0x2B), Some("initiate download, expedited"));
        assert_eq!(name(&SDO_REQUEST, 0x21), Some("initiate download"));
        assert_eq!(name(&SDO_REQUEST, 0xA2), Some("block upload: acknowledge"));
        assert_eq!(name(&SDO_RESPONSE, 0xC1), Some("block upload: end"));
        assert_eq!(name(&SDO_RESPONSE, 0xE0), None);
        assert_eq!(name(&ISO_TP, 0x21), Some("consecutive frame"));
        assert_eq!(NMT.shape(&[]), None);
    }

    #[test]
    fn only_what_the_frame_has_room_for_is_there() {
        assert_eq!(names(&EMCY, &[0, 0, 0]), ["error code", "error register"]);
        assert_eq!(names(&EMCY_SWAPPED, &[0]), Vec::<String>::new());
        // Lamps, then four bytes a fault: one in eight bytes, two in ten.
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
                for (name, slot) in service.slots(&bytes) {
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
