//! The visible time range.

/// The visible time range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeWindow {
    pub(super) from: i64,
    /// End, inclusive.
    pub(super) to: i64,
    pub(super) gap: Option<i64>,
    /// No value applies after this time.
    pub(super) until: i64,
}

impl TimeWindow {
    pub(super) fn contains(&self, time: i64) -> bool {
        (self.from..=self.to).contains(&time)
    }

    /// Whether the distance of two times is longer than the gap, so that no line joins them.
    pub(super) fn is_gap(&self, earlier: i64, later: i64) -> bool {
        self.gap.is_some_and(|gap| later.saturating_sub(earlier) > gap)
    }

    /// Last visible time at which a value may apply.
    pub(super) fn last_time(&self) -> i64 {
        self.to.min(self.until)
    }

    /// Length in ns.
    pub(super) fn span(&self) -> u64 {
        self.to.abs_diff(self.from).saturating_add(1)
    }

    /// Column of a time: -1 before the window, `columns` after it.
    pub(super) fn column_of(&self, time: i64, columns: u32) -> i64 {
        if time < self.from {
            -1
        } else if time > self.to {
            i64::from(columns)
        } else {
            let at = u128::from(time.abs_diff(self.from)) * u128::from(columns) / u128::from(self.span());
            i64::try_from(at).unwrap_or(i64::MAX)
        }
    }

    /// First time of a column.
    pub(super) fn time_of(&self, column: u32, columns: u32) -> i64 {
        let after = (u128::from(column) * u128::from(self.span())).div_ceil(u128::from(columns.max(1)));
        u64::try_from(after)
            .ok()
            .and_then(|after| self.from.checked_add_unsigned(after))
            .unwrap_or(self.to)
            .min(self.to)
    }
}
