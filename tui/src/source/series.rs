//! Series: parts of one capture that a recorder, or `split`, wrote as several files.
//!
//! ```text
//! run.log ──────▶│run-0002.log ──────▶│run-0003.log ──▶    one capture: frames are counted over all parts
//!                └─ starts 0 to 5 s after the last frame, on the same clock and buses
//! ```

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{Batch, ReadOptions};
use cobscope_decoder::frame::Timestamp;

use super::file::open;
use super::names::{is_numbered_like, order_in_series};
use super::scan::{Apart, CaptureScan};

/// Maximum size of a part with nothing but comments, in bytes.
const LARGEST_BLANK: u64 = 64 * 1024;

/// Maximum number of parts that a note lists at each end.
const LISTED: usize = 4;

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
}

/// A file that may be a part of a series.
#[derive(Debug, Clone)]
pub struct CaptureFile {
    /// Path; `-` is standard input, which is never joined.
    pub path: PathBuf,
    /// The user named the file. Files found in a folder are joined only if their names are consecutive.
    pub is_listed: bool,
}

/// One capture: a file, or the parts of a series in order.
#[derive(Debug, Clone)]
pub struct Series {
    /// Files in order.
    pub parts: Vec<PathBuf>,
    /// Number of the first frame of each part; empty for a single file.
    pub first_frames: Vec<u64>,
    /// Nanoseconds added to the timestamps of each part; empty for a single file.
    pub shifts: Vec<i64>,
}

impl Series {
    /// Whether the capture has several parts.
    pub fn is_joined(&self) -> bool {
        self.parts.len() > 1
    }

    /// Whether the capture consists of all files of the command line.
    pub fn is_joined_from(&self, files: &[PathBuf]) -> bool {
        self.is_joined() && self.parts.len() == files.len()
    }

    /// Path of the first part.
    pub fn first(&self) -> &Path {
        self.parts.first().map_or(Path::new(""), PathBuf::as_path)
    }

    /// Name of the capture: its path, or for a series `log/run.log..run-0003.log`.
    pub fn name(&self) -> String {
        let first = self.first().display().to_string();
        match self.parts.last().filter(|_| self.is_joined()) {
            Some(last) => format!("{first}..{}", file_name(last)),
            None => first,
        }
    }

    /// Note that lists the parts with the numbers of their first frames; `None` for a single file.
    pub fn note(&self) -> Option<String> {
        if !self.is_joined() {
            return None;
        }
        let all: Vec<String> = self
            .parts
            .iter()
            .zip(&self.first_frames)
            .map(|(part, frame)| format!("{} from {{{frame}}}", file_name(part)))
            .collect();
        let count = all.len();
        let shown = match (all.get(..LISTED), all.last()) {
            (Some(head), Some(last)) if count > LISTED + 1 => format!("{}, …, {last}", head.join(", ")),
            _ => all.join(", "),
        };
        let how = if self.shifts.iter().any(|shift| *shift != 0) {
            "their clocks start again, so the times of each continue at the last frame of the one before (--join)"
        } else {
            "--separate reads each alone"
        };
        Some(format!("{}: {count} parts of one capture: {shown}; {how}", self.name()))
    }
}

/// Position of a file relative to the previous part of the same recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Relation {
    /// No previous part.
    #[default]
    Independent,
    /// The next part of the series that contains this file.
    Continues(usize),
    /// The same recorder, after a pause that is longer than a series allows.
    Later(usize),
}

/// Relations of files, and notes on files that are not joined although their names are consecutive.
#[derive(Debug, Default)]
pub struct Relations {
    /// Files, without parts that contain nothing but comments.
    pub files: Vec<CaptureFile>,
    /// Relation of each file.
    pub of: Vec<Relation>,
    /// Reasons why files are not joined.
    pub notes: Vec<String>,
    /// Number of frames of each file that was read to its end.
    frames: Vec<u64>,
    /// Nanoseconds added to the timestamps of each file.
    shifts: Vec<i64>,
}

impl Relations {
    fn independent(files: Vec<CaptureFile>) -> Self {
        let count = files.len();
        let of = vec![Relation::Independent; count];
        Self { files, of, notes: Vec::new(), frames: vec![0; count], shifts: vec![0; count] }
    }

    /// Nanoseconds added to the timestamps of a file: its relative clock starts again.
    pub fn shift(&self, index: usize) -> i64 {
        self.shifts.get(index).copied().unwrap_or(0)
    }

    fn join(&mut self, before: usize, after: usize) {
        if let Some(relation) = self.of.get_mut(after) {
            *relation = Relation::Continues(before);
        }
    }

