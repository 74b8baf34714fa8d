//! Device descriptions: EDS and DCF (CiA 306-1), XDD and XDC (CiA 311), to objects.
//!
//! What can be read is read. What cannot is a [`Problem`] with its line, and nothing else is lost to it;
//! what was read by a guess (a leading zero, a section that is there twice) is a problem as well. What is
//! against the standard but has one meaning only is none: comments behind values, spaces in keywords,
//! empty values, missing `ObjectType`, any letter case, any line end.
//!
//! ```text
//! bytes ─text─▶ str ─┬─ini─▶ sections ─eds, object─▶ DeviceFile
//!                    └─xml─▶ elements ─xdd, xdd_object▶ DeviceFile
//! ```

mod code;
mod eds;
mod encode;
mod ini;
mod number;
mod object;
mod problem;
mod section;
mod text;
mod value;
mod xdd;
mod xdd_object;
mod xml;

use super::data_type::DataType;
use crate::wire::canopen::ObjectAddress;

pub use code::Access;
pub use problem::Problem;
pub(super) use text::decode;
pub use value::Given;

/// Entries that are read of one file. The largest of real devices has some 1,200; `CompactSubObj=254`
/// under every index would ask for 16 million.
pub const MOST_ENTRIES: usize = 1 << 16;

/// Bytes of one name or value. CiA 306-1 ends a line at 255 characters.
pub const LONGEST_VALUE: usize = 1024;

/// Problems that are told apart; one more line says how many others there are.
pub const MOST_PROBLEMS: usize = 1000;

/// What the content says a file is. Its name is not asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Electronic data sheet (CiA 306-1): a device type.
    Eds,
    /// Device configuration file (CiA 306-1): one device in a network, known by `[DeviceComissioning]`,
    /// `[ConnectedModules]` or a `ParameterValue`.
    Dcf,
    /// XML device description (CiA 311).
    Xdd,
    /// XML device configuration (CiA 311), known by `deviceCommissioning` or an `actualValue`.
    Xdc,
}

/// A device type, or a device, and its objects.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceFile {
    /// EDS, DCF, XDD or XDC.
    pub kind: Kind,
    /// `VendorName`; empty if it is not given.
    pub vendor_name: String,
    /// `VendorNumber`, else the default value of 1018:01. 0 is none: it names nobody.
    pub vendor_id: Option<u32>,
    /// `ProductName`; empty if it is not given.
    pub product_name: String,
    /// `ProductNumber`, else the default value of 1018:02. 0 is none.
    pub product_code: Option<u32>,
    /// `RevisionNumber`, else the default value of 1018:03. 0 is none.
    pub revision: Option<u32>,
    /// Node-ID of a DCF or XDC, 1..=127.
    pub node_id: Option<u8>,
    /// Node name of a DCF or XDC; empty if it is not given.
    pub node_name: String,
    /// Bit rate of a DCF or XDC in bit/s.
    pub bit_rate: Option<u32>,
    /// Bit rates the device can be set to in bit/s, ascending.
    pub bit_rates: Vec<u32>,
    /// Entries by address, ascending, each address once.
    pub objects: Vec<DeviceObject>,
    /// What could not be read, or only by a guess, by line.
    pub problems: Vec<Problem>,
}

/// An entry that has a value: a variable, or a sub-index of an array or record.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceObject {
    /// Index and sub-index.
    pub address: ObjectAddress,
    /// `ParameterName` of the object; empty if it is not given.
    pub object_name: String,
    /// `ParameterName` of the sub-index; none for a variable.
    pub entry_name: Option<String>,
    /// What whoever configured the device calls the entry (DCF, XDC).
    pub denotation: Option<String>,
    /// Data type, if it is one of CiA 301 table 44.
    pub data_type: Option<DataType>,
    /// Access, if the file says one.
    pub access: Option<Access>,
    /// `DefaultValue`: after "restore default parameters".
    pub default: Option<Given>,
    /// `LowLimit`: smallest value.
    pub low: Option<Given>,
    /// `HighLimit`: largest value.
    pub high: Option<Given>,
    /// `ParameterValue` of a DCF, `actualValue` of an XDC: what the device is configured to.
    pub value: Option<Given>,
    /// `PDOMapping`: whether a PDO may carry it.
    pub mappable: Option<bool>,
    /// Line the entry begins at, from 1; of a compact array the object's.
    pub line: usize,
}

/// Why a file is no device description at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum DeviceFileError {
    /// Nothing but white space.
    #[error("the file is empty")]
    Empty,
    /// Text without any section of CiA 306.
    #[error("no EDS, DCF or XDD: neither a section like [DeviceInfo] or [1000] nor XML")]
    NoSection,
    /// XML without any object of CiA 311.
    #[error("no XDD: XML without a CANopenObject")]
    NoObject,
}

