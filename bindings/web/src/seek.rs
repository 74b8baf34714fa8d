//! Walks to any frame: from the nearest checkpoint, with further checkpoints near the positions visited.

use std::collections::VecDeque;

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{CaptureWalk, Checkpoint, PlacedEvent};

use crate::capture::CaptureSet;
use crate::files::ContentSource;
use crate::survey::CaptureSurvey;

/// Frames between two checkpoints near a visited position.
const NEAR: u64 = 8_192;

/// Maximum number of such checkpoints, and of their bytes.
const MOST_NEAR: (usize, usize) = (48, 32 << 20);

/// Checkpoints near the positions visited last.
#[derive(Default)]
pub struct RecentCheckpoints {
    near: VecDeque<Checkpoint>,
    bytes: usize,
}

impl RecentCheckpoints {
    /// A walk before the events of frame `frame`.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn walk_before(
        &mut self,
        captures: &CaptureSet,
        survey: &CaptureSurvey,
        frame: u64,
    ) -> Result<CaptureWalk<ContentSource>, CaptureError> {
        let before = frame.saturating_sub(1);
        let near = self.near.iter().filter(|mark| mark.frames <= before);
        let mark = near.chain(survey.checkpoint_at(before)).max_by_key(|mark| mark.frames);
        let mut walk = match mark {
            Some(mark) => captures.resume_walk(mark)?,
            None => captures.start_walk()?,
        };
        let mut next = walk.world.frames().saturating_add(NEAR);
        while walk.world.frames() < before {
            if !walk.skip_batch(before, &mut |_| ())? {
                break;
            }
            self.remember_walk(&walk, &mut next);
        }
        Ok(walk)
    }

    /// The last frame up to a time.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn frame_at(
        &mut self,
        captures: &CaptureSet,
        survey: &CaptureSurvey,
        time: Timestamp,
    ) -> Result<u64, CaptureError> {
        let is_before = |mark: &&Checkpoint| mark.time.is_some_and(|at| at < time);
        let near = self.near.iter().filter(is_before).map(|mark| mark.frames).max().unwrap_or(0);
        let far = survey.index.before_time(time).map_or(0, |mark| mark.frames);
        let mut walk = self.walk_before(captures, survey, near.max(far).saturating_add(1))?;
        let mut next = walk.world.frames().saturating_add(NEAR);
        while walk.world.frames() < survey.end.frames() {
            if walk.peek_frame()?.and_then(|frame| frame.time).is_some_and(|next| next > time) {
                break;
            }
            if !walk.step_item(&mut |_| ())? {
                break;
            }
            self.remember_walk(&walk, &mut next);
        }
        Ok(walk.world.frames())
    }

    /// Steps to the next frame or notice and keeps checkpoints; `false` at the end.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn step_frame(
        &mut self,
        walk: &mut CaptureWalk<ContentSource>,
        see: &mut impl FnMut(PlacedEvent<'_>),
    ) -> Result<bool, CaptureError> {
        let mut next = walk.world.frames() / NEAR * NEAR + NEAR;
        let more = walk.step_item(see)?;
        self.remember_walk(walk, &mut next);
        Ok(more)
    }

    fn remember_walk(&mut self, walk: &CaptureWalk<ContentSource>, next: &mut u64) {
        let frames = walk.world.frames();
        if frames < *next || self.near.iter().any(|mark| mark.frames.abs_diff(frames) < NEAR / 2) {
            return;
        }
        let Some(mark) = walk.mark_position() else { return };
        *next = frames.saturating_add(NEAR);
        self.bytes = self.bytes.saturating_add(mark.world.footprint());
        self.near.push_back(mark);
        while self.near.len() > MOST_NEAR.0 || (self.bytes > MOST_NEAR.1 && self.near.len() > 1) {
            let dropped = self.near.pop_front();
            let size = dropped.map_or(0, |mark| mark.world.footprint());
            self.bytes = self.bytes.saturating_sub(size);
        }
    }
}
