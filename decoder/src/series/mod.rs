//! Series: parts of one capture that a recorder, or `split`, wrote as several files.
//!
//! ```text
//! run.log ──────▶│run-0002.log ──────▶│run-0003.log ──▶    one capture: frames are counted over all parts
//!                └─ starts 0 to 5 s after the last frame, on the same clock and buses
//! ```
//!
//! Nothing is opened here: a [`PossiblePart`] reads itself.

mod arrange;
mod names;
mod part;
mod scan;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::frame::Timestamp;
use names::{is_numbered_like, order_in_series};
use scan::SeparationReason;

pub use arrange::{CapturePlacement, MixedClocks, arrange_captures};
pub use names::count_siblings;
pub use part::{PossiblePart, SeriesRelation, is_blank};
pub use scan::CaptureScan;

/// Conditions for joining files.
#[derive(Debug, Clone, Copy)]
pub struct JoinOptions {
    /// Join no files.
    pub is_off: bool,
    /// Join all files in their order, also if a relative clock starts again.
    pub is_requested: bool,
    /// Maximum time from the last frame of a part to the first frame of the next one, in ns.
    pub max_gap: i64,
}

impl JoinOptions {
    /// Joins no files.
    pub const OFF: Self = Self { is_off: true, is_requested: false, max_gap: 0 };

    /// Joins files with consecutive names, or listed one after another, with a gap of at most 5 s.
    pub const USUAL: Self = Self { is_off: false, is_requested: false, max_gap: 5_000_000_000 };
}

/// Files of one series.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SeriesParts {
    /// Indices in [`SeriesRelations::files`], in order.
    pub files: Vec<usize>,
    /// Number of the first frame of each part; empty for a single file.
    pub first_frames: Vec<u64>,
    /// Nanoseconds added to the timestamps of each part; empty for a single file.
    pub shifts: Vec<i64>,
}

/// Reason why two files with consecutive names are not parts of one capture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotJoined {
    /// Names of both files, and the reason.
    pub text: String,
    /// Longest gap that joins files, such as `5.000 s`, if the gap is the reason.
    pub max_gap: Option<String>,
}

/// Relations of files, and notes on files that are not joined although their names are consecutive.
#[derive(Debug, Clone, Default)]
pub struct SeriesRelations {
    /// Indices of the candidates, without parts that contain nothing but comments.
    pub files: Vec<usize>,
    /// Relation of each of these files; numbers are indices in `files`.
    pub of: Vec<SeriesRelation>,
    /// Reasons why files are not joined.
    pub notes: Vec<NotJoined>,
    /// Number of frames of each file that was read to its end.
    frames: Vec<u64>,
    /// Nanoseconds added to the timestamps of each file.
    shifts: Vec<i64>,
}

impl SeriesRelations {
    fn independent(files: Vec<usize>) -> Self {
        let count = files.len();
        let of = vec![SeriesRelation::Independent; count];
        Self { files, of, notes: Vec::new(), frames: vec![0; count], shifts: vec![0; count] }
    }

    /// Nanoseconds added to the timestamps of a file: its relative clock starts again.
    pub fn time_shift(&self, index: usize) -> i64 {
        self.shifts.get(index).copied().unwrap_or(0)
    }

    fn join_parts(&mut self, before: usize, after: usize) {
        if let Some(relation) = self.of.get_mut(after) {
            *relation = SeriesRelation::Continues(before);
        }
    }

    fn set_frames(&mut self, index: usize, frames: u64) {
        if let Some(count) = self.frames.get_mut(index) {
            *count = frames;
        }
    }

    /// Whether a file is an earlier part of the series that contains `other`.
    fn is_part_before(&self, index: usize, other: usize) -> bool {
        let mut part = other;
        for _ in 0..self.of.len() {
            match self.of.get(part) {
                Some(SeriesRelation::Continues(before)) => part = *before,
                _ => break,
            }
        }
        part == index
    }

