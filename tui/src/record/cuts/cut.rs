//! A capture of a trigger while it is written.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use cobscope_decoder::frame::Timestamp;

use super::super::item::{PendingItem, RecordItem};
use super::super::parts::RecordParts;
use super::ring::{ItemRing, RingItem};
use super::{CompleteCut, CutEnd};

/// Maximum number of items that are written together.
pub(super) const BATCH: usize = 1_024;

/// Comments of frames by sequence number.
pub(super) type Comments = BTreeMap<u64, String>;

/// Start of a capture, and the next item to consider.
pub(super) struct OpenCutStart {
    begin: i64,
    first: Option<u64>,
    next: u64,
    next_frame: u64,
    span: Option<(Timestamp, Timestamp)>,
}

/// A capture with an open window.
pub(super) struct OpenCut {
    /// The file; None until it can be created.
    pub parts: Option<RecordParts>,
    /// Path of the file.
    pub path: PathBuf,
    /// Its bus file.
    pub bus_file: Option<PathBuf>,
    /// Start of the window in ring time, inclusive.
    pub begin: i64,
    /// End of the window in ring time, inclusive.
    pub end: i64,
    /// Sequence number of the first item of the file; None before it is taken.
    pub first: Option<u64>,
    /// Number of triggers.
    pub triggers: u64,
    /// Number of times that the file was replaced by a longer one.
    pub replaced: u32,
    /// Time of the next attempt to create the file.
    pub retry_at: Option<Instant>,
    /// Number of frames that left the ring while there was no file.
    pub missing: u64,
    /// Time that its start lacks, in ns.
    pub late: i64,
    /// Comment of the first frame, until it is written.
    title: Option<String>,
    /// Sequence number of the next item to consider.
    next: u64,
    /// Number of frames before this item.
    next_frame: u64,
    /// Earliest and latest time of the frames taken.
    span: Option<(Timestamp, Timestamp)>,
    /// Timestamp of the last frame taken.
    last_time: Option<Timestamp>,
    /// Items to be written.
    held: Vec<PendingItem>,
}

impl OpenCut {
    /// A capture without a file, of the items of the ring.
    pub(super) fn new(path: PathBuf, (begin, end): (i64, i64), ring: &ItemRing, title: String) -> Self {
        Self {
            parts: None,
            path,
            bus_file: None,
            begin,
            end,
            first: None,
            triggers: 1,
            replaced: 0,
            retry_at: None,
            missing: 0,
            late: 0,
            title: Some(title),
            next: ring.first_sequence(),
            next_frame: ring.evicted_frames(),
            span: None,
            last_time: None,
            held: Vec::new(),
        }
    }

    /// Starts again with another file, with a window from `begin` and the items of the ring. Returns the present start
    /// for `resume`.
    pub(super) fn restart_file(&mut self, begin: i64, ring: &ItemRing, title: String) -> OpenCutStart {
        let start = OpenCutStart {
            begin: self.begin,
            first: self.first,
            next: self.next,
            next_frame: self.next_frame,
            span: self.span,
        };
        self.title = Some(title);
        (self.begin, self.first) = (begin, None);
        self.skip_to_memory(ring);
        start
    }

    /// Continues the file before `restart`.
    pub(super) fn resume_file(
        &mut self,
        OpenCutStart { begin, first, next, next_frame, span }: OpenCutStart,
    ) {
        self.held.clear();
        self.title = None;
        (self.begin, self.first, self.span) = (begin, first, span);
        (self.next, self.next_frame) = (next, next_frame);
    }

    /// Takes items of the window from the ring, at most one batch; `false` if it has no further ones. Items after
    /// the window wait for an extension of it, unless it is final.
    pub(super) fn take_items(&mut self, ring: &ItemRing, comments: &Comments, is_final: bool) -> bool {
        if self.has_gap(ring) && !is_final {
            return false;
        }
        if self.next < ring.first_sequence() {
            self.skip_to_memory(ring);
        }
        for one in ring.items_from(self.next) {
            if self.is_full() {
                return true;
            }
            if one.time > self.end && !is_final {
                return false;
            }
            self.next = one.sequence.saturating_add(1);
            self.next_frame = self.next_frame.saturating_add(u64::from(one.item.is_frame()));
            if self.has_time(one.time) {
                self.first = self.first.or(Some(one.sequence));
                self.count_item(&one.item);
                let item = self.commented_item(one, comments);
                self.held.push(item);
            }
        }
        false
    }

