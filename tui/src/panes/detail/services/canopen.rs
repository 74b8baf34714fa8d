//! Services of CiA 301 and CiA 305.

use super::{
    FieldPresentation, ServiceDescription, ServiceField, define_service, define_shape, intel_slot,
    motorola_slot,
};

pub(super) const NO_YES: FieldPresentation = FieldPresentation::Names(&[(0, "no"), (1, "yes")]);
const CLIENT: FieldPresentation = FieldPresentation::Names(&[
    (0, "download segment"),
    (1, "initiate download"),
    (2, "initiate upload"),
    (3, "upload segment"),
    (4, "abort"),
    (5, "block upload"),
    (6, "block download"),
]);
const SERVER: FieldPresentation = FieldPresentation::Names(&[
    (0, "upload segment"),
    (1, "download segment"),
    (2, "initiate upload"),
    (3, "initiate download"),
    (4, "abort"),
    (5, "block download"),
    (6, "block upload"),
]);
const CCS: ServiceField = intel_slot("command (ccs)", 5, 3, CLIENT);
const SCS: ServiceField = intel_slot("command (scs)", 5, 3, SERVER);
const OBJECT: ServiceField = intel_slot("object", 8, 24, FieldPresentation::Object);
const TOGGLE: ServiceField = intel_slot("toggle (t)", 4, 1, FieldPresentation::Number);
const EXPEDITED: ServiceField = intel_slot("expedited (e)", 1, 1, NO_YES);
const SIZED: ServiceField = intel_slot("size indicated (s)", 0, 1, NO_YES);
const UNUSED: ServiceField = intel_slot("unused bytes (n)", 2, 2, FieldPresentation::Number);
const SEGMENT_UNUSED: ServiceField = intel_slot("unused bytes (n)", 1, 3, FieldPresentation::Number);
const LAST: ServiceField = intel_slot("last (c)", 0, 1, NO_YES);
const SEGMENT: ServiceField = intel_slot("data", 8, 0, FieldPresentation::Bytes);
const DATA: ServiceField = intel_slot("data", 32, 32, FieldPresentation::Bytes);
const SIZE: ServiceField = intel_slot("size", 32, 32, FieldPresentation::Number);
const CODE: ServiceField = intel_slot("abort code", 32, 32, FieldPresentation::Abort);
const CRC: ServiceField = intel_slot("CRC supported", 2, 1, NO_YES);
const BLOCK_SIZE: ServiceField = intel_slot("segments in a block", 32, 8, FieldPresentation::Number);
const ACKNOWLEDGED: ServiceField = intel_slot("last segment received", 8, 8, FieldPresentation::Number);
const NEXT_SIZE: ServiceField = intel_slot("segments in the next block", 16, 8, FieldPresentation::Number);
const BLOCK_SIZED: ServiceField = intel_slot("size indicated (s)", 1, 1, NO_YES);
const END_UNUSED: ServiceField = intel_slot("unused bytes (n)", 2, 3, FieldPresentation::Number);
const CHECKSUM: ServiceField = intel_slot("CRC", 8, 16, FieldPresentation::Hex);
const CLIENT_STEP: ServiceField = intel_slot(
    "step (cs)",
    0,
    2,
    FieldPresentation::Names(&[(0, "initiate"), (1, "end"), (2, "acknowledge"), (3, "start")]),
);
const SERVER_STEP: ServiceField = intel_slot(
    "step (ss)",
    0,
    2,
    FieldPresentation::Names(&[(0, "initiate"), (1, "end"), (2, "acknowledge")]),
);
const STEP: ServiceField = intel_slot("step", 0, 1, FieldPresentation::Names(&[(0, "initiate"), (1, "end")]));

/// SDO frames of the client (CiA 301 §7.2.4.3).
pub(in crate::panes::detail) const SDO_REQUEST: ServiceDescription = define_service(
    "CiA 301 §7.2.4.3",
    &[
        define_shape(
            "initiate download, expedited",
            0xE2,
            0x22,
            &[CCS, UNUSED, EXPEDITED, SIZED, OBJECT, DATA],
        ),
        define_shape("initiate download", 0xE2, 0x20, &[CCS, UNUSED, EXPEDITED, SIZED, OBJECT, SIZE]),
        define_shape("download segment", 0xE0, 0x00, &[CCS, TOGGLE, SEGMENT_UNUSED, LAST, SEGMENT]),
        define_shape("initiate upload", 0xE0, 0x40, &[CCS, OBJECT]),
        define_shape("upload segment", 0xE0, 0x60, &[CCS, TOGGLE]),
        define_shape("abort", 0xE0, 0x80, &[CCS, OBJECT, CODE]),
        define_shape(
            "block upload: initiate",
            0xE3,
            0xA0,
            &[
                CCS,
                CRC,
                CLIENT_STEP,
                OBJECT,
                BLOCK_SIZE,
                intel_slot("protocol switch threshold", 40, 8, FieldPresentation::Number),
            ],
        ),
        define_shape("block upload: acknowledge", 0xE3, 0xA2, &[CCS, CLIENT_STEP, ACKNOWLEDGED, NEXT_SIZE]),
        define_shape("block upload: end", 0xE3, 0xA1, &[CCS, CLIENT_STEP]),
        define_shape("block upload: start", 0xE3, 0xA3, &[CCS, CLIENT_STEP]),
        define_shape("block download: initiate", 0xE1, 0xC0, &[CCS, CRC, BLOCK_SIZED, STEP, OBJECT, SIZE]),
        define_shape("block download: end", 0xE1, 0xC1, &[CCS, END_UNUSED, STEP, CHECKSUM]),
    ],
);

