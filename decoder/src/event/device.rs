//! Events of a device: what its manual makes of its messages.

use std::sync::Arc;

use crate::profile::{Carrier, Effect};
use crate::wire::canopen::ObjectAddress;

/// A node that was recognised.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct NodeIdentified {
    /// Profile and variant.
    pub device: String,
    /// What output calls it.
    pub title: String,
    /// What told it.
    pub by: &'static str,
}

/// Why a device's state changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DeviceCause {
    /// The control word commands it.
    ControlWord,
    /// An NMT command.
    NmtCommand,
    /// An EMCY: the error behind it.
    Emcy,
    /// A trouble code of DM1: the fault behind it.
    Dtc,
    /// Life guarding expired.
    LifeGuard,
    /// The node started.
    BootUp,
    /// Nothing on the bus explains it: a hardware input, the maker's tool.
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

/// The device reports another state of its machine.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DeviceState {
    /// Machine.
    pub machine: String,
    /// Output of the device, where each has a machine.
    pub channel: Option<u8>,
    /// State before, if it was known.
    pub from: Option<String>,
    /// State now.
    pub to: String,
    /// The new state is a fault.
    pub fault: bool,
    /// Why.
    pub cause: DeviceCause,
    /// Frame of the cause; 0 if there is none.
    pub cause_frame: u64,
    /// Code of the EMCY that is the cause.
    pub emcy: Option<u16>,
    /// Of a fault: what the control word must do to leave it.
    pub leave: Option<String>,
    /// Control word that commands it.
    pub control: Option<u64>,
    /// On the way to the state commanded: states passed, and control words sent.
    pub path: Option<Box<Path>>,
}

/// How a commanded state was reached in several steps.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Path {
    /// States from the first to the present one.
    pub states: Vec<String>,
    /// Frames of the control words.
    pub frames: Vec<u64>,
    /// Nanoseconds from the first control word.
    pub duration: Option<i64>,
}

/// Bits of a control or status word changed.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct BitsChanged {
    /// Object.
    pub object: ObjectAddress,
    /// Its name.
    pub name: String,
    /// Output of the device.
    pub channel: Option<u8>,
    /// Names of bits that are set now; of several bits together name and number.
    pub set: Vec<String>,
    /// Names of bits that are clear now.
    pub cleared: Vec<String>,
    /// The same in words for people.
    pub words: Vec<String>,
}

/// Whether a set point acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effective {
    /// All gates are open.
    Yes,
    /// One is closed.
    No,
    /// The bus does not tell.
    Unknown,
}

impl Effective {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Yes => "yes",
            Self::No => "no",
            Self::Unknown => "unknown",
        }
    }
}

/// A set point changed, or began or ceased to act.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SetPoint {
    /// Object.
    pub object: ObjectAddress,
    /// Its name.
    pub signal: String,
    /// The word for it in lines.
    pub short: Option<String>,
    /// Output of the device.
    pub channel: Option<u8>,
    /// PDO or message it came by.
    pub carrier: Carrier,
    /// Value before, as people write it.
    pub from: Option<Quantity>,
    /// Value now.
    pub to: Quantity,
    /// Unit.
    pub unit: String,
    /// Rests on an assumption.
    pub assumed: bool,
    /// Whether it acts.
    pub effective: Effective,
    /// Names of the gates that are closed, or of those nothing is known of.
    pub gates: Vec<String>,
    /// Nanoseconds until the SYNC that makes it act.
    pub sync_after: Option<i64>,
}

/// A value with its text.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// Scaled number; `None` for special values.
    pub number: Option<f64>,
    /// As people write it.
    pub text: String,
}

/// A mode of operation changed, or became known.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ModeChange {
    /// Object.
    pub object: ObjectAddress,
    /// Its name.
    pub name: String,
    /// Output of the device.
    pub channel: Option<u8>,
    /// Mode before.
    pub from: Option<String>,
    /// Mode now.
    pub to: String,
    /// What it changes: PDO words and their units.
    pub consequence: String,
}

/// A procedure started, went a step on, or ended.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ProcedureEvent {
    /// Name.
    pub procedure: String,
    /// KIND of its line.
    pub word: Option<String>,
    /// `started`, the name of a step, `finished`.
    pub step: String,
    /// How it stands.
    pub status: &'static str,
    /// Nanoseconds since it started.
    pub duration: Option<i64>,
    /// Nominal duration in seconds.
    pub nominal: Option<f64>,
    /// What the device says of it.
    pub text: String,
    /// Object that started it.
    pub object: Option<ObjectAddress>,
    /// Set points of the bus are ignored meanwhile.
    pub takes_over: bool,
}

/// Two sources say different things of one object.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Conflict {
    /// Object.
    pub object: ObjectAddress,
    /// Its name.
    pub name: String,
    /// Who says what: source and bytes.
    pub sources: Vec<(Arc<str>, Vec<u8>)>,
    /// What it comes to.
    pub text: String,
}

/// A change in the object store.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ObjectChange {
    /// Object.
    pub object: ObjectAddress,
    /// Bytes known before.
    pub from: Option<Vec<u8>>,
    /// Bytes now; `None` if they fell back to something unknown.
    pub to: Option<Vec<u8>>,
    /// `download` or `upload`; `reset`: the device fell back to what it keeps; `restart`: a value that
    /// waited for it took effect.
    pub origin: &'static str,
    /// When it acts, if known.
    pub effect: Option<Effect>,
    /// Whether it stays: `yes`, `no`, `needs-save`, `unknown`.
    pub persists: Option<&'static str>,
}
