//! Samples: what proves a profile.

use std::collections::BTreeMap;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use toml::Spanned;

use crate::profile::layout::PdoName;
use crate::profile::object::{Given, Only};
use crate::wire::NodeId;

/// Frames, and what the device means by the last of them.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sample {
    /// What it shows.
    #[serde(default)]
    pub about: String,
    /// Section.
    #[serde(default)]
    pub source: String,
    /// The node: `32`, `"sa:0x80"`.
    #[serde(default = "first", deserialize_with = "node")]
    pub node: NodeId,
    /// Variants it holds for.
    #[serde(default)]
    pub only: Only,
    /// Raw values known before, by object.
    #[serde(default)]
    pub given: BTreeMap<String, Given>,
    /// What fills areas of the maker's tool, as the bus file tells: `tx_area = ["2F10/4"]`.
    #[serde(default)]
    pub areas: BTreeMap<String, Vec<String>>,
    /// Frames in candump's notation, 10 ms apart.
    pub frames: Vec<String>,
    /// The last frame is this PDO.
    #[serde(default)]
    pub pdo: Option<PdoName>,
    /// The last frame is this message of J1939, by its name in the profile.
    #[serde(default)]
    pub message: Option<String>,
    /// The last frame reports this fault, as "298985/19": SPN and FMI.
    #[serde(default)]
    pub dtc: Option<String>,
    /// Scaled values of the PDO or message by object.
    #[serde(default)]
    pub signals: BTreeMap<String, Spanned<f64>>,
    /// Its names of values and bits by object.
    #[serde(default)]
    pub texts: BTreeMap<String, String>,
    /// The last frame is an EMCY with this code.
    #[serde(default)]
    pub emcy: Option<u16>,
    /// The last frame ends an SDO transfer of this object.
    #[serde(default)]
    pub object: Option<String>,
    /// Its scaled value.
    #[serde(default)]
    pub value: Option<Spanned<f64>>,
    /// Its unit.
    #[serde(default)]
    pub unit: Option<String>,
    /// The last frame is an SDO abort with this code.
    #[serde(default)]
    pub abort: Option<u32>,
    /// The last frame answers a UDS request for this identifier.
    #[serde(default)]
    pub uds: Option<u16>,
    /// With this negative response code.
    #[serde(default)]
    pub nrc: Option<u8>,
    /// Text of the EMCY, of the fault, of the abort as the device means it, or of the object's value.
    #[serde(default)]
    pub text: Option<String>,
    /// The state machine is in this state.
    #[serde(default)]
    pub state: Option<String>,
    /// The last frame reports it, for this cause.
    #[serde(default)]
    pub cause: Option<String>,
    /// Of this channel.
    #[serde(default)]
    pub channel: Option<u8>,
    /// The last frame makes an event of this procedure.
    #[serde(default)]
    pub procedure: Option<String>,
    /// With this status, or this step.
    #[serde(default)]
    pub status: Option<String>,
    /// The set point of the last frame is closed by this gate.
    #[serde(default)]
    pub gate: Option<String>,
}

const fn first() -> NodeId {
    NodeId::Canopen(1)
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a node-ID, or a J1939 address as \"sa:0x80\"")]
enum Number {
    Id(u8),
    Text(String),
}

fn node<'de, D: Deserializer<'de>>(deserializer: D) -> Result<NodeId, D::Error> {
    match Number::deserialize(deserializer)? {
        Number::Id(id) => id.to_string().parse(),
        Number::Text(text) => text.parse(),
    }
    .map_err(D::Error::custom)
}
