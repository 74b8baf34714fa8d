//! Objects of one document, in file order. Those of a built-in profile are read on first use.

use std::sync::{Arc, OnceLock};

use serde::Deserialize;
use toml::Spanned;
use toml::de::Error;

use super::authored::{self, AuthoredEntry, SharedTables};
use super::compiled::{self, CompiledValue};
use super::entry::{MOST_REPEATS, ObjectEntry};
use super::object::EntryRepetition;
use crate::wire::canopen::ObjectAddress;

/// Key of the objects in a profile.
pub(super) const OBJECTS: &str = "object";

/// Objects of one document.
#[derive(Debug, Default)]
pub(super) struct DocumentLayer {
    positions: ObjectPositions,
    content: LayerContent,
}

/// Indexes of all objects.
#[derive(Debug, Clone, Default)]
struct ObjectPositions {
    /// First index of each object, and distance from it to the last index.
    spans: Vec<(u16, u16)>,
    /// Number of repeats and distance of their indexes.
    repeats: Vec<(u16, u16)>,
    /// Made at the first search.
    ranges: OnceLock<IndexRanges>,
}

/// Positions of objects by ranges of indexes within which they are the same: every transfer searches them several
/// times.
#[derive(Debug, Clone, Default)]
struct IndexRanges {
    /// First index of each range, ascending; the first one is 0.
    starts: Vec<u16>,
    /// Start of the positions of each range in `places`, and their end.
    bounds: Vec<usize>,
    /// Ascending within a range.
    places: Vec<usize>,
}

impl IndexRanges {
    fn new(spans: &[(u16, u16)]) -> Self {
        let ends = spans.iter().filter_map(|(first, distance)| first.checked_add(*distance)?.checked_add(1));
        let mut starts: Vec<u16> = spans.iter().map(|(first, _)| *first).chain(ends).chain([0]).collect();
        starts.sort_unstable();
        starts.dedup();
        let range_of = |index: u16| starts.partition_point(|start| *start <= index).saturating_sub(1);
        let mut covered: Vec<(usize, usize)> = Vec::with_capacity(starts.len());
        for (place, (first, distance)) in spans.iter().enumerate() {
            let ranges = range_of(*first)..=range_of(first.saturating_add(*distance));
            covered.extend(ranges.map(|range| (range, place)));
        }
        covered.sort_unstable();
        let bounds = (0..=starts.len()).map(|range| covered.partition_point(|(of, _)| *of < range)).collect();
        Self { starts, bounds, places: covered.into_iter().map(|(_, place)| place).collect() }
    }

    /// Positions of the objects whose span has this index, in file order.
    fn positions_at(&self, index: u16) -> &[usize] {
        let after = self.starts.partition_point(|start| *start <= index);
        let bounds = after.checked_sub(1).and_then(|range| self.bounds.get(range..=after));
        let places = match bounds {
            Some([start, end]) => self.places.get(*start..*end),
            _ => None,
        };
        places.unwrap_or(&[])
    }
}

impl ObjectPositions {
    fn push(&mut self, index: u16, EntryRepetition { count, stride, .. }: EntryRepetition) {
        let distance = count.saturating_sub(1).saturating_mul(stride);
        self.spans.push((index, distance.min(u16::MAX - index)));
        self.repeats.push((count, stride));
    }

    /// Positions of the objects that can have this index, in file order.
    fn positions_at(&self, index: u16) -> impl Iterator<Item = usize> {
        self.ranges.get_or_init(|| IndexRanges::new(&self.spans)).positions_at(index).iter().copied()
    }
}

#[derive(Debug)]
enum LayerContent {
    Read(Vec<ObjectEntry>),
    Compiled(CompiledObjects),
}

impl Default for LayerContent {
    fn default() -> Self {
        Self::Read(Vec::new())
    }
}

/// Objects of a built-in profile.
#[derive(Debug)]
struct CompiledObjects {
    source: Arc<LayerSource>,
    /// Selects the objects and entries of one variant; None for those of all variants.
    variant: Option<String>,
    /// The objects read so far; an object that the variant lacks is None.
    read: Vec<OnceLock<Option<Box<ObjectEntry>>>>,
    /// All objects, if they were needed at once.
    all: OnceLock<Vec<ObjectEntry>>,
}

#[derive(Debug)]
struct LayerSource {
    values: Vec<CompiledValue<'static>>,
    tables: SharedTables,
}

/// Keys of an object that determine its position.
#[derive(Deserialize)]
struct PositionKeys {
    index: u16,
    #[serde(default)]
    repeat: EntryRepetition,
}