    /// The series, in the order of their first parts among the files.
    pub fn series(&self) -> Vec<SeriesParts> {
        let count = self.files.len();
        let next = |index: usize| self.of.iter().position(|one| *one == SeriesRelation::Continues(index));
        let mut placed = vec![false; count];
        let mut all: Vec<SeriesParts> = Vec::new();
        for start in
            (0..count).filter(|start| !matches!(self.of.get(*start), Some(SeriesRelation::Continues(_))))
        {
            let mut members = Vec::new();
            let mut index = Some(start);
            while let Some(part) = index.filter(|part| placed.get(*part) == Some(&false)) {
                placed.iter_mut().skip(part).take(1).for_each(|is_placed| *is_placed = true);
                members.push(part);
                index = next(part);
            }
            all.push(self.build_series(members));
        }
        all.sort_by_key(|series| series.files.iter().min().copied());
        all
    }

    fn build_series(&self, members: Vec<usize>) -> SeriesParts {
        let mut frame: u64 = 1;
        let (mut first_frames, mut shifts) = (Vec::new(), Vec::new());
        for index in members.iter().filter(|_| members.len() > 1) {
            first_frames.push(frame);
            shifts.push(self.time_shift(*index));
            frame = frame.saturating_add(self.frames.get(*index).copied().unwrap_or(0));
        }
        SeriesParts { files: members, first_frames, shifts }
    }
}

/// Finds the series among files. Only files with consecutive names, or that were named one after another,
/// are read to their ends.
pub fn relate_files(candidates: &[impl PossiblePart], join: JoinOptions) -> SeriesRelations {
    let all: Vec<usize> = (0..candidates.len()).collect();
    if join.is_off || candidates.len() < 2 {
        return SeriesRelations::independent(all);
    }
    if join.is_requested {
        return joined_on_request(candidates);
    }
    let heads: Vec<Option<CaptureStart>> = candidates.iter().map(CaptureStart::read_start).collect();
    let files: Vec<usize> =
        all.into_iter().filter(|index| !is_blank_part(candidates, &heads, *index)).collect();
    let file = |index: usize| files.get(index).and_then(|candidate| candidates.get(*candidate));
    let mut relations = SeriesRelations::independent(files.clone());
    let mut scans: BTreeMap<usize, CaptureScan> = BTreeMap::new();
    for SeriesPair { before, after, is_numbered } in candidate_pairs(candidates, &heads, &files) {
        for index in [before, after] {
            if let (false, Some(candidate)) = (scans.contains_key(&index), file(index)) {
                scans.extend(CaptureScan::scan_file(candidate).map(|scan| (index, scan)));
            }
        }
        let (Some(earlier), Some(later)) = (scans.get(&before), scans.get(&after)) else { continue };
        let name = |index: usize| file(index).map_or(String::new(), file_text);
        match earlier.relate_next(later, join.max_gap) {
            Ok(()) if relations.is_part_before(after, before) => {}
            Ok(()) => {
                relations.join_parts(before, after);
                for (index, scan) in [(before, earlier), (after, later)] {
                    relations.set_frames(index, scan.frames);
                }
                if let (Some(earlier), Some(mut later)) = (scans.remove(&before), scans.remove(&after)) {
                    later.inherit_buses(&earlier);
                    scans.insert(before, earlier);
                    scans.insert(after, later);
                }
            }
            Err(SeparationReason { reason, max_gap, is_later, is_close }) => {
                if is_later && is_numbered {
                    let relation = relations.of.iter_mut().skip(after).take(1);
                    relation.for_each(|one| *one = SeriesRelation::Later(before));
                }
                if is_close && is_numbered {
                    let text = format!("{}: not joined to {}: {reason}", name(after), name(before));
                    relations.notes.push(NotJoined { text, max_gap });
                }
            }
        }
    }
    relations
}

/// All files as parts of one capture, in their order. A file whose clock does not fit starts another capture.
fn joined_on_request(candidates: &[impl PossiblePart]) -> SeriesRelations {
    let mut relations = SeriesRelations::independent((0..candidates.len()).collect());
    let mut before: Option<(usize, CaptureScan)> = None;
    for (index, candidate) in candidates.iter().enumerate() {
        // An unreadable file is reported when it is decoded.
        let Some(scan) = CaptureScan::scan_file(candidate) else { continue };
        if scan.frames == 0 {
            continue;
        }
        if let Some((earlier, known)) = &before {
            match known.shift_of(&scan, relations.time_shift(*earlier)) {
                Ok(shift) => {
                    relations.join_parts(*earlier, index);
                    relations.set_frames(*earlier, known.frames);
                    relations.set_frames(index, scan.frames);
                    relations.shifts.iter_mut().skip(index).take(1).for_each(|own| *own = shift);
                }
                Err(reason) => {
                    let first = candidates.get(*earlier).map_or(String::new(), file_text);
                    let text = format!("{}: not joined to {first}: {reason}", file_text(candidate));
                    relations.notes.push(NotJoined { text, max_gap: None });
                }
            }
        }
        before = Some((index, scan));
    }
    relations
}

