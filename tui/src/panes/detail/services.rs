//! What stands where in the frames of the standards' services: tables, found by the first byte.
//!
//! ```text
//! SDO request  23 00 20 01 E8 03 00 00
//!              ╰┬╯ ╰─┬─╯ ╰┬ ╰────┬────╯
//!        specifier index  sub  data         CiA 301 §7.2.4.3.3
//! ```

use cobscope_decoder::profile::BitOrder;

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

const NO_YES: Read = Read::Names(&[(0, "no"), (1, "yes")]);
const CLIENT: Read = Read::Names(&[
    (0, "download segment"),
    (1, "initiate download"),
    (2, "initiate upload"),
    (3, "upload segment"),
    (4, "abort"),
    (5, "block upload"),
    (6, "block download"),
]);
const SERVER: Read = Read::Names(&[
    (0, "upload segment"),
    (1, "download segment"),
    (2, "initiate upload"),
    (3, "initiate download"),
    (4, "abort"),
    (5, "block download"),
    (6, "block upload"),
]);
const CCS: Slot = slot("command (ccs)", 5, 3, CLIENT);
const SCS: Slot = slot("command (scs)", 5, 3, SERVER);
const OBJECT: Slot = slot("object", 8, 24, Read::Object);
const TOGGLE: Slot = slot("toggle (t)", 4, 1, Read::Number);
const EXPEDITED: Slot = slot("expedited (e)", 1, 1, NO_YES);
const SIZED: Slot = slot("size indicated (s)", 0, 1, NO_YES);
const UNUSED: Slot = slot("unused bytes (n)", 2, 2, Read::Number);
const SEGMENT_UNUSED: Slot = slot("unused bytes (n)", 1, 3, Read::Number);
const LAST: Slot = slot("last (c)", 0, 1, NO_YES);
const SEGMENT: Slot = slot("data", 8, 0, Read::Bytes);
const DATA: Slot = slot("data", 32, 32, Read::Bytes);
const SIZE: Slot = slot("size", 32, 32, Read::Number);
const CODE: Slot = slot("abort code", 32, 32, Read::Abort);
const CRC: Slot = slot("CRC supported", 2, 1, NO_YES);
const BLOCK_SIZE: Slot = slot("segments in a block", 32, 8, Read::Number);
const ACKNOWLEDGED: Slot = slot("last segment received", 8, 8, Read::Number);
const NEXT_SIZE: Slot = slot("segments in the next block", 16, 8, Read::Number);
const BLOCK_SIZED: Slot = slot("size indicated (s)", 1, 1, NO_YES);
const END_UNUSED: Slot = slot("unused bytes (n)", 2, 3, Read::Number);
const CHECKSUM: Slot = slot("CRC", 8, 16, Read::Hex);
const CLIENT_STEP: Slot =
    slot("step (cs)", 0, 2, Read::Names(&[(0, "initiate"), (1, "end"), (2, "acknowledge"), (3, "start")]));
const SERVER_STEP: Slot =
    slot("step (ss)", 0, 2, Read::Names(&[(0, "initiate"), (1, "end"), (2, "acknowledge")]));
const STEP: Slot = slot("step", 0, 1, Read::Names(&[(0, "initiate"), (1, "end")]));