impl DocumentLayer {
    pub(super) fn new(objects: Vec<ObjectEntry>) -> Self {
        let mut positions = ObjectPositions::default();
        for object in &objects {
            positions.push(object.index, object.repeat);
        }
        Self { positions, content: LayerContent::Read(objects) }
    }

    /// The objects of a compiled profile, which refer to its `tables`.
    ///
    /// # Errors
    /// An object without a valid index or repeat.
    pub(super) fn from_compiled(profile: &'static str, tables: SharedTables) -> Result<Self, Error> {
        let values = compiled::list_elements(profile, OBJECTS)?;
        let mut positions = ObjectPositions::default();
        for value in &values {
            let keys: PositionKeys = value.read_value()?;
            positions.push(keys.index, keys.repeat);
        }
        let source = Arc::new(LayerSource { values, tables });
        Ok(Self { positions, content: LayerContent::Compiled(CompiledObjects::new(source, None)) })
    }

    /// The objects and entries of one variant.
    pub(super) fn of_variant(self: &Arc<Self>, variant: &str) -> Arc<Self> {
        let objects = match &self.content {
            LayerContent::Compiled(objects) => {
                let objects = CompiledObjects::new(Arc::clone(&objects.source), Some(variant.to_owned()));
                let positions = self.positions.clone();
                return Arc::new(Self { positions, content: LayerContent::Compiled(objects) });
            }
            LayerContent::Read(objects) => objects,
        };
        let complete = |object: &ObjectEntry| {
            object.only.allows_variant(variant)
                && object.entries.iter().all(|entry| entry.only.allows_variant(variant))
        };
        if objects.iter().all(complete) {
            return Arc::clone(self);
        }
        let chosen = objects.iter().filter_map(|object| of_variant(object.clone(), variant));
        Arc::new(Self::new(chosen.collect()))
    }

    /// All objects.
    pub(super) fn objects(&self) -> &[ObjectEntry] {
        match &self.content {
            LayerContent::Read(objects) => objects,
            LayerContent::Compiled(objects) => objects.all_objects(),
        }
    }

    fn object_at(&self, place: usize) -> Option<&ObjectEntry> {
        match &self.content {
            LayerContent::Read(objects) => objects.get(place),
            LayerContent::Compiled(objects) => objects.object_at(place),
        }
    }

    /// Adds the objects that decide the meaning of others.
    pub(super) fn collect_deciding(&self, all: &mut Vec<ObjectAddress>) {
        let places = 0..self.positions.spans.len();
        let candidates = places.filter(|place| match &self.content {
            LayerContent::Read(_) => true,
            LayerContent::Compiled(objects) => objects.source.may_depend(*place),
        });
        candidates.filter_map(|place| self.object_at(place)).for_each(|object| object.collect_deciding(all));
    }

    /// Objects with this index, with their repeat number.
    pub(super) fn objects_at(&self, index: u16) -> impl Iterator<Item = (&ObjectEntry, u16)> {
        self.positions.positions_at(index).filter_map(move |place| {
            let object = self.object_at(place)?;
            Some((object, object.repeat_of(index)?))
        })
    }

    /// Whether the layer describes this entry.
    pub(super) fn has_object(&self, address: ObjectAddress) -> bool {
        self.objects_at(address.index).any(|(object, _)| object.entry(address.sub).is_some())
    }

    /// Adds the addresses with sub-index 0 or 1 that `picks` accepts and that have a default.
    pub(super) fn collect_defaults(
        &self,
        picks: impl Fn(ObjectAddress) -> bool,
        found: &mut Vec<ObjectAddress>,
    ) {
        let ObjectPositions { spans, repeats, .. } = &self.positions;
        for (place, ((first, _), (count, stride))) in spans.iter().zip(repeats).enumerate() {
            for sub in [0, 1] {
                let picked = |nth: u16| {
                    let address = ObjectAddress::new(first.wrapping_add(nth.wrapping_mul(*stride)), sub);
                    picks(address).then_some(address)
                };
                let mut addresses = (0..(*count).min(MOST_REPEATS)).filter_map(picked).peekable();
                let has_default = || self.object_at(place)?.entry(sub)?.default.as_ref();
                if addresses.peek().is_some() && has_default().is_some() {
                    found.extend(addresses);
                }
            }
        }
    }
}

impl CompiledObjects {
    fn new(source: Arc<LayerSource>, variant: Option<String>) -> Self {
        let read = source.values.iter().map(|_| OnceLock::new()).collect();
        Self { source, variant, read, all: OnceLock::new() }
    }

