//! Names of UDS: services, sub-functions, data identifiers, negative response codes (ISO 14229-1).

use std::sync::OnceLock;

use serde::Deserialize;

use crate::profile::embedded::parse;
use crate::wire::uds::{IdentifierPlace, ServiceLayout};

/// UDS service.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UdsService {
    /// Service identifier of the request.
    pub code: u8,
    /// Name in output.
    pub name: String,
    /// Title for display.
    pub title: String,
    #[serde(default)]
    sub_function: bool,
    #[serde(default)]
    identifier: Option<u8>,
    #[serde(default)]
    high: Option<u8>,
    #[serde(default = "yes")]
    response: bool,
    #[serde(default)]
    value: Option<ValueIn>,
}

/// Message of a service that contains the value of its identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ValueIn {
    /// The request: the service writes the value.
    Request,
    /// The positive response: the service reads the value.
    Response,
}

const fn yes() -> bool {
    true
}

impl UdsService {
    /// Layout of a request.
    pub fn request(&self) -> ServiceLayout {
        let place = |offset| IdentifierPlace { offset, high: self.high };
        ServiceLayout { sub_function: self.sub_function, identifier: self.identifier.map(place) }
    }

    /// Whether SAE J1979 defines the service, not ISO 14229-1. Small numbers are also common data bytes, so
    /// that alone they are no evidence for UDS.
    pub(crate) const fn is_obd(&self) -> bool {
        const FIRST_OF_UDS: u8 = 0x10;
        self.code < FIRST_OF_UDS
    }

    /// Message that contains the value of the identifier.
    pub(crate) const fn value_in(&self) -> Option<ValueIn> {
        self.value
    }

    /// Layout of a positive response.
    pub fn response(&self) -> ServiceLayout {
        if self.response { self.request() } else { ServiceLayout::default() }
    }
}

/// Negative response code.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UdsCode {
    /// Code number.
    pub code: u8,
    /// Name in output.
    pub name: String,
    /// Meaning of the code.
    pub text: String,
    /// Most common cause.
    #[serde(default)]
    pub hint: String,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct SubFunction {
    service: u8,
    code: u8,
    #[serde(default = "all_bits")]
    mask: u8,
    name: String,
}

const fn all_bits() -> u8 {
    0x7F
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Identifier {
    code: u16,
    name: String,
}

/// All UDS lookup tables.
#[derive(Debug, Default)]
pub struct UdsNames {
    service: Vec<UdsService>,
    subfunction: Vec<SubFunction>,
    identifier: Vec<Identifier>,
    code: Vec<UdsCode>,
}

impl UdsNames {
    /// Service by the identifier of its request.
    pub fn service(&self, code: u8) -> Option<&UdsService> {
        self.service.iter().find(|entry| entry.code == code)
    }

    /// Name of a sub-function, without bit 7.
    pub fn sub_function(&self, service: u8, value: u8) -> Option<&str> {
        let is_it =
            |entry: &&SubFunction| entry.service == service && value & entry.mask == entry.code & entry.mask;
        self.subfunction.iter().find(is_it).map(|entry| entry.name.as_str())
    }

    /// Name of a standardised data identifier.
    pub fn identifier(&self, code: u16) -> Option<&str> {
        self.identifier.iter().find(|entry| entry.code == code).map(|entry| entry.name.as_str())
    }

    /// Entry of a negative response code.
    pub fn code(&self, code: u8) -> Option<&UdsCode> {
        self.code.iter().find(|entry| entry.code == code)
    }
}

/// Names defined in ISO 14229-1.
pub fn uds() -> &'static UdsNames {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Services {
        service: Vec<UdsService>,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct SubFunctions {
        subfunction: Vec<SubFunction>,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Identifiers {
        identifier: Vec<Identifier>,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Codes {
        code: Vec<UdsCode>,
    }
    static TABLE: OnceLock<UdsNames> = OnceLock::new();
    TABLE.get_or_init(|| UdsNames {
        service: parse::<Services>("lookups/uds_services.toml").service,
        subfunction: parse::<SubFunctions>("lookups/uds_subfunctions.toml").subfunction,
        identifier: parse::<Identifiers>("lookups/uds_identifiers.toml").identifier,
        code: parse::<Codes>("lookups/uds_nrc.toml").code,
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn services_state_the_position_of_their_identifier() {
        let read = uds().service(0x22).unwrap();
        assert_eq!(read.name, "read-data-by-identifier");
        assert_eq!(read.request().identifier, Some(IdentifierPlace { offset: 0, high: None }));
        let routine = uds().service(0x31).unwrap().response();
        assert_eq!((routine.sub_function, routine.identifier.map(|place| place.offset)), (true, Some(1)));
        let periodic = uds().service(0x2A).unwrap();
        assert_eq!(periodic.request().identifier, Some(IdentifierPlace { offset: 1, high: Some(0xF2) }));
        assert_eq!(periodic.response(), ServiceLayout::default());
        assert!(uds().service(0x21).is_none());
    }

    #[test]
    fn codes_and_sub_functions() {
        assert_eq!(uds().code(0x31).map(|code| code.name.as_str()), Some("request-out-of-range"));
        assert_eq!(uds().sub_function(0x10, 3), Some("extended-session"));
        // Security levels: odd ones request the seed, even ones send the key.
        assert_eq!(uds().sub_function(0x27, 0x11), Some("request-seed"));
        assert_eq!(uds().sub_function(0x27, 0x12), Some("send-key"));
        assert_eq!(uds().sub_function(0x22, 1), None);
        assert_eq!(uds().identifier(0xF190), Some("VIN"));
    }

    /// Bit 6 of a service identifier marks responses, so no request has it; codes are unique.
    #[test]
    fn the_tables_are_consistent() {
        assert!(uds().service.iter().all(|service| service.code & 0x40 == 0));
        let is_kebab = |name: &str| {
            name.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-')
        };
        assert!(uds().service.iter().all(|service| is_kebab(&service.name)));
        assert!(
            uds()
                .subfunction
                .iter()
                .all(|entry| is_kebab(&entry.name) && uds().service(entry.service).is_some())
        );
        assert!(uds().code.iter().all(|code| is_kebab(&code.name) && !code.text.is_empty()));
        let codes: BTreeSet<_> = uds().code.iter().map(|code| code.code).collect();
        assert_eq!(codes.len(), uds().code.len());
        let services: BTreeSet<_> = uds().service.iter().map(|service| service.code).collect();
        // 27 of ISO 14229-1 and the ten of SAE J1979.
        assert_eq!(services.len(), 37);
        assert!(
            uds()
                .subfunction
                .iter()
                .all(|entry| uds().service(entry.service).is_some_and(|found| found.sub_function))
        );
    }
}
