//! A device on J1939: its messages and faults.

use serde::Deserialize;

use super::pdo::PdoField;
use crate::profile::formula::formula;
use crate::profile::layout::PdoDirection;
use crate::profile::object::Only;
use crate::wire::j1939::{Pgn, SpnConversion};

/// What holds for the device as a node of J1939.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct J1939Spec {
    /// First and last address it can have.
    pub addresses: Option<[u8; 2]>,
    /// DM1 shows only the most urgent fault: one that leaves may be hidden by another.
    pub highest_only: bool,
    /// Milliseconds between two DM1 while a fault is active; 0 where the manual does not say.
    pub dm1_period: u32,
    /// How an SPN is coded where its conversion method bit is set: version 1, 2 or 3.
    pub spn_conversion: Option<Conversion>,
    /// Faults.
    pub dtc: Vec<TroubleCode>,
    /// Assumption or defect of the manual.
    pub note: String,
    /// Section.
    pub source: String,
}

/// A version of the conversion method, as files write it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "u8")]
pub struct Conversion(pub SpnConversion);

impl TryFrom<u8> for Conversion {
    type Error = &'static str;

    fn try_from(version: u8) -> Result<Self, Self::Error> {
        SpnConversion::try_from(version).map(Self)
    }
}

/// A fault of the device.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TroubleCode {
    /// Suspect parameter, 19 bits.
    pub spn: u32,
    /// Failure mode.
    pub fmi: u8,
    /// What it means.
    pub text: String,
    /// Where the manual sees its source: `external`, `internal`.
    #[serde(default)]
    pub origin: String,
    /// The manual's word for how serious it is.
    #[serde(default)]
    pub severity: String,
    /// 1 is the most urgent, where the device shows only one.
    #[serde(default)]
    pub priority: Option<u8>,
    /// What the device does.
    #[serde(default)]
    pub reaction: String,
    /// How it is left.
    #[serde(default)]
    pub recovery: String,
    /// What to check, likeliest first.
    #[serde(default)]
    pub causes: Vec<String>,
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

/// A message of a device, or equal ones of groups that follow each other.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MessageSpec {
    /// What triggers and lines call it: `AVC`.
    pub name: String,
    /// What output calls it; `{n}` stands for its number.
    #[serde(default)]
    pub title: String,
    /// Its group, or the first one.
    pub pgn: u32,
    /// How many groups.
    #[serde(default = "one")]
    pub count: u16,
    /// Which of them is meant for the device, from 0; all where it is not said.
    #[serde(default)]
    pub number: Option<String>,
    /// Whether the device sends or takes it.
    pub direction: Direction,
    /// Contents, from bit 0 of byte 0.
    #[serde(default)]
    pub fields: Vec<PdoField>,
    /// Milliseconds between two, where the manual says it.
    #[serde(default)]
    pub period: Option<u32>,
    /// Milliseconds within which the next one must come.
    #[serde(default)]
    pub timeout: Option<u32>,
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

const fn one() -> u16 {
    1
}

/// Whether the device sends a message or takes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// It sends it.
    Transmit,
    /// It takes it.
    Receive,
}

impl From<Direction> for PdoDirection {
    fn from(direction: Direction) -> Self {
        match direction {
            Direction::Transmit => Self::Transmit,
            Direction::Receive => Self::Receive,
        }
    }
}

impl MessageSpec {
    /// Number of a group among those of this message.
    pub fn number_of(&self, pgn: Pgn) -> Option<u16> {
        let number = pgn.number().checked_sub(self.pgn)?;
        u16::try_from(number).ok().filter(|number| *number < self.count)
    }

    /// Whether the one of a group concerns the device at an address.
    pub fn concerns(&self, pgn: Pgn, address: u8) -> bool {
        let Some(number) = self.number_of(pgn) else { return false };
        match &self.number {
            None => true,
            Some(text) => formula(text, Some(address)) == Some(u64::from(number)),
        }
    }

    /// What output calls the one of a group.
    pub(crate) fn title_of(&self, pgn: Pgn) -> String {
        let title = if self.title.is_empty() { &self.name } else { &self.title };
        let number = self.number_of(pgn).unwrap_or(0).to_string();
        title.replace("{n}", &number)
    }
}
