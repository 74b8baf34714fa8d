//! All profiles by id: built-in and user-supplied ones.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use serde::Deserialize;

use super::device::{DeviceIdentity, DeviceProfile, ProfileFile, ProfileHint};
use super::position::TextError;
use super::{compiled, embedded};

/// Profiles by id. Built-in profiles are loaded on first use.
#[derive(Debug, Default)]
pub struct Catalogue {
    user: Vec<UserProfile>,
    /// User settings of device rules: profile, rule, key, value.
    tolerances: Vec<(String, String, String, f64)>,
    read: Mutex<BTreeMap<String, Arc<DeviceProfile>>>,
}

/// A user-supplied profile.
#[derive(Debug)]
struct UserProfile {
    id: String,
    origin: String,
    recognition: Recognition,
    content: CatalogueContent,
}

#[derive(Debug)]
enum CatalogueContent {
    Text(String),
    Device(Arc<DeviceProfile>),
    Broken(ProfileError),
}

impl UserProfile {
    fn is_profile(&self) -> bool {
        !self.is_device_file()
    }

    fn is_device_file(&self) -> bool {
        matches!(&self.content, CatalogueContent::Device(device) if device.is_file_alone())
    }
}

/// Reason why a profile cannot be loaded.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ProfileError {
    /// No profile has this id.
    #[error("unknown profile '{id}'{}", closest.as_ref().map(|it| format!("; did you mean '{it}'?")).unwrap_or_default())]
    Unknown {
        /// Requested id.
        id: String,
        /// Most similar id.
        closest: Option<String>,
    },
    /// The profile has no such variant.
    #[error("unknown variant '{variant}' of profile '{id}'; {}", if known.is_empty() { "it has no variants".into() } else { format!("expected {known}") })]
    NoVariant {
        /// Id of the profile.
        id: String,
        /// Requested variant.
        variant: String,
        /// Variants of the profile, separated by commas.
        known: String,
    },
    /// The text of the profile is invalid.
    #[error("{}", format_errors(file, errors))]
    Broken {
        /// File name or origin of the profile.
        file: String,
        /// Problems in the text.
        errors: Vec<TextError>,
    },
}

fn format_errors(file: &str, errors: &[TextError]) -> String {
    errors.iter().map(|error| error.show_in_file(file)).collect::<Vec<_>>().join("\n")
}

/// Identity data that a node reported.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReportedIdentity {
    /// Vendor-ID, object 1018:01.
    pub vendor_id: Option<u32>,
    /// Product code, object 1018:02.
    pub product_code: Option<u32>,
    /// Revision number, object 1018:03.
    pub revision: Option<u32>,
    /// Device type, object 1000:00.
    pub device_type: Option<u32>,
    /// Manufacturer device name, object 1008:00.
    pub device_name: Option<String>,
}

impl DeviceIdentity {
    /// Whether the node reported all the required data.
    pub fn matches_identity(&self, node: &ReportedIdentity) -> bool {
        let same = |wanted: Option<u32>, is: Option<u32>| wanted.is_none() || wanted == is;
        let asks = self.vendor_id.is_some() || self.device_name.is_some() || self.profile_number.is_some();
        let profile = node.device_type.map(|device_type| device_type & 0xFFFF);
        asks && same(self.vendor_id, node.vendor_id)
            && same(self.product_code, node.product_code)
            && same(self.revision, node.revision)
            && same(self.device_type, node.device_type)
            && same(self.profile_number.map(u32::from), profile)
            && self
                .device_name
                .as_deref()
                .is_none_or(|name| node.device_name.as_deref().is_some_and(|device| device.starts_with(name)))
    }
}

/// Folder of the built-in device profiles.
const VENDOR: &str = "vendor/";

/// Folder of the profiles of device classes, used for devices without a more specific profile.
const GENERIC: &str = "generic/";

/// Profile id of a path: `rexroth-sydfec` for `vendor/rexroth/sydfec.toml`, `cia301` for
/// `standard/cia301.toml`.
fn id_of(path: &str) -> Option<String> {
    let stem = path.strip_suffix(".toml")?;
    match stem.strip_prefix(VENDOR) {
        Some(device) => Some(device.replace('/', "-")),
        None => ["standard/", GENERIC].iter().find_map(|folder| stem.strip_prefix(folder)).map(str::to_owned),
    }
}

