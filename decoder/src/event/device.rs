//! Events of a device, derived from its profile.

use std::sync::Arc;

use strum::IntoStaticStr;

use crate::profile::device::ProcedureStatus;
use crate::profile::{Persistence, ValueCarrier, WriteEffect};
use crate::wire::canopen::ObjectAddress;

/// Source of a device assignment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AssignedBy {
    /// The command line.
    Option,
    /// The bus file.
    BusFile,
    /// An EDS, DCF or XDD file.
    DeviceFile,
    /// Identity that the node sent.
    Identity,
    /// Device type alone, which only indicates the class of device; any other source overrides it.
    DeviceType,
}

impl AssignedBy {
    /// Name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Option => "option",
            Self::BusFile => "bus-file",
            Self::DeviceFile => "device-file",
            Self::Identity => "identity",
            Self::DeviceType => "device-type",
        }
    }
}

/// A node whose device was identified.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct NodeIdentified {
    /// Profile id, with variant.
    pub device: String,
    /// Title of the profile.
    pub title: String,
    /// Source of the identification.
    pub by: AssignedBy,
}

/// Cause of a state change of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DeviceCause {
    /// The control word commanded the change.
    ControlWord,
    /// An NMT command caused it.
    NmtCommand,
    /// An EMCY reports the error that caused it.
    Emcy,
    /// A DM1 trouble code reports the fault that caused it.
    Dtc,
    /// Life guarding expired.
    LifeGuard,
    /// The node booted.
    BootUp,
    /// No message explains it; possible causes are a hardware input or the manufacturer's tool.
    NotOnTheBus,
}

impl DeviceCause {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ControlWord => "control-word",
            Self::NmtCommand => "nmt-command",
            Self::Emcy => "emcy",
            Self::Dtc => "dtc",
            Self::LifeGuard => "life-guard",
            Self::BootUp => "boot-up",
            Self::NotOnTheBus => "not-on-the-bus",
        }
    }
}

/// The device reports a new state of its state machine.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DeviceState {
    /// Name of the state machine.
    pub machine: String,
    /// Output of the device, if each one has a state machine.
    pub channel: Option<u8>,
    /// Previous state, if known.
    pub from: Option<String>,
    /// New state.
    pub to: String,
    /// The new state is a fault.
    pub fault: bool,
    /// Cause of the change.
    pub cause: DeviceCause,
    /// Frame of the cause; 0 if none.
    pub cause_frame: u64,
    /// EMCY code, if an EMCY is the cause.
    pub emcy: Option<u16>,
    /// Control word needed to leave the fault.
    pub leave: Option<String>,
    /// Control word that commanded the state.
    pub control: Option<u64>,
    /// Intermediate states and control words, if the command took several steps.
    pub path: Option<Box<StatePath>>,
}

/// Steps to a commanded state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatePath {
    /// States from the first to the current one.
    pub states: Vec<String>,
    /// Frames of the control words.
    pub frames: Vec<u64>,
    /// Time since the first control word, in ns.
    pub duration: Option<i64>,
}

/// Bits of a control or status word changed.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct BitsChanged {
    /// Address of the control or status word.
    pub object: ObjectAddress,
    /// Name of the object.
    pub name: String,
    /// Output of the device.
    pub channel: Option<u8>,
    /// Names of bits that are now set; a multi-bit field has its name and number.
    pub set: Vec<String>,
    /// Names of bits that are now clear.
    pub cleared: Vec<String>,
    /// All changes as text.
    pub words: Vec<String>,
}

/// Whether the device acts on a set point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EffectiveState {
    /// All gates are open.
    Yes,
    /// At least one gate is closed.
    No,
    /// The state of a gate is not visible on the bus.
    Unknown,
}

impl EffectiveState {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Yes => "yes",
            Self::No => "no",
            Self::Unknown => "unknown",
        }
    }
}

