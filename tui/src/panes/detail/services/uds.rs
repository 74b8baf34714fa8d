//! Frames of ISO 15765-2 and services of ISO 14229-1.

use super::{Read, Service, Slot, motorola, service, shape, slot};

const PCI: Slot = slot(
    "frame type (PCI)",
    4,
    4,
    Read::Names(&[(0, "single"), (1, "first"), (2, "consecutive"), (3, "flow control")]),
);

/// ISO-TP frames.
pub(in crate::panes::detail) const ISO_TP: Service = service(
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
                slot("minimum separation (STmin)", 16, 8, Read::Hex),
            ],
        ),
    ],
);

/// UDS message without the fields of its service; the first byte selects the `Shape`.
pub(in crate::panes::detail) const UDS: Service = service(
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
