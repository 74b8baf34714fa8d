//! Resolves the definitions of a profile for one node at one time: selects modes, computes scales.

use super::data_type::{DataType, Value};
use super::dictionary::{Dictionary, ResolvedObject};
use super::entry::Entry;
use super::meaning::{Factor, Meaning, integer};
use super::object::{Format, Interpretation, Scale};
use crate::wire::canopen::ObjectAddress;

/// Max length of a chain of objects whose scales depend on each other.
const DEEPEST: u8 = 4;

/// Known values of a node's objects.
pub trait KnownValues {
    /// Bytes of an object, and whether they may have changed without being seen.
    fn bytes(&self, object: ObjectAddress) -> Option<(&[u8], bool)>;
    /// User-defined unit of an object whose unit is configurable and not visible on the bus.
    fn unit(&self, object: ObjectAddress) -> Option<&str>;
}

/// No known values: defaults apply.
#[derive(Debug, Clone, Copy)]
pub struct NoValues;

impl KnownValues for NoValues {
    fn bytes(&self, _: ObjectAddress) -> Option<(&[u8], bool)> {
        None
    }

    fn unit(&self, _: ObjectAddress) -> Option<&str> {
        None
    }
}

/// Number that decides the meaning of other objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Number {
    /// Raw value.
    pub raw: i64,
    /// Whether it is a default or may have changed without being seen.
    pub assumed: bool,
}

/// Resolves entries of one dictionary and records the objects it depends on.
pub struct Resolver<'a> {
    dictionary: &'a Dictionary,
    known: &'a dyn KnownValues,
    /// Node-ID for defaults that depend on it.
    node: Option<u8>,
    /// Objects whose value influenced the result.
    pub looked_at: Vec<ObjectAddress>,
}

impl<'a> Resolver<'a> {
    /// Resolver without a node-ID: defaults that depend on it are unknown.
    pub fn new(dictionary: &'a Dictionary, known: &'a dyn KnownValues) -> Self {
        Self { dictionary, known, node: None, looked_at: Vec::new() }
    }

    /// Resolver for one node.
    pub fn for_node(dictionary: &'a Dictionary, known: &'a dyn KnownValues, node: u8) -> Self {
        Self { node: Some(node), ..Self::new(dictionary, known) }
    }

    /// Current meaning of an object; `None` if its index is unknown.
    pub fn meaning(&mut self, object: ObjectAddress) -> Option<Meaning> {
        let found = self.dictionary.find(object)?;
        Some(self.meaning_of(&found, 0))
    }

    /// Raw number of an object: seen, user-supplied or the factory default.
    pub fn number(&mut self, object: ObjectAddress) -> Option<Number> {
        if !self.looked_at.contains(&object) {
            self.looked_at.push(object);
        }
        let entry = self.dictionary.find(object).and_then(|found| found.entry);
        if let Some((bytes, assumed)) = self.known.bytes(object) {
            let width = u16::try_from(bytes.len().saturating_mul(8)).unwrap_or(64);
            let data_type = entry.and_then(|entry| entry.data_type).unwrap_or(DataType::unsigned(width));
            return Some(Number { raw: integer(&data_type.decode(bytes))?, assumed });
        }
        entry?.default_number(self.node).map(|raw| Number { raw, assumed: true })
    }

    fn meaning_of(&mut self, found: &ResolvedObject<'_>, depth: u8) -> Meaning {
        let mut meaning = bare(found);
        let Some(entry) = found.entry else { return meaning };
        let (mode, assumed) = self.mode(entry, found);
        meaning.assumed = assumed;
        meaning.errors = (entry.format == Format::Emcy).then(|| self.dictionary.errors.clone());
        meaning.name = match mode.and_then(|mode| mode.name.as_deref()) {
            Some(name) => found.numbered(name),
            None => found.name(),
        };
        let pick = Pick { mode, base: &entry.look };
        meaning.short = pick.of(|look| look.short.clone()).map(|short| found.numbered(&short));
        // The user's unit applies only if the manual leaves it open: another unit with the same scale would
        // be wrong.
        let given = self.known.unit(found.address).map(str::to_owned);
        meaning.unit = pick.of(|look| look.unit.clone()).or(given).unwrap_or_default();
        meaning.range = pick.of(|look| look.range);
        meaning.limits = pick.of(|look| look.limits);
        meaning.values = pick.of(|look| look.values.clone());
        meaning.special = pick.of(|look| look.special.clone());
        meaning.bits = pick.of(|look| look.bits.clone());
        meaning.role = pick.of(|look| look.role);
        meaning.of = pick.of(|look| look.of).map(|of| found.shifted(of));
        let scale = pick.of(|look| look.scale);
        let offset = pick.of(|look| look.offset).unwrap_or(0.0);
        let (scale, assumed) = self.factor(scale, offset, found, depth);
        meaning.scale = scale;
        meaning.assumed |= assumed;
        meaning.decimals = pick.of(|look| look.decimals).unwrap_or_else(|| decimals(scale));
        meaning
    }