/// A set point changed, or became effective or ineffective.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SetPoint {
    /// Address of the object.
    pub object: ObjectAddress,
    /// Name of the object.
    pub signal: String,
    /// Short name in text output.
    pub short: Option<String>,
    /// Output of the device.
    pub channel: Option<u8>,
    /// PDO or message that carried it.
    pub carrier: ValueCarrier,
    /// Previous value, formatted.
    pub from: Option<Quantity>,
    /// New value, formatted.
    pub to: Quantity,
    /// Unit of the values.
    pub unit: String,
    /// The value depends on an assumed scale or mapping.
    pub assumed: bool,
    /// Whether the device acts on the set point.
    pub effective: EffectiveState,
    /// Names of the closed gates, or of the gates in unknown state.
    pub gates: Vec<String>,
    /// Names of the gates without evidence on the bus, for example a hardware enable.
    pub invisible: Vec<String>,
    /// Time to the SYNC that makes it effective, in ns.
    pub sync_after: Option<i64>,
}

/// A value with its text.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// Scaled number; `None` for special values.
    pub number: Option<f64>,
    /// Formatted value, without unit.
    pub text: String,
}

/// A mode of operation changed, or became known.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ModeChange {
    /// Address of the object.
    pub object: ObjectAddress,
    /// Name of the object.
    pub name: String,
    /// Output of the device.
    pub channel: Option<u8>,
    /// Previous mode, if known.
    pub from: Option<String>,
    /// New mode.
    pub to: String,
    /// Effect on PDOs: words and units that change.
    pub consequence: String,
}

/// Phase that a procedure has reached.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum ProcedurePhase {
    /// Started.
    Started,
    /// A step of the profile, by its name.
    Step(String),
    /// The device accepted the command and reports no end.
    Accepted,
    /// Ended, with any outcome.
    Finished,
    /// The status reports a failure without a start in the capture.
    FailedEarlier,
}

impl ProcedurePhase {
    /// The name used in all output.
    pub fn name(&self) -> &str {
        match self {
            Self::Started => "started",
            Self::Step(name) => name,
            Self::Accepted => "accepted",
            Self::Finished => "finished",
            Self::FailedEarlier => "failed earlier",
        }
    }
}

/// A procedure started, advanced or ended.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ProcedureEvent {
    /// Name of the procedure.
    pub procedure: String,
    /// KIND column in text output.
    pub word: Option<String>,
    /// Phase that it has reached.
    pub phase: ProcedurePhase,
    /// Status of the procedure.
    pub status: ProcedureStatus,
    /// Time since its start, in ns.
    pub duration: Option<i64>,
    /// Nominal duration in seconds.
    pub nominal: Option<f64>,
    /// Status text of the device.
    pub text: String,
    /// Address of the object that started it.
    pub object: Option<ObjectAddress>,
    /// The device ignores set points from the bus while the procedure runs.
    pub takes_over: bool,
}

/// Two sources contradict each other about an object.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct SourceConflict {
    /// Address of the object.
    pub object: ObjectAddress,
    /// Name of the object.
    pub name: String,
    /// Value in bytes by source.
    pub sources: Vec<(Arc<str>, Vec<u8>)>,
    /// Conclusion as text.
    pub text: String,
}

/// Reason for a change in the object store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum ChangeOrigin {
    /// A write, confirmed by the server.
    Download,
    /// A restart: the value fell back to the stored one.
    Reset,
    /// A restart: a value that required one took effect.
    Restart,
}

impl ChangeOrigin {
    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A change in the object store.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ObjectChange {
    /// Address of the object.
    pub object: ObjectAddress,
    /// Previous value in bytes, if known.
    pub from: Option<Vec<u8>>,
    /// New value in bytes; None if it fell back to an unknown value.
    pub to: Option<Vec<u8>>,
    /// Reason for the change.
    pub origin: ChangeOrigin,
    /// Time of effect, if known.
    pub effect: Option<WriteEffect>,
    /// Whether the value survives a restart, if known.
    pub persists: Option<Persistence>,
}
