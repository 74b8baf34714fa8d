//! Reads a capture once and stores marks at regular intervals.

use std::sync::mpsc::Sender;
use std::sync::{Arc, PoisonError};

use crate::timeline::TimelineNews;
use crate::timeline::shared::SharedResults;
use crate::timeline::walk::{self, TimelineWalk};

/// Runs until the capture is read or the timeline ends.
pub(in crate::timeline) fn run_index(shared: &SharedResults, news: &Sender<TimelineNews>) {
    match walk::start_walk(shared) {
        Ok(mut walk) => {
            index_walk(shared, &mut walk, news);
            shared.progress.publish_progress(&walk.world, walk.names(), walk.offset());
            *shared.end.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(walk.world));
        }
        Err(error) => shared.fail_reading(&error),
    }
    shared.progress.complete_index();
    shared.begin_threads();
    // The application may have ended.
    let _ = news.send(TimelineNews::Indexed);
}

fn index_walk(shared: &SharedResults, walk: &mut TimelineWalk, news: &Sender<TimelineNews>) {
    while !shared.is_over() {
        let is_due = shared.index.read().unwrap_or_else(PoisonError::into_inner).is_due(walk.world.frames());
        if is_due && let Some(mark) = walk.mark_position() {
            shared.index.write().unwrap_or_else(PoisonError::into_inner).add_checkpoint(mark);
            shared.forget_evicted();
        }
        match walk.skip_batch(u64::MAX, &mut |_| ()) {
            Ok(true) => {
                shared.progress.publish_progress(&walk.world, walk.names(), walk.offset());
                if walk.is_drained() {
                    shared.report_growth(news);
                }
            }
            Ok(false) => return,
            Err(error) => {
                shared.fail_reading(&error);
                return walk.close_conditions(&mut |_| ());
            }
        }
    }
}
