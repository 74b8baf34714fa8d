//! A device: everything its manual says that decides what its messages mean.
//!
//! `profiles/README.md` shows the format by example.

mod condition;
mod gate;
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
use std::sync::Arc;

use serde::Deserialize;
use toml::Spanned;

pub use condition::{
    Condition, Conditions, LssTrigger, MessageTrigger, SetTrigger, Trigger, Triggers, Wanted,
};
pub use gate::{Gate, Otherwise};
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

use super::authored::{self, Authored, Tables, Wrong};
use super::compiled;
use super::dictionary::{Dictionary, Layer, Object};
use super::imported::Import;
use super::lookup::emcy_codes;
use super::names::{BitNames, Names};
use super::object::Only;
use super::position::TextError;
use crate::wire::canopen::ObjectAddress;

/// Copies of a repeated machine, gate, procedure or rule that are made; `check` wants fewer in all.
const MOST_COPIES: u16 = 1024;

/// A profile as its file says it.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct File {
    id: String,
    title: String,
    vendor: String,
    description: String,
    source: String,
    note: String,
    extends: Vec<Spanned<String>>,
    variant: Vec<Variant>,
    identity: Vec<Identity>,
    hint: Vec<Hint>,
    object: Vec<Spanned<Authored>>,
    values: BTreeMap<String, Names>,
    bits: BTreeMap<String, BitNames>,
    codes: BTreeMap<String, StatusCodes>,
    pdo: Vec<Spanned<PdoSpec>>,
    area: Vec<Area>,
    j1939: J1939Spec,
    message: Vec<Spanned<MessageSpec>>,
    emcy: EmcySpec,
    abort: Vec<AbortText>,
    nmt: NmtSpec,
    monitoring: Monitoring,
    identity_change: IdentityChange,
    uds: UdsSpec,
    machine: Vec<Spanned<Machine>>,
    gate: Vec<Spanned<Gate>>,
    procedure: Vec<Spanned<Procedure>>,
    rule: Vec<Spanned<DeviceRule>>,
    waiver: Vec<Waiver>,
    sample: Vec<Spanned<Sample>>,
}

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

/// A profile's text and what was read of it: all variants.
#[derive(Debug)]
pub struct ProfileFile {
    file: File,
    objects: Arc<Layer>,
}

impl ProfileFile {
    /// Reads the text of a profile.
    ///
    /// # Errors
    /// Text that is no TOML, unknown keys, values that are none; all errors of objects, with place.
    pub fn parse(text: &str) -> Result<Self, Vec<TextError>> {
        let file = toml::from_str(text).map_err(|error| vec![TextError::of_toml(text, &error)])?;
        Self::of(file, text)
    }

    /// The same of a profile of this program, as the build script compiled it; `text` is what it was made of.
    ///
    /// # Errors
    /// As for a text; a test excludes them.
    pub(super) fn compiled(compiled: &'static [u8], text: &str) -> Result<Self, Vec<TextError>> {
        let file = compiled::read(compiled).map_err(|error| vec![TextError::of_toml(text, &error)])?;
        Self::of(file, text)
    }

    fn of(mut file: File, text: &str) -> Result<Self, Vec<TextError>> {
        let tables = Tables {
            values: std::mem::take(&mut file.values)
                .into_iter()
                .map(|(name, it)| (name, Arc::new(it)))
                .collect(),
            bits: std::mem::take(&mut file.bits).into_iter().map(|(name, it)| (name, Arc::new(it))).collect(),
        };
        let mut wrong: Vec<Wrong> = Vec::new();
        let objects = authored::objects(std::mem::take(&mut file.object), &tables, &mut wrong);
        if !wrong.is_empty() {
            return Err(wrong
                .into_iter()
                .map(|(span, message)| TextError::at(text, span, message))
                .collect());
        }
        Ok(Self { file, objects: Arc::new(Layer::new(objects)) })
    }

    /// Its id.
    pub fn id(&self) -> &str {
        &self.file.id
    }

    /// Standards it extends, with their place in the text.
    pub fn extends(&self) -> impl DoubleEndedIterator<Item = (&str, Range<usize>)> {
        self.file.extends.iter().map(|name| (name.get_ref().as_str(), name.span()))
    }

    /// Its variants; the first is the default.
    pub fn variants(&self) -> &[Variant] {
        &self.file.variant
    }

    /// Rules that its waivers name, of all variants, with their place in the text.
    pub fn waived(&self) -> impl Iterator<Item = (&str, Range<usize>)> {
        self.file.waiver.iter().map(|waiver| (waiver.rule.get_ref().as_str(), waiver.rule.span()))
    }

    /// Rules that its rules take in, and are not its own, with the place of the rule.
    pub fn taken_in(&self) -> impl Iterator<Item = (&str, Range<usize>)> {
        let own = |name: &str| self.file.rule.iter().any(|rule| rule.get_ref().name == name);
        let each = |rule| -> (&DeviceRule, Range<usize>) { (Spanned::get_ref(rule), Spanned::span(rule)) };
        let all = self.file.rule.iter().map(each);
        all.flat_map(|(rule, span)| rule.takes_in.iter().map(move |name| (name.as_str(), span.clone())))
            .filter(move |(name, _)| !own(name))
    }

