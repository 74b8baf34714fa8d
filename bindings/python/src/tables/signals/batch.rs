//! A batch of values, whose repeated cells become columns on the thread of its reader.

use std::sync::{Arc, Mutex, PoisonError};

use arrow_array::ArrayRef;
use arrow_schema::ArrowError;
use cobscope_decoder::frame::Timestamp;

use crate::columns::{Key, NumberParts, dictionary_array};
use crate::tables::to_micros;

/// Cells that are equal in all rows of an event.
pub(super) struct EventCells {
    pub(super) time: Option<Timestamp>,
    pub(super) frame: u64,
    pub(super) bus: Key,
    pub(super) group: Key,
    pub(super) device: Option<Key>,
    pub(super) node: Option<u8>,
    /// Number of rows.
    pub(super) count: usize,
}

/// Numbers of the names of a signal in their dictionaries.
#[derive(Default, Clone, Copy)]
pub(super) struct SignalKeys {
    pub(super) signal: Key,
    pub(super) id: Key,
    pub(super) unit: Option<Key>,
}

/// Rows before they become columns.
#[derive(Default)]
pub(super) struct PendingSignalRows {
    pub(super) events: Vec<EventCells>,
    /// Number of the signal of each row.
    pub(super) signals: Vec<u32>,
}

impl PendingSignalRows {
    /// A cell of each event, and its number of rows.
    pub(super) fn of_events<T>(
        &self,
        cell: impl Fn(&EventCells) -> Option<T> + Clone,
    ) -> impl Iterator<Item = (Option<T>, usize)> + Clone {
        self.events.iter().map(move |event| (cell(event), event.count))
    }
}

/// Memory of rows for the next batches.
#[derive(Default, Clone)]
pub(super) struct SpareRows(Arc<Mutex<Vec<PendingSignalRows>>>);

impl SpareRows {
    /// No rows, in memory of an earlier batch if there is some.
    pub(super) fn take_spare(&self) -> PendingSignalRows {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    fn give_back(&self, mut rows: PendingSignalRows) {
        rows.events.clear();
        rows.signals.clear();
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(rows);
    }
}

/// A batch of values.
pub(super) struct SignalBatch {
    pub(super) rows: PendingSignalRows,
    pub(super) spare: SpareRows,
    /// By number of the signal.
    pub(super) keys: Vec<SignalKeys>,
    pub(super) capture: ArrayRef,
    pub(super) bus: ArrayRef,
    pub(super) device: ArrayRef,
    /// Texts of the dictionaries.
    pub(super) groups: ArrayRef,
    pub(super) signals: ArrayRef,
    pub(super) ids: ArrayRef,
    pub(super) units: ArrayRef,
    pub(super) value: ArrayRef,
    pub(super) text: ArrayRef,
    pub(super) label: ArrayRef,
    pub(super) raw: ArrayRef,
    pub(super) raw_hex: ArrayRef,
}

impl SignalBatch {
    /// All columns in the order of the schema.
    ///
    /// # Errors
    /// If a dictionary has too many texts.
    pub(super) fn into_columns(self) -> Result<Vec<ArrayRef>, ArrowError> {
        let Self { rows, keys, .. } = &self;
        let count = rows.signals.len();
        let numbers =
            |cell: fn(&EventCells) -> Option<i64>| NumberParts::of_runs(rows.of_events(cell), count);
        let names = |texts: &ArrayRef, key: fn(&SignalKeys) -> Option<Key>| {
            let keys = rows.signals.iter().map(|signal| keys.get(*signal as usize).and_then(key));
            dictionary_array(NumberParts::of_rows(keys), texts)
        };
        let columns = vec![
            numbers(|event| event.time.map(to_micros)).into_times(),
            numbers(|event| event.time.map(|Timestamp(time)| time)).into_numbers(),
            Arc::clone(&self.capture),
            Arc::clone(&self.bus),
            numbers(|event| Some(event.frame.cast_signed())).into_numbers(),
            numbers(|event| event.node.map(i64::from)).into_numbers(),
            Arc::clone(&self.device),
            dictionary_array(
                NumberParts::of_runs(rows.of_events(|event| Some(event.group)), count),
                &self.groups,
            )?,
            names(&self.signals, |keys| Some(keys.signal))?,
            names(&self.ids, |keys| Some(keys.id))?,
            Arc::clone(&self.value),
            Arc::clone(&self.text),
            names(&self.units, |keys| keys.unit)?,
            Arc::clone(&self.label),
            Arc::clone(&self.raw),
            Arc::clone(&self.raw_hex),
        ];
        self.spare.give_back(self.rows);
        Ok(columns)
    }
}