    /// Interpretation for the current mode, and whether the mode is only assumed.
    fn mode<'e>(
        &mut self,
        entry: &'e Entry,
        found: &ResolvedObject<'_>,
    ) -> (Option<&'e Interpretation>, bool) {
        let mut unknown = false;
        let mut assumed = false;
        for (when, look) in &entry.modes {
            match self.number(found.shifted(when.object)) {
                Some(number) if when.equals.contains(number.raw) => return (Some(look), number.assumed),
                Some(number) => assumed |= number.assumed,
                None => unknown = true,
            }
        }
        (None, unknown || assumed)
    }

    fn factor(
        &mut self,
        scale: Option<Scale>,
        offset: f64,
        found: &ResolvedObject<'_>,
        depth: u8,
    ) -> (Option<Factor>, bool) {
        let (raw, value, by, assumed) = match scale {
            None if offset == 0.0 => return (None, false),
            None => (1.0, 1.0, None, false),
            Some(Scale::Factor(factor)) => (1.0, factor, None, false),
            Some(Scale::Anchor { raw, value }) => (raw, value, None, false),
            Some(Scale::Reciprocal { reciprocal }) => (1.0, reciprocal, None, false),
            Some(Scale::ByObject { raw, object }) => {
                let object = found.shifted(object);
                match self.quantity(object, depth) {
                    Some((value, assumed)) => (raw, value, Some((object, value)), assumed),
                    None => return (None, true),
                }
            }
        };
        let factor = value / raw;
        let usable = factor.is_finite() && factor != 0.0;
        let is_reciprocal = matches!(scale, Some(Scale::Reciprocal { .. }));
        (usable.then_some(Factor { factor, offset, full_scale: by, is_reciprocal }), assumed)
    }

    /// Scaled value of an object that determines the scale of another one.
    fn quantity(&mut self, object: ObjectAddress, depth: u8) -> Option<(f64, bool)> {
        let number = self.number(object)?;
        let found = self.dictionary.find(object).filter(|_| depth < DEEPEST);
        let meaning = found.map(|found| self.meaning_of(&found, depth.saturating_add(1)));
        let value = Value::Integer(number.raw);
        let scaled = meaning.as_ref().and_then(|meaning| meaning.scaled(&value));
        #[expect(
            clippy::cast_precision_loss,
            reason = "scaled values are for display; raw numbers are exact"
        )]
        let plain = number.raw as f64;
        Some((scaled.unwrap_or(plain), number.assumed || meaning.is_some_and(|meaning| meaning.assumed)))
    }
}

/// Keys of a mode with the keys of the entry as fallback.
struct Pick<'a> {
    mode: Option<&'a Interpretation>,
    base: &'a Interpretation,
}

impl Pick<'_> {
    fn of<T>(&self, key: impl Fn(&Interpretation) -> Option<T>) -> Option<T> {
        self.mode.and_then(&key).or_else(|| key(self.base))
    }
}

/// Meaning independent of values: name, type, format.
fn bare(found: &ResolvedObject<'_>) -> Meaning {
    Meaning {
        object: found.address,
        name: found.name(),
        data_type: found.entry.and_then(|entry| entry.data_type),
        format: found.entry.map(|entry| entry.format).unwrap_or_default(),
        channel: found.channel(),
        ..Meaning::default()
    }
}

/// Decimals of a scaled value: none for integer factors, otherwise one.
fn decimals(scale: Option<Factor>) -> u8 {
    scale.map_or(0, |scale| {
        u8::from(scale.is_reciprocal || scale.factor.fract() != 0.0 || scale.offset.fract() != 0.0)
    })
}
