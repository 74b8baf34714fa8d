//! Contents of a device file: a device type or a configured device, with its objects.

use super::code::EntryAccess;
use super::problem::{DescriptionProblem, DescriptionProblems};
use super::value::EntryValue;
use crate::profile::data_type::DataType;
use crate::wire::canopen::ObjectAddress;

/// Kind of device file by content, independent of the file name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DescriptionKind {
    /// Electronic data sheet (CiA 306-1): a device type.
    Eds,
    /// Device configuration file (CiA 306-1): one device in a network, recognised by `[DeviceComissioning]`,
    /// `[ConnectedModules]` or a `ParameterValue`.
    Dcf,
    /// XML device description (CiA 311).
    Xdd,
    /// XML device configuration (CiA 311), recognised by `deviceCommissioning` or an `actualValue`.
    Xdc,
}

/// A device type or a configured device, with its objects.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceFile {
    /// Kind of file, determined by its content.
    pub kind: DescriptionKind,
    /// `VendorName`; empty if missing.
    pub vendor_name: String,
    /// `VendorNumber`, otherwise the default of 1018:01; `None` if both are 0 or missing.
    pub vendor_id: Option<u32>,
    /// `ProductName`; empty if missing.
    pub product_name: String,
    /// `ProductNumber`, otherwise the default of 1018:02; `None` if both are 0 or missing.
    pub product_code: Option<u32>,
    /// `RevisionNumber`, otherwise the default of 1018:03; `None` if both are 0 or missing.
    pub revision: Option<u32>,
    /// Node-ID of a DCF or XDC, 1..=127.
    pub node_id: Option<u8>,
    /// Node name of a DCF or XDC; empty if missing.
    pub node_name: String,
    /// Bit rate of a DCF or XDC in bit/s.
    pub bit_rate: Option<u32>,
    /// Supported bit rates in bit/s, ascending.
    pub bit_rates: Vec<u32>,
    /// Entries in ascending order of their unique addresses.
    pub objects: Vec<DeviceObject>,
    /// Problems by line: skipped parts and assumptions.
    pub problems: Vec<DescriptionProblem>,
}

/// Entry with a value: a variable, or a sub-index of an array or record.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceObject {
    /// Index and sub-index.
    pub address: ObjectAddress,
    /// `ParameterName` of the object; empty if missing.
    pub object_name: String,
    /// `ParameterName` of the sub-index; `None` for a variable.
    pub entry_name: Option<String>,
    /// `Denotation`: user-defined name of the entry (DCF, XDC).
    pub denotation: Option<String>,
    /// Data type, if defined in CiA 301 table 44.
    pub data_type: Option<DataType>,
    /// Access type, if stated.
    pub access: Option<EntryAccess>,
    /// `DefaultValue`: value after "restore default parameters".
    pub default: Option<EntryValue>,
    /// `LowLimit`: minimum.
    pub low: Option<EntryValue>,
    /// `HighLimit`: maximum.
    pub high: Option<EntryValue>,
    /// `ParameterValue` of a DCF, `actualValue` of an XDC: configured value.
    pub value: Option<EntryValue>,
    /// `PDOMapping`: whether a PDO can carry the entry.
    pub mappable: Option<bool>,
    /// First line of the entry, from 1; for a compact array, that of the object.
    pub line: usize,
}

/// Reason why a file is not a device description.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DeviceDescriptionError {
    /// The file contains only white space.
    #[error("the file is empty")]
    Empty,
    /// The text contains no section of CiA 306.
    #[error("not an EDS, DCF or XDD; expected a section such as [DeviceInfo] or [1000], or XML")]
    NoSection,
    /// The XML contains no object of CiA 311.
    #[error("not an XDD; expected XML with a CANopenObject")]
    NoObject,
}

impl DeviceFile {
    /// Empty file of a kind.
    pub(super) fn new(kind: DescriptionKind) -> Self {
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

    /// Entry at an address.
    pub fn find_object(&self, address: ObjectAddress) -> Option<&DeviceObject> {
        let at = self.objects.binary_search_by_key(&address, |object| object.address).ok()?;
        self.objects.get(at)
    }

    /// Completes the identity from the defaults of object 1018 (CiA 301 §7.5.2.21), which the device responds
    /// with. If they differ, the numbers of the device description take precedence.
    pub(super) fn complete_identity(&mut self, problems: &mut DescriptionProblems) {
        let default = |sub| {
            let entry = self.find_object(ObjectAddress::new(0x1018, sub))?;
            match entry.default.as_ref()?.number_for(0).map(u32::try_from) {
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
                Some(other) if other != default => problems.add_problem(
                    line,
                    format!("{name} {default:#X} in object 1018, but {other:#X} in the description (used)"),
                ),
                Some(_) => {}
            }
        }
    }
}