    /// Its objects, all variants.
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// One variant of the device on top of the standards it extends, given left to right.
    pub fn device(&self, variant: Option<&str>, standards: &[Arc<Device>]) -> Device {
        let file = &self.file;
        let chosen = match variant {
            Some(id) => file.variant.iter().find(|known| known.id == id),
            None => file.variant.first(),
        };
        let id = chosen.map_or("", |variant| variant.id.as_str());
        let mut device = Device {
            id: file.id.clone(),
            full_id: chosen.map_or_else(|| file.id.clone(), |variant| format!("{}:{}", file.id, variant.id)),
            variant: chosen.map(|variant| variant.id.clone()),
            title: chosen
                .map(|it| it.title.clone())
                .filter(|it| !it.is_empty())
                .unwrap_or(file.title.clone()),
            vendor: file.vendor.clone(),
            description: file.description.clone(),
            source: file.source.clone(),
            note: file.note.clone(),
            extends: self.extends().map(|(name, _)| name.to_owned()).collect(),
            variants: file.variant.clone(),
            identities: file.identity.clone(),
            hints: file.hint.clone(),
            areas: file.area.clone(),
            j1939: file.j1939.clone(),
            emcy: file.emcy.clone(),
            nmt: file.nmt.clone(),
            monitoring: file.monitoring.clone(),
            identity_change: file.identity_change.clone(),
            uds: file.uds.of_variant(id),
            codes: file.codes.clone(),
            ..Device::default()
        };
        device.dictionary.layers.push(self.objects_of(id));
        device.emcy.code.retain(|code| code.only.allows(id));
        device.j1939.dtc.retain(|dtc| dtc.only.allows(id));
        device.aborts = file.abort.iter().filter(|abort| abort.only.allows(id)).cloned().collect();
        device.waivers = file.waiver.iter().filter(|waiver| waiver.only.allows(id)).cloned().collect();
        self.add_behaviour(&mut device, id);
        for standard in standards.iter().rev() {
            device.extend(standard);
        }
        device.deciding = device.deciding_objects();
        device
    }

    /// The objects of one variant.
    fn objects_of(&self, variant: &str) -> Arc<Layer> {
        let all = |only: &Only| only.allows(variant);
        let complete =
            |object: &Object| all(&object.only) && object.entries.iter().all(|entry| all(&entry.only));
        if self.objects.iter().all(complete) {
            return Arc::clone(&self.objects);
        }
        let chosen = self.objects.iter().filter(|object| all(&object.only)).map(|object| {
            let mut object = object.clone();
            object.entries.retain(|entry| all(&entry.only));
            object
        });
        Arc::new(Layer::new(chosen.collect()))
    }

    fn add_behaviour(&self, device: &mut Device, variant: &str) {
        let file = &self.file;
        for pdo in file.pdo.iter().filter(|pdo| pdo.get_ref().only.allows(variant)) {
            device.places.pdos.push(pdo.span());
            device.pdos.push(pdo.get_ref().clone());
        }
        for message in file.message.iter().filter(|it| it.get_ref().only.allows(variant)) {
            device.places.messages.push(message.span());
            device.messages.push(message.get_ref().clone());
        }
        for machine in file.machine.iter().filter(|it| it.get_ref().only.allows(variant)) {
            for nth in 0..machine.get_ref().repeat.count.min(MOST_COPIES) {
                device.places.machines.push(machine.span());
                device.machines.push(machine.get_ref().pinned(nth));
            }
        }
        for gate in file.gate.iter().filter(|gate| gate.get_ref().only.allows(variant)) {
            for nth in 0..gate.get_ref().repeat.count.min(MOST_COPIES) {
                device.places.gates.push(gate.span());
                device.gates.push(gate.get_ref().pinned(nth));
            }
        }
        for procedure in file.procedure.iter().filter(|it| it.get_ref().only.allows(variant)) {
            for nth in 0..procedure.get_ref().repeat.count.min(MOST_COPIES) {
                device.places.procedures.push(procedure.span());
                device.procedures.push(procedure.get_ref().pinned(nth));
            }
        }
        for rule in file.rule.iter().filter(|rule| rule.get_ref().only.allows(variant)) {
            for nth in 0..rule.get_ref().repeat.count.min(MOST_COPIES) {
                device.places.rules.push(rule.span());
                device.rules.push(rule.get_ref().pinned(nth));
            }
        }
        let samples = file.sample.iter().filter(|sample| sample.get_ref().only.allows(variant));
        device.samples = samples.map(|sample| (sample.span(), sample.get_ref().clone())).collect();
    }
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
            None => emcy_codes().text(u32::from(code)),
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
