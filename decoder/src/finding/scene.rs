//! State of a node and its bus when a finding began: evidence for and against causes.

use strum::IntoStaticStr;

use crate::event::MonitoringMethod;
use crate::profile::PdoName;
use crate::wire::canopen::NmtState;

/// State of a node and its bus when a finding began.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct FindingScene {
    /// Confirmed NMT state of the node.
    pub nmt: Option<NmtState>,
    /// Sign of life of the node that arrived within its time.
    pub alive: Option<SceneLifeSign>,
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
pub struct SceneLifeSign {
    /// Type of the sign of life.
    pub by: MonitoringMethod,
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

/// Source of a proposed step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum AdviceSource {
    /// Causes of an EMCY code in the device manual.
    Emcy,
    /// Causes of a trouble code in the device manual.
    Dtc,
    /// A closed gate of a set point.
    Gate,
    /// The way out of a fault state in the device manual.
    State,
    /// The code tables of the standards.
    Code,
    /// The rule of the finding.
    Rule,
    /// A hint that applies to any device.
    General,
}

impl AdviceSource {
    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// One proposed step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advice {
    /// Instruction for the user, without a full stop in a story.
    pub text: String,
    /// Section of the device manual; empty if not from the manual.
    pub section: String,
    /// Source of the instruction.
    pub by: AdviceSource,
}
