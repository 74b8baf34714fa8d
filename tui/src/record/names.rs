//! File names of the parts of a capture.
//!
//! ```text
//! run.log ─────── cannot be written any more ──▶ run-0002.log         without limits
//! run-0001.log ── too large, too long ─────────▶ run-0002.log ▶ …     with limits
//! ```
//! `view run*.log` reads them as one capture.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use cobscope_decoder::capture::WritableFormat;
use jiff::civil::DateTime;

use super::format;
use crate::output_file;
use crate::path_text::path_text;

/// Number of digits of a part number.
const DIGITS: usize = 4;

/// Remedy for a file name that exists.
const OTHERWISE: &str = "files are never overwritten; choose another name or move the file";

/// Names of the parts of a capture.
#[derive(Debug, PartialEq, Eq)]
pub struct RecordNames {
    folder: PathBuf,
    stem: OsString,
    suffix: OsString,
    /// Whether the first part has a number too.
    is_numbered: bool,
    /// Number of the next part, from 1.
    pub number: u32,
}

impl RecordNames {
    /// Names for the option `path`; `now` is the local time for a name like that of `candump -l`.
    ///
    /// # Errors
    /// Folder missing, numbered parts exist, or unknown suffix.
    pub(super) fn new(
        path: Option<&Path>,
        is_numbered: bool,
        now: DateTime,
    ) -> anyhow::Result<(Self, &'static WritableFormat)> {
        let path = match path {
            Some(path) if path.as_os_str() == "-" => {
                bail!("--record needs a file; --print writes to standard output")
            }
            Some(path) if path.is_dir() => path.join(usual_name(now)),
            Some(path) => path.to_owned(),
            None => usual_name(now).into(),
        };
        let Some(format) = format::format_of(&path) else {
            bail!("{}: {}", path_text(&path), format::unknown_suffix(format::all_suffixes()));
        };
        let names = Self::names_for(&path, is_numbered)?;
        names.ensure_free()?;
        Ok((names, format))
    }

    /// Names of the parts of `path`.
    ///
    /// # Errors
    /// Folder missing or no file name.
    pub fn names_for(path: &Path, is_numbered: bool) -> anyhow::Result<Self> {
        let name = path_text(path);
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        if let Some(problem) = output_file::folder_problem(path) {
            bail!("{name}: {problem}");
        }
        let stem = path.file_stem().with_context(|| format!("{name}: not a file name"))?.to_owned();
        let suffix = path.extension().unwrap_or_default().to_owned();
        let names = Self { folder, stem, suffix, is_numbered, number: 1 };
        Ok(names)
    }

    /// Checks that no numbered part exists.
    ///
    /// # Errors
    /// A numbered part exists.
    pub fn ensure_free(&self) -> anyhow::Result<()> {
        match self.find_numbered().filter(|_| self.is_numbered) {
            Some(part) => {
                bail!("{}: part of an earlier capture; {OTHERWISE}", path_text(&part))
            }
            None => Ok(()),
        }
    }

    /// Path of the next part.
    pub fn next(&self) -> PathBuf {
        let mut name = self.stem.clone();
        if self.is_numbered || self.number > 1 {
            name.push(format!("-{:0DIGITS$}", self.number));
        }
        if !self.suffix.is_empty() {
            name.push(".");
            name.push(&self.suffix);
        }
        self.folder.join(name)
    }

    /// An existing numbered part.
    fn find_numbered(&self) -> Option<PathBuf> {
        let folder = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        let names = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
        let mut parts: Vec<_> = names.filter(|name| self.has_part(Path::new(name))).collect();
        parts.sort();
        parts.first().map(|name| self.folder.join(name))
    }

    /// Whether a file name is that of a numbered part.
    fn has_part(&self, name: &Path) -> bool {
        let stem = name.file_stem().unwrap_or_default().as_encoded_bytes();
        let number = stem.strip_prefix(self.stem.as_encoded_bytes()).and_then(|rest| rest.strip_prefix(b"-"));
        name.extension() == Some(&self.suffix)
            && number.is_some_and(|digits| digits.len() >= DIGITS && digits.iter().all(u8::is_ascii_digit))
    }
}

/// Error for a file that cannot be created.
pub(super) fn creation_error(path: &Path, error: std::io::Error) -> anyhow::Error {
    let shown = path_text(path);
    match error.kind() {
        std::io::ErrorKind::AlreadyExists => anyhow::anyhow!("{shown}: file exists; {OTHERWISE}"),
        _ => anyhow::Error::new(error).context(format!("{shown}: cannot be created")),
    }
}

/// A name like that of `candump -l`.
fn usual_name(now: DateTime) -> String {
    now.strftime("candump-%Y-%m-%d_%H%M%S.log").to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn now() -> DateTime {
        jiff::civil::date(2026, 11, 22).at(7, 30, 51, 999)
    }

    fn called(path: &Path, is_numbered: bool) -> Result<RecordNames, String> {
        RecordNames::new(Some(path), is_numbered, now())
            .map(|(names, _)| names)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn without_a_name_it_is_called_as_candump_does() {
        let (names, format) = RecordNames::new(None, false, now()).unwrap();
        assert_eq!(names.next(), Path::new("candump-2026-11-22_073051.log"));
        assert_eq!(format.name, "candump");
        let folder = tempfile::tempdir().unwrap();
        let in_folder = called(folder.path(), false).unwrap();
        assert_eq!(in_folder.next(), folder.path().join("candump-2026-11-22_073051.log"));
    }

    #[test]
    fn parts_have_numbers() {
        let mut names = called(Path::new("run.pcapng"), true).unwrap();
        assert_eq!(names.next(), Path::new("run-0001.pcapng"));
        names.number = 12_345;
        assert_eq!(names.next(), Path::new("run-12345.pcapng"));
        names.is_numbered = false;
        names.number = 1;
        assert_eq!(names.next(), Path::new("run.pcapng"));
        names.number = 2;
        assert_eq!(names.next(), Path::new("run-0002.pcapng"));
    }

    #[test]
    fn an_impossible_name_is_reported_with_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let (missing, run) = (path("no"), path("no").join("run.log"));
        assert_eq!(
            called(&run, false).unwrap_err(),
            format!("{}: folder {} does not exist; create it first", run.display(), missing.display())
        );
        let unknown = called(&path("run.log.gz"), false).unwrap_err();
        assert!(unknown.contains("run.log.gz: unknown suffix; expected .log ("), "{unknown}");
        assert!(unknown.contains(".pcapng ("), "{unknown}");
        assert!(called(Path::new("-"), false).unwrap_err().contains("--print"));

        std::fs::write(path("run-0003.log"), "").unwrap();
        let earlier = called(&path("run.log"), true).unwrap_err();
        assert!(earlier.contains("run-0003.log: part of an earlier capture"), "{earlier}");
        for other in ["run.pcapng", "ru.log", "run-.log", "run-0003.log"] {
            assert!(called(&path(other), true).is_ok(), "{other}");
        }
        assert!(called(&path("run.log"), false).is_ok());
    }
}
