//! Events of findings.

use std::sync::Arc;

use crate::profile::device::Severity;
use crate::wire::canopen::ObjectAddress;

/// A finding opened or closed.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FindingNews {
    /// Number within the capture; equal for opening and closing.
    pub id: u64,
    /// Name of the rule.
    pub rule: Arc<str>,
    /// Severity, after reductions for the quality of the capture and a presumed protocol.
    pub severity: Severity,
    /// KIND column in text output.
    pub word: &'static str,
    /// Text of the finding.
    pub text: String,
    /// Object as subject.
    pub object: Option<ObjectAddress>,
    /// J1939 PGN as subject.
    pub pgn: Option<u32>,
    /// Other subject: a code, an identifier, a name.
    pub about: Option<String>,
    /// Number of the finding that is the cause.
    pub cause: Option<u64>,
    /// First frame of the fact that is the cause, such as a command or a write; `None` for other causes.
    pub cause_frame: Option<u64>,
    /// Number of the finding that is printed for this one: the same fault with another subject.
    pub member_of: Option<u64>,
    /// Reason for a lower severity than that of the rule.
    pub downgraded: Option<String>,
    /// Occurrences since it opened.
    pub count: u64,
    /// Closed by the end of the capture; the condition may still hold.
    pub is_at_end: bool,
    /// Section of the manual, or clause of the standard.
    pub source: Option<Arc<str>>,
    /// `source` is a manual, which text output cites.
    pub is_manual: bool,
}
