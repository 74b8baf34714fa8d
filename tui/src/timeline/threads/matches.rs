//! Searches the whole capture for the shown events while the index grows.

use std::sync::Arc;
use std::sync::mpsc::Sender;

use cobscope_decoder::replay::PlacedEvent;

use crate::timeline::matches::SearchMatches;
use crate::timeline::news::TimelineNews;
use crate::timeline::shared::SharedResults;
use crate::timeline::walk;

/// Number of frames between two checks for cancellation.
const STRIDE: u64 = 4_096;

/// Searches the whole capture.
pub(in crate::timeline) fn run_search(
    shared: &SharedResults,
    matches: &Arc<SearchMatches>,
    news: &Sender<TimelineNews>,
) {
    shared.wait_for_index();
    if let Ok(mut walk) = walk::start_walk(shared) {
        let mut see = |reported: PlacedEvent<'_>| {
            if matches.matcher.matches_event(&reported) {
                matches.add_match(&reported);
            }
        };
        let mut next = STRIDE;
        while !shared.is_over() && !matches.is_stopped() {
            match walk.skip_batch(u64::MAX, &mut see) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    shared.fail_reading(&error);
                    walk.close_conditions(&mut see);
                    break;
                }
            }
            if walk.world.frames() >= next {
                next = walk.world.frames() + STRIDE;
                matches.set_scanned(walk.world.frames());
            }
        }
        matches.set_scanned(walk.world.frames());
    }
    matches.complete_search();
    // The application may have ended.
    let _ = news.send(TimelineNews::Filtered);
}
