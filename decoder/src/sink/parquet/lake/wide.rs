//! Values side by side: one table per message, as the decoders of CSS Electronics write them.
//!
//! ```text
//! wide/<machine>/<bus>_<message>/<yyyy>/<mm>/<dd>/<hash>.parquet     t, one column per signal
//! ```

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::sync::Arc;

use super::capture::LakeFiles;
use super::day::Day;
use crate::event::Event;
use crate::profile::Layout;
use crate::query::record::FieldValue;
use crate::session::Bus;
use crate::sink::Output;
use crate::sink::parquet::table::{Cell, Heading, Kind, Table, maybe};
use crate::sink::parquet::time::micros_of_date;
use crate::sink::values::{self, EventValues, FieldNames, Group, GroupNames};

/// Maximum number of messages, each with an open file.
const MOST_MESSAGES: usize = 256;

/// Maximum number of files of a capture; a clock without sense must not create any number of them.
const MOST_FILES: usize = 4_096;

/// Maximum buffered size per message, in bytes.
const MOST_BYTES: usize = 1024 * 1024;

/// Table of one message and day.
struct WideTable {
    day: Day,
    layout: Arc<Layout>,
    fields: Vec<FieldNames>,
    table: Table<Output>,
}

/// Tables of all messages of a capture.
#[derive(Default)]
pub(super) struct WideTables {
    open: BTreeMap<Group, WideTable>,
    /// Number of files per message and day.
    files: BTreeMap<(Group, Day), usize>,
    created: usize,
    /// Messages without a table.
    skipped: BTreeSet<Group>,
}

impl WideTables {
    /// Adds the values of an event as one row.
    ///
    /// # Errors
    /// If a file cannot be created or written.
    pub(super) fn row(
        &mut self,
        event: &Event,
        bus: &Bus,
        day: Day,
        files: &mut dyn LakeFiles,
    ) -> io::Result<()> {
        let Some(carried) = values::carried(event) else { return Ok(()) };
        let known = self.open.get(&carried.group);
        if !known.is_some_and(|known| known.day == day && Arc::ptr_eq(&known.layout, carried.layout)) {
            let is_full = known.is_none() && self.open.len() >= MOST_MESSAGES;
            if is_full || self.created >= MOST_FILES {
                if self.skipped.len() < MOST_MESSAGES {
                    self.skipped.insert(carried.group);
                }
                return Ok(());
            }
            self.begin(&carried, bus, day, files)?;
        }
        let Some(own) = self.open.get_mut(&carried.group) else { return Ok(()) };
        let mut cells = vec![Cell::Null; own.fields.len().saturating_add(1)];
        for (signal, (place, names)) in carried.with(own.fields.iter_mut().enumerate()) {
            let reading = values::reading(&signal, &mut names.label);
            if let Some(cell) = cells.get_mut(place.saturating_add(1)) {
                *cell = number(reading.value);
            }
        }
        if let Some(cell) = cells.first_mut() {
            *cell = micros_of_date(event.time);
        }
        own.table.push(&cells)
    }

    /// Ends the present file of a message and starts the next one: a new day, or other signals.
    fn begin(
        &mut self,
        carried: &EventValues<'_>,
        bus: &Bus,
        day: Day,
        files: &mut dyn LakeFiles,
    ) -> io::Result<()> {
        let GroupNames { group, fields } = GroupNames::of(carried, bus);
        let layout = Arc::clone(carried.layout);
        if let Some(mut before) = self.open.remove(&carried.group) {
            let names =
                |fields: &[FieldNames]| fields.iter().map(|field| field.name.clone()).collect::<Vec<_>>();
            if before.day == day && names(&before.fields) == names(&fields) {
                // Another scale of the same signals.
                self.open.insert(carried.group, WideTable { layout, fields, ..before });
                return Ok(());
            }
            before.table.finish()?;
        }
        self.created = self.created.saturating_add(1);
        let number = self.files.entry((carried.group, day)).or_default();
        *number = number.saturating_add(1);
        // The group of all buses but the first starts with the bus.
        let message =
            group.strip_prefix(bus.name()).map_or(group.as_str(), |rest| rest.trim_start_matches('/'));
        let message = format!("{}_{}", bus.name(), message.replace('/', "_"));
        let output = files.create_wide(&message, &day.to_string(), *number)?;
        let table = Table::with_limit(output, &headings(&fields), &[], MOST_BYTES)?;
        self.open.insert(carried.group, WideTable { day, layout, fields, table });
        Ok(())
    }

    /// Number of messages without a table.
    pub(super) fn skipped(&self) -> usize {
        self.skipped.len()
    }

    /// Ends all files.
    ///
    /// # Errors
    /// If one of them cannot be written.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        std::mem::take(&mut self.open).into_values().try_for_each(|mut own| own.table.finish())
    }
}

/// `t`, and a column per signal; a name that repeats gets a number.
fn headings(fields: &[FieldNames]) -> Vec<Heading> {
    let mut known = BTreeSet::from(["t".to_owned()]);
    let mut all = vec![maybe("t", Kind::Time)];
    for (field, place) in fields.iter().zip(1_usize..) {
        let name =
            if known.contains(&field.name) { format!("{} {place}", field.name) } else { field.name.clone() };
        known.insert(name.clone());
        all.push(Heading { name: Cow::Owned(name), kind: Kind::Real, is_optional: true });
    }
    all
}

#[expect(clippy::cast_precision_loss, reason = "`signals` has the exact bits")]
fn number(value: FieldValue<'_>) -> Cell<'static> {
    match value {
        FieldValue::Unsigned(value) => Cell::Real(value as f64),
        FieldValue::Integer(value) => Cell::Real(value as f64),
        FieldValue::Real(value) if value.is_finite() => Cell::Real(value),
        _ => Cell::Null,
    }
}
