//! Resolves the definitions of a profile for one node at one time: selects modes, computes scales.

use super::data_type::{DataType, DecodedValue};
use super::dictionary::{Dictionary, ResolvedObject};
use super::entry::SubEntry;
use super::meaning::{ObjectMeaning, RawConversion, as_integer};
use super::object::{NumberFormat, RawScale, ValueInterpretation};
use crate::wire::canopen::ObjectAddress;

/// Max length of a chain of objects whose scales depend on each other.
const DEEPEST: u8 = 4;

/// Known values of a node's objects.
pub trait KnownValues {
    /// Bytes of an object, and whether they may have changed without being seen.
    fn object_bytes(&self, object: ObjectAddress) -> Option<(&[u8], bool)>;
    /// User-defined unit of an object whose unit is configurable and not visible on the bus.
    fn object_unit(&self, object: ObjectAddress) -> Option<&str>;
}

/// No known values: defaults apply.
#[derive(Debug, Clone, Copy)]
pub struct NoValues;

impl KnownValues for NoValues {
    fn object_bytes(&self, _: ObjectAddress) -> Option<(&[u8], bool)> {
        None
    }

    fn object_unit(&self, _: ObjectAddress) -> Option<&str> {
        None
    }
}

/// Number that decides the meaning of other objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecidingNumber {
    /// Raw value.
    pub raw: i64,
    /// Whether it is a default or may have changed without being seen.
    pub assumed: bool,
}

/// Resolves entries of one dictionary and records the objects it depends on.
pub struct EntryResolver<'a> {
    dictionary: &'a Dictionary,
    known: &'a dyn KnownValues,
    /// Node-ID for defaults that depend on it.
    node: Option<u8>,
    /// Objects whose value influenced the result.
    pub looked_at: Vec<ObjectAddress>,
}

impl<'a> EntryResolver<'a> {
    /// Resolver without a node-ID: defaults that depend on it are unknown.
    pub fn new(dictionary: &'a Dictionary, known: &'a dyn KnownValues) -> Self {
        Self { dictionary, known, node: None, looked_at: Vec::new() }
    }

    /// Resolver for one node.
    pub fn for_node(dictionary: &'a Dictionary, known: &'a dyn KnownValues, node: u8) -> Self {
        Self { node: Some(node), ..Self::new(dictionary, known) }
    }

    /// Current meaning of an object; `None` if its index is unknown.
    pub fn resolve_meaning(&mut self, object: ObjectAddress) -> Option<ObjectMeaning> {
        let found = self.dictionary.find_object(object)?;
        Some(self.meaning_of(&found, 0))
    }

    /// Raw number of an object: seen, user-supplied or the factory default.
    pub fn resolve_number(&mut self, object: ObjectAddress) -> Option<DecidingNumber> {
        if !self.looked_at.contains(&object) {
            self.looked_at.push(object);
        }
        let entry = self.dictionary.find_object(object).and_then(|found| found.entry);
        if let Some((bytes, assumed)) = self.known.object_bytes(object) {
            let width = u16::try_from(bytes.len().saturating_mul(8)).unwrap_or(64);
            let data_type = entry.and_then(|entry| entry.data_type).unwrap_or(DataType::unsigned_of(width));
            return Some(DecidingNumber { raw: as_integer(&data_type.decode(bytes))?, assumed });
        }
        entry?.default_number(self.node).map(|raw| DecidingNumber { raw, assumed: true })
    }

    fn meaning_of(&mut self, found: &ResolvedObject<'_>, depth: u8) -> ObjectMeaning {
        let mut meaning = bare_meaning(found);
        let Some(entry) = found.entry else { return meaning };
        let (mode, assumed) = self.resolve_mode(entry, found);
        meaning.assumed = assumed;
        meaning.errors = (entry.format == NumberFormat::Emcy).then(|| self.dictionary.errors.clone());
        meaning.name = match mode.and_then(|mode| mode.name.as_deref()) {
            Some(name) => found.number_name(name),
            None => found.name(),
        };
        let pick = ModeKeys { mode, base: &entry.look };
        meaning.short = pick.pick_key(|look| look.short.clone()).map(|short| found.number_name(&short));
        // The user's unit applies only if the manual leaves it open: another unit with the same scale would
        // be wrong.
        let given = self.known.object_unit(found.address).map(str::to_owned);
        meaning.unit = pick.pick_key(|look| look.unit.clone()).or(given).unwrap_or_default();
        meaning.range = pick.pick_key(|look| look.range);
        meaning.limits = pick.pick_key(|look| look.limits);
        meaning.values = pick.pick_key(|look| look.values.clone());
        meaning.special = pick.pick_key(|look| look.special.clone());
        meaning.bits = pick.pick_key(|look| look.bits.clone());
        meaning.role = pick.pick_key(|look| look.role);
        meaning.of = pick.pick_key(|look| look.of).map(|of| found.shift_reference(of));
        let scale = pick.pick_key(|look| look.scale);
        let offset = pick.pick_key(|look| look.offset).unwrap_or(0.0);
        let (scale, assumed) = self.resolve_factor(scale, offset, found, depth);
        meaning.scale = scale;
        meaning.assumed |= assumed;
        meaning.decimals = pick.pick_key(|look| look.decimals).unwrap_or_else(|| scale_decimals(scale));
        meaning
    }

