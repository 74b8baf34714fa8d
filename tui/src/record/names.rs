//! Names of a record's parts.
//!
//! ```text
//! run.log ─────── cannot be written any more ──▶ run-0002.log         without limits
//! run-0001.log ── too large, too long ─────────▶ run-0002.log ▶ …     with limits
//! ```
//! They are one recording for `view run*.log`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use cobscope_decoder::capture::WritableFormat;
use cobscope_decoder::sink::escape;
use jiff::civil::DateTime;

use super::format;

/// Digits of a part's number.
const DIGITS: usize = 4;

/// What to do about a name that cannot be had.
const OTHERWISE: &str = "nothing is ever written over; choose another name or move it away";

/// How the parts of one record are called.
#[derive(Debug, PartialEq, Eq)]
pub struct Names {
    folder: PathBuf,
    stem: OsString,
    suffix: OsString,
    /// Whether the first one has a number too.
    is_numbered: bool,
    /// Of the part that is next, from 1.
    pub number: u32,
}

impl Names {
    /// Names as asked for; `now` is the time of day here, for the name that `candump -l` would give.
    ///
    /// # Errors
    /// When the folder does not exist, when such parts are there already, or when the name says no format.
    pub(super) fn new(
        path: Option<&Path>,
        is_numbered: bool,
        now: DateTime,
    ) -> anyhow::Result<(Self, &'static WritableFormat)> {
        let path = match path {
            Some(path) if path.as_os_str() == "-" => {
                bail!("a record is a file; --print writes to standard output")
            }
            Some(path) if path.is_dir() => path.join(usual_name(now)),
            Some(path) => path.to_owned(),
            None => usual_name(now).into(),
        };
        let Some(format) = format::of(&path) else {
            let shown = path.display().to_string();
            bail!("{}: {}", escape(&shown), format::unknown(format::suffixes()));
        };
        let names = Self::of(&path, is_numbered)?;
        names.ensure_free()?;
        Ok((names, format))
    }

    /// Names of files like this one.
    ///
    /// # Errors
    /// When the folder does not exist.
    pub fn of(path: &Path, is_numbered: bool) -> anyhow::Result<Self> {
        let shown = path.display().to_string();
        let shown = escape(&shown);
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let is_there = folder.as_os_str().is_empty() || folder.is_dir();
        let folder_shown = folder.display().to_string();
        ensure!(is_there, "{shown}: there is no folder {}; make it first", escape(&folder_shown));
        let stem = path.file_stem().with_context(|| format!("{shown}: has no name"))?.to_owned();
        let suffix = path.extension().unwrap_or_default().to_owned();
        let names = Self { folder, stem, suffix, is_numbered, number: 1 };
        Ok(names)
    }

    /// Refuses where parts with numbers are there already.
    ///
    /// # Errors
    /// When there is one.
    pub fn ensure_free(&self) -> anyhow::Result<()> {
        match self.find().filter(|_| self.is_numbered) {
            Some(part) => {
                bail!("{}: is part of an earlier record; {OTHERWISE}", escape(&part.display().to_string()))
            }
            None => Ok(()),
        }
    }

    /// The part that is next.
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

    /// A numbered part that is there.
    fn find(&self) -> Option<PathBuf> {
        let folder = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        let names = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
        let mut parts: Vec<_> = names.filter(|name| self.has(Path::new(name))).collect();
        parts.sort();
        parts.first().map(|name| self.folder.join(name))
    }

    /// Whether a file's name is that of a numbered part.
    fn has(&self, name: &Path) -> bool {
        let stem = name.file_stem().unwrap_or_default().as_encoded_bytes();
        let number = stem.strip_prefix(self.stem.as_encoded_bytes()).and_then(|rest| rest.strip_prefix(b"-"));
        name.extension() == Some(&self.suffix)
            && number.is_some_and(|digits| digits.len() >= DIGITS && digits.iter().all(u8::is_ascii_digit))
    }
}

/// Why a file cannot be made.
pub(super) fn refusal(path: &Path, error: std::io::Error) -> anyhow::Error {
    let shown = path.display().to_string();
    let shown = escape(&shown);
    match error.kind() {
        std::io::ErrorKind::AlreadyExists => anyhow::anyhow!("{shown}: is there already; {OTHERWISE}"),
        _ => anyhow::Error::new(error).context(format!("{shown}: cannot be made")),
    }
}

/// The name `candump -l` gives.
fn usual_name(now: DateTime) -> String {
    now.strftime("candump-%Y-%m-%d_%H%M%S.log").to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn now() -> DateTime {
        jiff::civil::date(2026, 11, 22).at(7, 30, 51, 999)
    }

    fn called(path: &Path, is_numbered: bool) -> Result<Names, String> {
        Names::new(Some(path), is_numbered, now()).map(|(names, _)| names).map_err(|error| error.to_string())
    }

    #[test]
    fn without_a_name_it_is_called_as_candump_does() {
        let (names, format) = Names::new(None, false, now()).unwrap();
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
    fn what_cannot_be_is_said_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let shown = folder.path().display();
        assert_eq!(
            called(&path("no/run.log"), false).unwrap_err(),
            format!("{shown}/no/run.log: there is no folder {shown}/no; make it first")
        );
        let unknown = called(&path("run.log.gz"), false).unwrap_err();
        assert!(unknown.contains("run.log.gz: the end of the name says the format: .log ("), "{unknown}");
        assert!(unknown.contains(".pcapng ("), "{unknown}");
        assert!(called(Path::new("-"), false).unwrap_err().contains("--print"));

        std::fs::write(path("run-0003.log"), "").unwrap();
        let earlier = called(&path("run.log"), true).unwrap_err();
        assert!(earlier.contains("run-0003.log: is part of an earlier record"), "{earlier}");
        for other in ["run.pcapng", "ru.log", "run-.log", "run-0003.log"] {
            assert!(called(&path(other), true).is_ok(), "{other}");
        }
        assert!(called(&path("run.log"), false).is_ok());
    }
}