impl Catalogue {
    /// Adds a profile as text and returns its id; `origin` is its name in error messages. It overrides an
    /// earlier profile with the same id.
    ///
    /// # Errors
    /// Invalid text.
    pub fn add_text(&mut self, origin: &str, text: &str) -> Result<String, ProfileError> {
        let broken = |errors| ProfileError::Broken { file: origin.to_owned(), errors };
        let file = ProfileFile::parse(text).map_err(broken)?;
        let id = file.id().to_owned();
        self.user.push(UserProfile {
            id: id.clone(),
            origin: origin.to_owned(),
            recognition: load_recognition(text),
            content: CatalogueContent::Text(text.to_owned()),
        });
        Ok(id)
    }

    /// Adds an invalid profile; the error is reported when a node requires it.
    pub fn add_broken(&mut self, id: &str, error: ProfileError) {
        self.user.push(UserProfile {
            id: id.to_owned(),
            origin: String::new(),
            recognition: Recognition::default(),
            content: CatalogueContent::Broken(error),
        });
    }

    /// Adds a device from another source: an EDS, DCF or XDD file.
    pub fn add_device(&mut self, origin: &str, device: DeviceProfile) {
        self.user.push(UserProfile {
            id: device.id.clone(),
            origin: origin.to_owned(),
            recognition: Recognition { identity: device.identities.clone(), hint: device.hints.clone() },
            content: CatalogueContent::Device(Arc::new(device)),
        });
    }

