//! Messages of SAE J1939-21, -73 and -81.

use super::canopen::NO_YES;
use super::{FieldPresentation, ServiceDescription, ServiceField, define_service, define_shape, intel_slot};

const CONTROL: ServiceField = intel_slot(
    "control",
    0,
    8,
    FieldPresentation::Names(&[
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
const BYTES: ServiceField = intel_slot("bytes", 8, 16, FieldPresentation::Number);
const PACKETS: ServiceField = intel_slot("packets", 24, 8, FieldPresentation::Number);
const GROUP: ServiceField = intel_slot("group", 40, 24, FieldPresentation::Group);

/// Connection management of the J1939 transport protocol.
pub(in crate::panes::detail) const TP_CM: ServiceDescription = define_service(
    "SAE J1939-21 §5.10",
    &[
        define_shape(
            "request to send",
            0xFF,
            16,
            &[
                CONTROL,
                BYTES,
                PACKETS,
                intel_slot("max packets per CTS", 32, 8, FieldPresentation::Number),
                GROUP,
            ],
        ),
        define_shape(
            "clear to send",
            0xFF,
            17,
            &[
                CONTROL,
                intel_slot("packets", 8, 8, FieldPresentation::Number),
                intel_slot("next packet", 16, 8, FieldPresentation::Number),
                GROUP,
            ],
        ),
        define_shape("end of message acknowledged", 0xFF, 19, &[CONTROL, BYTES, PACKETS, GROUP]),
        define_shape("broadcast announce", 0xFF, 32, &[CONTROL, BYTES, PACKETS, GROUP]),
        define_shape(
            "abort",
            0xFF,
            255,
            &[CONTROL, intel_slot("reason", 8, 8, FieldPresentation::Number), GROUP],
        ),
        define_shape(
            "extended",
            0,
            0,
            &[CONTROL, intel_slot("parameters", 8, 32, FieldPresentation::Bytes), GROUP],
        ),
    ],
);

/// Data of the J1939 transport protocol.
pub(in crate::panes::detail) const TP_DT: ServiceDescription = define_service(
    "SAE J1939-21 §5.10.4",
    &[define_shape(
        "data packet",
        0,
        0,
        &[
            intel_slot("sequence number", 0, 8, FieldPresentation::Number),
            intel_slot("data", 8, 0, FieldPresentation::Bytes),
        ],
    )],
);

/// Request for a J1939 group.
pub(in crate::panes::detail) const REQUEST: ServiceDescription = define_service(
    "SAE J1939-21 §5.4.2",
    &[define_shape("request", 0, 0, &[intel_slot("group", 0, 24, FieldPresentation::Group)])],
);

/// J1939 acknowledgement (ACKM).
pub(in crate::panes::detail) const ACKNOWLEDGEMENT: ServiceDescription = define_service(
    "SAE J1939-21 §5.4.4",
    &[define_shape(
        "acknowledgement",
        0,
        0,
        &[
            intel_slot(
                "control",
                0,
                8,
                FieldPresentation::Names(&[
                    (0, "positive"),
                    (1, "negative"),
                    (2, "access denied"),
                    (3, "cannot respond"),
                ]),
            ),
            intel_slot("group function", 8, 8, FieldPresentation::Number),
            intel_slot("address", 32, 8, FieldPresentation::Hex),
            GROUP,
        ],
    )],
);

/// The NAME of an address claim.
pub(in crate::panes::detail) const ADDRESS_CLAIM: ServiceDescription = define_service(
    "SAE J1939-81 §4.1.1",
    &[define_shape(
        "address claim",
        0,
        0,
        &[
            intel_slot("identity number", 0, 21, FieldPresentation::Number),
            intel_slot("manufacturer", 21, 11, FieldPresentation::Number),
            intel_slot("ECU instance", 32, 3, FieldPresentation::Number),
            intel_slot("function instance", 35, 5, FieldPresentation::Number),
            intel_slot("function", 40, 8, FieldPresentation::Number),
            intel_slot("reserved", 48, 1, FieldPresentation::Number),
            intel_slot("vehicle system", 49, 7, FieldPresentation::Number),
            intel_slot("vehicle system instance", 56, 4, FieldPresentation::Number),
            intel_slot("industry group", 60, 3, FieldPresentation::Number),
            intel_slot("arbitrary address", 63, 1, NO_YES),
        ],
    )],
);

const LAMP: FieldPresentation =
    FieldPresentation::Names(&[(0, "off"), (1, "on"), (2, "error"), (3, "not available")]);

/// Active and previously active trouble codes (DM1, DM2).
pub(in crate::panes::detail) const TROUBLE_CODES: ServiceDescription = ServiceDescription {
    source: "SAE J1939-73 §5.7.1",
    shapes: &[define_shape(
        "trouble codes",
        0,
        0,
        &[
            intel_slot("malfunction lamp", 6, 2, LAMP),
            intel_slot("red stop lamp", 4, 2, LAMP),
            intel_slot("amber warning lamp", 2, 2, LAMP),
            intel_slot("protect lamp", 0, 2, LAMP),
            intel_slot("lamp flashing", 8, 8, FieldPresentation::Hex),
        ],
    )],
    again: Some((
        &[
            intel_slot("SPN, bits 0 to 15", 16, 16, FieldPresentation::Number),
            intel_slot("SPN, bits 16 to 18", 37, 3, FieldPresentation::Number),
            intel_slot("failure mode (FMI)", 32, 5, FieldPresentation::FailureMode),
            intel_slot("conversion method", 47, 1, FieldPresentation::Number),
            intel_slot("occurrences", 40, 7, FieldPresentation::Number),
        ],
        32,
    )),
};
