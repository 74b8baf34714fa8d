//! EMCY (CiA 301 §7.2.7.3): identifier 0x80 + node-ID by default.
//!
//! ```text
//! bytes 0..2  error code   byte 2  error register (0x1001)   bytes 3..8  manufacturer specific
//! ```
//!
//! CiA 301 sends the code least significant byte first; some devices send the most significant byte
//! first. The caller passes the order of the device. An EMCY without data is the "ready" message of
//! CiA 301 version 3.

use crate::wire::Malformed;

/// Byte order of the error code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ByteOrder {
    /// Least significant byte first (CiA 301).
    #[default]
    LsbFirst,
    /// Most significant byte first.
    MsbFirst,
}

impl ByteOrder {
    /// Name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LsbFirst => "lsb-first",
            Self::MsbFirst => "msb-first",
        }
    }
}

/// An emergency message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Emcy {
    /// No data: boot-up without error (CiA 301 version 3).
    Ready,
    /// An error, or an error reset (code 0).
    Error {
        /// Error code; 0 = error reset or no error.
        code: u16,
        /// Error register, object 0x1001; `None` if the message is too short for it.
        register: Option<u8>,
        /// Manufacturer-specific bytes; only the first `vendor_length` are valid.
        vendor: [u8; 5],
        /// Number of manufacturer-specific bytes received, 0..=5.
        vendor_length: u8,
    },
}

/// Reads an emergency message; bytes missing from a message of fewer than eight are tolerated.
///
/// # Errors
/// If the message has exactly one byte: half an error code.
pub fn parse(data: &[u8], order: ByteOrder) -> Result<Emcy, Malformed> {
    let (low, high) = match (data, order) {
        ([], _) => return Ok(Emcy::Ready),
        ([_], _) => return Err(Malformed::at("emcy", 1, 1, data.len())),
        ([first, second, ..], ByteOrder::LsbFirst) => (*first, *second),
        ([first, second, ..], ByteOrder::MsbFirst) => (*second, *first),
    };
    let mut vendor = [0; 5];
    let rest = data.get(3..).unwrap_or_default();
    for (target, source) in vendor.iter_mut().zip(rest) {
        *target = *source;
    }
    Ok(Emcy::Error {
        code: u16::from_le_bytes([low, high]),
        register: data.get(2).copied(),
        vendor,
        vendor_length: u8::try_from(rest.len().min(5)).unwrap_or(5),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_code_in_both_orders() {
        // 0x8130, register 0x11, vendor byte 0x20.
        let data = [0x30, 0x81, 0x11, 0x20, 0, 0, 0, 0];
        let Ok(Emcy::Error { code, register, vendor, vendor_length }) = parse(&data, ByteOrder::LsbFirst)
        else {
            panic!("expected an error")
        };
        assert_eq!((code, register, vendor, vendor_length), (0x8130, Some(0x11), [0x20, 0, 0, 0, 0], 5));
        let Ok(Emcy::Error { code, .. }) = parse(&data, ByteOrder::MsbFirst) else {
            panic!("expected an error")
        };
        assert_eq!(code, 0x3081);
    }

    #[test]
    fn empty_is_ready_and_one_byte_is_malformed() {
        assert_eq!(parse(&[], ByteOrder::LsbFirst), Ok(Emcy::Ready));
        assert_eq!(parse(&[1], ByteOrder::LsbFirst).unwrap_err().offset, 1);
    }

    #[test]
    fn a_short_message_has_no_register() {
        let Ok(Emcy::Error { register, vendor_length, .. }) = parse(&[0x10, 0x81], ByteOrder::LsbFirst)
        else {
            panic!("expected an error")
        };
        assert_eq!((register, vendor_length), (None, 0));
    }
}