    fn set_frames(&mut self, index: usize, frames: u64) {
        if let Some(count) = self.frames.get_mut(index) {
            *count = frames;
        }
    }

    /// Whether a file is an earlier part of the series that contains `other`.
    fn precedes(&self, index: usize, other: usize) -> bool {
        let mut part = other;
        for _ in 0..self.of.len() {
            match self.of.get(part) {
                Some(Relation::Continues(before)) => part = *before,
                _ => break,
            }
        }
        part == index
    }

    /// The series, in the order of their first parts on the command line.
    pub fn series(&self) -> Vec<Series> {
        let files = &self.files;
        let next = |index: usize| self.of.iter().position(|one| *one == Relation::Continues(index));
        let mut placed = vec![false; files.len()];
        let mut all: Vec<(Series, Vec<usize>)> = Vec::new();
        for start in
            (0..files.len()).filter(|start| !matches!(self.of.get(*start), Some(Relation::Continues(_))))
        {
            let mut members = Vec::new();
            let mut index = Some(start);
            while let Some(part) = index.filter(|part| placed.get(*part) == Some(&false)) {
                placed.iter_mut().skip(part).take(1).for_each(|is_placed| *is_placed = true);
                members.push(part);
                index = next(part);
            }
            all.push((self.one(files, &members), members));
        }
        all.sort_by_key(|(_, members)| members.iter().min().copied());
        all.into_iter().map(|(series, _)| series).collect()
    }

    fn one(&self, files: &[CaptureFile], members: &[usize]) -> Series {
        let path = |index: &usize| files.get(*index).map(|file| file.path.clone());
        let mut frame: u64 = 1;
        let (mut first_frames, mut shifts) = (Vec::new(), Vec::new());
        for index in members.iter().filter(|_| members.len() > 1) {
            first_frames.push(frame);
            shifts.push(self.shift(*index));
            frame = frame.saturating_add(self.frames.get(*index).copied().unwrap_or(0));
        }
        Series { parts: members.iter().filter_map(path).collect(), first_frames, shifts }
    }
}

/// Finds the series among files. Only files with consecutive names, or that follow each other on the command
/// line, are read to their ends.
pub fn relate(files: Vec<CaptureFile>, read: &ReadOptions, join: JoinOptions) -> Relations {
    let count = files.iter().filter(|file| file.path.is_file()).count();
    if join.is_off || count < 2 {
        return Relations::independent(files);
    }
    if join.is_requested {
        return joined_on_request(files, read);
    }
    let heads: Vec<Option<Head>> = files.iter().map(|file| Head::read(&file.path, read)).collect();
    let (files, heads) = without_blank_parts(files, heads);
    let mut relations = Relations::independent(files);
    let files = relations.files.clone();
    let files = files.as_slice();
    let mut scans: BTreeMap<usize, CaptureScan> = BTreeMap::new();
    for Pair { before, after, is_numbered } in pairs(files, &heads) {
        for index in [before, after] {
            if let (false, Some(file)) = (scans.contains_key(&index), files.get(index)) {
                scans.extend(CaptureScan::read(&file.path, read).map(|scan| (index, scan)));
            }
        }
        let (Some(earlier), Some(later)) = (scans.get(&before), scans.get(&after)) else { continue };
        let name =
            |index: usize| files.get(index).map_or(String::new(), |file| file.path.display().to_string());
        match earlier.relation(later, join.max_gap) {
            Ok(()) if relations.precedes(after, before) => {}
            Ok(()) => {
                relations.join(before, after);
                for (index, scan) in [(before, earlier), (after, later)] {
                    relations.set_frames(index, scan.frames);
                }
                if let (Some(earlier), Some(mut later)) = (scans.remove(&before), scans.remove(&after)) {
                    later.inherit(&earlier);
                    scans.insert(before, earlier);
                    scans.insert(after, later);
                }
            }
            Err(Apart { reason, is_later, is_close }) => {
                if is_later && is_numbered {
                    relations
                        .of
                        .iter_mut()
                        .skip(after)
                        .take(1)
                        .for_each(|one| *one = Relation::Later(before));
                }
                if is_close && is_numbered {
                    relations.notes.push(format!(
                        "{}: not joined to {}: {reason}",
                        name(after),
                        name(before)
                    ));
                }
            }
        }
    }
    relations
}