    /// Interpretation for the current mode, and whether the mode is only assumed.
    fn resolve_mode<'e>(
        &mut self,
        entry: &'e SubEntry,
        found: &ResolvedObject<'_>,
    ) -> (Option<&'e ValueInterpretation>, bool) {
        let mut unknown = false;
        let mut assumed = false;
        for (when, look) in &entry.modes {
            match self.resolve_number(found.shift_reference(when.object)) {
                Some(number) if when.equals.contains(number.raw) => return (Some(look), number.assumed),
                Some(number) => assumed |= number.assumed,
                None => unknown = true,
            }
        }
        (None, unknown || assumed)
    }

    fn resolve_factor(
        &mut self,
        scale: Option<RawScale>,
        offset: f64,
        found: &ResolvedObject<'_>,
        depth: u8,
    ) -> (Option<RawConversion>, bool) {
        let (raw, value, by, assumed) = match scale {
            None if offset == 0.0 => return (None, false),
            None => (1.0, 1.0, None, false),
            Some(RawScale::Factor(factor)) => (1.0, factor, None, false),
            Some(RawScale::Anchor { raw, value }) => (raw, value, None, false),
            Some(RawScale::Reciprocal { reciprocal }) => (1.0, reciprocal, None, false),
            Some(RawScale::ByObject { raw, object }) => {
                let object = found.shift_reference(object);
                match self.resolve_quantity(object, depth) {
                    Some((value, assumed)) => (raw, value, Some((object, value)), assumed),
                    None => return (None, true),
                }
            }
        };
        let factor = value / raw;
        let usable = factor.is_finite() && factor != 0.0;
        let is_reciprocal = matches!(scale, Some(RawScale::Reciprocal { .. }));
        (usable.then_some(RawConversion { factor, offset, full_scale: by, is_reciprocal }), assumed)
    }

    /// Scaled value of an object that determines the scale of another one.
    fn resolve_quantity(&mut self, object: ObjectAddress, depth: u8) -> Option<(f64, bool)> {
        let number = self.resolve_number(object)?;
        let found = self.dictionary.find_object(object).filter(|_| depth < DEEPEST);
        let meaning = found.map(|found| self.meaning_of(&found, depth.saturating_add(1)));
        let value = DecodedValue::Integer(number.raw);
        let scaled = meaning.as_ref().and_then(|meaning| meaning.scaled_value(&value));
        #[expect(
            clippy::cast_precision_loss,
            reason = "scaled values are for display; raw numbers are exact"
        )]
        let plain = number.raw as f64;
        Some((scaled.unwrap_or(plain), number.assumed || meaning.is_some_and(|meaning| meaning.assumed)))
    }
}

/// Keys of a mode with the keys of the entry as fallback.
struct ModeKeys<'a> {
    mode: Option<&'a ValueInterpretation>,
    base: &'a ValueInterpretation,
}

impl ModeKeys<'_> {
    fn pick_key<T>(&self, key: impl Fn(&ValueInterpretation) -> Option<T>) -> Option<T> {
        self.mode.and_then(&key).or_else(|| key(self.base))
    }
}

/// Meaning independent of values: name, type, format.
fn bare_meaning(found: &ResolvedObject<'_>) -> ObjectMeaning {
    ObjectMeaning {
        object: found.address,
        name: found.name(),
        data_type: found.entry.and_then(|entry| entry.data_type),
        format: found.entry.map(|entry| entry.format).unwrap_or_default(),
        channel: found.channel(),
        ..ObjectMeaning::default()
    }
}

/// Decimals of a scaled value: none for integer factors, otherwise one.
fn scale_decimals(scale: Option<RawConversion>) -> u8 {
    scale.map_or(0, |scale| {
        u8::from(scale.is_reciprocal || scale.factor.fract() != 0.0 || scale.offset.fract() != 0.0)
    })
}
