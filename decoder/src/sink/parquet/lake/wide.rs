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
use super::day::PartitionDay;
use crate::event::Event;
use crate::profile::PayloadLayout;
use crate::query::record::FieldValue;
use crate::session::Bus;
use crate::sink::Output;
use crate::sink::parquet::table::{ColumnHeading, ColumnType, RowCell, TableWriter, optional_column};
use crate::sink::parquet::time::micros_of_date;
use crate::sink::values::{self, EventValues, FieldNames, GroupNames, ValueGroupKey};

/// Maximum number of messages, each with an open file.
const MOST_MESSAGES: usize = 256;

/// Maximum number of files of a capture; a clock without sense must not create any number of them.
const MOST_FILES: usize = 4_096;

/// Maximum buffered size per message, in bytes.
const MOST_BYTES: usize = 1024 * 1024;

/// Table of one message and day.
struct WideTable {
    day: PartitionDay,
    layout: Arc<PayloadLayout>,
    fields: Vec<FieldNames>,
    table: TableWriter<Output>,
}

/// Tables of all messages of a capture.
#[derive(Default)]
pub(super) struct WideTables {
    open: BTreeMap<ValueGroupKey, WideTable>,
    /// Number of files per message and day.
    files: BTreeMap<(ValueGroupKey, PartitionDay), usize>,
    created: usize,
    /// Messages without a table.
    skipped: BTreeSet<ValueGroupKey>,
}

impl WideTables {
    /// Adds the values of an event as one row.
    ///
    /// # Errors
    /// If a file cannot be created or written.
    pub(super) fn add_row(
        &mut self,
        event: &Event,
        bus: &Bus,
        day: PartitionDay,
        files: &mut dyn LakeFiles,
    ) -> io::Result<()> {
        let Some(carried) = values::carried_values(event) else { return Ok(()) };
        let known = self.open.get(&carried.group);
        if !known.is_some_and(|known| known.day == day && Arc::ptr_eq(&known.layout, carried.layout)) {
            let is_full = known.is_none() && self.open.len() >= MOST_MESSAGES;
            if is_full || self.created >= MOST_FILES {
                if self.skipped.len() < MOST_MESSAGES {
                    self.skipped.insert(carried.group);
                }
                return Ok(());
            }
            self.begin_file(&carried, bus, day, files)?;
        }
        let Some(own) = self.open.get_mut(&carried.group) else { return Ok(()) };
        let mut cells = vec![RowCell::Null; own.fields.len().saturating_add(1)];
        for (signal, (place, names)) in carried.zip_values(own.fields.iter_mut().enumerate()) {
            let reading = values::signal_reading(&signal, &mut names.label);
            if let Some(cell) = cells.get_mut(place.saturating_add(1)) {
                *cell = number_cell(reading.value);
            }
        }
        if let Some(cell) = cells.first_mut() {
            *cell = micros_of_date(event.time);
        }
        own.table.push(&cells)
    }

    /// Ends the present file of a message and starts the next one: a new day, or other signals.
    fn begin_file(
        &mut self,
        carried: &EventValues<'_>,
        bus: &Bus,
        day: PartitionDay,
        files: &mut dyn LakeFiles,
    ) -> io::Result<()> {
        let GroupNames { group, fields } = GroupNames::names_of(carried, bus);
        let layout = Arc::clone(carried.layout);
        if let Some(mut before) = self.open.remove(&carried.group) {
            let names =
                |fields: &[FieldNames]| fields.iter().map(|field| field.name.clone()).collect::<Vec<_>>();
            if before.day == day && names(&before.fields) == names(&fields) {
                // Another scale of the same signals.
                self.open.insert(carried.group, WideTable { layout, fields, ..before });
                return Ok(());
            }
            before.table.finish_table()?;
        }
        self.created = self.created.saturating_add(1);
        let number = self.files.entry((carried.group, day)).or_default();
        *number = number.saturating_add(1);
        // The group of all buses but the first starts with the bus.
        let message =
            group.strip_prefix(bus.name()).map_or(group.as_str(), |rest| rest.trim_start_matches('/'));
        let message = format!("{}_{}", bus.name(), message.replace('/', "_"));
        let output = files.create_wide(&message, &day.to_string(), *number)?;
        let table = TableWriter::with_limit(output, &wide_headings(&fields), &[], MOST_BYTES)?;
        self.open.insert(carried.group, WideTable { day, layout, fields, table });
        Ok(())
    }

    /// Number of messages without a table.
    pub(super) fn skipped_count(&self) -> usize {
        self.skipped.len()
    }

    /// Ends all files.
    ///
    /// # Errors
    /// If one of them cannot be written.
    pub(super) fn finish_files(&mut self) -> io::Result<()> {
        std::mem::take(&mut self.open).into_values().try_for_each(|mut own| own.table.finish_table())
    }
}

/// `t`, and a column per signal; a name that repeats gets a number.
fn wide_headings(fields: &[FieldNames]) -> Vec<ColumnHeading> {
    let mut known = BTreeSet::from(["t".to_owned()]);
    let mut all = vec![optional_column("t", ColumnType::Time)];
    for (field, place) in fields.iter().zip(1_usize..) {
        let name =
            if known.contains(&field.name) { format!("{} {place}", field.name) } else { field.name.clone() };
        known.insert(name.clone());
        all.push(ColumnHeading { name: Cow::Owned(name), kind: ColumnType::Real, is_optional: true });
    }
    all
}

#[expect(clippy::cast_precision_loss, reason = "`signals` has the exact bits")]
fn number_cell(value: FieldValue<'_>) -> RowCell<'static> {
    match value {
        FieldValue::Unsigned(value) => RowCell::Real(value as f64),
        FieldValue::Integer(value) => RowCell::Real(value as f64),
        FieldValue::Real(value) if value.is_finite() => RowCell::Real(value),
        _ => RowCell::Null,
    }
}
