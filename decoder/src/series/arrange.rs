//! Several captures on a common time axis.

use std::fmt;

use super::names::name_pattern;
use super::part::SeriesRelation;
use crate::frame::Timestamp;

/// Some captures have dates, others count from their start, so they have no common time axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MixedClocks;

impl fmt::Display for MixedClocks {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(
            "some of these captures have dates, others count from their start, so they have no common time axis; open \
             them one by one",
        )
    }
}

impl std::error::Error for MixedClocks {}

/// Position of a capture among the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CapturePlacement {
    /// Index of the capture among the names.
    pub index: usize,
    /// Captures with the same number are parts of one capture.
    pub group: usize,
    /// Nanoseconds added to the timestamps.
    pub shift: i64,
    /// The capture before this one is its previous part.
    pub continues: bool,
}

/// Arranges captures by their relations and the times of their first frames: parts of a series follow each
/// other. With `align` all start together with the latest one, and captures that differ only in digits are
/// parts of one capture.
///
/// # Errors
/// Some captures have dates and others do not.
pub fn arrange_captures(
    names: &[String],
    firsts: &[Option<Timestamp>],
    relations: &[SeriesRelation],
    align: bool,
) -> Result<Vec<CapturePlacement>, MixedClocks> {
    let times: Vec<Timestamp> = firsts.iter().flatten().copied().collect();
    let latest = times.iter().copied().max().unwrap_or_default();
    if !align && names.len() > 1 {
        let dated = times.iter().filter(|time| time.has_date()).count();
        if dated != 0 && dated != firsts.len() {
            return Err(MixedClocks);
        }
    }
    let relation = |index: usize| relations.get(index).copied().unwrap_or_default();
    let group = |index: usize| {
        if align {
            let stem = names.get(index).map(|name| name_pattern(name));
            return names.iter().position(|other| Some(name_pattern(other)) == stem).unwrap_or(index);
        }
        let mut first = index;
        // Relations have no cycle; the limit guards against one.
        for _ in 0..names.len() {
            match relation(first) {
                SeriesRelation::Continues(before) | SeriesRelation::Later(before) => first = before,
                SeriesRelation::Independent => break,
            }
        }
        first
    };
    let shift = |index: usize| {
        let first = firsts.get(index).copied().flatten().filter(|_| align);
        first.map_or(0, |first| latest.since(first))
    };
    let place =
        |index| CapturePlacement { index, group: group(index), shift: shift(index), continues: false };
    let mut all = Vec::new();
    for start in (0..names.len()).filter(|index| !matches!(relation(*index), SeriesRelation::Continues(_))) {
        all.push(place(start));
        let mut last = start;
        while let Some(next) =
            (0..names.len()).find(|index| relation(*index) == SeriesRelation::Continues(last))
        {
            all.push(CapturePlacement { continues: true, ..place(next) });
            last = next;
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[expect(clippy::unnecessary_wraps, reason = "captures without timestamps have none")]
    fn at(seconds: i64) -> Option<Timestamp> {
        Some(Timestamp(seconds * 1_000_000_000))
    }

    #[test]
    fn parts_follow_each_other_and_clocks_are_not_mixed() {
        use SeriesRelation::{Continues, Independent, Later};
        let names = ["b-2.log", "other.log", "b-1.log", "b-3.log"].map(str::to_owned);
        let firsts = [at(2), at(2), at(1), at(90)];
        let relations = [Continues(2), Independent, Independent, Later(0)];
        let all = arrange_captures(&names, &firsts, &relations, false).unwrap();
        let all: Vec<_> = all.iter().map(|one| (one.index, one.group, one.continues)).collect();
        assert_eq!(all, [(1, 1, false), (2, 2, false), (0, 2, true), (3, 2, false)]);
        let mixed = [at(1), at(2), at(1_700_000_000), at(3)];
        assert!(arrange_captures(&names, &mixed, &[], false).is_err());
        assert!(arrange_captures(&names[..1], &[None], &[], false).is_ok());
    }

    #[test]
    fn aligned_captures_start_together_and_share_buses_by_name() {
        let names = ["run.log", "run-0002.log", "other.log"].map(str::to_owned);
        let all = arrange_captures(&names, &[at(1), None, at(3)], &[], true).unwrap();
        let all: Vec<_> = all.iter().map(|one| (one.group, one.shift)).collect();
        assert_eq!(all, [(0, 2_000_000_000), (0, 0), (2, 0)]);
    }
}
