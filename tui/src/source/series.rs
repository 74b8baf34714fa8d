//! Files of a series; the library decides which files form one.

use std::fs::File;
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{Batch, ReadOptions};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::series::{
    self, CaptureScan, JoinOptions, MixedClocks, NotJoined, PossiblePart, SeriesParts, SeriesRelation,
};

use super::file::open_capture;
use crate::path_text::path_text;

/// Maximum number of parts that a note lists at each end.
const LISTED: usize = 4;

/// A file that may be a part of a series.
#[derive(Debug, Clone)]
pub struct CaptureFile {
    /// Path; `-` is standard input, which is never joined.
    pub path: PathBuf,
    /// The user named the file. Files found in a folder are joined only if their names are consecutive.
    pub is_listed: bool,
}

impl CaptureFile {
    /// Files that the user named.
    pub fn files_named(paths: &[PathBuf]) -> Vec<Self> {
        paths.iter().map(|path| Self { path: path.clone(), is_listed: true }).collect()
    }
}

/// One capture: a file, or the parts of a series in order.
#[derive(Debug, Clone)]
pub struct CaptureSeries {
    /// Files in order.
    pub parts: Vec<PathBuf>,
    /// Number of the first frame of each part; empty for a single file.
    pub first_frames: Vec<u64>,
    /// Nanoseconds added to the timestamps of each part; empty for a single file.
    pub shifts: Vec<i64>,
}

impl CaptureSeries {
    /// Whether the capture has several parts.
    pub fn is_joined(&self) -> bool {
        self.parts.len() > 1
    }

    /// Whether the capture consists of all files of the command line.
    pub fn is_joined_from(&self, files: &[PathBuf]) -> bool {
        self.is_joined() && self.parts.len() == files.len()
    }

    /// Path of the first part.
    pub fn first_path(&self) -> &Path {
        self.parts.first().map_or(Path::new(""), PathBuf::as_path)
    }

    /// Name of the capture: its path, or for a series `log/run.log..run-0003.log`.
    pub fn name(&self) -> String {
        let first = self.first_path().display().to_string();
        match self.parts.last().filter(|_| self.is_joined()) {
            Some(last) => format!("{first}..{}", file_name(last)),
            None => first,
        }
    }

    /// Note that lists the parts with the numbers of their first frames; `None` for a single file.
    pub fn parts_note(&self) -> Option<String> {
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

/// Maximum number of entries of a folder that are compared with the name of a capture.
const MOST_ENTRIES: usize = 20_000;

/// Note on a single file whose folder has further parts of the same recording.
pub fn siblings_note(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).ok()?.take(MOST_ENTRIES).flatten();
    let names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    let count = series::count_siblings(name, names.iter().map(String::as_str));
    (count > 0).then(|| {
        let shown = path_text(path);
        format!("{shown}: one of {} files with consecutive names in its folder; name all of them to read one capture", count + 1)
    })
}

/// Relations of files.
#[derive(Debug)]
pub struct CaptureRelations {
    /// Files, without parts that contain nothing but comments.
    pub files: Vec<CaptureFile>,
    found: series::SeriesRelations,
}

impl CaptureRelations {
    /// Relation of each file.
    pub fn all_relations(&self) -> &[SeriesRelation] {
        &self.found.of
    }

    /// Reasons why files are not joined.
    pub fn separation_notes(&self) -> impl Iterator<Item = String> {
        self.found.notes.iter().map(|NotJoined { text, max_gap }| match max_gap {
            Some(gap) => format!("{text} (--part-gap {gap})"),
            None => text.clone(),
        })
    }

    /// Nanoseconds added to the timestamps of a file: its relative clock starts again.
    pub fn time_shift(&self, index: usize) -> i64 {
        self.found.time_shift(index)
    }

    /// The series, in the order of their first parts on the command line.
    pub fn series(&self) -> Vec<CaptureSeries> {
        let path = |index: usize| self.files.get(index).map(|file| file.path.clone());
        let of = |SeriesParts { files, first_frames, shifts }| {
            let parts = files.into_iter().filter_map(path).collect();
            CaptureSeries { parts, first_frames, shifts }
        };
        self.found.series().into_iter().map(of).collect()
    }
}

/// Finds the series among files. Only files with consecutive names, or that follow each other on the command
/// line, are read to their ends.
pub fn relate_files(files: &[CaptureFile], read: &ReadOptions, join: JoinOptions) -> CaptureRelations {
    let candidates: Vec<_> = files.iter().map(|file| ReadableFile { file, read }).collect();
    let found = series::relate_files(&candidates, join);
    let files = found.files.iter().filter_map(|index| files.get(*index)).cloned().collect();
    CaptureRelations { files, found }
}

/// Error of captures without a common time axis, with the option that gives them one.
pub fn mixed_clocks(mixed: MixedClocks) -> anyhow::Error {
    anyhow::anyhow!("{mixed}, or use --align to start them together")
}

/// Earliest and latest timestamp of files; `None` for pipes, which can be read only once.
pub fn time_span(files: &[PathBuf], read: &ReadOptions) -> Option<(Timestamp, Timestamp)> {
    let mut all: Option<(Timestamp, Timestamp)> = None;
    for file in &CaptureFile::files_named(files) {
        let scan = CaptureScan::scan_file(&ReadableFile { file, read })?;
        if let Some((first, last)) = scan.time_span() {
            let known = all.get_or_insert((first, last));
            *known = (known.0.min(first), known.1.max(last));
        }
    }
    all
}

/// A file that reads itself.
struct ReadableFile<'a> {
    file: &'a CaptureFile,
    read: &'a ReadOptions,
}

impl PossiblePart for ReadableFile<'_> {
    fn path(&self) -> &Path {
        &self.file.path
    }

    fn is_listed(&self) -> bool {
        self.file.is_listed
    }

    fn read_batches(
        &self,
        is_whole: bool,
        take: &mut dyn FnMut(&Batch, &[String]) -> bool,
    ) -> Option<&'static str> {
        // A pipe can be read only once; `-` is stdin even if a file has this name.
        if self.file.path.as_os_str() == "-" || !self.file.path.is_file() {
            return None;
        }
        let capture = open_capture(&self.file.path, self.read).ok()?;
        let format = capture.reader.format().name;
        let (mut frames, mut progress) = capture.read_frames(is_whole);
        progress.hide_line();
        let mut batch = Batch::new();
        // An unreadable end is reported when the capture is decoded.
        while frames.read(&mut batch).unwrap_or(false) {
            if !take(&batch, frames.buses().names()) {
                break;
            }
        }
        Some(format)
    }

    fn is_blank(&self) -> bool {
        self.file.path.as_os_str() != "-" && File::open(&self.file.path).is_ok_and(series::is_blank)
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}
