//! Rows of the objects of one node.
//!
//! ```text
//! 6300:01  Spool set point  37.5 %  00 18  sent {69}  3.194 s
//! ```

use std::cmp::Ordering;

use cobscope_decoder::comparison::Difference;
use cobscope_decoder::profile::{DecodedValue, Dictionary, ObjectMeaning, Persistence, as_integer};
use cobscope_decoder::session::{Bus, Buses, Node, StoredObject};
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::canopen::ObjectAddress;
use cobscope_decoder::words::count_noun;

use crate::panes::meaning;
use crate::state::{DIFFERS, NodeKey, UiState, other_value};
use crate::theme::TextRole;

/// Maximum number of bytes in the column `Raw`.
const SHOWN_BYTES: usize = 4;
/// Maximum number of default objects that a search covers.
const MOST_DELIVERED: usize = 16_384;

/// The node shown.
pub(super) struct ObjectsNode<'a> {
    bus: &'a Bus,
    node: &'a Node,
}

/// An object of the node.
pub(super) struct KnownObject<'a> {
    address: ObjectAddress,
    /// Known value; None for a default or a pending value only.
    entry: Option<&'a StoredObject>,
    meaning: Option<ObjectMeaning>,
}

impl KnownObject<'_> {
    /// Index and sub-index.
    pub(super) fn address(&self) -> ObjectAddress {
        self.address
    }

    /// Frame that carried the value.
    pub(super) fn frame(&self) -> Option<u64> {
        self.entry.map(|entry| entry.origin.frame).filter(|frame| *frame > 0)
    }
}

/// Nodes with known objects.
pub(super) fn known_nodes(core: &UiState) -> Vec<NodeKey> {
    let buses = core.bus_state().map_or(Buses::default(), |world| world.buses());
    let of = |bus: &Bus| {
        let nodes = bus.nodes().filter(|node| !node.store().is_empty());
        nodes.map(|node| (bus.index(), node.id())).collect::<Vec<_>>()
    };
    buses.iter().flat_map(of).collect()
}

impl<'a> ObjectsNode<'a> {
    /// The selected node, else the node of the row at the cursor, else the first node with known objects.
    pub(super) fn selected_node(core: &'a UiState) -> Option<Self> {
        let world = core.bus_state()?;
        let get = |(index, id): NodeKey| {
            let bus = world.buses().iter().find(|bus| bus.index() == index)?;
            Some(Self { bus, node: bus.node(id)? })
        };
        if let Some(subject) = core.node.and_then(get) {
            return Some(subject);
        }
        let of_row = core.cursor_row().and_then(|row| get((row.event.bus, row.event.node?)));
        let has_objects = |subject: &Self| !subject.node.store().is_empty();
        of_row.filter(has_objects).or_else(|| known_nodes(core).into_iter().next().and_then(get))
    }

    /// Bus and id of the node.
    pub(super) fn key(&self) -> NodeKey {
        (self.bus.index(), self.node.id())
    }

    /// `node 32/20 boom on can0, Danfoss PVE`.
    pub(super) fn label(&self) -> String {
        let name = self.node.name().map_or(String::new(), |name| format!(" {name}"));
        let device = self.node.device_title().map_or(String::new(), |title| format!(", {title}"));
        format!("{}{name} on {}{device}", self.node.id().sentence_label(), self.bus.name())
    }

    /// Difference of an object from the other capture.
    fn difference_of<'c>(&self, core: &'c UiState, known: &KnownObject<'_>) -> Option<&'c Difference> {
        core.against.difference_of(self.bus.name(), self.node.id(), known.address)
    }

    /// Number of objects that differ from the other capture.
    pub(super) fn difference_count(&self, core: &UiState) -> usize {
        core.against.objects_that_differ(self.bus.name(), self.node.id())
    }

    /// Objects by address; with a search only the matching ones.
    pub(super) fn object_rows(&self, search: &str) -> Vec<KnownObject<'a>> {
        let store = self.node.store();
        let mut all: Vec<(ObjectAddress, Option<&'a StoredObject>)> =
            store.sorted().into_iter().map(|(address, entry)| (address, Some(entry))).collect();
        let waiting = store.all_waiting().map(|(address, _)| address);
        let more: Vec<_> = waiting.filter(|address| store.get(*address).is_none()).collect();
        all.extend(more.into_iter().map(|address| (address, None)));
        if !search.is_empty() {
            let delivered = default_addresses(&self.node.device().dictionary);
            all.extend(delivered.into_iter().filter(|at| store.get(*at).is_none()).map(|at| (at, None)));
        }
        all.sort_unstable_by_key(|(address, _)| *address);
        all.dedup_by_key(|(address, _)| *address);
        let known = |(address, entry)| KnownObject { address, entry, meaning: self.node.meaning(address) };
        all.into_iter().map(known).filter(|known| matches_search(known, search)).collect()
    }

