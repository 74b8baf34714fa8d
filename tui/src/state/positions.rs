//! Positions named by the user: their limits, and their frame and time before the cursor moves there.

use std::cmp::Ordering;

use cobscope_decoder::figures::format_time;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::EventPosition;

use super::place::PositionPreview;
use super::{JumpPlace, UiState};
use crate::select::RangeBound;
use crate::timeline::{RowMatcher, RowWindow, SeekTarget, WindowRequest};

impl UiState {
    /// Position of a bound, which is returned without a wall-clock time.
    pub(super) fn place_of(&self, bound: RangeBound) -> Result<(RangeBound, JumpPlace), String> {
        let bound = match (bound, self.timeline.progress().time_range()) {
            (RangeBound::Clock(clock), Some((first, last))) => {
                RangeBound::Moment(clock.moment_in(first, last)?)
            }
            (bound, _) => bound,
        };
        let no_times = || "this capture has no timestamps; enter a frame as #1234".to_owned();
        let place = match bound {
            RangeBound::Frame(frame) => JumpPlace::Frame(frame),
            RangeBound::Moment(time) => JumpPlace::Time(time),
            RangeBound::Offset(offset) => JumpPlace::Time(
                self.first_time().or(self.timeline.first_time()).ok_or_else(no_times)?.plus(offset),
            ),
            RangeBound::Clock(_) => return Err(no_times()),
        };
        Ok((bound, place))
    }

    /// Position of a bound inside the captures.
    ///
    /// # Errors
    /// The bound is outside the captures, or they have no timestamps.
    pub fn position_inside(&self, bound: RangeBound) -> Result<JumpPlace, String> {
        let (bound, place) = self.place_of(bound)?;
        let outside = self.position_outside(bound).filter(|_| self.timeline.progress().is_complete());
        outside.map_or(Ok(place), |(_, text)| Err(text))
    }

    /// Side and message for a position outside the captures.
    pub(super) fn position_outside(&self, bound: RangeBound) -> Option<(Ordering, String)> {
        let frames = self.timeline.progress().frames();
        let times = self.timeline.progress().time_range();
        let (what, side) = match (bound, times) {
            (RangeBound::Frame(0), _) => ("frame", Ordering::Less),
            (RangeBound::Frame(frame), _) => ("frame", frame.cmp(&frames).max(Ordering::Equal)),
            (_, None) | (RangeBound::Clock(_), _) => return None,
            (RangeBound::Moment(time), Some((first, last))) => ("time", side_of(time, first, last)),
            (RangeBound::Offset(offset), Some((first, last))) => {
                ("time", side_of(first.plus(offset), first, last))
            }
        };
        let time =
            times.map_or(String::new(), |(first, last)| format!(", {}", format_time(last.since(first))));
        let text = match side {
            Ordering::Less => format!("no such {what}: the capture starts here"),
            Ordering::Equal => return None,
            Ordering::Greater => format!("no such {what}: the capture ends here, #{frames}{time}"),
        };
        Some((side, text))
    }

    /// Requests the frame and time of a position, or shows the reason why there is none; `None` ends the
    /// preview.
    pub fn look_at(&mut self, place: Option<Result<JumpPlace, String>>) {
        self.preview = None;
        let target = match place {
            Some(Err(reason)) => {
                self.preview = Some(PositionPreview { serial: 0, text: Some(reason) });
                return;
            }
            Some(Ok(JumpPlace::Time(time))) => SeekTarget::Time(time),
            Some(Ok(JumpPlace::Frame(frame))) => SeekTarget::Event(EventPosition::after_frame(frame)),
            _ => return,
        };
        // The request for the window of the cursor is more important.
        if self.is_waiting() {
            return;
        }
        self.serial += 1;
        self.preview = Some(PositionPreview { serial: self.serial, text: None });
        let (serial, matcher) = (self.serial, RowMatcher::default());
        self.timeline.request_window(WindowRequest {
            serial,
            target,
            before: 1,
            after: 0,
            matcher,
            search: None,
        });
    }

    /// Frame and time of the position: `frame 1842, 371.204 s`.
    pub fn preview_text(&self) -> Option<String> {
        self.preview.as_ref()?.text.clone()
    }

    /// Whether a position is being looked up.
    pub fn is_previewing(&self) -> bool {
        self.preview.as_ref().is_some_and(|preview| preview.text.is_none())
    }

    /// Takes the window of a preview; `false` for other windows.
    pub(super) fn take_preview(&mut self, window: &RowWindow) -> bool {
        let time = self.time_words(window.world.last_time(), 3);
        let Some(preview) = self.preview.as_mut().filter(|preview| preview.serial == window.serial) else {
            return false;
        };
        let time = time.map_or(String::new(), |time| format!(", {time}"));
        let state = if window.is_pending { ", not read yet" } else { "" };
        preview.text = Some(format!("frame {}{time}{state}", window.spot.frame));
        true
    }
}

/// Position of a time relative to the captures.
fn side_of(time: Timestamp, first: Timestamp, last: Timestamp) -> Ordering {
    if time < first { Ordering::Less } else { time.cmp(&last).max(Ordering::Equal) }
}
