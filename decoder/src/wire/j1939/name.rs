//! The NAME of a device: 64 bits, unique on a bus.

use nom::Parser;
use nom::number::complete::le_u64;

use crate::wire::parser::{Parsed, bit_field};

/// A NAME (J1939-81 §4.1.1) as a number; the lower one has priority in an address conflict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct J1939Name(pub u64);

/// Fields of a NAME, from the least significant bit up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NameFields {
    /// 21 bits: serial number assigned by the manufacturer.
    pub identity_number: u32,
    /// 11 bits: manufacturer code.
    pub manufacturer_code: u16,
    /// 3 bits: instance of the control unit within a function.
    pub ecu_instance: u8,
    /// 5 bits: instance of the function.
    pub function_instance: u8,
    /// 8 bits: function; from 128 on it depends on industry group and device class.
    pub function: u8,
    /// 7 bits: device class, "vehicle system" in J1939.
    pub device_class: u8,
    /// 4 bits: instance of the device class.
    pub device_class_instance: u8,
    /// 3 bits: industry group.
    pub industry_group: u8,
    /// Whether the device can choose another address.
    pub arbitrary_address_capable: bool,
}

impl J1939Name {
    /// Reads the eight bytes of an address claim, least significant first; `None` if there are fewer.
    pub fn read(data: &[u8]) -> Option<Self> {
        Self::parse_field(data).ok().map(|(_, name)| name)
    }

    /// Parses eight bytes.
    pub(super) fn parse_field(data: &[u8]) -> Parsed<'_, Self> {
        le_u64.map(Self).parse(data)
    }

    /// Splits the NAME into its fields.
    pub fn fields(self) -> NameFields {
        NameFields {
            identity_number: bit_field(self.0, 0, 21),
            manufacturer_code: bit_field(self.0, 21, 11),
            ecu_instance: bit_field(self.0, 32, 3),
            function_instance: bit_field(self.0, 35, 5),
            function: bit_field(self.0, 40, 8),
            device_class: bit_field(self.0, 49, 7),
            device_class_instance: bit_field(self.0, 56, 4),
            industry_group: bit_field(self.0, 60, 3),
            arbitrary_address_capable: bit_field::<u8>(self.0, 63, 1) == 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_name() {
        // Identity number 0x12345 of 21 bits, manufacturer 57 of 11 bits: 57 << 21 | 0x12345 = 0x07212345.
        // Function 129, function instance 1 (<< 3), ECU instance 2: 0x0A. Class 17 << 1 = 0x22. Arbitrary
        // address capable 1, group 2, class instance 3: 1010 0011.
        let name = J1939Name::read(&[0x45, 0x23, 0x21, 0x07, 0x0A, 0x81, 0x22, 0xA3]).unwrap();
        assert_eq!(name, J1939Name(0xA322_810A_0721_2345));
        let fields = name.fields();
        assert_eq!((fields.identity_number, fields.manufacturer_code), (0x12345, 57));
        assert_eq!((fields.ecu_instance, fields.function_instance, fields.function), (2, 1, 129));
        assert_eq!((fields.device_class, fields.device_class_instance), (17, 3));
        assert_eq!((fields.industry_group, fields.arbitrary_address_capable), (2, true));
        assert_eq!(J1939Name::read(&[0; 7]), None);
    }
}
