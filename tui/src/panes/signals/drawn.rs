//! The plotted series and the line above the plot.

use std::borrow::Cow;
use std::sync::Arc;

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::words::count_noun;

use super::view::PlotView;
use super::{OF_LEGEND, PlottedKey, SignalsPane, list};
use crate::bucket::SampleBucket;
use crate::state::UiState;
use crate::theme::{Glyph, TextRole};
use crate::timeline::MOST_SIGNALS;
use crate::widgets::plot::{PlotSeries, TimePlot};

/// A plotted signal.
struct PlottedSignal {
    name: String,
    unit: String,
    role: TextRole,
    points: Arc<Vec<SampleBucket>>,
}

impl SignalsPane {
    /// The plotted signals, with the exact values at the cursors if they are known.
    fn plotted_signals(&self, core: &UiState) -> Vec<PlottedSignal> {
        let room = self.pane_areas(Self::plot_area(core)).plot.width.saturating_sub(OF_LEGEND);
        let cursor = self.view.cursor_time(core).filter(|_| !core.is_pending() && !core.is_waiting());
        let shown = |picked: &PlottedKey| {
            let points = self.view.finest_points(core, &picked.key);
            let is_assumed = points.as_ref().is_some_and(|points| points.is_assumed);
            let mut points = points.map(|points| points.buckets).unwrap_or_default();
            if let (Some(time), Some(value)) = (cursor, list::cursor_value(core, &picked.key)) {
                insert_value(&mut points, time, value);
            }
            if let Some(second) = &self.second
                && let Some((_, Some(value))) = second.values.iter().find(|(key, _)| *key == picked.key)
            {
                insert_value(&mut points, second.time, *value);
            }
            let name = list::fit_name(&picked.key.name, room);
            let name = format!("{name}{}", if is_assumed { "?" } else { "" });
            PlottedSignal {
                name,
                unit: picked.key.unit.clone(),
                role: TextRole::Highlight(picked.look),
                points,
            }
        };
        self.picked.iter().map(shown).collect()
    }

    /// Builds the plot and passes it to `then`.
    pub(super) fn with_plot<T>(
        &self,
        core: &UiState,
        then: impl for<'a> FnOnce(&'a TimePlot<'a>) -> T,
    ) -> Option<T> {
        let (from, to) = self.view.view_range(core)?;
        let (_, last) = PlotView::whole_range(core)?;
        let shown = self.plotted_signals(core);
        let series: Vec<_> = shown
            .iter()
            .map(|shown| PlotSeries {
                name: Cow::Borrowed(shown.name.as_str()),
                unit: Cow::Borrowed(shown.unit.as_str()),
                role: shown.role,
                points: &shown.points,
            })
            .collect();
        let second = self.second.as_ref().map(|second| second.time);
        let is_over = self.view.sampled_share(core).is_none();
        let marks = self.plot_marks(core, last);
        let plot = TimePlot::new(&core.theme, &series, from, to)
            .with_zero(core.first_time().map_or(from, |zero| zero.0))
            .with_cursors(self.view.cursor_time(core), second)
            .with_end(last)
            .with_marks(&marks)
            .with_empty_text(if is_over { "no values in this range" } else { "reading …" });
        Some(then(&plot))
    }

    /// Range and progress, shown above the plot.
    pub(super) fn plot_title(&self, core: &UiState) -> String {
        let Some((from, to)) = self.view.view_range(core) else { return "no timestamps".into() };
        let delta = core.theme.glyph(Glyph::Delta);
        let time = |time| core.seconds_of(Some(Timestamp(time))).unwrap_or_default();
        let span = time(to) - time(from);
        // Enough decimals for a thousandth of the range.
        let digits = (0..6).find(|digits| span * 10_f64.powi(*digits) >= 1_000.0).unwrap_or(6);
        let digits = usize::try_from(digits).unwrap_or(0).max(3);
        let all = if self.view.is_whole() { ", whole capture" } else { "" };
        let mut text =
            format!("{:.digits$} to {:.digits$} s, {delta} {span:.digits$} s{all}", time(from), time(to));
        if let Some(share) = self.view.sampled_share(core) {
            text = format!("reading {share} %  {text}");
        }
        let area = self.pane_areas(Self::plot_area(core)).plot;
        match self.with_plot(core, |plot| plot.units_without_room(area)) {
            None | Some(0) => {}
            Some(missing) => {
                let larger = if self.is_large { "" } else { "; enter enlarges the plot" };
                text = format!("no room for {}{larger}  {text}", count_noun(missing, "unit"));
            }
        }
        if self.refused > 0 {
            text = format!("{} more not plotted (max {MOST_SIGNALS})  {text}", self.refused);
        }
        text
    }
}

/// Inserts the exact value at a time if its bucket contains several values.
fn insert_value(points: &mut Arc<Vec<SampleBucket>>, time: i64, value: f64) {
    let behind = points.partition_point(|bucket| bucket.t <= time);
    let Some(place) = behind.checked_sub(1) else { return };
    if points
        .get(place)
        .is_some_and(|bucket| !bucket.last.is_nan() && bucket.last.to_bits() != value.to_bits())
    {
        let exact = SampleBucket { t: time, min: value, max: value, last: value };
        Arc::make_mut(points).insert(behind, exact);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bucket(t: i64, min: f64, max: f64, last: f64) -> SampleBucket {
        SampleBucket { t, min, max, last }
    }

    #[test]
    fn the_value_at_the_cursor_is_drawn_inside_a_bucket() {
        let coarse = Arc::new(vec![bucket(0, 1.0, 3.0, 3.0), bucket(100, 4.0, 4.0, 4.0)]);
        let mut points = Arc::clone(&coarse);
        // The first bucket contains several values, so the value at 50 is inserted; the second contains only
        // one.
        insert_value(&mut points, 50, 2.0);
        insert_value(&mut points, 150, 4.0);
        insert_value(&mut points, -1, 7.0);
        assert_eq!(
            *points,
            [bucket(0, 1.0, 3.0, 3.0), bucket(50, 2.0, 2.0, 2.0), bucket(100, 4.0, 4.0, 4.0)]
        );
        // The shared points stay unchanged.
        assert_eq!(coarse.len(), 2);
    }
}