    fn object_at(&self, place: usize) -> Option<&ObjectEntry> {
        let read = || self.source.read_object(place, self.variant.as_deref()).map(Box::new);
        self.read.get(place)?.get_or_init(read).as_deref()
    }

    fn all_objects(&self) -> &[ObjectEntry] {
        self.all.get_or_init(|| {
            let places = 0..self.source.values.len();
            places.filter_map(|place| self.source.read_object(place, self.variant.as_deref())).collect()
        })
    }
}

impl LayerSource {
    /// Whether the meaning of an object may depend on another object; also true if a text contains the key.
    fn may_depend(&self, place: usize) -> bool {
        let value = self.values.get(place);
        value.is_some_and(|value| DEPENDENT_KEYS.iter().any(|key| value.contains(key)))
    }

    /// Reads an object. Built-in profiles have no errors: a test reads every object.
    fn read_object(&self, place: usize, variant: Option<&str>) -> Option<ObjectEntry> {
        let authored: Spanned<AuthoredEntry> = self.values.get(place)?.read_value().ok()?;
        let object = authored::convert_object(authored, &self.tables).ok()?;
        match variant {
            Some(variant) => of_variant(object, variant),
            None => Some(object),
        }
    }
}

/// Keys of an object of which at least one is required to depend on another object: those of modes, and of scales by
/// an object.
const DEPENDENT_KEYS: [&str; 2] = ["modes", "object"];

/// The entries of one variant; None if it lacks the object.
fn of_variant(mut object: ObjectEntry, variant: &str) -> Option<ObjectEntry> {
    object.entries.retain(|entry| entry.only.allows_variant(variant));
    object.only.allows_variant(variant).then_some(object)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::deciding::DecidingObjects;
    use crate::profile::device::ProfileFile;
    use crate::profile::embedded::FILES;

    fn shown(objects: &[ObjectEntry]) -> Vec<String> {
        objects.iter().map(|object| format!("{object:?}")).collect()
    }

    #[test]
    fn an_index_is_in_all_spans_that_reach_it() {
        // 1000h; 1400h to 15FFh; 1500h alone; FFF0h to FFFFh; 1400h again.
        let spans = [(0x1000, 0), (0x1400, 0x1FF), (0x1500, 0), (0xFFF0, 0xF), (0x1400, 0)];
        let ranges = IndexRanges::new(&spans);
        let expected: [(u16, &[usize]); 10] = [
            (0, &[]),
            (0x1000, &[0]),
            (0x1001, &[]),
            (0x1400, &[1, 4]),
            (0x1401, &[1]),
            (0x1500, &[1, 2]),
            (0x15FF, &[1]),
            (0x1600, &[]),
            (0xFFEF, &[]),
            (0xFFFF, &[3]),
        ];
        for (index, places) in expected {
            assert_eq!(ranges.positions_at(index), places, "{index:04X}");
        }
        assert_eq!(IndexRanges::new(&[]).positions_at(0x1000), [0_usize; 0]);
    }

    #[test]
    fn compiled_objects_are_those_of_the_text() {
        let (mut files, mut count, mut deciders) = (0, 0, 0);
        for (path, text, compiled) in FILES {
            // The other files are tables of another form.
            let Ok(read) = ProfileFile::parse(text) else { continue };
            let lazy = ProfileFile::from_compiled(compiled, text).unwrap();
            files += 1;
            assert_eq!(shown(read.objects()), shown(lazy.objects()), "{path}");
            let variants = read.variants().iter().map(|variant| Some(variant.id.as_str())).chain([None]);
            for variant in variants {
                let [read, lazy] = [&read, &lazy].map(|file| file.build_device(variant, &[]).dictionary);
                // Single objects first, before all of them are read.
                for object in read.own_objects() {
                    for entry in &object.entries {
                        let address = ObjectAddress::new(object.index, entry.sub);
                        let [of_text, compiled] =
                            [&read, &lazy].map(|it| format!("{:?}", it.find_object(address)));
                        assert_eq!(of_text, compiled, "{path}");
                        count += 1;
                    }
                }
                let deciding = [&read, &lazy].map(|it| DecidingObjects::new(it, Vec::new()).to_vec());
                deciders += deciding[0].len();
                assert_eq!(deciding[0], deciding[1], "{path} {variant:?}");
                assert_eq!(read.defaults(|_| true), lazy.defaults(|_| true), "{path}");
                assert_eq!(shown(read.own_objects()), shown(lazy.own_objects()), "{path} {variant:?}");
            }
        }
        assert!(files >= 9 && count > 1_000 && deciders >= 5, "{count} {deciders}");
    }
}
