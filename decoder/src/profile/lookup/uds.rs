//! Names of UDS: services, sub-functions, data identifiers, negative response codes (ISO 14229-1).

use std::sync::OnceLock;

use serde::Deserialize;

use crate::profile::embedded::parse_embedded;
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
    #[serde(default = "default_true")]
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

const fn default_true() -> bool {
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
struct SubFunctionEntry {
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
struct IdentifierEntry {
    code: u16,
    name: String,
}

/// All UDS lookup tables.
#[derive(Debug, Default)]
pub struct UdsNames {
    service: Vec<UdsService>,
    subfunction: Vec<SubFunctionEntry>,
    identifier: Vec<IdentifierEntry>,
    code: Vec<UdsCode>,
}

impl UdsNames {
    /// Service by the identifier of its request.
    pub fn service_by_id(&self, code: u8) -> Option<&UdsService> {
        self.service.iter().find(|entry| entry.code == code)
    }

    /// Name of a sub-function, without bit 7.
    pub fn sub_function(&self, service: u8, value: u8) -> Option<&str> {
        let is_it = |entry: &&SubFunctionEntry| {
            entry.service == service && value & entry.mask == entry.code & entry.mask
        };
        self.subfunction.iter().find(is_it).map(|entry| entry.name.as_str())
    }

    /// Name of a standardised data identifier.
    pub fn identifier_name(&self, code: u16) -> Option<&str> {
        self.identifier.iter().find(|entry| entry.code == code).map(|entry| entry.name.as_str())
    }

    /// Entry of a negative response code.
    pub fn code_entry(&self, code: u8) -> Option<&UdsCode> {
        self.code.iter().find(|entry| entry.code == code)
    }
}

/// Names defined in ISO 14229-1.
pub fn uds_names() -> &'static UdsNames {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct ServiceTable {
        service: Vec<UdsService>,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct SubFunctions {
        subfunction: Vec<SubFunctionEntry>,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct IdentifierTable {
        identifier: Vec<IdentifierEntry>,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct UdsCodes {
        code: Vec<UdsCode>,
    }
    static TABLE: OnceLock<UdsNames> = OnceLock::new();
    TABLE.get_or_init(|| UdsNames {
        service: parse_embedded::<ServiceTable>("lookups/uds_services.toml").service,
        subfunction: parse_embedded::<SubFunctions>("lookups/uds_subfunctions.toml").subfunction,
        identifier: parse_embedded::<IdentifierTable>("lookups/uds_identifiers.toml").identifier,
        code: parse_embedded::<UdsCodes>("lookups/uds_nrc.toml").code,
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn services_state_the_position_of_their_identifier() {
        let read = uds_names().service_by_id(0x22).unwrap();
        assert_eq!(read.name, "read-data-by-identifier");
        assert_eq!(read.request().identifier, Some(IdentifierPlace { offset: 0, high: None }));
        let routine = uds_names().service_by_id(0x31).unwrap().response();
        assert_eq!((routine.sub_function, routine.identifier.map(|place| place.offset)), (true, Some(1)));
        let periodic = uds_names().service_by_id(0x2A).unwrap();
        assert_eq!(periodic.request().identifier, Some(IdentifierPlace { offset: 1, high: Some(0xF2) }));
        assert_eq!(periodic.response(), ServiceLayout::default());
        assert!(uds_names().service_by_id(0x21).is_none());
    }

    #[test]
    fn codes_and_sub_functions() {
        assert_eq!(uds_names().code_entry(0x31).map(|code| code.name.as_str()), Some("request-out-of-range"));
        assert_eq!(uds_names().sub_function(0x10, 3), Some("extended-session"));
        // Security levels: odd ones request the seed, even ones send the key.
        assert_eq!(uds_names().sub_function(0x27, 0x11), Some("request-seed"));
        assert_eq!(uds_names().sub_function(0x27, 0x12), Some("send-key"));
        assert_eq!(uds_names().sub_function(0x22, 1), None);
        assert_eq!(uds_names().identifier_name(0xF190), Some("VIN"));
    }

    /// Bit 6 of a service identifier marks responses, so no request has it; codes are unique.
    #[test]
    fn the_tables_are_consistent() {
        assert!(uds_names().service.iter().all(|service| service.code & 0x40 == 0));
        let is_kebab = |name: &str| {
            name.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-')
        };
        assert!(uds_names().service.iter().all(|service| is_kebab(&service.name)));
        assert!(
            uds_names()
                .subfunction
                .iter()
                .all(|entry| is_kebab(&entry.name) && uds_names().service_by_id(entry.service).is_some())
        );
        assert!(uds_names().code.iter().all(|code| is_kebab(&code.name) && !code.text.is_empty()));
        let codes: BTreeSet<_> = uds_names().code.iter().map(|code| code.code).collect();
        assert_eq!(codes.len(), uds_names().code.len());
        let services: BTreeSet<_> = uds_names().service.iter().map(|service| service.code).collect();
        // 27 of ISO 14229-1 and the ten of SAE J1979.
        assert_eq!(services.len(), 37);
        assert!(
            uds_names().subfunction.iter().all(|entry| uds_names()
                .service_by_id(entry.service)
                .is_some_and(|found| found.sub_function))
        );
    }
}
