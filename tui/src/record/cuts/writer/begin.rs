//! Start of a capture: items that are in the files of the ring only, and the bus file.

use super::super::super::item::PendingItem;
use super::super::super::status::RecordFailure;
use super::super::clock::RingClock;
use super::super::cut::OpenCut;
use super::super::state::{BusState, path_of};
use super::CutWriter;

/// Result of reading the files of the ring.
struct FilesRead {
    /// State before the first item of the window.
    state: Option<BusState>,
    /// Time of the oldest frame in the files.
    first: Option<i64>,
    /// Whether items of the window were taken.
    has_begun: bool,
    /// Whether the files contain all frames since the start.
    is_all: bool,
    clock: RingClock,
    /// Ring time of the last frame.
    time: i64,
}

impl FilesRead {
    /// Advances the time to that of an item.
    fn advance_to(&mut self, item: &PendingItem) {
        if let Some(stamp) = item.frame().and_then(|frame| frame.time) {
            self.time = self.clock.ring_time(stamp);
            self.first = self.first.or(Some(self.time));
        }
    }

    /// Adds an item to a capture if it is in its window; if it is before the window, it changes the state.
    fn take_item(&mut self, item: PendingItem, cut: &mut OpenCut, buses: &[String]) -> bool {
        let is_in = cut.has_time(self.time);
        if is_in {
            self.has_begun = true;
            cut.add_item(item);
        } else if let Some(state) = self.state.as_mut().filter(|_| !self.has_begun) {
            state.push(&item, buses);
        }
        is_in
    }
}

impl CutWriter {
    /// Writes the bus file of a capture, and items of its window that are no longer in memory.
    pub(super) fn begin_cut(&mut self, cut: &mut OpenCut, buses: &[String]) {
        cut.late = self.lacking_time(cut.begin);
        let in_files = if cut.late > 0 { self.begin_in_files(cut, buses) } else { None };
        let state = in_files.or_else(|| {
            let mut state = self.state.as_ref()?.in_memory.clone();
            let before = self.ring.items_from(0).take_while(|one| !cut.has_time(one.time));
            before.for_each(|one| state.push(&one.item, buses));
            Some(state)
        });
        if let Some(state) = state {
            self.write_state(cut, &state);
        }
    }

    /// Time that the ring in memory lacks at the start of a window, in ns.
    fn lacking_time(&self, begin: i64) -> i64 {
        let first = self.ring.first_time().filter(|_| self.ring.first_sequence() > 0);
        first.map_or(0, |first| first.saturating_sub(begin).max(0))
    }

    /// Takes the items before those in memory from the files; returns the state before the first one. `None` if the
    /// files have none.
    fn begin_in_files(&mut self, cut: &mut OpenCut, buses: &[String]) -> Option<BusState> {
        let state = self.state.as_ref().map(|state| state.in_files.clone());
        let found = self.read_files(cut, 0, state, buses)?;
        if let Some(first) = found.first {
            cut.late = if found.is_all { 0 } else { first.saturating_sub(cut.begin).max(0) };
        }
        found.state.filter(|_| found.has_begun)
    }

    /// Takes the items between those in the file and those in memory from the files of the ring; `false` if they are
    /// incomplete.
    pub(super) fn fill_gap(&mut self, cut: &mut OpenCut, buses: &[String]) -> bool {
        cut.write_items(buses, self.now);
        let is_filled = self.read_files(cut, cut.next_frame(), None, buses).is_some();
        cut.skip_to_memory(&self.ring);
        is_filled
    }

    /// Takes items of the window from the files of the ring: from the frame after `from` frames on, up to those in
    /// memory. `state` follows the items before them. `None` if the files are incomplete.
    fn read_files(
        &mut self,
        cut: &mut OpenCut,
        from: u64,
        state: Option<BusState>,
        buses: &[String],
    ) -> Option<FilesRead> {
        let mut files = self.ring_files.take_if(|files| files.is_complete())?;
        let until = self.ring.evicted_frames();
        let (now, most) = (self.now, self.options.bytes.saturating_sub(self.done.bytes));
        let is_all = files.removed_frames() == 0;
        let (clock, time) = (self.clock, i64::MIN);
        let mut found = FilesRead { state, first: None, has_begun: false, is_all, clock, time };
        let read = files.read_items(buses, &mut |before, item| {
            let is_over = before >= until;
            // A notice directly before the first frame may be in the file already.
            let is_known = before < from || (from > 0 && !found.has_begun && !item.is_frame());
            found.advance_to(&item);
            if !is_over && !is_known && found.take_item(item, cut, buses) && cut.is_full() {
                cut.write_items(buses, now);
            }
            !is_over && cut.bytes() < most
        });
        self.ring_files = Some(files);
        let Err(error) = read else { return Some(found) };
        self.other_failure(&cut.path.clone(), &format!("cannot read the ring: {error}"));
        None
    }

    /// Writes the bus file with the state before the first frame.
    fn write_state(&mut self, cut: &mut OpenCut, state: &BusState) {
        let Some(follower) = &self.state else { return };
        let path = path_of(&cut.path);
        let written = follower
            .bus_file_text(state, &path)
            .and_then(|text| Ok(self.files.write_state(&path, &text).map(|()| text.len())?));
        match written {
            Ok(size) => {
                self.done.bytes = self.done.bytes.saturating_add(size as u64);
                cut.bus_file = Some(path);
            }
            Err(error) => self.other_failure(&path, &format!("{error:#}")),
        }
    }

    fn other_failure(&mut self, path: &std::path::Path, reason: &str) {
        let (path, reason) = (path.to_owned(), reason.to_owned());
        self.done.other_failure = Some(RecordFailure { path, reason, missing: 0, is_over: false });
    }
}
