//! Profile files, and the devices they define.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use serde::Deserialize;
use toml::Spanned;

use super::expectation::{ExpectEntry, ExpectTable, check_entries};
use super::{
    AbortText, DeviceIdentity, DeviceProcedure, DeviceProfile, DeviceRule, DeviceVariant, EmcySpec, Gate,
    IdentityChange, J1939Spec, MessageSpec, Monitoring, NmtSpec, PdoArea, PdoSpec, ProfileHint,
    ProfileSample, RuleWaiver, StateMachine, StatusCodes, UdsSpec,
};
use crate::profile::authored::{self, AuthoredEntry, SharedTables, TextProblem};
use crate::profile::compiled;
use crate::profile::entry::ObjectEntry;
use crate::profile::layer::{DocumentLayer, OBJECTS};
use crate::profile::names::{BitNames, ValueNames};
use crate::profile::position::TextError;

/// Max repeats expanded per machine, gate, procedure or rule; above the total that `check` accepts.
const MOST_COPIES: u16 = 1024;

/// Profile file as parsed.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RawProfileFile {
    id: String,
    title: String,
    vendor: String,
    description: String,
    source: String,
    note: String,
    extends: Vec<Spanned<String>>,
    variant: Vec<DeviceVariant>,
    identity: Vec<DeviceIdentity>,
    hint: Vec<ProfileHint>,
    object: Vec<Spanned<AuthoredEntry>>,
    values: BTreeMap<String, ValueNames>,
    bits: BTreeMap<String, BitNames>,
    codes: BTreeMap<String, StatusCodes>,
    pdo: Vec<Spanned<PdoSpec>>,
    area: Vec<PdoArea>,
    j1939: J1939Spec,
    message: Vec<Spanned<MessageSpec>>,
    emcy: EmcySpec,
    abort: Vec<AbortText>,
    nmt: NmtSpec,
    monitoring: Monitoring,
    identity_change: IdentityChange,
    uds: UdsSpec,
    machine: Vec<Spanned<StateMachine>>,
    gate: Vec<Spanned<Gate>>,
    procedure: Vec<Spanned<DeviceProcedure>>,
    rule: Vec<Spanned<DeviceRule>>,
    expect: Vec<ExpectTable>,
    waiver: Vec<RuleWaiver>,
    sample: Vec<Spanned<ProfileSample>>,
}

impl RawProfileFile {
    /// Tables that objects refer to by name.
    fn take_tables(&mut self) -> SharedTables {
        let values = std::mem::take(&mut self.values).into_iter();
        let bits = std::mem::take(&mut self.bits).into_iter();
        SharedTables {
            values: values.map(|(name, it)| (name, Arc::new(it))).collect(),
            bits: bits.map(|(name, it)| (name, Arc::new(it))).collect(),
        }
    }
}

/// A parsed profile with all its variants.
#[derive(Debug)]
pub struct ProfileFile {
    file: RawProfileFile,
    objects: Arc<DocumentLayer>,
    expectations: Vec<ExpectEntry>,
}

impl ProfileFile {
    /// Parses the text of a profile.
    ///
    /// # Errors
    /// Invalid TOML, unknown keys or invalid values, with line and column; all errors in objects at once.
    pub fn parse(text: &str) -> Result<Self, Vec<TextError>> {
        let file = toml::from_str(text).map_err(|error| vec![TextError::of_toml(text, &error)])?;
        Self::from_raw(file, text)
    }

    /// Loads a built-in profile that the build script compiled from `text`.
    ///
    /// # Errors
    /// Same as [`Self::parse`]; a test proves that none occur.
    pub(in crate::profile) fn from_compiled(
        compiled: &'static str,
        text: &str,
    ) -> Result<Self, Vec<TextError>> {
        let wrong = |error: toml::de::Error| vec![TextError::of_toml(text, &error)];
        let mut file: RawProfileFile = compiled::read_without(compiled, OBJECTS).map_err(wrong)?;
        let objects = DocumentLayer::from_compiled(compiled, file.take_tables()).map_err(wrong)?;
        Self::with_objects(file, objects, text)
    }

    fn from_raw(mut file: RawProfileFile, text: &str) -> Result<Self, Vec<TextError>> {
        let tables = file.take_tables();
        let mut wrong: Vec<TextProblem> = Vec::new();
        let objects = authored::convert_objects(std::mem::take(&mut file.object), &tables, &mut wrong);
        if !wrong.is_empty() {
            return Err(wrong
                .into_iter()
                .map(|(span, message)| TextError::at_place(text, span, message))
                .collect());
        }
        Self::with_objects(file, DocumentLayer::new(objects), text)
    }

    fn with_objects(
        mut file: RawProfileFile,
        objects: DocumentLayer,
        text: &str,
    ) -> Result<Self, Vec<TextError>> {
        let expectations = check_entries(std::mem::take(&mut file.expect), Some(&file.id))
            .map_err(|(span, message)| vec![TextError::at_place(text, span, message)])?;
        Ok(Self { file, objects: Arc::new(objects), expectations })
    }

