//! Texts of EMCY codes: those of a device, otherwise those of CiA 301.

use std::sync::{Arc, OnceLock};

use serde::Deserialize;

use super::embedded::parse_embedded;
use super::lookup::emcy_codes;

/// Texts of the EMCY codes of a device, shared by all its meanings.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ErrorTexts(Arc<[(u16, String)]>);

impl ErrorTexts {
    /// Texts of a device by code.
    pub(super) fn from_codes(codes: impl Iterator<Item = (u16, String)>) -> Self {
        Self(codes.collect())
    }

    /// Text of a code.
    pub fn get(&self, code: u16) -> &str {
        let own = self.0.iter().find(|(own, _)| *own == code).map(|(_, text)| text.as_str());
        own.unwrap_or_else(|| standard_text(code))
    }
}

/// Text of a code in CiA 301 (table 26).
pub(super) fn standard_text(code: u16) -> &'static str {
    emcy_codes().find_code(u32::from(code)).map_or("undefined in CiA 301", |known| &known.text)
}

/// Code of a device profile (CiA 4xx).
#[derive(Debug, Default, Deserialize)]
struct ProfileCode {
    code: u16,
    text: String,
}

#[derive(Debug, Default, Deserialize)]
struct ProfileCodes {
    #[serde(default)]
    code: Vec<ProfileCode>,
}

/// Title and error codes of a generic device profile.
#[derive(Debug, Default, Deserialize)]
struct GenericProfile {
    #[serde(default)]
    title: String,
    #[serde(default)]
    emcy: ProfileCodes,
}

/// Meaning of an undefined code in the generic device profiles, with the title of the profile. It is only a
/// suggestion, since the device may follow another profile. `None` for codes of CiA 301.
pub fn suggested_error_text(code: u16) -> Option<(&'static str, &'static str)> {
    static PROFILES: OnceLock<Vec<GenericProfile>> = OnceLock::new();
    if emcy_codes().find_code(u32::from(code)).is_some() {
        return None;
    }
    let profiles = PROFILES.get_or_init(|| GENERIC.iter().map(|path| parse_embedded(path)).collect());
    profiles.iter().find_map(|profile| {
        let known = profile.emcy.code.iter().find(|known| known.code == code)?;
        Some((profile.title.as_str(), known.text.as_str()))
    })
}

/// Embedded profiles of device classes.
const GENERIC: [&str; 1] = ["generic/cia402.toml"];

#[cfg(test)]
mod tests {
    use super::*;

    /// 8611 belongs to CiA 402; 8130 to CiA 301; 8305 to no generic profile.
    #[test]
    fn only_undefined_codes_have_a_suggestion() {
        assert_eq!(suggested_error_text(0x8611), Some(("CiA 402", "following error")));
        assert_eq!(suggested_error_text(0x8130), None);
        assert_eq!(suggested_error_text(0x8305), None);
    }

    #[test]
    fn own_texts_override_those_of_the_standard() {
        let texts = ErrorTexts::from_codes([(0x8130, "own".to_owned())].into_iter());
        assert_eq!((texts.get(0x8130), texts.get(0x8305)), ("own", "undefined in CiA 301"));
        assert_eq!(ErrorTexts::default().get(0x8130), "heartbeat or life-guard error");
    }
}
