//! Extension of an open capture by a later trigger.

use std::path::Path;

use super::super::super::parts::RecordParts;
use super::super::super::trigger::CaptureTrigger;
use super::super::cut::OpenCut;
use super::super::files::replacement_path;
use super::super::ring_files::RingFiles;
use super::super::{CutEnd, CutNews};
use super::CutWriter;

/// Maximum number of times that a capture is replaced by one that starts earlier.
const MOST_REPLACED: u32 = 8;

impl CutWriter {
    /// Extends the open capture to the window of a trigger that overlaps with it. If items in between are in no ring any
    /// more, it ends and another one starts.
    pub(super) fn extend_cut(&mut self, (begin, end): (i64, i64), trigger: CaptureTrigger, buses: &[String]) {
        let Some(mut cut) = self.cut.take() else { return };
        let former_end = cut.end;
        cut.end = cut.end.max(end);
        if cut.has_gap(&self.ring) && !self.fill_gap(&mut cut, buses) {
            cut.end = former_end;
            self.cut = Some(cut);
            self.complete_cut(CutEnd::Window, buses);
            return self.start_cut((begin, end), trigger, buses);
        }
        let late = if begin >= cut.begin {
            0
        } else if self.extend_start(&mut cut, begin, &trigger, buses) {
            cut.late
        } else {
            cut.begin.saturating_sub(begin)
        };
        cut.triggers = cut.triggers.saturating_add(1);
        let path = cut.path.clone();
        self.cut = Some(cut);
        self.report_news(CutNews::Triggered { trigger, path, late });
    }

    /// Lets a capture start earlier, which needs another file; `false` if the ring or the disk does not allow it.
    fn extend_start(
        &mut self,
        cut: &mut OpenCut,
        begin: i64,
        trigger: &CaptureTrigger,
        buses: &[String],
    ) -> bool {
        let is_whole = cut
            .parts
            .as_ref()
            .is_some_and(|parts| parts.paths().count() == 1 && parts.status().failure.is_none());
        let first = cut.first.unwrap_or(u64::MAX);
        let has_files = self.ring_files.as_ref().is_some_and(RingFiles::is_complete);
        let has_all = has_files || self.ring.first_sequence() <= first;
        if !has_all || !is_whole || cut.replaced >= MOST_REPLACED {
            return false;
        }
        let adds_items = has_files || {
            let mut earlier = self.ring.items_from(0).take_while(|one| one.sequence < first);
            earlier.any(|one| one.time >= begin)
        };
        if adds_items {
            return self.replace_file(cut, begin, trigger, buses);
        }
        cut.begin = begin;
        true
    }

    /// Replaces the file of a capture by one with earlier items; `false` if it cannot be written.
    fn replace_file(
        &mut self,
        cut: &mut OpenCut,
        begin: i64,
        trigger: &CaptureTrigger,
        buses: &[String],
    ) -> bool {
        let Ok((_, parts)) = self.files.create_capture(&replacement_path(&cut.path)) else { return false };
        cut.write_items(buses, self.now);
        let earlier = cut.parts.replace(parts);
        let start = cut.restart_file(begin, &self.ring, trigger.frame_comment());
        self.begin_cut(cut, buses);
        while cut.take_items(&self.ring, &self.comments, false) {
            cut.write_items(buses, self.now);
        }
        cut.write_items(buses, self.now);
        if cut.parts.as_mut().is_some_and(|parts| is_renamed(parts, &cut.path)) {
            cut.replaced = cut.replaced.saturating_add(1);
            return true;
        }
        // The file so far stays, and later frames are added to it.
        if let Some(mut failed) = std::mem::replace(&mut cut.parts, earlier) {
            failed.remove_all();
        }
        cut.resume_file(start);
        false
    }
}

/// Renames a complete file; `false` if it is not complete or cannot be renamed.
fn is_renamed(parts: &mut RecordParts, path: &Path) -> bool {
    parts.sync_to_disk();
    parts.status().failure.is_none() && parts.rename_part(path.to_owned()).is_ok()
}
