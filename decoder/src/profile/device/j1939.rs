//! J1939 messages and faults of a device.

use serde::Deserialize;

use super::pdo::PdoField;
use crate::profile::formula::evaluate_formula;
use crate::profile::layout::PdoDirection;
use crate::profile::object::VariantFilter;
use crate::wire::j1939::{Pgn, SpnConversion};

/// Properties of the device as a J1939 node.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct J1939Spec {
    /// First and last address that it can claim.
    pub addresses: Option<[u8; 2]>,
    /// Whether DM1 contains only the most urgent fault, which can hide others.
    pub highest_only: bool,
    /// Period of DM1 while a fault is active, in ms; 0 if the manual does not state it.
    pub dm1_period: u32,
    /// SPN conversion method (version 1, 2 or 3) if the conversion method bit is set.
    pub spn_conversion: Option<ConversionMethod>,
    /// Diagnostic trouble codes of the device.
    pub dtc: Vec<DeviceTroubleCode>,
    /// Assumption or defect of the manual.
    pub note: String,
    /// Section of the manual.
    pub source: String,
}

/// SPN conversion method as written in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "u8")]
pub struct ConversionMethod(pub SpnConversion);

impl TryFrom<u8> for ConversionMethod {
    type Error = &'static str;

    fn try_from(version: u8) -> Result<Self, Self::Error> {
        SpnConversion::try_from(version).map(Self)
    }
}

/// Diagnostic trouble code of a device.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceTroubleCode {
    /// Suspect parameter number, 19 bits.
    pub spn: u32,
    /// Failure mode identifier.
    pub fmi: u8,
    /// Meaning in the manual.
    pub text: String,
    /// Origin of the fault in the manual: `external`, `internal`.
    #[serde(default)]
    pub origin: String,
    /// Severity in the words of the manual.
    #[serde(default)]
    pub severity: String,
    /// Priority if the device shows only one fault; 1 is the most urgent.
    #[serde(default)]
    pub priority: Option<u8>,
    /// Reaction of the device.
    #[serde(default)]
    pub reaction: String,
    /// Condition to leave the fault.
    #[serde(default)]
    pub recovery: String,
    /// Points to check, most likely first.
    #[serde(default)]
    pub causes: Vec<String>,
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

/// J1939 message of a device, or several equal ones with consecutive PGNs.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MessageSpec {
    /// Short name in triggers and output: `AVC`.
    pub name: String,
    /// Title in output; `{n}` is replaced by the number of the message.
    #[serde(default)]
    pub title: String,
    /// First parameter group number.
    pub pgn: u32,
    /// Number of consecutive parameter groups.
    #[serde(default = "one")]
    pub count: u16,
    /// Formula for the number, from 0, of the message addressed to the device; `None` for all messages.
    #[serde(default)]
    pub number: Option<String>,
    /// Direction, as seen from the device.
    pub direction: MessageDirection,
    /// Contents, from bit 0 of byte 0.
    #[serde(default)]
    pub fields: Vec<PdoField>,
    /// Period in ms, if the manual states it.
    #[serde(default)]
    pub period: Option<u32>,
    /// Timeout in ms until the next message.
    #[serde(default)]
    pub timeout: Option<u32>,
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

const fn one() -> u16 {
    1
}

/// Direction of a message, as seen from the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MessageDirection {
    /// The device sends the message.
    Transmit,
    /// The device receives the message.
    Receive,
}

impl From<MessageDirection> for PdoDirection {
    fn from(direction: MessageDirection) -> Self {
        match direction {
            MessageDirection::Transmit => Self::Transmit,
            MessageDirection::Receive => Self::Receive,
        }
    }
}

impl MessageSpec {
    /// Number of a parameter group within this message, from 0; `None` if it is outside.
    pub fn number_of(&self, pgn: Pgn) -> Option<u16> {
        let number = pgn.number().checked_sub(self.pgn)?;
        u16::try_from(number).ok().filter(|number| *number < self.count)
    }

    /// Whether the message with this PGN is for a device at `address`.
    pub fn is_for(&self, pgn: Pgn, address: u8) -> bool {
        let Some(number) = self.number_of(pgn) else { return false };
        match &self.number {
            None => true,
            Some(text) => evaluate_formula(text, Some(address)) == Some(u64::from(number)),
        }
    }

    /// Title in output of the message with this PGN.
    pub(crate) fn title_of(&self, pgn: Pgn) -> String {
        let title = if self.title.is_empty() { &self.name } else { &self.title };
        let number = self.number_of(pgn).unwrap_or(0).to_string();
        title.replace("{n}", &number)
    }
}
