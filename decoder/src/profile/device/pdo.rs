//! PDOs of a device.

use serde::Deserialize;

use crate::profile::layout::PdoName;
use crate::profile::object::{Only, When};
use crate::profile::reference::Reference;

/// A PDO of the device.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PdoSpec {
    /// Which.
    pub pdo: PdoName,
    /// What decides its contents.
    pub mapping: Mapping,
    /// What makes the device send it.
    #[serde(default)]
    pub trigger: Option<String>,
    /// When an RPDO acts.
    #[serde(default)]
    pub effect: PdoEffect,
    /// Contents, from bit 0 of byte 0.
    #[serde(default)]
    pub fields: Vec<PdoField>,
    /// Only with this value of an object.
    #[serde(default)]
    pub when: Option<When>,
    /// Identifier, where it is not that of the predefined connection set.
    #[serde(default)]
    pub cob_id: Option<String>,
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

/// What decides a PDO's contents.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mapping {
    /// Never changes.
    Fixed,
    /// As delivered, until the bus shows another.
    Default,
    /// Set by the maker's tool: only the bus file can tell.
    BusFile,
}

/// When an RPDO acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PdoEffect {
    /// As its transmission type says (14xx:02), at once if that is not known.
    #[default]
    ByType,
    /// At the next SYNC with the node's own identifier.
    AtSync,
    /// At once.
    AtOnce,
}

/// A part of a PDO.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PdoField {
    /// Object; none: room without meaning.
    #[serde(default)]
    pub object: Option<Reference>,
    /// Width.
    pub bits: u16,
    /// What room without meaning always holds.
    #[serde(default)]
    pub constant: Option<u64>,
}
