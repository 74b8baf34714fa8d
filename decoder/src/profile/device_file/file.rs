//! What a device file says: a device type or a device, and its objects.

use super::code::Access;
use super::problem::{Problem, Problems};
use super::value::Given;
use crate::profile::data_type::DataType;
use crate::wire::canopen::ObjectAddress;

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
#[non_exhaustive]
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

impl DeviceFile {
    /// A file of which nothing is read yet.
    pub(super) fn new(kind: Kind) -> Self {
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
    pub(super) fn complete_identity(&mut self, problems: &mut Problems) {
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
