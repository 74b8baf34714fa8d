//! News of findings: a rule judged something to be wrong.

use std::sync::Arc;

use crate::profile::device::Severity;
use crate::wire::canopen::ObjectAddress;

/// A finding opened, or closed.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FindingNews {
    /// The same in its opening and closing, within a capture.
    pub id: u64,
    /// Name of the rule.
    pub rule: Arc<str>,
    /// How bad, after what quality and presumption take from it.
    pub severity: Severity,
    /// KIND of its line in text.
    pub word: &'static str,
    /// What is wrong.
    pub text: String,
    /// Object it is about.
    pub object: Option<ObjectAddress>,
    /// Group of J1939 it is about.
    pub pgn: Option<u32>,
    /// What else it is about: a code, an identifier, a name.
    pub about: Option<String>,
    /// Finding that explains it.
    pub cause: Option<u64>,
    /// Why it is less severe than its rule says.
    pub downgraded: Option<String>,
    /// Times seen since it opened.
    pub count: u64,
    /// It closes because the capture ends: nothing tells that it is over.
    pub is_at_end: bool,
    /// Section of the manual, or clause, that says so.
    pub source: Option<Arc<str>>,
}