    /// Text of a cell.
    pub(super) fn cell_text(&self, core: &UiState, known: &KnownObject<'_>, column: usize) -> String {
        let text = match column {
            0 => known.address.to_string(),
            1 => known.meaning.as_ref().map_or(String::new(), |meaning| meaning.name.clone()),
            2 => match self.difference_of(core, known) {
                Some(difference) => {
                    format!("{} {DIFFERS} {}", self.value_text(known), other_value(difference))
                }
                None => self.value_text(known),
            },
            3 => known.entry.map_or(String::new(), raw_text),
            4 => match known.entry {
                Some(entry) if entry.origin.frame > 0 => {
                    format!("{} {{{}}}", entry.origin.kind.origin_text(), entry.origin.frame)
                }
                Some(entry) => origin_text(entry),
                None if self.is_delivered(known) => "default".into(),
                None => String::new(),
            },
            5 => value_age(core, known).map_or(String::new(), format_seconds),
            6 => known
                .entry
                .and_then(|_| self.node.persistence_text(known.address))
                .map_or("", storage_text)
                .into(),
            _ => self.pending_text(known),
        };
        escape(&text).into_owned()
    }

    /// Role of a cell; None for normal text.
    pub(super) fn cell_role(
        &self,
        core: &UiState,
        known: &KnownObject<'_>,
        column: usize,
    ) -> Option<TextRole> {
        let is_outside = known.meaning.as_ref().is_some_and(|meaning| {
            known.entry.is_some_and(|entry| meaning.is_outside(&meaning.decode(&entry.value)))
        });
        match (known.entry, column) {
            (_, 2) if is_outside => Some(TextRole::Bad),
            (_, 2) if self.difference_of(core, known).is_some() => Some(TextRole::Caution),
            (_, 7) => Some(TextRole::Caution),
            (None, _) | (Some(_), 3..=6) => Some(TextRole::Quiet),
            _ => None,
        }
    }

    /// The details of an object.
    pub(super) fn detail_lines(&self, core: &UiState, known: &KnownObject<'_>) -> Vec<String> {
        let name = known.meaning.as_ref().map_or("unknown object", |meaning| &meaning.name);
        let origin = known.entry.map_or(String::new(), |entry| {
            let stale =
                if entry.stale { ", presumed: node restarted since, or value from a DCF" } else { "" };
            format!(", {}{stale}", meaning::origin_text(core, entry))
        });
        let mut lines = vec![format!("{} {name} = {}{origin}", known.address, self.value_text(known))];
        lines.extend(self.difference_of(core, known).map(|difference| against_line(core, difference)));
        if let Some(entry) = known.entry {
            let data = entry.value.iter().take(LONGEST).map(|byte| format!("{byte:02X}"));
            let more = if entry.size > LONGEST as u64 { " …" } else { "" };
            let bytes = count_noun(entry.size, "byte");
            lines.push(format!("{bytes}: {}{more}", data.collect::<Vec<_>>().join(" ")));
        }
        let waits = self.pending_text(known);
        if !waits.is_empty() {
            lines.push(format!("pending: {waits}"));
        }
        let keeps = known.entry.and_then(|_| self.node.persistence_text(known.address));
        lines.extend(keeps.map(|keeps| format!("after a restart: {}", keeps_in_full(keeps))));
        if let (Some(about), Some(entry)) = (&known.meaning, known.entry) {
            meaning::of_value(core, Some(self.node), about, &about.decode(&entry.value), &mut lines);
        }
        lines.iter().map(|line| escape(line).into_owned()).collect()
    }

    /// Compares two rows by a column; numeric values as numbers.
    pub(super) fn compare_objects(
        &self,
        one: &KnownObject<'_>,
        other: &KnownObject<'_>,
        column: usize,
    ) -> Ordering {
        let name = |known: &KnownObject<'_>| known.meaning.as_ref().map(|meaning| meaning.name.clone());
        let time = |known: &KnownObject<'_>| known.entry.and_then(|entry| entry.origin.time);
        let frame = |known: &KnownObject<'_>| {
            known.entry.map(|entry| (entry.origin.kind.origin_text(), entry.origin.frame))
        };
        let bytes = |known: &KnownObject<'_>| known.entry.map(|entry| entry.value.clone());
        let keeps =
            |known: &KnownObject<'_>| known.entry.and_then(|_| self.node.persistence_text(known.address));
        match column {
            1 => name(one).cmp(&name(other)),
            2 => match (numeric_value(one), numeric_value(other)) {
                (Some(one), Some(other)) => one.total_cmp(&other),
                _ => self.value_text(one).cmp(&self.value_text(other)),
            },
            3 => bytes(one).cmp(&bytes(other)),
            4 => frame(one).cmp(&frame(other)),
            // Ascending age: the latest first.
            5 => time(other).cmp(&time(one)),
            6 => keeps(one).map(Persistence::name).cmp(&keeps(other).map(Persistence::name)),
            7 => self.pending_text(other).cmp(&self.pending_text(one)),
            _ => one.address.cmp(&other.address),
        }
    }

    fn value_text(&self, known: &KnownObject<'_>) -> String {
        let Some(entry) = known.entry else {
            let found = self.node.device().dictionary.find_object(known.address);
            let raw = found.and_then(|found| found.entry?.default_number(Some(self.node.id().number())));
            let shown = raw
                .zip(known.meaning.as_ref())
                .map(|(raw, meaning)| meaning.format_value(&meaning.convert_raw(raw)));
            return shown.unwrap_or_default();
        };
        let value = match known.meaning.as_ref().map(|meaning| (meaning, meaning.decode(&entry.value))) {
            Some((_, DecodedValue::Bytes(_))) | None => String::new(),
            Some((meaning, value)) => meaning.format_value(&value),
        };
        let stale = if entry.stale { "?" } else { "" };
        format!("{value}{stale}")
    }

    fn is_delivered(&self, known: &KnownObject<'_>) -> bool {
        let found = self.node.device().dictionary.find_object(known.address);
        found.and_then(|found| found.entry).is_some_and(|entry| entry.default.is_some())
    }

    /// `33 after reset node {88}`.
    fn pending_text(&self, known: &KnownObject<'_>) -> String {
        let Some(waiting) = self.node.store().waiting_value(known.address) else { return String::new() };
        let value = match &known.meaning {
            Some(meaning) => meaning.format_value(&meaning.decode(&waiting.value)),
            None => DecodedValue::Bytes(waiting.value.clone()).to_string(),
        };
        format!("{value} {}{}", waiting.effect.time_text(), waiting.origin.origin_place())
    }
}

