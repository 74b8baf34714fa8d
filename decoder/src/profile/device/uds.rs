//! UDS as a device has it: its own identifiers and its own words for negative responses.

use std::sync::Arc;

use serde::Deserialize;
use toml::Spanned;

use super::network::OrderName;
use crate::profile::data_type::DataType;
use crate::profile::meaning::Meaning;
use crate::profile::names::Names;
use crate::profile::object::{Access, Effect, Only, Role};
use crate::wire::canopen::emcy::ByteOrder;

/// UDS of a device.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UdsSpec {
    /// Byte order of identifiers and numbers; ISO 14229-1 sends the high byte first.
    pub identifier_order: Option<OrderName>,
    /// Identifiers of its own.
    pub identifier: Vec<Spanned<UdsIdentifier>>,
    /// Negative responses with a meaning of their own.
    pub nrc: Vec<UdsNrc>,
    /// Assumption or defect of the manual.
    pub note: String,
    /// Section.
    pub source: String,
}

/// A data or routine identifier.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UdsIdentifier {
    /// The identifier.
    pub id: u16,
    /// Name.
    pub name: String,
    /// Who may do what.
    #[serde(default)]
    pub access: Option<Access>,
    /// Type; bytes where it is not said.
    #[serde(default, rename = "type")]
    pub data_type: Option<DataType>,
    /// Unit.
    #[serde(default)]
    pub unit: String,
    /// Permitted raw values.
    #[serde(default)]
    pub range: Option<[i64; 2]>,
    /// As delivered.
    #[serde(default)]
    pub default: Option<i64>,
    /// Enumeration.
    #[serde(default)]
    pub values: Option<Names>,
    /// What it is for the device.
    #[serde(default)]
    pub role: Option<Role>,
    /// When a write acts.
    #[serde(default)]
    pub effect: Effect,
    /// Variants it belongs to.
    #[serde(default)]
    pub only: Only,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section.
    #[serde(default)]
    pub source: String,
}

/// A negative response code with a meaning of the device's own.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UdsNrc {
    /// The code.
    pub code: u8,
    /// Meaning.
    pub text: String,
    /// Only for these services, if any are named.
    #[serde(default)]
    pub services: Vec<u8>,
    /// Only for these identifiers, if any are named.
    #[serde(default)]
    pub identifiers: Vec<u16>,
    /// Variants it belongs to.
    #[serde(default)]
    pub only: Only,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section.
    #[serde(default)]
    pub source: String,
}

impl UdsSpec {
    /// Byte order of identifiers and numbers.
    pub fn order(&self) -> ByteOrder {
        self.identifier_order.map_or(ByteOrder::MsbFirst, OrderName::order)
    }

    /// An identifier of its own.
    pub fn identifier(&self, id: u16) -> Option<&UdsIdentifier> {
        self.identifier.iter().map(Spanned::get_ref).find(|entry| entry.id == id)
    }

    /// Its own entry of a negative response; one for the service or identifier goes before one for all.
    pub fn nrc(&self, code: u8, service: u8, identifier: Option<u16>) -> Option<&UdsNrc> {
        let fits = |entry: &&UdsNrc| {
            entry.code == code
                && (entry.services.is_empty() || entry.services.contains(&service))
                && (entry.identifiers.is_empty()
                    || identifier.is_some_and(|identifier| entry.identifiers.contains(&identifier)))
        };
        let narrow = |entry: &&UdsNrc| {
            usize::from(!entry.services.is_empty()) + 2 * usize::from(!entry.identifiers.is_empty())
        };
        self.nrc.iter().rev().filter(fits).max_by_key(narrow)
    }

    /// Whether the device says anything of UDS.
    pub fn is_empty(&self) -> bool {
        self.identifier_order.is_none() && self.identifier.is_empty() && self.nrc.is_empty()
    }

    /// What one variant has of it.
    pub(super) fn of_variant(&self, variant: &str) -> Self {
        let mut own = self.clone();
        own.identifier.retain(|entry| entry.get_ref().only.allows(variant));
        own.nrc.retain(|entry| entry.only.allows(variant));
        own
    }
}

impl UdsIdentifier {
    /// How its value is read.
    pub fn meaning(&self) -> Meaning {
        Meaning {
            name: self.name.clone(),
            data_type: self.data_type,
            unit: self.unit.clone(),
            range: self.range,
            values: self.values.clone().map(Arc::new),
            role: self.role,
            ..Meaning::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        identifier_order = "lsb-first"
        [[identifier]]
        id = 0x1001
        name = "node-ID"
        type = "UNSIGNED8"
        range = [1, 127]
        role = "node-id"
        effect = "reset-node"
        [[nrc]]
        code = 0x31
        text = "unknown identifier"
        [[nrc]]
        code = 0x31
        text = "outside 1 to 127"
        services = [0x2E]
        identifiers = [0x1001]
        "#;

    #[test]
    fn an_identifier_has_a_meaning() {
        let spec: UdsSpec = toml::from_str(TEXT).unwrap();
        assert_eq!(spec.order(), ByteOrder::LsbFirst);
        assert_eq!(UdsSpec::default().order(), ByteOrder::MsbFirst);
        let meaning = spec.identifier(0x1001).unwrap().meaning();
        assert_eq!((meaning.name.as_str(), meaning.role), ("node-ID", Some(Role::NodeId)));
        assert!(meaning.is_outside(&meaning.decode(&[0])) && !meaning.is_outside(&meaning.decode(&[127])));
        assert!(spec.identifier(0x0110).is_none());
    }

    #[test]
    fn the_narrowest_text_of_a_code_is_told() {
        let spec: UdsSpec = toml::from_str(TEXT).unwrap();
        let text = |service, identifier| spec.nrc(0x31, service, identifier).map(|nrc| nrc.text.as_str());
        assert_eq!(text(0x2E, Some(0x1001)), Some("outside 1 to 127"));
        assert_eq!(text(0x22, Some(0x1001)), Some("unknown identifier"));
        assert_eq!(text(0x2E, None), Some("unknown identifier"));
        assert!(spec.nrc(0x72, 0x2E, None).is_none());
    }
}