    /// Profile id, as used in options.
    pub fn id(&self) -> &str {
        &self.file.id
    }

    /// Standards that the profile extends, with their position in the text.
    pub fn extended_standards(&self) -> impl DoubleEndedIterator<Item = (&str, Range<usize>)> {
        self.file.extends.iter().map(|name| (name.get_ref().as_str(), name.span()))
    }

    /// Variants of the device; the first is the default.
    pub fn variants(&self) -> &[DeviceVariant] {
        &self.file.variant
    }

    /// Rules that waivers of any variant name, with their position in the text.
    pub fn waived_rules(&self) -> impl Iterator<Item = (&str, Range<usize>)> {
        self.file.waiver.iter().map(|waiver| (waiver.rule.get_ref().as_str(), waiver.rule.span()))
    }

    /// Rules outside this profile that its rules list in `takes_in` or `follows`, with the position of the rule.
    pub(crate) fn taken_in(&self) -> impl Iterator<Item = (&str, Range<usize>)> {
        let own = |name: &str| self.file.rule.iter().any(|rule| rule.get_ref().name == name);
        let each = |rule| -> (&DeviceRule, Range<usize>) { (Spanned::get_ref(rule), Spanned::span(rule)) };
        let all = self.file.rule.iter().map(each);
        all.flat_map(|(rule, span)| {
            rule.takes_in.iter().chain(&rule.follows).map(move |name| (name.as_str(), span.clone()))
        })
        .filter(move |(name, _)| !own(name))
    }

    /// Expectations about each node with the profile.
    pub fn expectations(&self) -> &[ExpectEntry] {
        &self.expectations
    }

    /// Objects of all variants.
    pub fn objects(&self) -> &[ObjectEntry] {
        self.objects.objects()
    }

    /// Builds one variant of the device on top of the standards that it extends, in order of precedence.
    pub fn build_device(&self, variant: Option<&str>, standards: &[Arc<DeviceProfile>]) -> DeviceProfile {
        let file = &self.file;
        let chosen = match variant {
            Some(id) => file.variant.iter().find(|known| known.id == id),
            None => file.variant.first(),
        };
        let id = chosen.map_or("", |variant| variant.id.as_str());
        let mut device = DeviceProfile {
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
            extends: self.extended_standards().map(|(name, _)| name.to_owned()).collect(),
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
            expectations: self.expectations.clone(),
            ..DeviceProfile::default()
        };
        device.dictionary.layers.push(self.objects.of_variant(id));
        device.emcy.code.retain(|code| code.only.allows_variant(id));
        device.j1939.dtc.retain(|dtc| dtc.only.allows_variant(id));
        device.aborts = file.abort.iter().filter(|abort| abort.only.allows_variant(id)).cloned().collect();
        device.waivers =
            file.waiver.iter().filter(|waiver| waiver.only.allows_variant(id)).cloned().collect();
        self.add_behaviour(&mut device, id);
        for standard in standards.iter().rev() {
            device.extend_by(standard);
        }
        device.deciding = device.deciding_objects();
        device.share_error_texts();
        device
    }

    fn add_behaviour(&self, device: &mut DeviceProfile, variant: &str) {
        let file = &self.file;
        for pdo in file.pdo.iter().filter(|pdo| pdo.get_ref().only.allows_variant(variant)) {
            device.places.pdos.push(pdo.span());
            device.pdos.push(pdo.get_ref().clone());
        }
        for message in file.message.iter().filter(|it| it.get_ref().only.allows_variant(variant)) {
            device.places.messages.push(message.span());
            device.messages.push(message.get_ref().clone());
        }
        for machine in file.machine.iter().filter(|it| it.get_ref().only.allows_variant(variant)) {
            for nth in 0..machine.get_ref().repeat.count.min(MOST_COPIES) {
                device.places.machines.push(machine.span());
                device.machines.push(machine.get_ref().pin_repeat(nth));
            }
        }
        for gate in file.gate.iter().filter(|gate| gate.get_ref().only.allows_variant(variant)) {
            for nth in 0..gate.get_ref().repeat.count.min(MOST_COPIES) {
                device.places.gates.push(gate.span());
                device.gates.push(gate.get_ref().pin_repeat(nth));
            }
        }
        for procedure in file.procedure.iter().filter(|it| it.get_ref().only.allows_variant(variant)) {
            for nth in 0..procedure.get_ref().repeat.count.min(MOST_COPIES) {
                device.places.procedures.push(procedure.span());
                device.procedures.push(procedure.get_ref().pin_repeat(nth));
            }
        }
        for rule in file.rule.iter().filter(|rule| rule.get_ref().only.allows_variant(variant)) {
            for nth in 0..rule.get_ref().repeat.count.min(MOST_COPIES) {
                device.places.rules.push(rule.span());
                device.rules.push(rule.get_ref().pin_repeat(nth));
            }
        }
        let samples = file.sample.iter().filter(|sample| sample.get_ref().only.allows_variant(variant));
        device.samples = samples.map(|sample| (sample.span(), sample.get_ref().clone())).collect();
    }
}