/// `≠ good.log: 500 ms, frame 4`: value of the other capture.
fn against_line(core: &UiState, difference: &Difference) -> String {
    let name = core.against.compared_name().unwrap_or_default();
    let frame = difference.good.as_ref().map_or(0, |value| value.mark.frame);
    let frame = if frame == 0 { String::new() } else { format!(", frame {frame}") };
    let note = if difference.note.is_empty() { String::new() } else { format!(" ({})", difference.note) };
    format!("{DIFFERS} {name}: {}{frame}{note}", other_value(difference))
}

/// Origin of a value that no frame carried.
fn origin_text(entry: &StoredObject) -> String {
    match entry.origin.kind {
        cobscope_decoder::session::OriginKind::BusFile => "bus file".into(),
        cobscope_decoder::session::OriginKind::DeviceFile => "DCF".into(),
        kind => format!("{} before", kind.origin_text()),
    }
}

/// Maximum number of bytes in the details.
const LONGEST: usize = 64;

fn raw_text(entry: &StoredObject) -> String {
    let shown = entry.value.iter().take(SHOWN_BYTES).map(|byte| format!("{byte:02X}"));
    let more = if entry.size > SHOWN_BYTES as u64 { "…" } else { "" };
    format!("{}{more}", shown.collect::<Vec<_>>().join(" "))
}

fn value_age(core: &UiState, known: &KnownObject<'_>) -> Option<i64> {
    Some(core.cursor_time()?.since(known.entry?.origin.time?))
}

/// `0.194 s`, `12 s`, `3 min`.
fn format_seconds(nanoseconds: i64) -> String {
    let milliseconds = nanoseconds / 1_000_000;
    match milliseconds.abs() {
        ..100_000 => format!("{}.{:03} s", milliseconds / 1_000, milliseconds.abs() % 1_000),
        100_000..6_000_000 => format!("{} s", milliseconds / 1_000),
        _ => format!("{} min", milliseconds / 60_000),
    }
}

const fn storage_text(persistence: Persistence) -> &'static str {
    match persistence {
        Persistence::Yes => "yes",
        Persistence::No => "no",
        Persistence::NeedsSave | Persistence::NotStored => "unsaved",
    }
}

const fn keeps_in_full(persistence: Persistence) -> &'static str {
    match persistence {
        Persistence::Yes => "kept",
        Persistence::No => "lost",
        Persistence::NeedsSave | Persistence::NotStored => "lost: not saved since it was written",
    }
}

fn numeric_value(known: &KnownObject<'_>) -> Option<f64> {
    let (meaning, entry) = (known.meaning.as_ref()?, known.entry?);
    let value = meaning.decode(&entry.value);
    #[expect(clippy::cast_precision_loss, reason = "only used for sorting")]
    meaning.scaled_value(&value).or_else(|| as_integer(&value).map(|number| number as f64))
}

/// Whether address and name contain all words of a search.
fn matches_search(known: &KnownObject<'_>, search: &str) -> bool {
    let name = known.meaning.as_ref().map_or("", |meaning| &meaning.name);
    let text = format!("0x{} {name}", known.address).to_lowercase();
    search.to_lowercase().split_whitespace().all(|word| text.contains(word))
}

/// Addresses with a default value in the profile or EDS.
fn default_addresses(dictionary: &Dictionary) -> Vec<ObjectAddress> {
    let mut all = Vec::new();
    for object in dictionary.own_objects() {
        for nth in 0..object.repeat.count {
            let index = object.index.wrapping_add(nth.wrapping_mul(object.repeat.stride));
            for entry in object.entries.iter().filter(|entry| entry.default.is_some()) {
                all.extend((entry.sub..=entry.to).map(|sub| ObjectAddress::new(index, sub)));
            }
            if all.len() >= MOST_DELIVERED {
                return all;
            }
        }
    }
    all
}
