//! Part of a capture around a claim.

use super::model::PlotAxis;
use crate::diagnosis::Story;
use crate::frame::Timestamp;

/// Time before and after a claim, in ns.
const MARGIN: i64 = 5_000_000_000;

/// Maximum time from the beginning of a claim to the end of its window, in ns.
const LONGEST: i64 = 60_000_000_000;

/// Frames before and after a claim, without timestamps.
const MARGIN_FRAMES: u64 = 200;

/// Maximum number of frames from the beginning of a claim, without timestamps.
const MOST_FRAMES: u64 = 2_000;

/// Part of a capture around a claim: a range of times, else of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ClaimWindow {
    /// First and last time.
    Times(Timestamp, Timestamp),
    /// First and last frame.
    Frames(u64, u64),
}

impl ClaimWindow {
    /// The window of a story.
    pub(super) fn window_of(story: &Story) -> Self {
        if let Some(began) = story.began.time {
            let ended = story.ended.time.unwrap_or(began).min(began.plus(LONGEST));
            Self::Times(began.plus(-MARGIN), ended.max(began).plus(MARGIN))
        } else {
            let began = story.began.frames.first;
            let ended = story.ended.frames.last.clamp(began, began.saturating_add(MOST_FRAMES));
            Self::Frames(began.saturating_sub(MARGIN_FRAMES), ended.saturating_add(MARGIN_FRAMES))
        }
    }

    /// Whether a frame is in the window.
    pub(super) fn contains(self, time: Option<Timestamp>, frame: u64) -> bool {
        match self {
            Self::Times(from, to) => time.is_some_and(|time| from <= time && time <= to),
            Self::Frames(from, to) => (from..=to).contains(&frame),
        }
    }

    /// Position on the horizontal axis: seconds from `zero`, else the number of the frame.
    pub(super) fn axis_position(
        self,
        time: Option<Timestamp>,
        frame: u64,
        zero: Option<Timestamp>,
    ) -> Option<f64> {
        match self {
            #[expect(clippy::cast_precision_loss, reason = "drawn with a few digits")]
            Self::Times(..) => Some(time?.since(zero?) as f64 / 1e9),
            #[expect(clippy::cast_precision_loss, reason = "drawn with a few digits")]
            Self::Frames(..) => Some(frame as f64),
        }
    }

    /// Unit of the horizontal axis.
    pub(super) const fn axis_unit(self) -> PlotAxis {
        match self {
            Self::Times(..) => PlotAxis::Seconds,
            Self::Frames(..) => PlotAxis::Frames,
        }
    }
}