    /// Overrides a number in a device rule; applies to devices that are loaded later.
    pub fn set_tolerance(&mut self, profile: &str, rule: &str, key: &str, value: f64) {
        self.tolerances.push((profile.to_owned(), rule.to_owned(), key.to_owned(), value));
        self.read.get_mut().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Whether the profile with this id originates from a device file.
    pub fn is_device_file(&self, id: &str) -> bool {
        let user = self.user.iter().rev().find(|user| user.id == id);
        user.is_some_and(UserProfile::is_device_file)
    }

    /// Origin of the user-supplied profile with this id; `None` without one.
    pub fn content_of(&self, id: &str) -> Option<&str> {
        self.user.iter().rev().find(|user| user.id == id).map(|user| user.origin.as_str())
    }

    /// Origin of the profile that the last one added for this id overrides; empty for a built-in profile.
    pub fn replaced_origin(&self, id: &str) -> Option<&str> {
        let of_user = self.user.iter().rev().filter(|user| user.id == id).nth(1);
        let is_bundled = || bundled_devices().any(|device| device == id);
        of_user.map(|user| user.origin.as_str()).or_else(|| is_bundled().then_some(""))
    }

    /// Sorted ids of all devices, without standards.
    pub fn ids(&self) -> Vec<String> {
        let mut ids: Vec<_> = bundled_devices().chain(self.user.iter().map(|user| user.id.clone())).collect();
        ids.sort();
        ids.dedup();
        ids
    }

    /// Device of an assignment: `rexroth-sydfec`, `wandfluh-md2:controller`.
    ///
    /// # Errors
    /// Unknown ids and variants; invalid profiles.
    pub fn device(&self, assignment: &str) -> Result<Arc<DeviceProfile>, ProfileError> {
        let read = || self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(device) = read().get(assignment) {
            return Ok(Arc::clone(device));
        }
        let device = self.find_device(assignment, 0)?;
        read().insert(assignment.to_owned(), Arc::clone(&device));
        Ok(device)
    }

    fn find_device(&self, assignment: &str, depth: u8) -> Result<Arc<DeviceProfile>, ProfileError> {
        let (id, variant) = match assignment.split_once(':') {
            Some((id, variant)) => (id, Some(variant)),
            None => (assignment, None),
        };
        let user = self.user.iter().rev().find(|user| user.id == id);
        let (origin, text, file) = match user.map(|user| (&user.origin, &user.content)) {
            Some((_, CatalogueContent::Device(device))) => return Ok(Arc::clone(device)),
            Some((_, CatalogueContent::Broken(error))) => return Err(error.clone()),
            Some((origin, CatalogueContent::Text(text))) => {
                (origin.clone(), text.as_str(), ProfileFile::parse(text))
            }
            None => {
                let found = bundled_profiles().find(|(path, ..)| id_of(path).as_deref() == Some(id));
                let &(path, text, compiled) = found.ok_or_else(|| self.unknown_profile(id))?;
                (format!("profiles/{path}"), text, ProfileFile::from_compiled(compiled, text))
            }
        };
        let broken = |errors| ProfileError::Broken { file: origin.clone(), errors };
        let file = file.map_err(broken)?;
        if let Some(variant) = variant.filter(|id| !file.variants().iter().any(|known| known.id == **id)) {
            let known: Vec<_> = file.variants().iter().map(|known| known.id.as_str()).collect();
            return Err(ProfileError::NoVariant {
                id: id.into(),
                variant: variant.into(),
                known: known.join(", "),
            });
        }
        let mut standards = Vec::new();
        for (name, span) in file.extended_standards() {
            let standard =
                if depth < 4 { self.find_device(name, depth + 1) } else { Err(self.unknown_profile(name)) };
            let wrong =
                |error: ProfileError| broken(vec![TextError::at_place(text, span, error.to_string())]);
            standards.push(standard.map_err(wrong)?);
        }
        let mut device = file.build_device(variant, &standards);
        for (_, rule, key, value) in self.tolerances.iter().filter(|(profile, ..)| profile == id) {
            device
                .rules
                .iter_mut()
                .filter(|own| own.name == *rule)
                .for_each(|own| own.set_tolerance(key, *value));
        }
        Ok(Arc::new(device))
    }

    fn unknown_profile(&self, id: &str) -> ProfileError {
        ProfileError::Unknown { id: id.to_owned(), closest: closest_name(id, self.ids()) }
    }

    /// Assignments that match the identity data of a node; ambiguous if more than one. Device files are used
    /// only if no profile matches, profiles of device classes only if no device file matches.
    pub(crate) fn identify_node(&self, node: &ReportedIdentity) -> Vec<String> {
        let own = || {
            let own = bundled_recognition().iter().filter(|own| self.content_of(&own.id).is_none());
            own.map(|own| (own, (own.id.as_str(), own.by.identity.as_slice())))
        };
        let devices = own().filter(|(own, _)| !own.is_generic).map(|(_, identities)| identities);
        let mut found = fitting_profiles(self.user_profiles(UserProfile::is_profile).chain(devices), node);
        if found.is_empty() {
            found = fitting_profiles(self.user_profiles(UserProfile::is_device_file), node);
        }
        if found.is_empty() {
            found = fitting_profiles(
                own().filter(|(own, _)| own.is_generic).map(|(_, identities)| identities),
                node,
            );
        }
        found
    }

    /// Ids of the devices that have hints, sorted, with these hints. Only the chosen devices need to be loaded.
    pub(crate) fn hints(&self) -> BTreeMap<&str, &[ProfileHint]> {
        let own = bundled_recognition().iter().map(|own| (own.id.as_str(), own.by.hint.as_slice()));
        let users = self.user.iter().map(|user| (user.id.as_str(), user.recognition.hint.as_slice()));
        let mut hints: BTreeMap<_, _> = own.chain(users).collect();
        hints.retain(|_, hints| !hints.is_empty());
        hints
    }

    /// Whether the profile with this id describes a device class rather than a device.
    pub fn is_generic(&self, id: &str) -> bool {
        self.content_of(id).is_none()
            && bundled_recognition().iter().any(|own| own.is_generic && own.id == id)
    }

    fn user_profiles(
        &self,
        counts: fn(&UserProfile) -> bool,
    ) -> impl Iterator<Item = (&str, &[DeviceIdentity])> {
        let user = self.user.iter().filter(move |user| counts(user));
        user.map(|user| (user.id.as_str(), user.recognition.identity.as_slice()))
    }
}

/// Assignments of the profiles whose identity matches.
fn fitting_profiles<'a>(
    profiles: impl Iterator<Item = (&'a str, &'a [DeviceIdentity])>,
    node: &ReportedIdentity,
) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for (id, identities) in profiles {
        for identity in identities.iter().filter(|identity| identity.matches_identity(node)) {
            let assignment = match &identity.variant {
                Some(variant) => format!("{id}:{variant}"),
                None => id.to_owned(),
            };
            if !all.contains(&assignment) {
                all.push(assignment);
            }
        }
    }
    all
}

/// Most similar known name: the longest common prefix of words, at least three letters, because shorter
/// prefixes are too common.
fn closest_name(wanted: &str, known: impl IntoIterator<Item = String>) -> Option<String> {
    let common = |a: &str, b: &str| a.chars().zip(b.chars()).take_while(|(a, b)| a == b).count();
    let alike = |name: &str| {
        let words = name.split('-').chain([name]);
        words
            .map(|word| {
                common(word, wanted).max(wanted.split('-').map(|part| common(word, part)).max().unwrap_or(0))
            })
            .max()
    };
    let scored = known.into_iter().filter_map(|name| Some((alike(&name)?, name)));
    scored.filter(|(score, _)| *score > 2).max_by_key(|(score, _)| *score).map(|(_, name)| name)
}

/// Path, text and compiled form of the built-in profiles.
fn bundled_profiles() -> impl Iterator<Item = &'static (&'static str, &'static str, &'static str)> {
    embedded::FILES.iter()
}

/// Ids of the built-in devices.
fn bundled_devices() -> impl Iterator<Item = String> {
    bundled_profiles().filter(|(path, ..)| is_device(path)).filter_map(|(path, ..)| id_of(path))
}

