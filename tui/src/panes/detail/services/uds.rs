//! Frames of ISO 15765-2 and services of ISO 14229-1.

use super::{
    FieldPresentation, ServiceDescription, ServiceField, define_service, define_shape, intel_slot,
    motorola_slot,
};

const PCI: ServiceField = intel_slot(
    "frame type (PCI)",
    4,
    4,
    FieldPresentation::Names(&[(0, "single"), (1, "first"), (2, "consecutive"), (3, "flow control")]),
);

/// ISO-TP frames.
pub(in crate::panes::detail) const ISO_TP: ServiceDescription = define_service(
    "ISO 15765-2 §9.6",
    &[
        define_shape(
            "single frame",
            0xF0,
            0x00,
            &[
                PCI,
                intel_slot("length", 0, 4, FieldPresentation::Number),
                intel_slot("message", 8, 0, FieldPresentation::Bytes),
            ],
        ),
        define_shape(
            "first frame",
            0xF0,
            0x10,
            &[
                PCI,
                motorola_slot("length", 3, 12, FieldPresentation::Number),
                intel_slot("message", 16, 0, FieldPresentation::Bytes),
            ],
        ),
        define_shape(
            "consecutive frame",
            0xF0,
            0x20,
            &[
                PCI,
                intel_slot("sequence number", 0, 4, FieldPresentation::Number),
                intel_slot("message", 8, 0, FieldPresentation::Bytes),
            ],
        ),
        define_shape(
            "flow control",
            0xF0,
            0x30,
            &[
                PCI,
                intel_slot(
                    "status",
                    0,
                    4,
                    FieldPresentation::Names(&[(0, "continue to send"), (1, "wait"), (2, "overflow")]),
                ),
                intel_slot("block size, 0 for all", 8, 8, FieldPresentation::Number),
                intel_slot("minimum separation (STmin)", 16, 8, FieldPresentation::Hex),
            ],
        ),
    ],
);

/// UDS message without the fields of its service; the first byte selects the `Shape`.
pub(in crate::panes::detail) const UDS: ServiceDescription = define_service(
    "ISO 14229-1",
    &[
        define_shape(
            "negative response",
            0xFF,
            0x7F,
            &[
                intel_slot("negative response", 0, 8, FieldPresentation::Hex),
                intel_slot("service", 8, 8, FieldPresentation::UdsService),
                intel_slot("response code (NRC)", 16, 8, FieldPresentation::UdsCode),
            ],
        ),
        define_shape("message", 0, 0, &[intel_slot("service", 0, 8, FieldPresentation::UdsService)]),
    ],
);