    /// Whether items after the file so far have left the ring: they were after the window.
    pub(super) fn has_gap(&self, ring: &ItemRing) -> bool {
        self.parts.is_some() && self.next < ring.first_sequence()
    }

    /// Number of frames before the next item to consider.
    pub(super) fn next_frame(&self) -> u64 {
        self.next_frame
    }

    /// Continues with the oldest item in memory.
    pub(super) fn skip_to_memory(&mut self, ring: &ItemRing) {
        (self.next, self.next_frame) = (ring.first_sequence(), ring.evicted_frames());
    }

    /// Adds an item before those of the ring.
    pub(super) fn add_item(&mut self, item: PendingItem) {
        self.count_item(&item);
        let item = match (&item.what, self.title.take_if(|_| item.is_frame())) {
            (RecordItem::Frame(frame), Some(title)) => {
                let what = RecordItem::Commented(Box::new((*frame, title)));
                PendingItem { bus: item.bus, what }
            }
            _ => item,
        };
        self.held.push(item);
    }

    /// Whether a batch was taken.
    pub(super) fn is_full(&self) -> bool {
        self.held.len() >= BATCH
    }

    fn count_item(&mut self, item: &PendingItem) {
        let Some(time) = item.frame().and_then(|frame| frame.time) else { return };
        self.last_time = Some(time);
        let (first, last) = self.span.unwrap_or((time, time));
        self.span = Some((first.min(time), last.max(time)));
    }

    /// Writes the taken items. Without a file they are missing.
    pub(super) fn write_items(&mut self, buses: &[String], now: Option<Instant>) {
        let items = std::mem::take(&mut self.held);
        match &mut self.parts {
            _ if items.is_empty() => (),
            Some(parts) => parts.take_items(items, buses, now),
            None => {
                let frames = items.iter().filter(|item| item.is_frame()).count() as u64;
                self.missing = self.missing.saturating_add(frames);
            }
        }
    }

    /// Counts a frame that leaves the ring although it should be written.
    pub(super) fn count_evicted(&mut self, one: &RingItem) {
        let is_lost = one.sequence >= self.next && self.has_time(one.time) && one.item.is_frame();
        self.missing = self.missing.saturating_add(u64::from(is_lost));
    }

    /// Whether a time is in the window.
    pub(super) fn has_time(&self, time: i64) -> bool {
        (self.begin..=self.end).contains(&time)
    }

    /// Bytes written.
    pub(super) fn bytes(&self) -> u64 {
        self.parts.as_ref().map_or(0, |parts| parts.status().bytes)
    }

    /// Ends the file.
    pub(super) fn finish_cut(mut self, end: CutEnd) -> (CompleteCut, Option<RecordParts>) {
        let mut parts = self.parts.take();
        if let Some(parts) = &mut parts {
            parts.finish_recording();
        }
        let status = parts.as_ref().map(|parts| parts.status().clone()).unwrap_or_default();
        let complete = CompleteCut {
            paths: parts.as_ref().map(|parts| parts.paths().cloned().collect()).unwrap_or_default(),
            bus_file: self.bus_file,
            frames: status.frames,
            missing: status.missing.saturating_add(self.missing),
            bytes: status.bytes,
            triggers: self.triggers,
            last_time: self.last_time,
            duration: self.span.map_or(0, |(first, last)| last.0.saturating_sub(first.0)),
            end,
        };
        (complete, parts)
    }

    /// The item with its comments.
    fn commented_item(&mut self, one: &RingItem, comments: &Comments) -> PendingItem {
        let RecordItem::Frame(frame) = &one.item.what else { return one.item.clone() };
        let own = comments.get(&one.sequence);
        let title = self.title.take().filter(|title| own.is_none_or(|own| !own.contains(title.as_str())));
        let texts: Vec<&str> = title.as_deref().into_iter().chain(own.map(String::as_str)).collect();
        if texts.is_empty() {
            return one.item.clone();
        }
        let what = RecordItem::Commented(Box::new((*frame, texts.join("\n"))));
        PendingItem { bus: one.item.bus, what }
    }
}
