//! Writes a capture per trigger.

mod begin;
mod extend;

use std::collections::VecDeque;
use std::path::Path;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use jiff::civil::DateTime;

use super::super::backend::RecorderBackend;
use super::super::item::{PendingItem, RecordItem};
use super::super::parts::RETRY_AFTER;
use super::super::status::{RecordFailure, RecordStatus};
use super::super::trigger::CaptureTrigger;
use super::clock::RingClock;
use super::cut::{Comments, OpenCut};
use super::files::{CutFiles, DiskMaker};
use super::ring::ItemRing;
use super::ring_files::RingFiles;
use super::state::StateFollower;
use super::{CutEnd, CutNews, CutOptions, RefusalReason, SLACK};

/// Maximum number of comments kept for frames of the ring.
const MOST_COMMENTS: usize = 10_000;

/// Ring, open capture and totals.
pub(in super::super) struct CutWriter {
    options: CutOptions,
    before: i64,
    after: i64,
    files: CutFiles,
    ring: ItemRing,
    ring_files: Option<RingFiles>,
    clock: RingClock,
    /// Triggers of the next item.
    waiting: Vec<CaptureTrigger>,
    /// Comments for the next frame.
    carried: VecDeque<String>,
    comments: Comments,
    cut: Option<OpenCut>,
    /// None if no bus files are written.
    state: Option<StateFollower>,
    news: Sender<CutNews>,
    /// Totals of complete captures.
    done: RecordStatus,
    status: RecordStatus,
    now: Option<Instant>,
}

impl CutWriter {
    /// Creates the folder, unless it exists, and the files of a ring on disk. `now` is the local time for their
    /// names.
    ///
    /// # Errors
    /// If one of them cannot be created.
    pub(in super::super) fn open_writer(
        disk: DiskMaker,
        options: CutOptions,
        state: Option<StateFollower>,
        news: Sender<CutNews>,
        now: DateTime,
    ) -> anyhow::Result<Self> {
        let files = CutFiles::new(disk, options.folder.clone())?;
        let [before, after, slack] = [options.before, options.after, SLACK].map(to_nanoseconds);
        let most = usize::try_from(options.ring_bytes).unwrap_or(usize::MAX);
        let ring_files = options.ring_files.map(|bytes| files.ring_files(bytes, now)).transpose()?;
        let done =
            RecordStatus { path: options.folder.clone(), format: files.title(), ..RecordStatus::default() };
        Ok(Self {
            before,
            after,
            files,
            ring: ItemRing::new(before.saturating_add(slack), most),
            ring_files,
            clock: RingClock::default(),
            waiting: Vec::new(),
            carried: VecDeque::new(),
            comments: Comments::new(),
            cut: None,
            state,
            news,
            status: done.clone(),
            done,
            now: None,
            options,
        })
    }

    /// Adds an item to the ring and the open capture. Triggers that wait for it open a capture.
    fn on_item(&mut self, item: PendingItem, buses: &[String]) {
        let time = match &item.what {
            RecordItem::Notice(notice) => self.clock.notice_time(notice),
            _ => self.clock.frame_time(item.frame().and_then(|frame| frame.time)),
        };
        let is_frame = item.is_frame();
        let sequence = self.ring.push(time, item);
        let triggers = std::mem::take(&mut self.waiting);
        self.keep_comments(&triggers, is_frame.then_some(sequence));
        for trigger in triggers {
            self.fire_trigger(trigger, buses);
        }
        self.advance_cut(buses);
        self.evict_items(buses);
    }

    /// Keeps the comments of triggers for their frame, or for the next one.
    fn keep_comments(&mut self, triggers: &[CaptureTrigger], frame: Option<u64>) {
        self.carried.extend(triggers.iter().map(CaptureTrigger::frame_comment));
        if let Some(sequence) = frame.filter(|_| !self.carried.is_empty()) {
            let texts: Vec<String> = self.carried.drain(..).collect();
            self.comments.insert(sequence, texts.join("\n"));
        }
        while self.carried.len() > MOST_COMMENTS {
            self.carried.pop_front();
        }
        while self.comments.len() > MOST_COMMENTS {
            self.comments.pop_first();
        }
    }

