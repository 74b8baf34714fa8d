//! Texts and numbers as the file writes them, and what is wrong with them.

use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;

use crate::frame::CanId;
use crate::wire::NodeId;

/// What is wrong, and where in the text.
pub(super) type Wrong = (Range<usize>, String);

/// A text and its place in the file, quotes included.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// What it says, escapes resolved.
    pub text: String,
    /// Where it stands.
    pub span: Range<usize>,
}

impl From<Spanned<String>> for Written {
    fn from(text: Spanned<String>) -> Self {
        Self { span: text.span(), text: text.into_inner() }
    }
}

#[derive(Deserialize)]
#[serde(untagged)]
pub(super) enum Number {
    Integer(i64),
    Text(String),
}

impl Number {
    /// The identifier it is, of 29 bits where it has more than eleven, eight digits or `extended`.
    pub(super) fn can_id(&self, extended: bool) -> Option<CanId> {
        let (number, extended) = match self {
            Self::Integer(number) => (u32::try_from(*number).ok()?, extended || *number > 0x7FF),
            Self::Text(text) => {
                let hex = matches!(text.len(), 3 | 8) && text.bytes().all(|byte| byte.is_ascii_hexdigit());
                let number = hex.then(|| u32::from_str_radix(text, 16).ok()).flatten()?;
                (number, extended || text.len() == 8)
            }
        };
        match (u16::try_from(number), extended) {
            (Ok(id), false) if id <= 0x7FF => Some(CanId::Standard(id)),
            (_, true) if number <= 0x1FFF_FFFF => Some(CanId::Extended(number)),
            _ => None,
        }
    }
}

/// What is said of a number that is no identifier.
pub(super) const NO_IDENTIFIER: &str =
    "an identifier has 11 or 29 bits: 0x1A0, or \"1A0\" and \"000001A0\" as candump prints them";

#[derive(Deserialize)]
#[serde(untagged, expecting = "a node-ID, or a J1939 address as \"sa:0x80\"")]
pub(super) enum NodeNumber {
    Integer(u8),
    Text(String),
}

/// The node that is meant.
pub(super) fn node_id(number: &Spanned<NodeNumber>) -> Result<NodeId, Wrong> {
    let parsed = match number.get_ref() {
        NodeNumber::Integer(id) => id.to_string().parse(),
        NodeNumber::Text(text) => text.parse(),
    };
    parsed.map_err(|message: &str| (number.span(), message.to_owned()))
}
