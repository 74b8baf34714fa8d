//! An object of a dictionary and its sub-entries, as a document describes them.

use std::ops::Range;

use super::data_type::DataType;
use super::formula::evaluate_formula;
use super::object::{
    DefaultValue, EntryRepetition, NumberFormat, ObjectCondition, Persistence, RawScale, SdoAccess,
    ValueInterpretation, ValueStorage, VariantFilter, WriteEffect,
};
use super::reference::{ObjectRange, ObjectReference};
use crate::wire::canopen::ObjectAddress;

/// An object, or several equal objects at a constant distance.
#[derive(Debug, Clone)]
pub struct ObjectEntry {
    /// Index of the first repeat.
    pub index: u16,
    /// Number of repeats and distance of their indexes.
    pub repeat: EntryRepetition,
    /// Name; `{n}` is replaced by the repeat number.
    pub name: String,
    /// Sub-entries; a variable has one with sub-index 0.
    pub entries: Vec<SubEntry>,
    /// Whether the entries have separate names.
    pub is_record: bool,
    /// Variants it applies to; all if empty.
    pub only: VariantFilter,
    /// Section of the manual.
    pub source: String,
    pub(super) span: Range<usize>,
}

/// A sub-entry, or equal ones from `sub` to `to`.
#[derive(Debug, Clone)]
pub struct SubEntry {
    /// First sub-index.
    pub sub: u8,
    /// Last sub-index.
    pub to: u8,
    /// Data type; `None` if unknown.
    pub data_type: Option<DataType>,
    /// Access by SDO.
    pub access: Option<SdoAccess>,
    /// Number format in output.
    pub format: NumberFormat,
    /// Interpretation of the value.
    pub look: ValueInterpretation,
    /// Interpretations by mode; the first match is used, missing keys are taken from `look`.
    pub modes: Vec<(ObjectCondition, ValueInterpretation)>,
    /// Factory default.
    pub default: Option<DefaultValue>,
    /// Persistence of a written value.
    pub storage: ValueStorage,
    /// Object that stores the value.
    pub save: Option<ObjectReference>,
    /// Time at which a write takes effect.
    pub effect: WriteEffect,
    /// Objects whose known value becomes invalid after a write.
    pub invalidates: Vec<ObjectRange>,
    pub(super) channel: Option<u8>,
    /// Raw values of a mode in which actual values do not follow set points.
    pub open_loop: Vec<i64>,
    /// Variants it applies to; all if empty.
    pub only: VariantFilter,
    /// Section of the manual.
    pub source: String,
    /// Assumption or defect of the manual.
    pub note: String,
    pub(super) span: Range<usize>,
}

/// Max repeats expanded for objects that decide the meaning or the identifiers of others.
pub(super) const MOST_REPEATS: u16 = 1024;

impl ObjectEntry {
    /// Repeat number of an index, from 0.
    pub fn repeat_of(&self, index: u16) -> Option<u16> {
        let distance = index.checked_sub(self.index)?;
        if distance == 0 {
            return Some(0);
        }
        let EntryRepetition { count, stride, .. } = self.repeat;
        let nth = distance.checked_div(stride)?;
        (distance % stride == 0 && nth < count).then_some(nth)
    }

    /// Entry with a sub-index.
    pub fn entry(&self, sub: u8) -> Option<&SubEntry> {
        self.entries.iter().find(|entry| (entry.sub..=entry.to).contains(&sub))
    }

    /// Collects the objects that decide the meaning of this object's entries, in all repeats.
    pub(super) fn collect_deciding(&self, all: &mut Vec<ObjectAddress>) {
        for entry in &self.entries {
            let looks = std::iter::once(&entry.look).chain(entry.modes.iter().map(|(_, look)| look));
            let scales = looks.filter_map(|look| match look.scale {
                Some(RawScale::ByObject { object, .. }) => Some(object),
                _ => None,
            });
            let modes = entry.modes.iter().map(|(when, _)| when.object);
            for reference in scales.chain(modes) {
                all.extend(
                    (0..self.repeat.count.min(MOST_REPEATS))
                        .map(|nth| reference.shift_object(nth, self.repeat.stride)),
                );
            }
        }
    }

    /// Repeat number for output.
    pub fn repeat_number(&self, nth: u16) -> u16 {
        self.repeat.first.saturating_add(nth)
    }

    /// Number of entries, including repeats.
    pub fn entry_count(&self) -> usize {
        let subs = self.entries.iter().map(|entry| usize::from(entry.to - entry.sub) + 1);
        subs.sum::<usize>() * usize::from(self.repeat.count)
    }
}

impl SubEntry {
    /// Effect and persistence of a write, if known; none for signatures, which are commands rather than
    /// values.
    pub(crate) fn write_consequence(&self) -> (Option<WriteEffect>, Option<Persistence>) {
        if self.format == NumberFormat::Ascii {
            return (None, None);
        }
        let effect = Some(self.effect).filter(|effect| *effect != WriteEffect::Unknown);
        (effect, self.storage.persistence_text())
    }

    /// Factory default as a raw number; formulas such as `$NODEID+0x200` require the node-ID.
    pub fn default_number(&self, node: Option<u8>) -> Option<i64> {
        match self.default.as_ref()? {
            DefaultValue::Number(number) => Some(*number),
            DefaultValue::Text(text) if self.data_type.is_none_or(DataType::is_integer) => {
                i64::try_from(evaluate_formula(text, node)?).ok()
            }
            DefaultValue::Text(_) | DefaultValue::Real(_) => None,
        }
    }
}