/// Whether a file is a part without frames: the first lines of a capture may be comments, and `split` can write empty
/// parts. A neighbour with the same kind of name must have frames.
fn is_blank_part(candidates: &[impl PossiblePart], heads: &[Option<CaptureStart>], index: usize) -> bool {
    let (Some(candidate), Some(None)) = (candidates.get(index), heads.get(index)) else { return false };
    let (path, name) = (candidate.path(), file_name(candidate));
    let numbered = candidates.iter().zip(heads).filter(|(other, head)| {
        head.is_some()
            && other.path().parent() == path.parent()
            && is_numbered_like(&name, &file_name(*other))
    });
    // A single other file is an ordinary capture next to an empty one.
    numbered.count() > 1 && candidate.is_blank()
}

/// Two files of which the second may continue the first.
struct SeriesPair {
    before: usize,
    after: usize,
    /// Their names are consecutive.
    is_numbered: bool,
}

/// Pairs that may belong together: consecutive names first, then neighbours that were named.
fn candidate_pairs(
    candidates: &[impl PossiblePart],
    heads: &[Option<CaptureStart>],
    files: &[usize],
) -> Vec<SeriesPair> {
    let candidate = |index: usize| files.get(index).and_then(|file| candidates.get(*file));
    let head = |index: usize| files.get(index).and_then(|file| heads.get(*file)).and_then(Option::as_ref);
    let mut order: Vec<(usize, &CaptureStart, String)> = Vec::new();
    for index in 0..files.len() {
        if let (Some(candidate), Some(head)) = (candidate(index), head(index)) {
            order.push((index, head, file_name(candidate)));
        }
    }
    order.sort_by(|(_, one, name), (_, other, other_name)| {
        one.kind().cmp(&other.kind()).then_with(|| order_in_series(name).cmp(&order_in_series(other_name)))
    });
    let mut all = Vec::new();
    for two in order.windows(2) {
        let [(before, one, name), (after, other, next)] = two else { continue };
        // A file that starts earlier overlaps, or belongs to another recording.
        if one.may_precede(other) && is_numbered_like(name, next) {
            all.push(SeriesPair { before: *before, after: *after, is_numbered: true });
        }
    }
    let listed = (1..files.len()).filter(|after| {
        let both = candidate(after.saturating_sub(1)).zip(candidate(*after));
        both.is_some_and(|(one, other)| one.is_listed() && other.is_listed())
    });
    for after in listed {
        let before = after.saturating_sub(1);
        let heads = head(before).zip(head(after));
        let is_free = !all.iter().any(|pair| pair.before == before || pair.after == after);
        if is_free && heads.is_some_and(|(one, other)| one.may_precede(other)) {
            all.push(SeriesPair { before, after, is_numbered: false });
        }
    }
    all
}

/// Start of a capture.
struct CaptureStart {
    folder: PathBuf,
    format: &'static str,
    first: Timestamp,
}

impl CaptureStart {
    /// `None` for anything but a readable file with timestamps.
    fn read_start(candidate: &impl PossiblePart) -> Option<Self> {
        let mut first = None;
        let format = candidate.read_batches(false, &mut |batch, _| {
            first = batch.frames().first().map(|frame| frame.time);
            first.is_none()
        })?;
        let folder = candidate.path().parent().unwrap_or(Path::new("")).to_owned();
        Some(Self { folder, format, first: first?? })
    }

    fn kind(&self) -> (&Path, &'static str, bool) {
        (&self.folder, self.format, self.first.has_date())
    }

    fn may_precede(&self, other: &Self) -> bool {
        self.kind() == other.kind() && self.first <= other.first
    }
}

fn file_text(candidate: &impl PossiblePart) -> String {
    candidate.path().display().to_string()
}

fn file_name(candidate: &impl PossiblePart) -> String {
    candidate
        .path()
        .file_name()
        .map_or_else(|| file_text(candidate), |name| name.to_string_lossy().into_owned())
}
