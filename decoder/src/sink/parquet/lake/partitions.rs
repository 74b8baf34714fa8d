//! One table of the lake: a file per day.

use std::collections::BTreeMap;
use std::io;

use super::capture::LakeFiles;
use super::day::PartitionDay;
use crate::frame::Timestamp;
use crate::sink::Output;
use crate::sink::parquet::table::{ColumnHeading, RowCell, TableWriter};

/// Days of which a file is open. A capture passes midnight in order; a clock that was set goes back once.
const OPEN_DAYS: usize = 3;

/// Files of one table of a capture; a clock without sense must not create any number of files. Later rows have no day.
const MOST_FILES: usize = 1_000;

/// Name of the constant column.
pub(super) const HASH: &str = "capture_hash";

/// Receives a row: the time that determines its day, and its cells.
pub(super) type PushRow<'a> = &'a mut dyn FnMut(Option<Timestamp>, &[RowCell<'_>]) -> io::Result<()>;

/// Rows of one table of a capture.
pub(super) struct TablePartitions {
    table: &'static str,
    headings: &'static [ColumnHeading],
    hash: String,
    /// Open files, that of the last row first.
    open: Vec<(PartitionDay, TableWriter<Output>)>,
    /// Number of files per day.
    files: BTreeMap<PartitionDay, usize>,
    created: usize,
    rows: u64,
}

impl TablePartitions {
    pub(super) fn new(table: &'static str, headings: &'static [ColumnHeading], hash: &str) -> Self {
        Self {
            table,
            headings,
            hash: hash.to_owned(),
            open: Vec::new(),
            files: BTreeMap::new(),
            created: 0,
            rows: 0,
        }
    }

    /// Number of rows.
    pub(super) fn row_count(&self) -> u64 {
        self.rows
    }

    /// Adds a row to the file of a day.
    ///
    /// # Errors
    /// If the file cannot be created or written.
    pub(super) fn push(
        &mut self,
        day: PartitionDay,
        files: &mut dyn LakeFiles,
        cells: &[RowCell<'_>],
    ) -> io::Result<()> {
        if self.open.first().is_none_or(|(open, _)| *open != day) {
            self.turn_to(day, files)?;
        }
        self.rows = self.rows.saturating_add(1);
        self.open.first_mut().map_or(Ok(()), |(_, table)| table.push(cells))
    }

    /// Makes the file of a day the first open one.
    fn turn_to(&mut self, day: PartitionDay, files: &mut dyn LakeFiles) -> io::Result<()> {
        let day = if self.created >= MOST_FILES { PartitionDay::Unknown } else { day };
        if let Some(place) = self.open.iter().position(|(open, _)| *open == day) {
            self.open.get_mut(..=place).unwrap_or_default().rotate_right(1);
            return Ok(());
        }
        if self.open.len() >= OPEN_DAYS
            && let Some((_, mut oldest)) = self.open.pop()
        {
            oldest.finish_table()?;
        }
        self.created = self.created.saturating_add(1);
        let number = self.files.entry(day).or_default();
        *number = number.saturating_add(1);
        let output = files.create_file(self.table, &day.to_string(), *number)?;
        let table = TableWriter::new(output, self.headings, &[(HASH, &self.hash)])?;
        self.open.insert(0, (day, table));
        Ok(())
    }

    /// Ends all files.
    ///
    /// # Errors
    /// If one of them cannot be written.
    pub(super) fn finish_files(&mut self) -> io::Result<()> {
        self.open.drain(..).try_for_each(|(_, mut table)| table.finish_table())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::sink::parquet::table::{ColumnType, required_column};

    const HEADINGS: &[ColumnHeading] = &[required_column("n", ColumnType::Number)];

    #[derive(Default)]
    struct Names(Arc<Mutex<Vec<String>>>);

    impl LakeFiles for Names {
        fn create_file(&mut self, table: &'static str, day: &str, number: usize) -> io::Result<Output> {
            self.0.lock().unwrap().push(format!("{table} {day} {number}"));
            Ok(Box::new(io::sink()))
        }

        fn create_wide(&mut self, _message: &str, day: &str, number: usize) -> io::Result<Output> {
            self.create_file("wide", day, number)
        }
    }

    fn created(days: impl Iterator<Item = i64>) -> Vec<String> {
        let mut calendar = super::super::day::DayCalendar::new(None);
        let mut files = Names::default();
        let mut table = TablePartitions::new("t", HEADINGS, "00");
        for day in days {
            let time = Timestamp((20_000 + day) * 86_400_000_000_000);
            table.push(calendar.day_of(Some(time)), &mut files, &[RowCell::Number(day)]).unwrap();
        }
        table.finish_files().unwrap();
        files.0.lock().unwrap().clone()
    }

    /// Day 20,000 since 1970 is 2024-10-04.
    #[test]
    fn the_file_of_a_day_stays_open_for_a_while() {
        assert_eq!(
            created([0, 1, 0, 2, 1].into_iter()),
            ["t 2024-10-04 1", "t 2024-10-05 1", "t 2024-10-06 1"]
        );
        let many = created([0, 1, 2, 3, 0].into_iter());
        assert_eq!(many.last().map(String::as_str), Some("t 2024-10-04 2"));
    }

    #[test]
    fn a_clock_without_sense_does_not_fill_the_disk_with_files() {
        let names = created((0..1_500).map(|n| n * 7));
        assert_eq!(names.len(), 1_001);
        assert_eq!(names.last().map(String::as_str), Some("t unknown 1"));
        // Four days in turn exceed the open ones each time.
        let names = created((0..5_000).map(|n| n % 4));
        assert_eq!(names.len(), 1_001);
        assert_eq!(names.last().map(String::as_str), Some("t unknown 1"));
    }
}
