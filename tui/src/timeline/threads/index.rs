//! Reads a capture once and stores marks at regular intervals.

use std::sync::mpsc::Sender;
use std::sync::{Arc, PoisonError};

use crate::timeline::News;
use crate::timeline::shared::Shared;
use crate::timeline::walk::{self, TimelineWalk};

/// Runs until the capture is read or the timeline ends.
pub(in crate::timeline) fn run(shared: &Shared, news: &Sender<News>) {
    match walk::start(shared) {
        Ok(mut walk) => {
            go(shared, &mut walk, news);
            shared.progress.publish(&walk.world, walk.names(), walk.offset());
            *shared.end.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(walk.world));
        }
        Err(error) => shared.fail(&error),
    }
    shared.progress.complete();
    shared.begin();
    // The application may have ended.
    let _ = news.send(News::Indexed);
}

fn go(shared: &Shared, walk: &mut TimelineWalk, news: &Sender<News>) {
    while !shared.is_over() {
        let is_due = shared.index.read().unwrap_or_else(PoisonError::into_inner).is_due(walk.world.frames());
        if is_due && let Some(mark) = walk.mark() {
            shared.index.write().unwrap_or_else(PoisonError::into_inner).add(mark);
            shared.forget();
        }
        match walk.leap(u64::MAX, &mut |_| ()) {
            Ok(true) => {
                shared.progress.publish(&walk.world, walk.names(), walk.offset());
                if walk.is_drained() {
                    shared.report_growth(news);
                }
            }
            Ok(false) => return,
            Err(error) => {
                shared.fail(&error);
                return walk.close(&mut |_| ());
            }
        }
    }
}
