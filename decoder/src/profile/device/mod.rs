//! A device: everything in its manual that defines the meaning of its messages.
//!
//! `profiles/README.md` describes the format with examples.

mod condition;
mod evaluate;
mod expectation;
mod file;
mod gate;
mod import;
mod j1939;
mod machine;
mod network;
mod pdo;
mod procedure;
mod rule;
mod sample;
mod uds;
mod words;

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Deserialize;

pub use condition::{
    DeviceCondition, DeviceConditions, ExpectedValue, LssTrigger, MessageTrigger, ProfileTrigger,
    ProfileTriggers, SetTrigger,
};
pub use evaluate::GateStatus;
pub(crate) use evaluate::{
    DeviceFacts, LssEvent, SYNC_AGE, TriggerEvent, UpdateSource, ValueUpdate, evaluate_all,
};
pub use expectation::{ExpectCondition, ExpectEntry};
pub(crate) use expectation::{ExpectTable, check_entries};
pub use file::ProfileFile;
pub use gate::{Gate, GateFallback};
pub use import::DescriptionImport;
pub use j1939::{DeviceTroubleCode, J1939Spec, MessageDirection, MessageSpec};
pub use machine::{
    EmcyCodes, ForcedTransition, ForcingEvent, MaskedWord, StateDefinition, StateMachine, StateTransition,
};
pub use network::{
    AbortText, AtBoot, BootSign, ClearMeaning, DeviceErrorCode, DeviceIdentity, EmcySpec, ErrorCodeOrder,
    GuardingSpec, HeartbeatSpec, HintSign, IdentityChange, Monitoring, MonitoringMethod, NmtName, NmtSpec,
    OrderName, PdoArea, ProfileHint, TextList, VendorField,
};
pub use pdo::{MappingSource, PdoEffect, PdoField, PdoSpec, PdoTrigger};
pub use procedure::{
    DeviceProcedure, FallbackValue, ProcedureStatus, ProcedureStep, StatusCode, StatusCodes, StatusSpec,
};
pub use rule::{
    CountWindow, DeviceRule, FrameForm, RuleKind, RuleTolerance, RuleWaiver, Severity, VariableWindow,
};
pub use sample::ProfileSample;
pub use uds::{UdsIdentifier, UdsNrc, UdsSpec};

use super::deciding::DecidingObjects;
use super::dictionary::Dictionary;
use super::entry::ObjectEntry;
use super::error_texts::{self, ErrorTexts};
use crate::wire::canopen::ObjectAddress;

/// One of several products in the same manual.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceVariant {
    /// Part after the colon of an assignment.
    pub id: String,
    /// Title in output.
    #[serde(default)]
    pub title: String,
    /// Explanation for the user.
    #[serde(default)]
    pub text: String,
}

/// One variant of a device, including the standards that it extends.
#[derive(Debug, Clone, Default)]
pub struct DeviceProfile {
    /// Profile id, such as `rexroth-sydfec`.
    pub id: String,
    /// Profile id with variant, such as `wandfluh-md2:controller`.
    pub full_id: String,
    /// Id of the variant; `None` if the manual describes only one.
    pub variant: Option<String>,
    /// Title in output.
    pub title: String,
    /// Manufacturer.
    pub vendor: String,
    /// Kind of device.
    pub description: String,
    /// Title and edition of the manual.
    pub source: String,
    /// Assumption or defect of the manual that concerns the whole device.
    pub note: String,
    /// Ids of the standards it extends.
    pub extends: Vec<String>,
    /// All variants in the profile.
    pub variants: Vec<DeviceVariant>,
    /// Identity data that assign the profile automatically.
    pub identities: Vec<DeviceIdentity>,
    /// Behaviour that suggests the profile.
    pub hints: Vec<ProfileHint>,
    /// Object dictionary.
    pub dictionary: Dictionary,
    /// PDOs with their contents.
    pub pdos: Vec<PdoSpec>,
    /// PDO areas that are configured in the manufacturer's tool.
    pub areas: Vec<PdoArea>,
    /// Properties as a J1939 node.
    pub j1939: J1939Spec,
    /// J1939 messages.
    pub messages: Vec<MessageSpec>,
    /// EMCY behaviour and codes.
    pub emcy: EmcySpec,
    /// Device-specific SDO abort codes.
    pub aborts: Vec<AbortText>,
    /// NMT behaviour.
    pub nmt: NmtSpec,
    /// Guarding and heartbeat.
    pub monitoring: Monitoring,
    /// Effects of a node-ID change.
    pub identity_change: IdentityChange,
    /// UDS identifiers and negative responses.
    pub uds: UdsSpec,
    /// State machines, one per channel.
    pub machines: Vec<StateMachine>,
    /// Gates, one per channel.
    pub gates: Vec<Gate>,
    /// Procedures with start and end.
    pub procedures: Vec<DeviceProcedure>,
    /// Tables `[codes.NAME]`: meanings of status numbers.
    pub codes: BTreeMap<String, StatusCodes>,
    /// Rules derived from the manual.
    pub rules: Vec<DeviceRule>,
    /// Expectations about each node with the profile.
    pub expectations: Vec<ExpectEntry>,
    /// General rules that do not apply to the device.
    pub waivers: Vec<RuleWaiver>,
    /// Objects that decide the meaning of other objects or PDOs.
    pub deciding: DecidingObjects,
    /// Device file that it originates from, completely or in part.
    pub file: Option<DescriptionImport>,
    /// Samples with their position in the profile.
    pub samples: Vec<(Range<usize>, ProfileSample)>,
    /// Positions of PDOs, machines, gates and others in the profile, for checks.
    pub(super) places: TablePositions,
}

