//! Names of channels: `USB1` is the handle `PCAN_USBBUS1`.

use super::api::{AttachedChannel, Handle};
use crate::driver_text::clean_text;

/// Families of channels: name, first handle, first handle from channel 9 on, number of channels (`PCANBasic.h`).
const FAMILIES: &[(&str, Handle, Handle, Handle)] = &[
    ("USB", 0x51, 0x509, 16),
    ("PCI", 0x41, 0x409, 16),
    ("LAN", 0x801, 0x809, 16),
    ("PCC", 0x61, 0, 2),
    ("DNG", 0x31, 0, 1),
    ("ISA", 0x21, 0, 8),
];

/// Last channel with a handle of the first group.
const FIRST_GROUP: Handle = 8;

/// The handle of a channel, with or without `PCAN_` and `BUS`: `USB1`, `usb1`, `PCAN_USBBUS1`.
pub(super) fn parse_handle(name: &str) -> Option<Handle> {
    let upper = name.to_ascii_uppercase();
    let name = upper.strip_prefix("PCAN_").unwrap_or(&upper);
    let (family, number) = name.split_at_checked(3)?;
    let number = number.strip_prefix("BUS").unwrap_or(number);
    if !number.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let number: Handle = number.parse().ok()?;
    let (_, first, ninth, count) = FAMILIES.iter().find(|(known, ..)| *known == family)?;
    match number {
        1.. if number > *count => None,
        1..=FIRST_GROUP => first.checked_add(number - 1),
        _ => ninth.checked_add(number.checked_sub(FIRST_GROUP + 1)?),
    }
}

/// The name of a handle; the handle itself if it is unknown.
pub(super) fn handle_name(searched: Handle) -> String {
    let names = FAMILIES
        .iter()
        .flat_map(|(family, _, _, count)| (1..=*count).map(move |number| format!("{family}{number}")));
    names
        .into_iter()
        .find(|name| parse_handle(name) == Some(searched))
        .unwrap_or_else(|| format!("{searched:X}h"))
}

/// The device with its channel: `PCAN-USB Pro FD, channel 2, device 7`.
pub(super) fn device_text(attached: &AttachedChannel) -> String {
    let name = clean_text(&attached.device_name);
    let name = if name.is_empty() { "PCAN device".to_owned() } else { name };
    let channel = u16::from(attached.controller) + 1;
    match attached.device_id {
        0 | u32::MAX => format!("{name}, channel {channel}"),
        id => format!("{name}, channel {channel}, device {id}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_handles() {
        let known = [
            ("USB1", 0x51),
            ("USB8", 0x58),
            ("USB9", 0x509),
            ("USB16", 0x510),
            ("PCI10", 0x40A),
            ("LAN1", 0x801),
            ("LAN16", 0x810),
            ("PCC2", 0x62),
            ("DNG1", 0x31),
            ("ISA8", 0x28),
        ];
        for (text, expected) in known {
            assert_eq!(parse_handle(text), Some(expected), "{text}");
            assert_eq!(handle_name(expected), text);
        }
        assert_eq!(parse_handle("pcan_usbbus3"), Some(0x53));
        for wrong in ["", "USB", "USB0", "USB17", "PCC3", "DNG2", "ISA9", "USB+1", "XYZ1", "USBÄ", "USB65536"]
        {
            assert_eq!(parse_handle(wrong), None, "{wrong}");
        }
        assert_eq!(handle_name(0x99), "99h");
    }
}
