//! Converts EDS, DCF and XDD files to devices and to profiles.
//!
//! ```text
//! DeviceFile ─objects─▶ Object ─┬─▶ Device: the objects of the file override those of CiA 301
//!                               └─repeat, text─▶ a profile in TOML
//! ```
//!
//! A device file contains no units, scales or names of values. If a standard defines the same entry with the
//! same type, the entry of the standard is used, with the access, default and limits of the file.

mod objects;
mod pdos;
mod printable;
mod repeat;
mod text;

use std::sync::Arc;

use self::printable::replace_controls;
use super::device::{DeviceIdentity, DeviceProfile};
use super::device_file::{DescriptionKind, DeviceFile};
use super::dictionary::Dictionary;
use super::layer::DocumentLayer;
use super::layout::LayoutOrigin;
use super::standards::plain_device;
use crate::wire::canopen::ObjectAddress;

pub use super::device::DescriptionImport;
pub use text::write_profile;

/// Max length of an id that is derived from names.
const LONGEST_ID: usize = 60;

/// Device described by a file; `name` is the file name without its folder.
pub fn describe_device(file: &Arc<DeviceFile>, name: &str) -> DeviceProfile {
    let standard = plain_device();
    let mut device = DeviceProfile { file: None, ..(**standard).clone() };
    device.id = id(file, name);
    device.full_id.clone_from(&device.id);
    device.title = device_title(file, name);
    device.vendor = replace_controls(&file.vendor_name);
    device.source = replace_controls(name);
    device.identities = device_identity(file).into_iter().collect();
    let objects = objects::import_objects(file, &standard.dictionary, |_| true).list;
    device.dictionary.layers.insert(0, Arc::new(DocumentLayer::new(objects)));
    device.deciding = device.deciding_objects();
    device.file = Some(DescriptionImport { file: Arc::clone(file), layer: 0 });
    device
}

impl DeviceProfile {
    /// Whether only a device file describes the device.
    pub(crate) fn is_file_alone(&self) -> bool {
        self.file.as_ref().is_some_and(|import| import.layer == 0)
    }

    /// Source of an object's default: `profile`, or the kind of the device file.
    pub(crate) fn default_origin(&self, object: ObjectAddress) -> LayoutOrigin {
        let layer = self.dictionary.layer_of(object);
        let import = self.file.as_ref().filter(|import| layer == Some(import.layer));
        import.map_or(LayoutOrigin::Profile, |import| import.file.kind.into())
    }

    /// Copy of the device in which a device file adds the objects that its profile lacks.
    #[must_use]
    pub fn fill_from(&self, file: &Arc<DeviceFile>) -> Self {
        let layers = &self.dictionary.layers;
        let standards =
            Dictionary { layers: layers.iter().skip(1).cloned().collect(), ..Dictionary::default() };
        let says = |address| self.dictionary.is_own(address) || self.says_of_pdo(address);
        let objects = objects::import_objects(file, &standards, |address| !says(address)).list;
        let layer = layers.len().min(1);
        let mut device = self.clone();
        device.dictionary.layers.insert(layer, Arc::new(DocumentLayer::new(objects)));
        device.deciding = device.deciding_objects();
        device.file = Some(DescriptionImport { file: Arc::clone(file), layer });
        device
    }

    /// Whether the profile defines this PDO parameter in another way.
    fn says_of_pdo(&self, address: ObjectAddress) -> bool {
        self.pdos.iter().any(|spec| {
            address.index == spec.pdo.mapping_index()
                || spec.cob_id.is_some() && address == ObjectAddress::new(spec.pdo.communication_index(), 1)
        })
    }
}

impl From<DescriptionKind> for LayoutOrigin {
    fn from(kind: DescriptionKind) -> Self {
        match kind {
            DescriptionKind::Eds => Self::Eds,
            DescriptionKind::Dcf => Self::Dcf,
            DescriptionKind::Xdd => Self::Xdd,
            DescriptionKind::Xdc => Self::Xdc,
        }
    }
}

impl DescriptionKind {
    /// Name in output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Eds => "eds",
            Self::Dcf => "dcf",
            Self::Xdd => "xdd",
            Self::Xdc => "xdc",
        }
    }
}

/// Vendor-ID and product code: fewer numbers would match other devices, and the revision differs between
/// devices of the same type.
fn device_identity(file: &DeviceFile) -> Option<DeviceIdentity> {
    let (vendor_id, product_code) = (file.vendor_id?, file.product_code?);
    Some(DeviceIdentity {
        vendor_id: Some(vendor_id),
        product_code: Some(product_code),
        ..DeviceIdentity::default()
    })
}