    /// Opens the window of a trigger, or extends the open one.
    fn fire_trigger(&mut self, trigger: CaptureTrigger, buses: &[String]) {
        let at = trigger.time.map_or(self.clock.now(), |time| self.clock.ring_time(time));
        let begin = self.first_time(&trigger, at).min(at).saturating_sub(self.before);
        let end = at.saturating_add(self.after);
        if self.cut.as_ref().is_some_and(|cut| begin > cut.end) {
            self.complete_cut(CutEnd::Window, buses);
        }
        if self.cut.is_some() {
            self.extend_cut((begin, end), trigger, buses);
        } else {
            self.start_cut((begin, end), trigger, buses);
        }
    }

    /// Time of the first frame of a trigger, or of the oldest item if the ring no longer contains it.
    fn first_time(&self, trigger: &CaptureTrigger, at: i64) -> i64 {
        if trigger.first_frame == 0 {
            return at;
        }
        let known = self.ring.time_of(trigger.first_frame);
        known.or_else(|| self.ring.first_time()).unwrap_or(at)
    }

    fn start_cut(&mut self, window: (i64, i64), trigger: CaptureTrigger, buses: &[String]) {
        let refused = if self.status.parts >= self.options.files {
            Some(RefusalReason::Files)
        } else {
            (self.status.bytes >= self.options.bytes).then_some(RefusalReason::Bytes)
        };
        if let Some(reason) = refused {
            return self.report_news(CutNews::Refused { trigger, reason });
        }
        let path = self.files.path(&trigger);
        let mut cut = OpenCut::new(path, window, &self.ring, trigger.frame_comment());
        self.create_file(&mut cut, buses);
        self.done.parts = self.done.parts.saturating_add(1);
        self.status.parts = self.done.parts;
        self.report_news(CutNews::Triggered { trigger, path: cut.path.clone(), late: cut.late });
        self.cut = Some(cut);
    }

    /// Creates the file of a capture, unless the last attempt failed recently.
    fn create_file(&mut self, cut: &mut OpenCut, buses: &[String]) {
        let is_early = cut.retry_at.is_some_and(|at| self.now.is_none_or(|now| now < at));
        if cut.parts.is_some() || is_early {
            return;
        }
        match self.files.create_capture(&cut.path) {
            Ok((path, parts)) => {
                self.on_recovered(cut);
                (cut.path, cut.parts) = (path, Some(parts));
                self.begin_cut(cut, buses);
            }
            Err(error) => {
                cut.retry_at = self.now.map(|now| now + RETRY_AFTER);
                self.on_failed(&cut.path.clone(), &error.to_string());
            }
        }
    }

    /// Ends the failure to create a file. Frames that left the ring meanwhile are missing.
    fn on_recovered(&mut self, cut: &OpenCut) {
        let own = self.done.failure.take_if(|failure| failure.path == cut.path && !failure.is_over);
        if let Some(failure) = own.filter(|_| cut.missing > 0) {
            self.done.failure = Some(RecordFailure { missing: cut.missing, is_over: true, ..failure });
        }
    }

    fn on_failed(&mut self, path: &Path, reason: &str) {
        let (path, reason) = (path.to_owned(), reason.to_owned());
        self.done.failure = Some(RecordFailure { path, reason, missing: 0, is_over: false });
    }

    /// Writes further items of the open capture, and completes it if no later window can overlap with it.
    fn advance_cut(&mut self, buses: &[String]) {
        let Some(mut cut) = self.cut.take() else { return };
        self.create_file(&mut cut, buses);
        if cut.parts.is_some() {
            while cut.take_items(&self.ring, &self.comments, false) {
                cut.write_items(buses, self.now);
                if self.done.bytes.saturating_add(cut.bytes()) >= self.options.bytes {
                    break;
                }
            }
        }
        let is_over = self.clock.expected_from() > cut.end.saturating_add(self.before);
        let is_large = self.done.bytes.saturating_add(cut.bytes()) >= self.options.bytes;
        self.cut = Some(cut);
        if is_large {
            self.complete_cut(CutEnd::Bytes, buses);
        } else if is_over {
            self.complete_cut(CutEnd::Window, buses);
        }
    }

