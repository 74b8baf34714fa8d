//! Search for the next or previous matching row.

use cobscope_decoder::replay::{EventPosition, PlacedEvent};

use super::{Answer, FIRST_SPAN, NEAR, Seeker};
use crate::timeline::order::{TextSearch, WindowRequest};
use crate::timeline::walk::TimelineWalk;

impl Seeker {
    /// Position of the next match: `Some(None)` without a match, None if a newer order arrived.
    pub(super) fn search_next(
        &mut self,
        order: &WindowRequest,
        search: &TextSearch,
        from: EventPosition,
        frames: u64,
        is_stale: &mut impl FnMut() -> bool,
    ) -> Answer<Option<EventPosition>> {
        let mut span = FIRST_SPAN;
        loop {
            let start = if search.is_backward { from.frame.saturating_sub(span) } else { from.frame };
            let start = start.saturating_sub(1);
            let Some(walk) = self.walk_to(start, is_stale)? else { return Ok(None) };
            let Some(met) = self.search_from(walk, order, search, from, frames, is_stale)? else {
                return Ok(None);
            };
            if met.is_some() || !search.is_backward || start == 0 {
                return Ok(Some(met));
            }
            span = span.saturating_mul(8);
        }
    }

    /// The first match after `from`, or the last one before it.
    fn search_from(
        &mut self,
        mut walk: TimelineWalk,
        order: &WindowRequest,
        search: &TextSearch,
        from: EventPosition,
        frames: u64,
        is_stale: &mut impl FnMut() -> bool,
    ) -> Answer<Option<EventPosition>> {
        let mut met = None;
        let mut next = walk.world.frames() + NEAR;
        while self.is_whole() || walk.world.frames() < frames {
            let mut see = |reported: PlacedEvent<'_>| {
                let is_beyond = if search.is_backward {
                    reported.spot < from
                } else {
                    reported.spot > from && met.is_none()
                };
                if is_beyond
                    && order.matcher.matches_event(&reported)
                    && search.matcher.matches_event(&reported)
                {
                    met = Some(reported.spot);
                }
            };
            let more = walk.step_item(&mut see)?;
            let is_over = if search.is_backward { walk.world.frames() > from.frame } else { met.is_some() };
            if !more || is_over {
                break;
            }
            if walk.world.frames() >= next {
                next = walk.world.frames() + NEAR;
                if is_stale() {
                    return Ok(None);
                }
            }
        }
        Ok(Some(met))
    }
}