/// Positions of tables in the profile, in bytes.
#[derive(Debug, Clone, Default)]
pub(super) struct TablePositions {
    pub(super) pdos: Vec<Range<usize>>,
    pub(super) messages: Vec<Range<usize>>,
    pub(super) procedures: Vec<Range<usize>>,
    pub(super) rules: Vec<Range<usize>>,
    pub(super) gates: Vec<Range<usize>>,
    pub(super) machines: Vec<Range<usize>>,
}

impl DeviceProfile {
    /// Objects that modes, scales and PDO layouts depend on.
    pub(super) fn deciding_objects(&self) -> DecidingObjects {
        let of_pdos = self.pdos.iter().filter_map(|pdo| pdo.when.as_ref());
        DecidingObjects::new(&self.dictionary, of_pdos.map(|when| when.object.object).collect())
    }

    /// Makes the texts of the error codes available to the meanings of objects.
    fn share_error_texts(&mut self) {
        let codes = self.emcy.code.iter().map(|error| (error.code, error.text.clone()));
        self.dictionary.errors = ErrorTexts::from_codes(codes);
    }

    /// Adds the parts of a standard that the device does not define itself.
    fn extend_by(&mut self, standard: &DeviceProfile) {
        self.dictionary.layers.extend(standard.dictionary.layers.iter().cloned());
        if self.machines.is_empty() {
            self.machines.clone_from(&standard.machines);
        }
        let named = |name: &str| self.messages.iter().any(|own| own.name == name);
        let more: Vec<_> = standard.messages.iter().filter(|it| !named(&it.name)).cloned().collect();
        self.messages.extend(more);
        let own: Vec<_> = self.procedures.iter().map(|procedure| procedure.start.clone()).collect();
        let more = standard.procedures.iter().filter(|procedure| !own.contains(&procedure.start));
        self.procedures.extend(more.cloned());
        for (name, codes) in &standard.codes {
            self.codes.entry(name.clone()).or_insert_with(|| codes.clone());
        }
    }

    /// Reference to a section of the manual: `RE 30027-Z/11.06 §9`; to the whole manual if it is empty.
    pub(crate) fn cite_section(&self, section: &str) -> String {
        let manual = if self.source.is_empty() { &self.title } else { &self.source };
        match section.as_bytes().first() {
            None => manual.clone(),
            Some(first) if first.is_ascii_digit() => format!("{manual} §{section}"),
            Some(_) => format!("{manual}, {section}"),
        }
    }

    /// Device-specific entry for an error code.
    pub fn error_entry(&self, code: u16) -> Option<&DeviceErrorCode> {
        self.emcy.code.iter().find(|error| error.code == code)
    }

    /// Meaning of an error code, from the manual, otherwise from CiA 301.
    pub fn error_text(&self, code: u16) -> &str {
        match self.error_entry(code) {
            Some(error) => &error.text,
            None => error_texts::standard_text(code),
        }
    }

    /// Device-specific entry for a trouble code.
    pub fn trouble_code_entry(&self, spn: u32, fmi: u8) -> Option<&DeviceTroubleCode> {
        self.j1939.dtc.iter().find(|dtc| (dtc.spn, dtc.fmi) == (spn, fmi))
    }

    /// Device-specific meaning of an abort code; an entry for this object takes precedence.
    pub fn abort_entry(&self, code: u32, object: Option<ObjectAddress>) -> Option<&AbortText> {
        let matching = || self.aborts.iter().filter(|abort| abort.code == code);
        let special = object.and_then(|object| {
            matching().find(|abort| abort.objects.iter().any(|range| range.covers(object, 0, 0)))
        });
        special.or_else(|| matching().find(|abort| abort.objects.is_empty()))
    }

    /// Number of entries in its own profile, including repeats.
    pub fn object_count(&self) -> usize {
        self.dictionary.own_objects().iter().map(ObjectEntry::entry_count).sum()
    }
}