/// SDO from the client (CiA 301 §7.2.4.3).
pub(super) const SDO_REQUEST: Service = service(
    "CiA 301 §7.2.4.3",
    &[
        shape("initiate download, expedited", 0xE2, 0x22, &[CCS, UNUSED, EXPEDITED, SIZED, OBJECT, DATA]),
        shape("initiate download", 0xE2, 0x20, &[CCS, UNUSED, EXPEDITED, SIZED, OBJECT, SIZE]),
        shape("download segment", 0xE0, 0x00, &[CCS, TOGGLE, SEGMENT_UNUSED, LAST, SEGMENT]),
        shape("initiate upload", 0xE0, 0x40, &[CCS, OBJECT]),
        shape("upload segment", 0xE0, 0x60, &[CCS, TOGGLE]),
        shape("abort", 0xE0, 0x80, &[CCS, OBJECT, CODE]),
        shape(
            "block upload: initiate",
            0xE3,
            0xA0,
            &[
                CCS,
                CRC,
                CLIENT_STEP,
                OBJECT,
                BLOCK_SIZE,
                slot("protocol switch threshold", 40, 8, Read::Number),
            ],
        ),
        shape("block upload: acknowledge", 0xE3, 0xA2, &[CCS, CLIENT_STEP, ACKNOWLEDGED, NEXT_SIZE]),
        shape("block upload: end", 0xE3, 0xA1, &[CCS, CLIENT_STEP]),
        shape("block upload: start", 0xE3, 0xA3, &[CCS, CLIENT_STEP]),
        shape("block download: initiate", 0xE1, 0xC0, &[CCS, CRC, BLOCK_SIZED, STEP, OBJECT, SIZE]),
        shape("block download: end", 0xE1, 0xC1, &[CCS, END_UNUSED, STEP, CHECKSUM]),
    ],
);

/// SDO from the server (CiA 301 §7.2.4.3).
pub(super) const SDO_RESPONSE: Service = service(
    "CiA 301 §7.2.4.3",
    &[
        shape("upload, expedited", 0xE2, 0x42, &[SCS, UNUSED, EXPEDITED, SIZED, OBJECT, DATA]),
        shape("upload initiated", 0xE2, 0x40, &[SCS, UNUSED, EXPEDITED, SIZED, OBJECT, SIZE]),
        shape("upload segment", 0xE0, 0x00, &[SCS, TOGGLE, SEGMENT_UNUSED, LAST, SEGMENT]),
        shape("download segment accepted", 0xE0, 0x20, &[SCS, TOGGLE]),
        shape("download accepted", 0xE0, 0x60, &[SCS, OBJECT]),
        shape("abort", 0xE0, 0x80, &[SCS, OBJECT, CODE]),
        shape("block download: initiated", 0xE3, 0xA0, &[SCS, CRC, SERVER_STEP, OBJECT, BLOCK_SIZE]),
        shape("block download: acknowledge", 0xE3, 0xA2, &[SCS, SERVER_STEP, ACKNOWLEDGED, NEXT_SIZE]),
        shape("block download: ended", 0xE3, 0xA1, &[SCS, SERVER_STEP]),
        shape("block upload: initiated", 0xE1, 0xC0, &[SCS, CRC, BLOCK_SIZED, STEP, OBJECT, SIZE]),
        shape("block upload: end", 0xE1, 0xC1, &[SCS, END_UNUSED, STEP, CHECKSUM]),
    ],
);

/// A segment within a block (CiA 301 §7.2.4.3.10).
pub(super) const SDO_SEGMENT: Service = service(
    "CiA 301 §7.2.4.3.10",
    &[
        shape("abort", 0xFF, 0x80, &[CCS, OBJECT, CODE]),
        shape(
            "block segment",
            0,
            0,
            &[slot("last (c)", 7, 1, NO_YES), slot("sequence number", 0, 7, Read::Number), SEGMENT],
        ),
    ],
);

/// NMT.
pub(super) const NMT: Service = service(
    "CiA 301 §7.2.8.3.1",
    &[shape(
        "NMT command",
        0,
        0,
        &[slot("command", 0, 8, Read::NmtCommand), slot("node-ID, 0 for all", 8, 8, Read::Number)],
    )],
);

/// Heartbeat, boot-up, guarding reply.
pub(super) const ERROR_CONTROL: Service = service(
    "CiA 301 §7.2.8.3.2",
    &[shape(
        "error control",
        0,
        0,
        &[slot("toggle (guarding only)", 7, 1, Read::Number), slot("NMT state", 0, 7, Read::NmtState)],
    )],
);

/// SYNC.
pub(super) const SYNC: Service =
    service("CiA 301 §7.2.5.3", &[shape("SYNC", 0, 0, &[slot("counter", 0, 8, Read::Number)])]);

