//! Codes in device files: data types, access types, object types.

use crate::profile::DataType;

/// Access type of an entry (CiA 306-1 §4.6.3, CiA 301 table 43).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum EntryAccess {
    /// `ro`: read only.
    Ro,
    /// `wo`: write only.
    Wo,
    /// `rw`: read and write.
    Rw,
    /// `rwr`: read and write, as a process input that a TPDO can carry.
    Rwr,
    /// `rww`: read and write, as a process output that an RPDO can carry.
    Rww,
    /// `const`: read only, with a constant value.
    Const,
}

impl EntryAccess {
    /// Keyword in an EDS: `ro`, `rww`, `const`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ro => "ro",
            Self::Wo => "wo",
            Self::Rw => "rw",
            Self::Rwr => "rwr",
            Self::Rww => "rww",
            Self::Const => "const",
        }
    }

    /// Parses a keyword in any letter case.
    pub(super) fn from_keyword(word: &str) -> Option<Self> {
        let all = [Self::Ro, Self::Wo, Self::Rw, Self::Rwr, Self::Rww, Self::Const];
        all.into_iter().find(|access| access.name().eq_ignore_ascii_case(word))
    }

    /// Parses the access of a `parameter` in an XDD (CiA 311): as seen from the network, like in an EDS.
    pub(super) fn of_parameter(word: &str) -> Option<Self> {
        Some(match word {
            "const" => Self::Const,
            "read" => Self::Ro,
            "write" => Self::Wo,
            "readWrite" => Self::Rw,
            "readWriteInput" => Self::Rwr,
            "readWriteOutput" => Self::Rww,
            _ => return None,
        })
    }
}

/// Object type (CiA 301 table 42).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ObjectType {
    /// NULL: placeholder without an object.
    Null,
    /// DOMAIN: one entry of any length.
    Domain,
    /// DEFTYPE and DEFSTRUCT: a type, not a value.
    Type,
    /// VAR: one entry.
    Var,
    /// ARRAY: entries of one type.
    Array,
    /// RECORD: entries of several types.
    Record,
}

impl ObjectType {
    pub(super) const fn from_code(code: i128) -> Option<Self> {
        Some(match code {
            0 => Self::Null,
            2 => Self::Domain,
            5 | 6 => Self::Type,
            7 => Self::Var,
            8 => Self::Array,
            9 => Self::Record,
            _ => return None,
        })
    }

    pub(super) const fn has_entries(self) -> bool {
        matches!(self, Self::Array | Self::Record)
    }
}

/// Data type with this index in CiA 301 table 44.
pub(super) const fn data_type(code: i128) -> Option<DataType> {
    Some(match code {
        0x01 => DataType::Boolean,
        0x02 => DataType::Integer8,
        0x03 => DataType::Integer16,
        0x04 => DataType::Integer32,
        0x05 => DataType::Unsigned8,
        0x06 => DataType::Unsigned16,
        0x07 => DataType::Unsigned32,
        0x08 => DataType::Real32,
        0x09 => DataType::VisibleString,
        0x0A => DataType::OctetString,
        0x0B => DataType::UnicodeString,
        0x0C => DataType::TimeOfDay,
        0x0D => DataType::TimeDifference,
        0x0F => DataType::Domain,
        0x10 => DataType::Integer24,
        0x11 => DataType::Real64,
        0x12 => DataType::Integer40,
        0x13 => DataType::Integer48,
        0x14 => DataType::Integer56,
        0x15 => DataType::Integer64,
        0x16 => DataType::Unsigned24,
        0x18 => DataType::Unsigned40,
        0x19 => DataType::Unsigned48,
        0x1A => DataType::Unsigned56,
        0x1B => DataType::Unsigned64,
        _ => return None,
    })
}

/// Data type of an XDD element (CiA 311, after IEC 61131-3). BITSTRING is used for all types without an
/// equivalent: octets, times, domains.
pub(super) fn element_type(name: &str) -> Option<DataType> {
    Some(match name {
        "BOOL" => DataType::Boolean,
        "SINT" => DataType::Integer8,
        "INT" => DataType::Integer16,
        "DINT" => DataType::Integer32,
        "LINT" => DataType::Integer64,
        "USINT" | "BYTE" | "CHAR" => DataType::Unsigned8,
        "UINT" | "WORD" => DataType::Unsigned16,
        "UDINT" | "DWORD" => DataType::Unsigned32,
        "ULINT" | "LWORD" => DataType::Unsigned64,
        "REAL" => DataType::Real32,
        "LREAL" => DataType::Real64,
        "STRING" => DataType::VisibleString,
        "WSTRING" => DataType::UnicodeString,
        "BITSTRING" => DataType::OctetString,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_any_case_are_an_access() {
        assert_eq!(EntryAccess::from_keyword("RW"), Some(EntryAccess::Rw));
        assert_eq!(EntryAccess::from_keyword("Const"), Some(EntryAccess::Const));
        assert_eq!(EntryAccess::from_keyword("UNKNOWN"), None);
        assert_eq!(EntryAccess::of_parameter("readWriteOutput"), Some(EntryAccess::Rww));
    }

    #[test]
    fn codes_are_those_of_table_44() {
        assert_eq!(data_type(0x16), Some(DataType::Unsigned24));
        assert_eq!(data_type(0x17), None);
        assert_eq!(data_type(-1), None);
        assert_eq!(element_type("UDINT"), Some(DataType::Unsigned32));
    }
}
