//! Time and content of each column of the bars.
//!
//! ```text
//! start            cursor                 start + columns × column
//!   ├──────────────────┼──────────────────┤
//! ```

use crate::timeline::{LoadOverTime, LoadStep};

/// Maximum zoom; each step halves the range.
pub(super) const MOST_ZOOM: u32 = 24;

/// Times of the columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TimeAxis {
    /// Time of the first column, in ns.
    pub(super) start: i64,
    /// Duration of a column, in ns.
    pub(super) column: i64,
    /// Number of columns.
    pub(super) columns: u16,
}

/// Content of a column.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct AxisColumnContent {
    /// Bits per second of its busiest step.
    pub(super) bits: u64,
    /// Frames per second of its busiest step.
    pub(super) frames: u64,
    /// Number of error frames.
    pub(super) errors: u64,
}

impl TimeAxis {
    /// The range from `first` to `last`, or the part of it that contains the cursor.
    pub(super) fn new(first: i64, last: i64, cursor: i64, zoom: u32, columns: u16) -> Self {
        let whole = last.saturating_sub(first).max(1);
        let span = (whole >> zoom.min(MOST_ZOOM)).max(1);
        // Pages: the bars stay in place while the cursor moves. The last frame is on the last page.
        let page = cursor.saturating_sub(first).clamp(0, whole.saturating_sub(1)) / span;
        let column = (span / i64::from(columns.max(1))).saturating_add(1);
        Self { start: first.saturating_add(page.saturating_mul(span)), column, columns }
    }

    /// End of the last column.
    pub(super) fn axis_end(&self) -> i64 {
        self.start.saturating_add(self.column.saturating_mul(i64::from(self.columns)))
    }

    /// The column that contains a time.
    pub(super) fn column_of(&self, time: i64) -> Option<u16> {
        let since = time.checked_sub(self.start).filter(|since| *since >= 0)?;
        u16::try_from(since / self.column).ok().filter(|column| *column < self.columns)
    }

    /// Time of the middle of a column.
    pub(super) fn time_of(&self, column: u16) -> i64 {
        let begin = self.start.saturating_add(self.column.saturating_mul(i64::from(column)));
        begin.saturating_add(self.column / 2)
    }

    /// Content of all columns.
    pub(super) fn column_contents(&self, load: &LoadOverTime) -> Vec<AxisColumnContent> {
        (0..self.columns).map(|column| self.column_content(load, column)).collect()
    }

    fn column_content(&self, load: &LoadOverTime, column: u16) -> AxisColumnContent {
        let Some(start) = load.start() else { return AxisColumnContent::default() };
        let begin = self.start.saturating_add(self.column.saturating_mul(i64::from(column)));
        let end = begin.saturating_add(self.column - 1);
        let place = |time: i64| usize::try_from(time.saturating_sub(start).div_euclid(load.step())).ok();
        // A column that starts before the first step may still overlap it.
        let Some(last) = place(end) else { return AxisColumnContent::default() };
        let steps =
            load.steps().get(place(begin).unwrap_or(0)..=last.min(load.steps().len().wrapping_sub(1)));
        let step = load.step().unsigned_abs().max(1);
        let rate = |count: u64| u128::from(count) * 1_000_000_000 / u128::from(step);
        let rate = |count: u64| u64::try_from(rate(count)).unwrap_or(u64::MAX);
        steps.unwrap_or_default().iter().fold(AxisColumnContent::default(), |sum, step: &LoadStep| {
            AxisColumnContent {
                bits: sum.bits.max(rate(step.bits)),
                frames: sum.frames.max(rate(step.frames)),
                errors: sum.errors + step.errors,
            }
        })
    }
}

/// Time at least one column to the right of `time`, far enough that a frame is in between.
pub(super) fn further_time(loads: &[LoadOverTime], time: i64, by: i64) -> Option<i64> {
    loads.iter().filter_map(|load| further_on(load, time, by)).min()
}

fn further_on(load: &LoadOverTime, time: i64, by: i64) -> Option<i64> {
    let (start, step) = (load.start()?, load.step());
    let place = |time: i64| usize::try_from(time.saturating_sub(start).div_euclid(step)).unwrap_or(0);
    let end = |place: usize| {
        let steps = i64::try_from(place + 1).unwrap_or(i64::MAX);
        start.saturating_add(steps.saturating_mul(step)) - 1
    };
    let wanted = time.saturating_add(by.max(step));
    let (first, last) = (if time < start { 0 } else { place(time) + 1 }, place(wanted));
    let has_frames = |at: &usize| load.steps().get(*at).is_some_and(|step| step.frames > 0);
    if (first..=last).any(|at| has_frames(&at)) {
        return Some(end(last));
    }
    (last + 1..load.steps().len()).find(has_frames).map(end)
}

#[cfg(test)]
mod tests {
    use cobscope_decoder::frame::{CanId, Frame, FrameFlags, Timestamp};

    use super::*;

    /// Frames of 48 bits at these times in ms; error frames at negative ones.
    fn load(milliseconds: &[i64]) -> LoadOverTime {
        let mut load = LoadOverTime::default();
        for time in milliseconds {
            let mut frame = Frame::data_frame(CanId::from_standard(0x555), &[]);
            if *time < 0 {
                frame.flags = FrameFlags::ERROR;
            }
            frame.time = Some(Timestamp(time.abs() * 1_000_000));
            load.count_frame(&frame);
        }
        load
    }

    #[test]
    fn columns_go_from_the_first_frame_to_the_last() {
        let axis = TimeAxis::new(1_000, 2_000, 1_000, 0, 10);
        assert_eq!(
            (axis.start, axis.column, axis.column_of(2_000), axis.column_of(999)),
            (1_000, 101, Some(9), None)
        );
        // The third of four pages contains the cursor.
        let axis = TimeAxis::new(1_000, 2_000, 1_500, 2, 10);
        assert_eq!((axis.start, axis.column, axis.column_of(1_500)), (1_500, 26, Some(0)));
        assert_eq!(TimeAxis::new(5, 5, 5, 3, 0).column_of(5), None);
    }

    #[test]
    fn a_column_tells_the_busiest_step_in_it_and_all_its_error_frames() {
        // Steps of 100 ms: two frames, one, none, an error frame.
        let load = load(&[0, 50, 100, -350]);
        let axis = TimeAxis::new(0, 350_000_000, 0, 0, 2);
        let reported = axis.column_contents(&load);
        assert_eq!(reported[0], AxisColumnContent { bits: 960, frames: 20, errors: 0 });
        assert_eq!((reported[1].frames, reported[1].errors), (10, 1));
    }

    #[test]
    fn a_step_on_the_right_reaches_the_next_frame() {
        let load = [load(&[0, 50, 120, 900])];
        assert_eq!(further_time(&load, 0, 1), Some(199_999_999));
        assert_eq!(further_time(&load, 120_000_000, 1), Some(999_999_999));
        assert_eq!(further_time(&load, 900_000_000, 1), None);
    }
}
