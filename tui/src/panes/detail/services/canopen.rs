//! Services of CiA 301 and CiA 305.

use super::{Read, Service, Slot, motorola, service, shape, slot};

pub(super) const NO_YES: Read = Read::Names(&[(0, "no"), (1, "yes")]);
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

/// SDO frames of the client (CiA 301 §7.2.4.3).
pub(in crate::panes::detail) const SDO_REQUEST: Service = service(
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

/// SDO frames of the server (CiA 301 §7.2.4.3).
pub(in crate::panes::detail) const SDO_RESPONSE: Service = service(
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

/// Segments of a block transfer (CiA 301 §7.2.4.3.10).
pub(in crate::panes::detail) const SDO_SEGMENT: Service = service(
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

/// NMT command.
pub(in crate::panes::detail) const NMT: Service = service(
    "CiA 301 §7.2.8.3.1",
    &[shape(
        "NMT command",
        0,
        0,
        &[slot("command", 0, 8, Read::NmtCommand), slot("node-ID, 0 for all", 8, 8, Read::Number)],
    )],
);

/// Heartbeat, boot-up and guarding response.
pub(in crate::panes::detail) const ERROR_CONTROL: Service = service(
    "CiA 301 §7.2.8.3.2",
    &[shape(
        "error control",
        0,
        0,
        &[slot("toggle (guarding only)", 7, 1, Read::Number), slot("NMT state", 0, 7, Read::NmtState)],
    )],
);

/// SYNC with an optional counter.
pub(in crate::panes::detail) const SYNC: Service =
    service("CiA 301 §7.2.5.3", &[shape("SYNC", 0, 0, &[slot("counter", 0, 8, Read::Number)])]);

/// TIME: milliseconds and days.
pub(in crate::panes::detail) const TIME: Service = service(
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

/// EMCY with the least significant byte of the code first (CiA 301).
pub(in crate::panes::detail) const EMCY: Service = service(
    "CiA 301 §7.2.7.3",
    &[shape("EMCY", 0, 0, &[slot("error code", 0, 16, Read::EmcyCode), REGISTER, VENDOR])],
);

/// EMCY with the most significant byte of the code first, as some devices send it.
pub(in crate::panes::detail) const EMCY_SWAPPED: Service = service(
    "CiA 301 §7.2.7.3, most significant byte of the code first",
    &[shape("EMCY", 0, 0, &[motorola("error code", 7, 16, Read::EmcyCode), REGISTER, VENDOR])],
);

/// LSS command.
pub(in crate::panes::detail) const LSS: Service = service(
    "CiA 305 §6",
    &[shape("LSS", 0, 0, &[slot("command specifier", 0, 8, Read::Lss), slot("data", 8, 0, Read::Bytes)])],
);