/// Reads an EDS, DCF, XDD or XDC, recognised by its content: XML begins with `<`. Text is UTF-8 or UTF-16
/// if it says or can be so, else Windows-1252. Time and memory are linear in the length of `bytes`.
///
/// # Errors
/// If there is nothing of a device description in it.
pub fn parse(bytes: &[u8]) -> Result<DeviceFile, DeviceFileError> {
    let text = decode(bytes);
    match text.trim_start().chars().next() {
        None => Err(DeviceFileError::Empty),
        Some('<') => xdd::parse(&text),
        Some(_) => eds::parse(&text),
    }
}

impl DeviceFile {
    /// A file of which nothing is read yet.
    fn new(kind: Kind) -> Self {
        Self {
            kind,
            vendor_name: String::new(),
            vendor_id: None,
            product_name: String::new(),
            product_code: None,
            revision: None,
            node_id: None,
            node_name: String::new(),
            bit_rate: None,
            bit_rates: Vec::new(),
            objects: Vec::new(),
            problems: Vec::new(),
        }
    }

    /// The entry at an address.
    pub fn find(&self, address: ObjectAddress) -> Option<&DeviceObject> {
        let at = self.objects.binary_search_by_key(&address, |object| object.address).ok()?;
        self.objects.get(at)
    }

    /// Completes the identity from the defaults of object 1018 (CiA 301 §7.5.2.21), which a device answers
    /// with. Where both say something else, the device description's own numbers count.
    fn complete_identity(&mut self, problems: &mut problem::Problems) {
        let default = |sub| {
            let entry = self.find(ObjectAddress::new(0x1018, sub))?;
            match entry.default.as_ref()?.number(0).map(u32::try_from) {
                Some(Ok(number)) if number != 0 => Some((number, entry.line)),
                _ => None,
            }
        };
        let defaults = [default(1), default(2), default(3)];
        let names = ["vendor-ID", "product code", "revision number"];
        let numbers = [&mut self.vendor_id, &mut self.product_code, &mut self.revision];
        for ((number, default), name) in numbers.into_iter().zip(defaults).zip(names) {
            *number = number.filter(|number| *number != 0);
            let Some((default, line)) = default else { continue };
            match *number {
                None => *number = Some(default),
                Some(other) if other != default => problems.add(
                    line,
                    format!(
                        "{name} {default:#X} in object 1018 but {other:#X} in the description of the device"
                    ),
                ),
                Some(_) => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::*;

    #[test]
    fn the_content_says_the_kind() {
        let kind = |text: &[u8]| parse(text).map(|file| file.kind);
        assert_eq!(kind(b"[FileInfo]"), Ok(Kind::Eds));
        assert_eq!(kind(b"[1000]\nDefaultValue=1\nParameterValue="), Ok(Kind::Eds));
        assert_eq!(kind(b"[1000]\nParameterValue=1"), Ok(Kind::Dcf));
        assert_eq!(kind(b"[DeviceCommissioning]"), Ok(Kind::Dcf));
        assert_eq!(kind(b"\xEF\xBB\xBF <x><CANopenObject index='1000'/></x>"), Ok(Kind::Xdd));
        assert_eq!(kind(b"<CANopenObject index='1000' dataType='7' actualValue='1'/>"), Ok(Kind::Xdc));
        assert_eq!(kind(b" \r\n"), Err(DeviceFileError::Empty));
        assert_eq!(kind(b"(1.0) can0 123#00"), Err(DeviceFileError::NoSection));
        assert_eq!(kind(b"[section]\nkey=value"), Err(DeviceFileError::NoSection));
        assert_eq!(kind(b"<html/>"), Err(DeviceFileError::NoObject));
    }

    #[test]
    fn the_identity_is_completed_from_object_1018() {
        let file = parse(
            b"[DeviceInfo]\nVendorNumber=0\nProductNumber=2\nRevisionNumber=\n[1018sub1]\nDataType=7\nDefaultValue=0x36\n\
              [1018sub2]\nDataType=7\nDefaultValue=3\n[1018sub3]\nDataType=7\nDefaultValue=0",
        )
        .unwrap();
        assert_eq!((file.vendor_id, file.product_code, file.revision), (Some(0x36), Some(2), None));
        assert!(
            file.problems
                .iter()
                .any(|problem| problem.to_string().contains("product code 0x3 in object 1018"))
        );
    }

    #[test]
    fn a_file_that_asks_for_more_entries_than_there_can_be_gets_the_first() {
        let mut text = String::new();
        for index in 0x2000..0x2200 {
            write!(text, "[{index:04X}]\nDataType=5\nObjectType=8\nCompactSubObj=254\n").unwrap();
        }
        let file = parse(text.as_bytes()).unwrap();
        assert_eq!(file.objects.len(), MOST_ENTRIES);
        assert!(
            file.problems
                .iter()
                .any(|problem| problem.reason == "not read from 2101 on: more than 65536 entries")
        );
        assert!(file.find(ObjectAddress::new(0x2101, 0)).is_some());
        assert!(file.find(ObjectAddress::new(0x2101, 1)).is_none());
    }
}