/// All files as parts of one capture, in their order. A file whose clock does not fit starts another capture.
fn joined_on_request(files: Vec<CaptureFile>, read: &ReadOptions) -> Relations {
    let mut relations = Relations::independent(files);
    let paths: Vec<PathBuf> = relations.files.iter().map(|file| file.path.clone()).collect();
    let mut before: Option<(usize, CaptureScan)> = None;
    for (index, path) in paths.iter().enumerate() {
        // An unreadable file is reported when it is decoded.
        let Some(scan) = path.is_file().then(|| CaptureScan::read(path, read)).flatten() else { continue };
        if scan.frames == 0 {
            continue;
        }
        if let Some((earlier, known)) = &before {
            match known.shift_of(&scan, relations.shift(*earlier)) {
                Ok(shift) => {
                    relations.join(*earlier, index);
                    relations.set_frames(*earlier, known.frames);
                    relations.set_frames(index, scan.frames);
                    relations.shifts.iter_mut().skip(index).take(1).for_each(|own| *own = shift);
                }
                Err(reason) => {
                    let name = |index: usize| {
                        paths.get(index).map_or(String::new(), |path| path.display().to_string())
                    };
                    relations.notes.push(format!(
                        "{}: not joined to {}: {reason}",
                        name(index),
                        name(*earlier)
                    ));
                }
            }
        }
        before = Some((index, scan));
    }
    relations
}

/// Removes parts without frames: the first lines of a capture may be comments, and `split` can write empty
/// parts. A neighbour with the same kind of name must have frames.
fn without_blank_parts(
    files: Vec<CaptureFile>,
    heads: Vec<Option<Head>>,
) -> (Vec<CaptureFile>, Vec<Option<Head>>) {
    let numbered: Vec<(PathBuf, String)> = files
        .iter()
        .zip(&heads)
        .filter(|(_, head)| head.is_some())
        .map(|(file, _)| (file.path.clone(), file_name(&file.path)))
        .collect();
    let is_part = |path: &Path| {
        let name = file_name(path);
        let is_like = |(other, known): &(PathBuf, String)| {
            other.parent() == path.parent() && is_numbered_like(&name, known)
        };
        // A single other file is an ordinary capture next to an empty one.
        numbered.iter().filter(|known| is_like(known)).count() > 1
    };
    let all = files.into_iter().zip(heads);
    all.filter(|(file, head)| head.is_some() || !is_part(&file.path) || !is_blank(&file.path)).unzip()
}

/// Whether a file contains only empty lines and comments.
fn is_blank(path: &Path) -> bool {
    let mut text = Vec::new();
    let Ok(file) = File::open(path) else { return false };
    let size = file.take(LARGEST_BLANK + 1).read_to_end(&mut text).unwrap_or(usize::MAX);
    let mut lines = text.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii);
    size as u64 <= LARGEST_BLANK && lines.all(|line| line.is_empty() || line.starts_with(b"#"))
}

/// Two files of which the second may continue the first.
struct Pair {
    before: usize,
    after: usize,
    /// Their names are consecutive.
    is_numbered: bool,
}

/// Pairs that may belong together: consecutive names first, then neighbours on the command line.
fn pairs(files: &[CaptureFile], heads: &[Option<Head>]) -> Vec<Pair> {
    let mut order: Vec<(usize, &Head, String)> = Vec::new();
    for (index, (file, head)) in files.iter().zip(heads).enumerate() {
        if let Some(head) = head {
            order.push((index, head, file_name(&file.path)));
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
            all.push(Pair { before: *before, after: *after, is_numbered: true });
        }
    }
    let listed = (1..files.len()).filter(|after| {
        let both = files.get(after - 1).zip(files.get(*after));
        both.is_some_and(|(one, other)| one.is_listed && other.is_listed)
    });
    for after in listed {
        let before = after - 1;
        let heads = heads.get(before).and_then(Option::as_ref).zip(heads.get(after).and_then(Option::as_ref));
        let is_free = !all.iter().any(|pair| pair.before == before || pair.after == after);
        if is_free && heads.is_some_and(|(one, other)| one.may_precede(other)) {
            all.push(Pair { before, after, is_numbered: false });
        }
    }
    all
}

/// Start of a capture.
struct Head {
    folder: PathBuf,
    format: &'static str,
    first: Timestamp,
}

impl Head {
    /// `None` for anything but a readable file with timestamps; pipes can be read only once.
    fn read(path: &Path, options: &ReadOptions) -> Option<Self> {
        if !path.is_file() {
            return None;
        }
        let mut reader = open(path, options).ok()?.reader;
        let mut batch = Batch::new();
        while batch.frames().is_empty() && reader.read(&mut batch).ok()? {}
        let first = batch.frames().first()?.time?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        Some(Self { folder, format: reader.format().name, first })
    }

    fn kind(&self) -> (&Path, &'static str, bool) {
        (&self.folder, self.format, self.first.has_date())
    }

    fn may_precede(&self, other: &Self) -> bool {
        self.kind() == other.kind() && self.first <= other.first
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}
