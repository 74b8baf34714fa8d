//! State of a node and its bus when a finding began: evidence for and against causes.

use crate::profile::PdoName;
use crate::wire::canopen::NmtState;

/// State of a node and its bus when a finding began.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct Scene {
    /// Confirmed NMT state of the node.
    pub nmt: Option<NmtState>,
    /// Sign of life of the node that arrived within its time.
    pub alive: Option<Alive>,
    /// Periodic commands to the node.
    pub commands: Option<CommandStream>,
    /// What the profile, code tables and closed gates propose, most likely cause first.
    pub advice: Vec<Advice>,
    /// Conditions of set points that no capture shows, such as a hardware enable.
    pub invisible: Vec<String>,
    /// Whether a profile is assigned to the node.
    pub has_profile: bool,
    /// Number of error frames for a disturbed frame so far.
    pub error_frames: u64,
    /// Number of such error frames in the last complete second.
    pub recent_error_frames: u64,
}

/// Periodic sign of life of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Alive {
    /// `heartbeat` or `guarding response`.
    pub by: &'static str,
    /// Configured interval in ns.
    pub expected: i64,
    /// Time since the last one, in ns.
    pub age: i64,
}

/// Periodic commands to a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CommandStream {
    /// The RPDO.
    pub pdo: PdoName,
    /// Usual interval in ns.
    pub period: i64,
    /// Time since the last one, in ns.
    pub age: i64,
}

/// One proposed step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advice {
    /// Instruction for the user, without a full stop in a story.
    pub text: String,
    /// Section of the device manual; empty if not from the manual.
    pub section: String,
    /// Origin: `emcy`, `dtc`, `gate`, `state`, `code`, `rule`, `general`.
    pub by: &'static str,
}
