//! Texts and node numbers as written in files of the user.

use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;

use super::authored::TextProblem;
use crate::wire::NodeId;

/// A text and its position in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SpannedText {
    /// The text with escapes resolved.
    pub text: String,
    /// Position in bytes, including quotes.
    pub span: Range<usize>,
}

impl From<Spanned<String>> for SpannedText {
    fn from(text: Spanned<String>) -> Self {
        Self { span: text.span(), text: text.into_inner() }
    }
}

/// Node-ID, or J1939 address such as `sa:0x80`.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, expecting = "expected a node-ID, or a J1939 address such as \"sa:0x80\"")]
pub enum NodeNumber {
    /// Node-ID.
    Integer(u8),
    /// Node-ID or address as text.
    Text(String),
}

/// Parses a node-ID or J1939 address.
pub(crate) fn node_id(number: &Spanned<NodeNumber>) -> Result<NodeId, TextProblem> {
    let parsed = match number.get_ref() {
        NodeNumber::Integer(id) => id.to_string().parse(),
        NodeNumber::Text(text) => text.parse(),
    };
    parsed.map_err(|message: &str| (number.span(), message.to_owned()))
}