/// Whether a built-in profile describes a device rather than a standard.
fn is_device(path: &str) -> bool {
    path.starts_with(VENDOR) || path.starts_with(GENERIC)
}

/// Whether a TOML text is a bus file rather than a profile: it has keys specific to bus files, and no profile
/// id.
pub fn is_bus_file(text: &str) -> bool {
    const PARTS: [&str; 8] = ["bus", "node", "master", "dbc", "rules", "suppress", "expect", "diff"];
    // In a bus file these are lists, in a profile single values.
    const LISTS: [&str; 2] = ["id", "uds"];
    let Ok(table) = text.parse::<toml::Table>() else { return false };
    let has_list = LISTS.iter().any(|key| table.get(*key).is_some_and(toml::Value::is_array));
    !table.get("id").is_some_and(toml::Value::is_str)
        && (has_list || PARTS.iter().any(|key| table.contains_key(*key)))
}

/// The parts of a profile by which a device is recognised, readable without the rest.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Recognition {
    /// Identity data that assign the profile.
    identity: Vec<DeviceIdentity>,
    /// Behaviour that suggests the profile.
    hint: Vec<ProfileHint>,
}

/// How a built-in device is recognised.
struct OwnRecognition {
    id: String,
    by: Recognition,
    is_generic: bool,
}

/// How the built-in devices are recognised; collected on first use.
fn bundled_recognition() -> &'static [OwnRecognition] {
    static ALL: OnceLock<Vec<OwnRecognition>> = OnceLock::new();
    ALL.get_or_init(|| {
        let devices = bundled_profiles().filter(|(path, ..)| is_device(path));
        let own = |path: &str, compiled| {
            Some(OwnRecognition {
                id: id_of(path)?,
                by: compiled::read_compiled(compiled).unwrap_or_default(),
                is_generic: path.starts_with(GENERIC),
            })
        };
        devices.filter_map(|(path, _, compiled)| own(path, compiled)).collect()
    })
}

/// How the device of a valid profile is recognised.
fn load_recognition(text: &str) -> Recognition {
    toml::from_str(text).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUMP: &str = "id = \"acme-pump\"\ntitle = \"P\"\nextends = [\"cia301\"]\n\n[[variant]]\nid = \"a\"\n\n\
        [[variant]]\nid = \"b\"\n\n[[identity]]\nvendor_id = 0x19\nproduct_code = 7\nvariant = \"b\"\n\n\
        [[object]]\nindex = 0x2000\nname = \"Pressure\"\ntype = \"UNSIGNED16\"\n";

    #[test]
    fn a_device_with_its_standards_and_variants() {
        let mut catalogue = Catalogue::default();
        catalogue.add_text("pump.toml", PUMP).unwrap();
        let device = catalogue.device("acme-pump").unwrap();
        assert_eq!((device.full_id.as_str(), device.object_count()), ("acme-pump:a", 1));
        assert!(device.dictionary.find_object("1017:00".parse().unwrap()).is_some());
        assert_eq!(catalogue.device("acme-pump:b").unwrap().variant.as_deref(), Some("b"));
        let error = catalogue.device("acme-pump:c").unwrap_err();
        assert_eq!(error.to_string(), "unknown variant 'c' of profile 'acme-pump'; expected a, b");
        let error = catalogue.device("pump").unwrap_err();
        assert_eq!(error.to_string(), "unknown profile 'pump'; did you mean 'acme-pump'?");
    }

    #[test]
    fn identity_assigns_when_all_of_it_fits() {
        let mut catalogue = Catalogue::default();
        catalogue.add_text("pump.toml", PUMP).unwrap();
        let mut node = ReportedIdentity { vendor_id: Some(0x19), ..ReportedIdentity::default() };
        assert!(catalogue.identify_node(&node).is_empty());
        node.product_code = Some(7);
        assert_eq!(catalogue.identify_node(&node), ["acme-pump:b"]);
    }

    #[test]
    fn a_broken_profile_names_its_place() {
        let mut catalogue = Catalogue::default();
        let error =
            catalogue.add_text("x.toml", "id = \"x\"\n[[object]]\nindx = 1\n").unwrap_err().to_string();
        assert!(error.starts_with("x.toml:3:1: unknown field `indx`"), "{error}");
        let text = PUMP.replace("[\"cia301\"]", "[\"cia999\"]");
        catalogue.add_text("x.toml", &text).unwrap();
        let error = catalogue.device("acme-pump").unwrap_err().to_string();
        assert!(error.contains("x.toml:3:12: unknown profile 'cia999'"), "{error}");
    }
}
