//! A capture of a trigger while it is written.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use cobscope_decoder::frame::Timestamp;

use super::super::item::{Item, RecordItem};
use super::super::parts::Parts;
use super::ring::{Ring, RingItem};
use super::{CompleteCut, CutEnd};

/// Maximum number of items that are written together.
pub(super) const BATCH: usize = 1_024;

/// Comments of frames by sequence number.
pub(super) type Comments = BTreeMap<u64, String>;

/// Start of a capture, and the next item to consider.
pub(super) struct CutStart {
    begin: i64,
    first: Option<u64>,
    next: u64,
    span: Option<(i64, i64)>,
}

/// A capture with an open window.
pub(super) struct Cut {
    /// The file; None until it can be created.
    pub parts: Option<Parts>,
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
    /// Comment of the first frame, until it is written.
    title: Option<String>,
    /// Sequence number of the next item to consider.
    next: u64,
    /// Earliest and latest time of the frames taken.
    span: Option<(i64, i64)>,
    /// Timestamp of the last frame taken.
    last_time: Option<Timestamp>,
    /// Items to be written.
    held: Vec<Item>,
}

impl Cut {
    /// A capture without a file, of items of the ring from `next` on.
    pub(super) fn new(path: PathBuf, (begin, end): (i64, i64), next: u64, title: String) -> Self {
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
            title: Some(title),
            next,
            span: None,
            last_time: None,
            held: Vec::new(),
        }
    }

    /// Starts again with another file, with a window from `begin` and items of the ring from `next` on. Returns the
    /// present start for `resume`.
    pub(super) fn restart(&mut self, begin: i64, next: u64, title: String) -> CutStart {
        let start = CutStart { begin: self.begin, first: self.first, next: self.next, span: self.span };
        self.title = Some(title);
        (self.begin, self.first, self.next) = (begin, None, next);
        start
    }

    /// Continues the file before `restart`.
    pub(super) fn resume(&mut self, CutStart { begin, first, next, span }: CutStart) {
        self.held.clear();
        self.title = None;
        (self.begin, self.first, self.next, self.span) = (begin, first, next, span);
    }

    /// Takes items of the window from the ring, at most one batch; `false` if it has no further ones. Items after
    /// the window wait for an extension of it, unless it is final.
    pub(super) fn take(&mut self, ring: &Ring, comments: &Comments, is_final: bool) -> bool {
        let next = self.next.max(ring.first_sequence());
        for one in ring.items_from(next) {
            if self.held.len() >= BATCH {
                return true;
            }
            if one.time > self.end && !is_final {
                return false;
            }
            self.next = one.sequence.saturating_add(1);
            if self.has(one.time) {
                self.first = self.first.or(Some(one.sequence));
                if let Some(frame) = one.item.frame() {
                    self.last_time = frame.time.or(self.last_time);
                    let (first, last) = self.span.unwrap_or((one.time, one.time));
                    self.span = Some((first.min(one.time), last.max(one.time)));
                }
                let item = self.commented(one, comments);
                self.held.push(item);
            }
        }
        false
    }

    /// Writes the taken items. Without a file they are missing.
    pub(super) fn write(&mut self, buses: &[String], now: Option<Instant>) {
        let items = std::mem::take(&mut self.held);
        match &mut self.parts {
            _ if items.is_empty() => (),
            Some(parts) => parts.take(items, buses, now),
            None => {
                let frames = items.iter().filter(|item| item.is_frame()).count() as u64;
                self.missing = self.missing.saturating_add(frames);
            }
        }
    }

    /// Counts a frame that leaves the ring although it should be written.
    pub(super) fn evicted(&mut self, one: &RingItem) {
        let is_lost = one.sequence >= self.next && self.has(one.time) && one.item.is_frame();
        self.missing = self.missing.saturating_add(u64::from(is_lost));
    }

    /// Whether a time is in the window.
    pub(super) fn has(&self, time: i64) -> bool {
        (self.begin..=self.end).contains(&time)
    }

    /// Bytes written.
    pub(super) fn bytes(&self) -> u64 {
        self.parts.as_ref().map_or(0, |parts| parts.status().bytes)
    }

    /// Ends the file.
    pub(super) fn finish(mut self, end: CutEnd) -> (CompleteCut, Option<Parts>) {
        let mut parts = self.parts.take();
        if let Some(parts) = &mut parts {
            parts.finish();
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
            duration: self.span.map_or(0, |(first, last)| last.saturating_sub(first)),
            end,
        };
        (complete, parts)
    }

    /// The item with its comments.
    fn commented(&mut self, one: &RingItem, comments: &Comments) -> Item {
        let RecordItem::Frame(frame) = &one.item.what else { return one.item.clone() };
        let own = comments.get(&one.sequence);
        let title = self.title.take().filter(|title| own.is_none_or(|own| !own.contains(title.as_str())));
        let texts: Vec<&str> = title.as_deref().into_iter().chain(own.map(String::as_str)).collect();
        if texts.is_empty() {
            return one.item.clone();
        }
        let what = RecordItem::Commented(Box::new((*frame, texts.join("\n"))));
        Item { bus: one.item.bus, what }
    }
}
