//! Messages of SAE J1939-21, -73 and -81.

use super::canopen::NO_YES;
use super::{Read, Service, Slot, service, shape, slot};

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
pub(in crate::panes::detail) const TP_CM: Service = service(
    "SAE J1939-21 §5.10",
    &[
        shape(
            "request to send",
            0xFF,
            16,
            &[CONTROL, BYTES, PACKETS, slot("max packets per CTS", 32, 8, Read::Number), GROUP],
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
pub(in crate::panes::detail) const TP_DT: Service = service(
    "SAE J1939-21 §5.10.4",
    &[shape(
        "data packet",
        0,
        0,
        &[slot("sequence number", 0, 8, Read::Number), slot("data", 8, 0, Read::Bytes)],
    )],
);

/// Request for a J1939 group.
pub(in crate::panes::detail) const REQUEST: Service =
    service("SAE J1939-21 §5.4.2", &[shape("request", 0, 0, &[slot("group", 0, 24, Read::Group)])]);

/// J1939 acknowledgement (ACKM).
pub(in crate::panes::detail) const ACKNOWLEDGEMENT: Service = service(
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
pub(in crate::panes::detail) const ADDRESS_CLAIM: Service = service(
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

/// Active and previously active trouble codes (DM1, DM2).
pub(in crate::panes::detail) const TROUBLE_CODES: Service = Service {
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
            slot("lamp flashing", 8, 8, Read::Hex),
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
