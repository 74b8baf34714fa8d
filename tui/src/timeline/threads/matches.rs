//! Searches the whole capture for the shown events while the index grows.

use std::sync::Arc;
use std::sync::mpsc::Sender;

use cobscope_decoder::replay::PlacedEvent;

use crate::timeline::matches::Matches;
use crate::timeline::news::News;
use crate::timeline::shared::Shared;
use crate::timeline::walk;

/// Number of frames between two checks for cancellation.
const STRIDE: u64 = 4_096;

/// Searches the whole capture.
pub(in crate::timeline) fn run(shared: &Shared, matches: &Arc<Matches>, news: &Sender<News>) {
    shared.wait_for_index();
    if let Ok(mut walk) = walk::start(shared) {
        let mut see = |told: PlacedEvent<'_>| {
            if matches.matcher.takes(&told) {
                matches.add(&told);
            }
        };
        let mut next = STRIDE;
        while !shared.is_over() && !matches.is_stopped() {
            match walk.leap(u64::MAX, &mut see) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    shared.fail(&error);
                    walk.close(&mut see);
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
    matches.complete();
    // The application may have ended.
    let _ = news.send(News::Filtered);
}
