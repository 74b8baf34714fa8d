//! A device: everything its manual says that decides what its messages mean.
//!
//! `profiles/README.md` shows the format by example.

mod condition;
mod evaluate;
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

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Deserialize;

pub use condition::{
    Condition, Conditions, LssTrigger, MessageTrigger, SetTrigger, Trigger, Triggers, Wanted,
};
pub use evaluate::GateStatus;
pub(crate) use evaluate::{
    DeviceFacts, LssEvent, SYNC_AGE, TriggerEvent, UpdateSource, ValueUpdate, evaluate_all,
};
pub use file::ProfileFile;
pub use gate::{Gate, Otherwise};
pub use import::Import;
pub use j1939::{Direction, J1939Spec, MessageSpec, TroubleCode};
pub use machine::{EmcyCodes, Forced, Machine, Masked, State, Transition};
pub use network::{
    AbortText, Area, AtBoot, Boot, Cleared, EmcySpec, ErrorCode, GuardingSpec, HeartbeatSpec, Hint, Identity,
    IdentityChange, Monitoring, NmtName, NmtSpec, Order, OrderName, Sign, VendorField, Words,
};
pub use pdo::{Mapping, PdoEffect, PdoField, PdoSpec};
pub use procedure::{Fallback, Procedure, ProcedureStatus, StatusCode, StatusCodes, StatusSpec, Step};
pub use rule::{DeviceRule, Per, RuleKind, Severity, Shape, Stretch, Waiver};
pub use sample::Sample;
pub use uds::{UdsIdentifier, UdsNrc, UdsSpec};

use super::dictionary::{Dictionary, Object};
use super::lookup::emcy_codes;
use crate::wire::canopen::ObjectAddress;

/// Products of one manual that differ.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Variant {
    /// Behind the colon of an assignment.
    pub id: String,
    /// What output calls it.
    #[serde(default)]
    pub title: String,
    /// For the reader.
    #[serde(default)]
    pub text: String,
}

/// One device, one variant of it, with the standards it extends.
#[derive(Debug, Clone, Default)]
pub struct Device {
    /// `rexroth-sydfec`.
    pub id: String,
    /// `wandfluh-md2:controller`.
    pub full_id: String,
    /// Variant, if the manual describes several.
    pub variant: Option<String>,
    /// What output calls it.
    pub title: String,
    /// Maker.
    pub vendor: String,
    /// What it is.
    pub description: String,
    /// The document.
    pub source: String,
    /// What holds for the device as a whole: an assumption or a defect of the manual.
    pub note: String,
    /// Ids of the standards it extends.
    pub extends: Vec<String>,
    /// All variants.
    pub variants: Vec<Variant>,
    /// What assigns it.
    pub identities: Vec<Identity>,
    /// What suggests it.
    pub hints: Vec<Hint>,
    /// Objects.
    pub dictionary: Dictionary,
    /// PDOs.
    pub pdos: Vec<PdoSpec>,
    /// Areas of the maker's tool.
    pub areas: Vec<Area>,
    /// What holds on J1939.
    pub j1939: J1939Spec,
    /// Messages of J1939.
    pub messages: Vec<MessageSpec>,
    /// EMCY.
    pub emcy: EmcySpec,
    /// SDO aborts.
    pub aborts: Vec<AbortText>,
    /// NMT.
    pub nmt: NmtSpec,
    /// Monitoring.
    pub monitoring: Monitoring,
    /// Node-ID changes.
    pub identity_change: IdentityChange,
    /// UDS.
    pub uds: UdsSpec,
    /// State machines, one a channel.
    pub machines: Vec<Machine>,
    /// Gates, one a channel.
    pub gates: Vec<Gate>,
    /// Procedures.
    pub procedures: Vec<Procedure>,
    /// What status numbers mean.
    pub codes: BTreeMap<String, StatusCodes>,
    /// Statements a capture can violate.
    pub rules: Vec<DeviceRule>,
    /// General rules it need not obey.
    pub waivers: Vec<Waiver>,
    /// Objects whose value decides how others are read.
    pub deciding: Vec<ObjectAddress>,
    /// The device file it was made of, wholly or in part.
    pub file: Option<Import>,
    /// Samples with their place in the file.
    pub samples: Vec<(Range<usize>, Sample)>,
    /// PDOs, machines and gates with their places in the file, for checks.
    pub(super) places: Places,
}

/// Where in the file things stand.
#[derive(Debug, Clone, Default)]
pub(super) struct Places {
    pub(super) pdos: Vec<Range<usize>>,
    pub(super) messages: Vec<Range<usize>>,
    pub(super) procedures: Vec<Range<usize>>,
    pub(super) rules: Vec<Range<usize>>,
    pub(super) gates: Vec<Range<usize>>,
    pub(super) machines: Vec<Range<usize>>,
}

impl Device {
    /// Objects that modes, scales and PDO layouts look at.
    pub(super) fn deciding_objects(&self) -> Vec<ObjectAddress> {
        let mut all = Vec::new();
        for object in self.dictionary.layers.iter().flat_map(|layer| layer.iter()) {
            object.deciding(&mut all);
        }
        all.extend(self.pdos.iter().filter_map(|pdo| pdo.when.as_ref()).map(|when| when.object.object));
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Adds what a standard says where the device itself says nothing.
    fn extend(&mut self, standard: &Device) {
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

    /// The device's own entry of an error code.
    pub fn error(&self, code: u16) -> Option<&ErrorCode> {
        self.emcy.code.iter().find(|error| error.code == code)
    }

    /// What an error code means: by the device's manual, else by CiA 301.
    pub fn error_text(&self, code: u16) -> &str {
        match self.error(code) {
            Some(error) => &error.text,
            None => emcy_codes().find(u32::from(code)).map_or("no CiA 301 code", |known| &known.text),
        }
    }

    /// The device's own entry of a trouble code.
    pub fn dtc(&self, spn: u32, fmi: u8) -> Option<&TroubleCode> {
        self.j1939.dtc.iter().find(|dtc| (dtc.spn, dtc.fmi) == (spn, fmi))
    }

    /// The device's own text of an abort code, for an object where the text depends on it.
    pub fn abort(&self, code: u32, object: Option<ObjectAddress>) -> Option<&AbortText> {
        let matching = || self.aborts.iter().filter(|abort| abort.code == code);
        let special = object.and_then(|object| {
            matching().find(|abort| abort.objects.iter().any(|range| range.covers(object, 0, 0)))
        });
        special.or_else(|| matching().find(|abort| abort.objects.is_empty()))
    }

    /// Entries of its own file after repeats.
    pub fn object_count(&self) -> usize {
        self.dictionary.own().iter().map(Object::count).sum()
    }
}
