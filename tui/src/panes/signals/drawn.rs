//! The plot as it is drawn: its series, and the line above it.

use std::borrow::Cow;
use std::sync::Arc;

use cobscope_decoder::frame::Timestamp;

use super::view::View;
use super::{OF_LEGEND, Picked, Signals, list};
use crate::bucket::Bucket;
use crate::state::Core;
use crate::theme::{Glyph, Role};
use crate::timeline::MOST_SIGNALS;
use crate::widgets::plot::{Plot, Series};

/// A signal as it is drawn.
struct Shown {
    name: String,
    unit: String,
    role: Role,
    points: Arc<Vec<Bucket>>,
}

impl Signals {
    /// The signals that are plotted, with the values at the cursors as exactly as they are known.
    fn shown(&self, core: &Core) -> Vec<Shown> {
        let room = self.parts(Self::area(core)).plot.width.saturating_sub(OF_LEGEND);
        let cursor = self.view.cursor(core).filter(|_| !core.is_pending() && !core.is_waiting());
        let shown = |picked: &Picked| {
            let points = self.view.points(core, &picked.key);
            let is_assumed = points.as_ref().is_some_and(|points| points.is_assumed);
            let mut points = points.map(|points| points.buckets).unwrap_or_default();
            if let (Some(time), Some(value)) = (cursor, list::number(core, &picked.key)) {
                put(&mut points, time, value);
            }
            if let Some(second) = &self.second
                && let Some((_, Some(value))) = second.values.iter().find(|(key, _)| *key == picked.key)
            {
                put(&mut points, second.time, *value);
            }
            let name = list::within(&picked.key.name, room);
            let name = format!("{name}{}", if is_assumed { "?" } else { "" });
            Shown { name, unit: picked.key.unit.clone(), role: Role::Highlight(picked.look), points }
        };
        self.picked.iter().map(shown).collect()
    }

    /// Does something with the plot as it is drawn.
    pub(super) fn with_plot<T>(
        &self,
        core: &Core,
        then: impl for<'a> FnOnce(&'a Plot<'a>) -> T,
    ) -> Option<T> {
        let (from, to) = self.view.range(core)?;
        let (_, last) = View::whole(core)?;
        let shown = self.shown(core);
        let series: Vec<_> = shown
            .iter()
            .map(|shown| Series {
                name: Cow::Borrowed(shown.name.as_str()),
                unit: Cow::Borrowed(shown.unit.as_str()),
                role: shown.role,
                points: &shown.points,
            })
            .collect();
        let second = self.second.as_ref().map(|second| second.time);
        let is_over = self.view.share(core).is_none();
        let plot = Plot::new(&core.theme, &series, from, to)
            .zero(core.zero().map_or(from, |zero| zero.0))
            .cursors(self.view.cursor(core), second)
            .until(last)
            .empty(if is_over { "no value in this time" } else { "reading …" });
        Some(then(&plot))
    }

    /// The line above the plot.
    pub(super) fn title(&self, core: &Core) -> String {
        let Some((from, to)) = self.view.range(core) else { return "no times".into() };
        let delta = core.theme.glyph(Glyph::Delta);
        let time = |time| core.seconds(Some(Timestamp(time))).unwrap_or_default();
        let span = time(to) - time(from);
        // As many digits as tell the ends of a thousandth apart.
        let digits = (0..6).find(|digits| span * 10_f64.powi(*digits) >= 1_000.0).unwrap_or(6);
        let digits = usize::try_from(digits).unwrap_or(0).max(3);
        let all = if self.view.is_whole() { ", all of it" } else { "" };
        let mut text =
            format!("{:.digits$} to {:.digits$} s, {delta} {span:.digits$} s{all}", time(from), time(to));
        if let Some(share) = self.view.share(core) {
            text = format!("reading {share} %  {text}");
        }
        if self.refused > 0 {
            text = format!("{} more not plotted: {MOST_SIGNALS} are the most  {text}", self.refused);
        }
        text
    }
}

/// Puts in what is known to hold at a time, where buckets are too long to tell.
fn put(points: &mut Arc<Vec<Bucket>>, time: i64, value: f64) {
    let behind = points.partition_point(|bucket| bucket.t <= time);
    let Some(place) = behind.checked_sub(1) else { return };
    if points
        .get(place)
        .is_some_and(|bucket| !bucket.last.is_nan() && bucket.last.to_bits() != value.to_bits())
    {
        let exact = Bucket { t: time, min: value, max: value, last: value };
        Arc::make_mut(points).insert(behind, exact);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bucket(t: i64, min: f64, max: f64, last: f64) -> Bucket {
        Bucket { t, min, max, last }
    }

    #[test]
    fn what_holds_at_a_cursor_is_put_where_a_bucket_cannot_tell() {
        let coarse = Arc::new(vec![bucket(0, 1.0, 3.0, 3.0), bucket(100, 4.0, 4.0, 4.0)]);
        let mut points = Arc::clone(&coarse);
        // Within the first bucket 2 held at 50; of the second its only value is known.
        put(&mut points, 50, 2.0);
        put(&mut points, 150, 4.0);
        put(&mut points, -1, 7.0);
        assert_eq!(
            *points,
            [bucket(0, 1.0, 3.0, 3.0), bucket(50, 2.0, 2.0, 2.0), bucket(100, 4.0, 4.0, 4.0)]
        );
        // What others have is left alone.
        assert_eq!(coarse.len(), 2);
    }
}