/// TIME.
pub(super) const TIME: Service = service(
    "CiA 301 §7.2.6.3",
    &[shape(
        "TIME",
        0,
        0,
        &[
            slot("milliseconds after midnight", 0, 28, Read::Number),
            slot("reserved", 28, 4, Read::Number),
            slot("days since 1984-01-01", 32, 16, Read::Number),
        ],
    )],
);

const REGISTER: Slot = slot("error register", 16, 8, Read::Register);
const VENDOR: Slot = slot("manufacturer's bytes", 24, 0, Read::Bytes);

/// EMCY, the least significant byte of the code first, as the standard has it.
pub(super) const EMCY: Service = service(
    "CiA 301 §7.2.7.3",
    &[shape("EMCY", 0, 0, &[slot("error code", 0, 16, Read::EmcyCode), REGISTER, VENDOR])],
);

/// EMCY with the most significant byte of the code first, as some devices have it.
pub(super) const EMCY_SWAPPED: Service = service(
    "CiA 301 §7.2.7.3, most significant byte of the code first",
    &[shape("EMCY", 0, 0, &[motorola("error code", 7, 16, Read::EmcyCode), REGISTER, VENDOR])],
);

/// LSS.
pub(super) const LSS: Service = service(
    "CiA 305 §6",
    &[shape("LSS", 0, 0, &[slot("command specifier", 0, 8, Read::Lss), slot("data", 8, 0, Read::Bytes)])],
);

const PCI: Slot = slot(
    "frame type (PCI)",
    4,
    4,
    Read::Names(&[(0, "single"), (1, "first"), (2, "consecutive"), (3, "flow control")]),
);

/// ISO-TP.
pub(super) const ISO_TP: Service = service(
    "ISO 15765-2 §9.6",
    &[
        shape(
            "single frame",
            0xF0,
            0x00,
            &[PCI, slot("length", 0, 4, Read::Number), slot("message", 8, 0, Read::Bytes)],
        ),
        shape(
            "first frame",
            0xF0,
            0x10,
            &[PCI, motorola("length", 3, 12, Read::Number), slot("message", 16, 0, Read::Bytes)],
        ),
        shape(
            "consecutive frame",
            0xF0,
            0x20,
            &[PCI, slot("sequence number", 0, 4, Read::Number), slot("message", 8, 0, Read::Bytes)],
        ),
        shape(
            "flow control",
            0xF0,
            0x30,
            &[
                PCI,
                slot("status", 0, 4, Read::Names(&[(0, "continue to send"), (1, "wait"), (2, "overflow")])),
                slot("block size, 0 for all", 8, 8, Read::Number),
                slot("least separation (STmin)", 16, 8, Read::Hex),
            ],
        ),
    ],
);

const CONTROL: Slot = slot(
    "control",
    0,
    8,
    Read::Names(&[
        (16, "request to send"),
        (17, "clear to send"),
        (19, "end of message acknowledged"),
        (20, "extended: request to send"),
        (21, "extended: clear to send"),
        (22, "extended: data packet offset"),
        (23, "extended: end of message acknowledged"),
        (32, "broadcast announce"),
        (255, "connection abort"),
    ]),
);
const BYTES: Slot = slot("bytes", 8, 16, Read::Number);
const PACKETS: Slot = slot("packets", 24, 8, Read::Number);
const GROUP: Slot = slot("group", 40, 24, Read::Group);

/// Connection management of the J1939 transport protocol.
pub(super) const TP_CM: Service = service(
    "SAE J1939-21 §5.10",
    &[
        shape(
            "request to send",
            0xFF,
            16,
            &[CONTROL, BYTES, PACKETS, slot("most packets at once", 32, 8, Read::Number), GROUP],
        ),
        shape(
            "clear to send",
            0xFF,
            17,
            &[CONTROL, slot("packets", 8, 8, Read::Number), slot("next packet", 16, 8, Read::Number), GROUP],
        ),
        shape("end of message acknowledged", 0xFF, 19, &[CONTROL, BYTES, PACKETS, GROUP]),
        shape("broadcast announce", 0xFF, 32, &[CONTROL, BYTES, PACKETS, GROUP]),
        shape("abort", 0xFF, 255, &[CONTROL, slot("reason", 8, 8, Read::Number), GROUP]),
        shape("extended", 0, 0, &[CONTROL, slot("parameters", 8, 32, Read::Bytes), GROUP]),
    ],
);

