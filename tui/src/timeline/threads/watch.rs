//! Compares the files of the captures with their content when they were opened, at regular intervals. Readers
//! compare what they read; this thread finds changes while nothing is read.

use std::sync::mpsc::Sender;
use std::time::Duration;

use crate::timeline::TimelineNews;
use crate::timeline::shared::SharedResults;

/// Interval of the comparison.
const INTERVAL: Duration = Duration::from_secs(1);

/// Runs until the timeline ends.
pub(in crate::timeline) fn run_watch(shared: &SharedResults, news: &Sender<TimelineNews>) {
    while !shared.waits_for_end(INTERVAL) {
        shared.report_changes(news);
    }
}
