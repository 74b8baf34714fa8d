//! UDS properties of a device: its own identifiers and negative responses.

use std::sync::Arc;

use serde::Deserialize;
use toml::Spanned;

use super::network::OrderName;
use crate::profile::data_type::DataType;
use crate::profile::meaning::ObjectMeaning;
use crate::profile::names::ValueNames;
use crate::profile::object::{ObjectRole, SdoAccess, VariantFilter, WriteEffect};
use crate::wire::canopen::emcy::EmcyByteOrder;

/// UDS properties of a device.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UdsSpec {
    /// Byte order of identifiers and numbers; high byte first (ISO 14229-1) if `None`.
    pub identifier_order: Option<OrderName>,
    /// Device-specific data and routine identifiers.
    pub identifier: Vec<Spanned<UdsIdentifier>>,
    /// Device-specific negative responses.
    pub nrc: Vec<UdsNrc>,
    /// Assumption or defect of the manual.
    pub note: String,
    /// Section of the manual.
    pub source: String,
}

/// A data or routine identifier.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UdsIdentifier {
    /// Identifier number.
    pub id: u16,
    /// Name in output.
    pub name: String,
    /// Access rights.
    #[serde(default)]
    pub access: Option<SdoAccess>,
    /// Data type; raw bytes if `None`.
    #[serde(default, rename = "type")]
    pub data_type: Option<DataType>,
    /// Unit of the value.
    #[serde(default)]
    pub unit: String,
    /// Permitted raw values.
    #[serde(default)]
    pub range: Option<[i64; 2]>,
    /// Factory default.
    #[serde(default)]
    pub default: Option<i64>,
    /// Names of values.
    #[serde(default)]
    pub values: Option<ValueNames>,
    /// Function of the value in the device.
    #[serde(default)]
    pub role: Option<ObjectRole>,
    /// Time at which a write takes effect.
    #[serde(default)]
    pub effect: WriteEffect,
    /// Variants it applies to; all if empty.
    #[serde(default)]
    pub only: VariantFilter,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section of the manual.
    #[serde(default)]
    pub source: String,
}

/// Device-specific meaning of a negative response code.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UdsNrc {
    /// Negative response code.
    pub code: u8,
    /// Meaning in the manual.
    pub text: String,
    /// Services it applies to; all if empty.
    #[serde(default)]
    pub services: Vec<u8>,
    /// Identifiers it applies to; all if empty.
    #[serde(default)]
    pub identifiers: Vec<u16>,
    /// Variants it applies to; all if empty.
    #[serde(default)]
    pub only: VariantFilter,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section of the manual.
    #[serde(default)]
    pub source: String,
}

impl UdsSpec {
    /// Byte order of identifiers and numbers.
    pub fn order(&self) -> EmcyByteOrder {
        self.identifier_order.map_or(EmcyByteOrder::MsbFirst, OrderName::order)
    }

    /// Device-specific identifier.
    pub fn identifier(&self, id: u16) -> Option<&UdsIdentifier> {
        self.identifier.iter().map(Spanned::get_ref).find(|entry| entry.id == id)
    }

    /// Device-specific negative response; the most specific entry takes precedence.
    pub fn response_code_entry(&self, code: u8, service: u8, identifier: Option<u16>) -> Option<&UdsNrc> {
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

    /// Whether the profile contains no UDS properties.
    pub fn is_empty(&self) -> bool {
        self.identifier_order.is_none() && self.identifier.is_empty() && self.nrc.is_empty()
    }

    /// UDS properties of one variant.
    pub(super) fn of_variant(&self, variant: &str) -> Self {
        let mut own = self.clone();
        own.identifier.retain(|entry| entry.get_ref().only.allows_variant(variant));
        own.nrc.retain(|entry| entry.only.allows_variant(variant));
        own
    }
}

impl UdsIdentifier {
    /// Decoding of the identifier's value.
    pub fn meaning(&self) -> ObjectMeaning {
        ObjectMeaning {
            name: self.name.clone(),
            data_type: self.data_type,
            unit: self.unit.clone(),
            range: self.range,
            values: self.values.clone().map(Arc::new),
            role: self.role,
            ..ObjectMeaning::default()
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
        assert_eq!(spec.order(), EmcyByteOrder::LsbFirst);
        assert_eq!(UdsSpec::default().order(), EmcyByteOrder::MsbFirst);
        let meaning = spec.identifier(0x1001).unwrap().meaning();
        assert_eq!((meaning.name.as_str(), meaning.role), ("node-ID", Some(ObjectRole::NodeId)));
        assert!(meaning.is_outside(&meaning.decode(&[0])) && !meaning.is_outside(&meaning.decode(&[127])));
        assert!(spec.identifier(0x0110).is_none());
    }

    #[test]
    fn the_most_specific_text_of_a_code_is_used() {
        let spec: UdsSpec = toml::from_str(TEXT).unwrap();
        let text = |service, identifier| {
            spec.response_code_entry(0x31, service, identifier).map(|nrc| nrc.text.as_str())
        };
        assert_eq!(text(0x2E, Some(0x1001)), Some("outside 1 to 127"));
        assert_eq!(text(0x22, Some(0x1001)), Some("unknown identifier"));
        assert_eq!(text(0x2E, None), Some("unknown identifier"));
        assert!(spec.response_code_entry(0x72, 0x2E, None).is_none());
    }
}