/// SDO frames of the server (CiA 301 §7.2.4.3).
pub(in crate::panes::detail) const SDO_RESPONSE: ServiceDescription = define_service(
    "CiA 301 §7.2.4.3",
    &[
        define_shape("upload, expedited", 0xE2, 0x42, &[SCS, UNUSED, EXPEDITED, SIZED, OBJECT, DATA]),
        define_shape("upload initiated", 0xE2, 0x40, &[SCS, UNUSED, EXPEDITED, SIZED, OBJECT, SIZE]),
        define_shape("upload segment", 0xE0, 0x00, &[SCS, TOGGLE, SEGMENT_UNUSED, LAST, SEGMENT]),
        define_shape("download segment accepted", 0xE0, 0x20, &[SCS, TOGGLE]),
        define_shape("download accepted", 0xE0, 0x60, &[SCS, OBJECT]),
        define_shape("abort", 0xE0, 0x80, &[SCS, OBJECT, CODE]),
        define_shape("block download: initiated", 0xE3, 0xA0, &[SCS, CRC, SERVER_STEP, OBJECT, BLOCK_SIZE]),
        define_shape("block download: acknowledge", 0xE3, 0xA2, &[SCS, SERVER_STEP, ACKNOWLEDGED, NEXT_SIZE]),
        define_shape("block download: ended", 0xE3, 0xA1, &[SCS, SERVER_STEP]),
        define_shape("block upload: initiated", 0xE1, 0xC0, &[SCS, CRC, BLOCK_SIZED, STEP, OBJECT, SIZE]),
        define_shape("block upload: end", 0xE1, 0xC1, &[SCS, END_UNUSED, STEP, CHECKSUM]),
    ],
);

/// Segments of a block transfer (CiA 301 §7.2.4.3.10).
pub(in crate::panes::detail) const SDO_SEGMENT: ServiceDescription = define_service(
    "CiA 301 §7.2.4.3.10",
    &[
        define_shape("abort", 0xFF, 0x80, &[CCS, OBJECT, CODE]),
        define_shape(
            "block segment",
            0,
            0,
            &[
                intel_slot("last (c)", 7, 1, NO_YES),
                intel_slot("sequence number", 0, 7, FieldPresentation::Number),
                SEGMENT,
            ],
        ),
    ],
);

/// NMT command.
pub(in crate::panes::detail) const NMT: ServiceDescription = define_service(
    "CiA 301 §7.2.8.3.1",
    &[define_shape(
        "NMT command",
        0,
        0,
        &[
            intel_slot("command", 0, 8, FieldPresentation::NmtCommand),
            intel_slot("node-ID, 0 for all", 8, 8, FieldPresentation::Number),
        ],
    )],
);

/// Heartbeat, boot-up and guarding response.
pub(in crate::panes::detail) const ERROR_CONTROL: ServiceDescription = define_service(
    "CiA 301 §7.2.8.3.2",
    &[define_shape(
        "error control",
        0,
        0,
        &[
            intel_slot("toggle (guarding only)", 7, 1, FieldPresentation::Number),
            intel_slot("NMT state", 0, 7, FieldPresentation::NmtState),
        ],
    )],
);

/// SYNC with an optional counter.
pub(in crate::panes::detail) const SYNC: ServiceDescription = define_service(
    "CiA 301 §7.2.5.3",
    &[define_shape("SYNC", 0, 0, &[intel_slot("counter", 0, 8, FieldPresentation::Number)])],
);

/// TIME: milliseconds and days.
pub(in crate::panes::detail) const TIME: ServiceDescription = define_service(
    "CiA 301 §7.2.6.3",
    &[define_shape(
        "TIME",
        0,
        0,
        &[
            intel_slot("milliseconds after midnight", 0, 28, FieldPresentation::Number),
            intel_slot("reserved", 28, 4, FieldPresentation::Number),
            intel_slot("days since 1984-01-01", 32, 16, FieldPresentation::Number),
        ],
    )],
);

const REGISTER: ServiceField = intel_slot("error register", 16, 8, FieldPresentation::Register);
const VENDOR: ServiceField = intel_slot("manufacturer's bytes", 24, 0, FieldPresentation::Bytes);

/// EMCY with the least significant byte of the code first (CiA 301).
pub(in crate::panes::detail) const EMCY: ServiceDescription = define_service(
    "CiA 301 §7.2.7.3",
    &[define_shape(
        "EMCY",
        0,
        0,
        &[intel_slot("error code", 0, 16, FieldPresentation::EmcyCode), REGISTER, VENDOR],
    )],
);

/// EMCY with the most significant byte of the code first, as some devices send it.
pub(in crate::panes::detail) const EMCY_SWAPPED: ServiceDescription = define_service(
    "CiA 301 §7.2.7.3, most significant byte of the code first",
    &[define_shape(
        "EMCY",
        0,
        0,
        &[motorola_slot("error code", 7, 16, FieldPresentation::EmcyCode), REGISTER, VENDOR],
    )],
);

/// LSS command.
pub(in crate::panes::detail) const LSS: ServiceDescription = define_service(
    "CiA 305 §6",
    &[define_shape(
        "LSS",
        0,
        0,
        &[
            intel_slot("command specifier", 0, 8, FieldPresentation::Lss),
            intel_slot("data", 8, 0, FieldPresentation::Bytes),
        ],
    )],
);