/// `vendor-product` from their names, otherwise derived from the file name.
fn id(file: &DeviceFile, name: &str) -> String {
    let (vendor, product) = (to_kebab_case(&file.vendor_name), to_kebab_case(&file.product_name));
    if vendor.is_empty() || product.is_empty() {
        id_of_name(name)
    } else {
        to_kebab_case(&format!("{vendor}-{product}"))
    }
}

/// Id derived from a file name.
pub fn id_of_name(name: &str) -> String {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    match to_kebab_case(stem) {
        id if id.is_empty() => "device".to_owned(),
        id => id,
    }
}

fn device_title(file: &DeviceFile, name: &str) -> String {
    let product = file.product_name.trim();
    if product.is_empty() { id_of_name(name) } else { replace_controls(product) }
}

/// ASCII letters and digits in lower case; all other characters become hyphens.
fn to_kebab_case(text: &str) -> String {
    let lower = text.to_lowercase();
    let spelled = [('ä', "ae"), ('ö', "oe"), ('ü', "ue"), ('ß', "ss")];
    let lower = spelled.iter().fold(lower, |text, (letter, letters)| text.replace(*letter, letters));
    let words = lower.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    let mut id = String::new();
    for word in words {
        if !id.is_empty() {
            id.push('-');
        }
        id.push_str(word);
    }
    id.truncate(LONGEST_ID);
    id.trim_end_matches('-').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::device_file;

    #[test]
    fn ids_are_made_of_names() {
        let of = |vendor: &str, product: &str, name: &str| {
            let text = format!("[DeviceInfo]\nVendorName={vendor}\nProductName={product}\n");
            let device =
                describe_device(&Arc::new(device_file::parse_device_file(text.as_bytes()).unwrap()), name);
            (device.id, device.title)
        };
        let named = |id: &str, title: &str| (id.to_owned(), title.to_owned());
        assert_eq!(of("Müller & Söhne", "Größe L", "x.eds"), named("mueller-soehne-groesse-l", "Größe L"));
        assert_eq!(of("", "Pump", "My pump.V2.eds"), named("my-pump-v2", "Pump"));
        assert_eq!(of("日本", "Pump", "--.eds"), named("device", "Pump"));
        assert_eq!(of("", "", "a.dcf"), named("a", "a"));
        assert_eq!(of(&"x".repeat(99), "b", "a.dcf").0.len(), LONGEST_ID);
    }

    #[test]
    fn only_both_numbers_are_an_identity() {
        let of = |numbers: &str| {
            let text = format!("[DeviceInfo]\n{numbers}\n");
            describe_device(&Arc::new(device_file::parse_device_file(text.as_bytes()).unwrap()), "a.eds")
                .identities
                .len()
        };
        assert_eq!(of("VendorNumber=1\nProductNumber=2"), 1);
        assert_eq!(of("VendorNumber=1\nProductNumber=0"), 0);
        assert_eq!(of("ProductNumber=2"), 0);
    }

    #[test]
    fn a_profile_says_what_it_says_of_a_pdo() {
        let text = "[1800]\nParameterName=a\nObjectType=9\n[1800sub1]\nParameterName=a\nDataType=7\nAccessType=rw\nDefaultValue=0x3A0\n\
            [1A00]\nParameterName=a\nObjectType=9\n[1A00sub0]\nParameterName=a\nDataType=5\nAccessType=rw\nDefaultValue=1\n";
        let file = Arc::new(device_file::parse_device_file(text.as_bytes()).unwrap());
        let profile =
            "id = \"x\"\n[[pdo]]\npdo = \"TPDO1\"\nmapping = \"default\"\nfields = [{ bits = 8 }]\n";
        let profile = crate::profile::device::ProfileFile::parse(profile).unwrap();
        let filled = profile.build_device(None, &[Arc::clone(plain_device())]).fill_from(&file);
        let default = |index, sub| {
            let found = filled.dictionary.find_object(ObjectAddress::new(index, sub)).unwrap();
            found.entry.unwrap().default_number(None)
        };
        assert_eq!((default(0x1800, 1), default(0x1A00, 0)), (Some(0x3A0), None));
        assert_eq!(filled.default_origin(ObjectAddress::new(0x1800, 1)), LayoutOrigin::Eds);
        assert_eq!(filled.default_origin(ObjectAddress::new(0x1A00, 0)), LayoutOrigin::Profile);
        assert!(!filled.is_file_alone());
    }
}