/// Data of the J1939 transport protocol.
pub(super) const TP_DT: Service = service(
    "SAE J1939-21 §5.10.4",
    &[shape(
        "data packet",
        0,
        0,
        &[slot("sequence number", 0, 8, Read::Number), slot("data", 8, 0, Read::Bytes)],
    )],
);

/// Request for a J1939 group.
pub(super) const REQUEST: Service =
    service("SAE J1939-21 §5.4.2", &[shape("request", 0, 0, &[slot("group", 0, 24, Read::Group)])]);

/// J1939 acknowledgement.
pub(super) const ACKNOWLEDGEMENT: Service = service(
    "SAE J1939-21 §5.4.4",
    &[shape(
        "acknowledgement",
        0,
        0,
        &[
            slot(
                "control",
                0,
                8,
                Read::Names(&[(0, "positive"), (1, "negative"), (2, "access denied"), (3, "cannot respond")]),
            ),
            slot("group function", 8, 8, Read::Number),
            slot("address", 32, 8, Read::Hex),
            GROUP,
        ],
    )],
);

/// The NAME of an address claim.
pub(super) const ADDRESS_CLAIM: Service = service(
    "SAE J1939-81 §4.1.1",
    &[shape(
        "address claim",
        0,
        0,
        &[
            slot("identity number", 0, 21, Read::Number),
            slot("manufacturer", 21, 11, Read::Number),
            slot("ECU instance", 32, 3, Read::Number),
            slot("function instance", 35, 5, Read::Number),
            slot("function", 40, 8, Read::Number),
            slot("reserved", 48, 1, Read::Number),
            slot("vehicle system", 49, 7, Read::Number),
            slot("vehicle system instance", 56, 4, Read::Number),
            slot("industry group", 60, 3, Read::Number),
            slot("arbitrary address", 63, 1, NO_YES),
        ],
    )],
);

const LAMP: Read = Read::Names(&[(0, "off"), (1, "on"), (2, "error"), (3, "not available")]);

/// Active and previously active trouble codes.
pub(super) const TROUBLE_CODES: Service = Service {
    source: "SAE J1939-73 §5.7.1",
    shapes: &[shape(
        "trouble codes",
        0,
        0,
        &[
            slot("malfunction lamp", 6, 2, LAMP),
            slot("red stop lamp", 4, 2, LAMP),
            slot("amber warning lamp", 2, 2, LAMP),
            slot("protect lamp", 0, 2, LAMP),
            slot("lamps' flashing", 8, 8, Read::Hex),
        ],
    )],
    again: Some((
        &[
            slot("SPN, bits 0 to 15", 16, 16, Read::Number),
            slot("SPN, bits 16 to 18", 37, 3, Read::Number),
            slot("failure mode (FMI)", 32, 5, Read::FailureMode),
            slot("conversion method", 47, 1, Read::Number),
            slot("occurrences", 40, 7, Read::Number),
        ],
        32,
    )),
};

/// A UDS message without what its service adds; `Shape` by its first byte.
pub(super) const UDS: Service = service(
    "ISO 14229-1",
    &[
        shape(
            "negative response",
            0xFF,
            0x7F,
            &[
                slot("negative response", 0, 8, Read::Hex),
                slot("service", 8, 8, Read::UdsService),
                slot("response code (NRC)", 16, 8, Read::UdsCode),
            ],
        ),
        shape("message", 0, 0, &[slot("service", 0, 8, Read::UdsService)]),
    ],
);

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