    fn evict_items(&mut self, buses: &[String]) {
        while let Some(chunk) = self.ring.evict_chunk(self.clock.now()) {
            if let Some(state) = &mut self.state {
                chunk.items().iter().for_each(|one| state.in_memory.push(&one.item, buses));
            }
            if let Some(cut) = &mut self.cut {
                chunk.items().iter().for_each(|one| cut.count_evicted(one));
            }
        }
        let first = self.ring.first_sequence();
        while self.comments.first_key_value().is_some_and(|(sequence, _)| *sequence < first) {
            self.comments.pop_first();
        }
    }

    /// Writes the rest of the open capture and ends it.
    fn complete_cut(&mut self, end: CutEnd, buses: &[String]) {
        let Some(mut cut) = self.cut.take() else { return };
        while end != CutEnd::Bytes && cut.take_items(&self.ring, &self.comments, true) {
            cut.write_items(buses, self.now);
        }
        cut.write_items(buses, self.now);
        let (complete, parts) = cut.finish_cut(end);
        self.done.frames = self.done.frames.saturating_add(complete.frames);
        self.done.bytes = self.done.bytes.saturating_add(complete.bytes);
        self.done.missing = self.done.missing.saturating_add(complete.missing);
        if let Some(failure) = parts.and_then(|parts| parts.status().failure.clone()) {
            self.done.failure = Some(failure);
        } else if complete.paths.is_empty()
            && let Some(failure) = &mut self.done.failure
        {
            failure.missing = failure.missing.saturating_add(complete.missing);
        }
        self.report_news(CutNews::Complete(complete));
        self.refresh_status();
    }

    fn report_news(&self, news: CutNews) {
        // At the end there is no receiver of news any more.
        let _ = self.news.send(news);
    }

    fn refresh_status(&mut self) {
        self.status.clone_from(&self.done);
        if let Some(parts) = self.cut.as_ref().and_then(|cut| cut.parts.as_ref()) {
            let own = parts.status();
            self.status.path.clone_from(&own.path);
            self.status.frames = self.status.frames.saturating_add(own.frames);
            self.status.bytes = self.status.bytes.saturating_add(own.bytes);
            self.status.missing = self.status.missing.saturating_add(own.missing);
            self.status.failure = own.failure.clone().or(self.status.failure.take());
        }
        if let Some(failure) = self.ring_files.as_ref().and_then(RingFiles::last_failure) {
            self.status.other_failure = Some(failure.clone());
        }
    }
}

impl RecorderBackend for CutWriter {
    fn take_items(&mut self, items: Vec<PendingItem>, buses: &[String], now: Option<Instant>) {
        self.now = now.or(self.now);
        if let Some(ring) = &mut self.ring_files {
            ring.take_items(&items, buses, now);
            let mut state = self.state.as_mut().map(|state| &mut state.in_files);
            ring.remove_oldest(buses, &mut |item| {
                if let Some(state) = &mut state {
                    state.push(item, buses);
                }
            });
        }
        for item in items {
            match item.what {
                RecordItem::Trigger(trigger) => self.waiting.push(*trigger),
                _ => self.on_item(item, buses),
            }
        }
        if let Some(cut) = &mut self.cut {
            cut.write_items(buses, self.now);
        }
        self.refresh_status();
    }

    fn sync_to_disk(&mut self) {
        if let Some(parts) = self.cut.as_mut().and_then(|cut| cut.parts.as_mut()) {
            parts.sync_to_disk();
        }
        if let Some(ring) = &mut self.ring_files {
            ring.sync_to_disk();
        }
    }

    fn finish_recording(&mut self, buses: &[String]) {
        for trigger in std::mem::take(&mut self.waiting) {
            self.fire_trigger(trigger, buses);
        }
        let is_over = self.cut.as_ref().is_some_and(|cut| self.clock.latest_complete() > cut.end);
        self.complete_cut(if is_over { CutEnd::Window } else { CutEnd::Stopped }, buses);
        if let Some(ring) = &mut self.ring_files {
            // The ring is for a crash; the captures are complete.
            ring.remove_all();
        }
        self.refresh_status();
        self.status.has_ended = true;
    }

    fn status(&self) -> &RecordStatus {
        &self.status
    }
}

fn to_nanoseconds(time: Duration) -> i64 {
    i64::try_from(time.as_nanos()).unwrap_or(i64::MAX)
}
