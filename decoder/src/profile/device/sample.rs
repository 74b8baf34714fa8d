//! Samples: test cases of a profile.

use std::collections::BTreeMap;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use toml::Spanned;

use crate::profile::layout::PdoName;
use crate::profile::object::{DefaultValue, VariantFilter};
use crate::wire::NodeId;

/// Frames, and the expected result of the last one.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileSample {
    /// Purpose of the sample.
    #[serde(default)]
    pub about: String,
    /// Section of the manual.
    #[serde(default)]
    pub source: String,
    /// Node of the device: `32`, `"sa:0x80"`.
    #[serde(default = "first_node", deserialize_with = "deserialize_node")]
    pub node: NodeId,
    /// Variants it applies to; all if empty.
    #[serde(default)]
    pub only: VariantFilter,
    /// Known raw values before the first frame, by object.
    #[serde(default)]
    pub given: BTreeMap<String, DefaultValue>,
    /// Areas of the manufacturer's tool, as in the bus file: `tx_area = ["2F10/4"]`.
    #[serde(default)]
    pub areas: BTreeMap<String, Vec<String>>,
    /// Frames in candump's notation, 10 ms apart.
    pub frames: Vec<String>,
    /// The last frame is this PDO.
    #[serde(default)]
    pub pdo: Option<PdoName>,
    /// The last frame is this J1939 message, by its name in the profile.
    #[serde(default)]
    pub message: Option<String>,
    /// The last frame reports this fault, such as "298985/19": SPN and FMI.
    #[serde(default)]
    pub dtc: Option<String>,
    /// Expected scaled values in the PDO or message, by object.
    #[serde(default)]
    pub signals: BTreeMap<String, Spanned<f64>>,
    /// Expected names of values and bits, by object.
    #[serde(default)]
    pub texts: BTreeMap<String, String>,
    /// The last frame is an EMCY with this code.
    #[serde(default)]
    pub emcy: Option<u16>,
    /// The last frame ends an SDO transfer of this object.
    #[serde(default)]
    pub object: Option<String>,
    /// Expected scaled value of the object.
    #[serde(default)]
    pub value: Option<Spanned<f64>>,
    /// Expected unit of the value.
    #[serde(default)]
    pub unit: Option<String>,
    /// The last frame is an SDO abort with this code.
    #[serde(default)]
    pub abort: Option<u32>,
    /// The last frame completes the response to a UDS request for this identifier.
    #[serde(default)]
    pub uds: Option<u16>,
    /// Expected negative response code.
    #[serde(default)]
    pub nrc: Option<u8>,
    /// Expected text of the EMCY, fault, abort or value.
    #[serde(default)]
    pub text: Option<String>,
    /// Expected state of the state machine.
    #[serde(default)]
    pub state: Option<String>,
    /// Expected cause of the state, reported by the last frame.
    #[serde(default)]
    pub cause: Option<String>,
    /// Channel of the state machine.
    #[serde(default)]
    pub channel: Option<u8>,
    /// The last frame causes an event of this procedure.
    #[serde(default)]
    pub procedure: Option<String>,
    /// Expected status or step of the procedure.
    #[serde(default)]
    pub status: Option<String>,
    /// This gate closes the set point in the last frame.
    #[serde(default)]
    pub gate: Option<String>,
}

const fn first_node() -> NodeId {
    NodeId::Canopen(1)
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a node-ID, or a J1939 address such as \"sa:0x80\"")]
enum SampleNumber {
    Id(u8),
    Text(String),
}

fn deserialize_node<'de, D: Deserializer<'de>>(deserializer: D) -> Result<NodeId, D::Error> {
    match SampleNumber::deserialize(deserializer)? {
        SampleNumber::Id(id) => id.to_string().parse(),
        SampleNumber::Text(text) => text.parse(),
    }
    .map_err(D::Error::custom)
}
