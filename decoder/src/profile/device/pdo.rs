//! PDOs of a device.

use serde::Deserialize;
use strum::{IntoStaticStr, VariantArray};

use crate::profile::layout::PdoName;
use crate::profile::object::{ObjectCondition, VariantFilter};
use crate::profile::reference::ObjectReference;

/// PDO of a device with its contents.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PdoSpec {
    /// Name, such as TPDO1.
    pub pdo: PdoName,
    /// Source of the mapping.
    pub mapping: MappingSource,
    /// Name of the trigger that makes the device send it; a check reports unknown ones.
    #[serde(default)]
    pub trigger: Option<String>,
    /// Time at which an RPDO takes effect.
    #[serde(default)]
    pub effect: PdoEffect,
    /// Contents, from bit 0 of byte 0.
    #[serde(default)]
    pub fields: Vec<PdoField>,
    /// Object value under which this entry applies.
    #[serde(default)]
    pub when: Option<ObjectCondition>,
    /// Identifier, if different from the predefined connection set.
    #[serde(default)]
    pub cob_id: Option<String>,
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

impl PdoSpec {
    /// Trigger that makes the device send it; `None` if it is not stated or unknown.
    pub fn trigger(&self) -> Option<PdoTrigger> {
        PdoTrigger::VARIANTS.iter().copied().find(|known| Some(known.name()) == self.trigger.as_deref())
    }
}

/// Trigger that makes a device send a PDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum PdoTrigger {
    /// SYNC.
    Sync,
    /// A change of the device.
    Event,
    /// An RPDO.
    Rpdo,
    /// A period.
    Timer,
    /// A remote request.
    Request,
}

impl PdoTrigger {
    /// The name in profiles.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Source of a PDO mapping.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MappingSource {
    /// Fixed in the device.
    Fixed,
    /// Factory default; replaced by a mapping seen on the bus.
    Default,
    /// Configured in the manufacturer's tool; known from the bus file only.
    BusFile,
}

/// Time at which an RPDO takes effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PdoEffect {
    /// According to the transmission type (14xx:02); immediately if unknown.
    #[default]
    ByType,
    /// At the next SYNC with the identifier configured in the node.
    AtSync,
    /// Immediately.
    AtOnce,
}

/// Field of a PDO or message.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PdoField {
    /// Mapped object; `None` for a gap.
    #[serde(default)]
    pub object: Option<ObjectReference>,
    /// Length in bits.
    pub bits: u16,
    /// Fixed content of a gap.
    #[serde(default)]
    pub constant: Option<u64>,
}
