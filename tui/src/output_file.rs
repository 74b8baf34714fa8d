//! Output files that have their name only once they are whole.
//!
//! ```text
//! create ─▶ events.jsonl.part ── finish ─▶ events.jsonl
//!                    └─ full disk, crash: stays
//! ```

use crate::device_name::{self, DeviceName};
use crate::path_text::path_text;
use std::ffi::OsString;
use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

/// Suffix of an incomplete file.
pub const PART: &str = "part";

/// What happens to a file that exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExistingFile {
    /// The output is refused.
    Keep,
    /// The whole output takes its place.
    Replace,
}

/// Name that an output file receives once it is whole; until then the file has a name that ends in `.part`.
#[derive(Debug)]
#[must_use = "the file keeps the name of a part until `finish`"]
pub struct FinalName {
    /// Present name and final name; `None` if the output has its name already.
    names: Option<(PathBuf, PathBuf)>,
}

/// Name of a file before it is whole.
pub fn part_of(path: &Path) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".");
    name.push(PART);
    name.into()
}

/// Creates an output file. A device or a pipe is written directly.
///
/// # Errors
/// [`ErrorKind::AlreadyExists`] if the file exists and is to be kept; any error of the file system.
pub fn create_output(path: &Path, existing: ExistingFile) -> io::Result<(File, FinalName)> {
    if is_device(path)? {
        return Ok((File::options().write(true).open(path)?, FinalName::at_once()));
    }
    match path.metadata() {
        Ok(found) if !found.is_file() => {
            let file = File::options().write(true).open(path)?;
            return Ok((file, FinalName { names: None }));
        }
        Ok(found) if existing == ExistingFile::Replace => {
            // A link stays, and its target is replaced. Other paths stay as typed: Windows lengthens them.
            let is_link = path.symlink_metadata()?.is_symlink();
            let place = if is_link { path.canonicalize()? } else { path.to_owned() };
            return begin_part(place, Some(&found));
        }
        // A link without a target exists, too.
        _ if existing == ExistingFile::Keep && path.symlink_metadata().is_ok() => {
            return Err(ErrorKind::AlreadyExists.into());
        }
        _ => {}
    }
    begin_part(path.to_owned(), None)
}

/// Creates an output file that others read while it grows.
///
/// # Errors
/// As [`create_output`].
pub fn create_at_once(path: &Path, existing: ExistingFile) -> io::Result<File> {
    let mut options = File::options();
    options.write(true);
    if !is_device(path)? && path.metadata().map_or(true, |found| found.is_file()) {
        match existing {
            ExistingFile::Keep => options.create_new(true),
            ExistingFile::Replace => options.create(true).truncate(true),
        };
    }
    options.open(path)
}

/// Why the folder of a file cannot contain it, with the remedy; `None` for a folder, and if only an attempt shows it.
pub fn folder_problem(path: &Path) -> Option<String> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty())?;
    if device_name::is_device(path) {
        return None;
    }
    match folder.metadata() {
        Ok(found) if found.is_dir() => None,
        Ok(_) => Some(format!("{} is not a folder; choose another name", path_text(folder))),
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            Some(format!("folder {} does not exist; create it first", path_text(folder)))
        }
        Err(_) => None,
    }
}

/// Whether a path names a device or a pipe of Windows, which cannot be examined without opening it.
///
/// # Errors
/// The path names a device in place of a file.
pub fn is_device(path: &Path) -> io::Result<bool> {
    match device_name::device_of(path) {
        Some(DeviceName::Reserved) => {
            Err(io::Error::new(ErrorKind::InvalidInput, "name of a device; choose another file name"))
        }
        name => Ok(name.is_some()),
    }
}

/// Creates the part of a file; `replaced` has the permissions of the file whose place it takes.
fn begin_part(path: PathBuf, replaced: Option<&Metadata>) -> io::Result<(File, FinalName)> {
    let part = part_of(&path);
    // The part of a run that was stopped. A new file never follows a link.
    if part.symlink_metadata().is_ok_and(|found| !found.is_dir()) {
        fs::remove_file(&part)?;
    }
    let file = File::options().write(true).create_new(true).open(&part)?;
    if let Some(replaced) = replaced {
        // Without the same permissions the content is complete all the same.
        let _ = file.set_permissions(replaced.permissions());
    }
    Ok((file, FinalName { names: Some((part, path)) }))
}

/// Writes a whole file.
///
/// # Errors
/// As [`create_output`]; an incomplete file keeps the name of a part.
pub fn write_file(path: &Path, existing: ExistingFile, content: &[u8]) -> io::Result<()> {
    let (mut file, name) = create_output(path, existing)?;
    file.write_all(content)?;
    name.finish_file()
}

impl FinalName {
    /// Name of a device or pipe, or of a file for readers while it grows.
    pub const fn at_once() -> Self {
        Self { names: None }
    }

    /// Gives the file its name; all of it was written.
    ///
    /// # Errors
    /// If the file cannot be renamed; it keeps the name of a part.
    pub fn finish_file(self) -> io::Result<()> {
        let Some((part, path)) = self.names else { return Ok(()) };
        let renamed = fs::rename(&part, &path);
        renamed.map_err(|error| {
            // Windows refuses it while another program has opened the file without sharing it.
            let is_in_use = cfg!(windows) && path.exists();
            let remedy = if is_in_use { "; close programs that have the file open" } else { "" };
            let text = format!("cannot be renamed from {}: {error}{remedy}", path_text(&part));
            io::Error::new(error.kind(), text)
        })
    }

    /// Removes the file, which has no content.
    pub fn discard_file(self) {
        if let Some((part, _)) = self.names {
            // A part that cannot be removed does not look like a result.
            let _ = fs::remove_file(part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<_> = entries.map(|name| name.into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_has_its_name_once_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.log");
        let (mut file, name) = create_output(&path, ExistingFile::Keep).unwrap();
        file.write_all(b"1").unwrap();
        assert_eq!(names(folder.path()), ["out.log.part"]);
        name.finish_file().unwrap();
        assert_eq!(names(folder.path()), ["out.log"]);
        let error = create_output(&path, ExistingFile::Keep).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);

        let (mut file, name) = create_output(&path, ExistingFile::Replace).unwrap();
        file.write_all(b"2").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"1");
        drop((file, name));
        // A later run replaces the part.
        let (_, name) = create_output(&path, ExistingFile::Replace).unwrap();
        assert_eq!(fs::read(part_of(&path)).unwrap(), b"");
        name.discard_file();
        assert_eq!(names(folder.path()), ["out.log"]);
    }

    #[test]
    fn a_folder_exists_or_has_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), b"1").unwrap();
        let problem = |name: &str| {
            let text = folder_problem(&folder.path().join(name))?;
            Some(text.replace(&folder.path().display().to_string(), "@").replace('\\', "/"))
        };
        assert_eq!(folder_problem(Path::new("out.log")), None);
        assert_eq!(problem("out.log"), None);
        let missing = "folder @/no does not exist; create it first";
        assert_eq!(problem("no/out.log").as_deref(), Some(missing));
        assert_eq!(problem("file/out.log").as_deref(), Some("@/file is not a folder; choose another name"));
    }

    #[cfg(unix)]
    #[test]
    fn links_and_permissions_stay() {
        use std::os::unix::fs::{PermissionsExt as _, symlink};
        let folder = tempfile::tempdir().unwrap();
        let [target, link] = ["target", "link"].map(|name| folder.path().join(name));
        fs::write(&target, b"1").unwrap();
        fs::set_permissions(&target, fs::Permissions::from_mode(0o600)).unwrap();
        symlink(&target, &link).unwrap();
        // Another file must not be written through a link with the name of the part.
        let other = folder.path().join("other");
        fs::write(&other, b"mine").unwrap();
        symlink(&other, part_of(&target)).unwrap();
        write_file(&link, ExistingFile::Replace, b"2").unwrap();
        assert_eq!((fs::read(&target).unwrap(), fs::read(&other).unwrap()), (b"2".into(), b"mine".into()));
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert_eq!(target.metadata().unwrap().permissions().mode() & 0o777, 0o600);

        let dangling = folder.path().join("dangling");
        symlink(folder.path().join("nowhere"), &dangling).unwrap();
        assert_eq!(
            create_output(&dangling, ExistingFile::Keep).unwrap_err().kind(),
            ErrorKind::AlreadyExists
        );
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_directly() {
        write_file(Path::new("/dev/null"), ExistingFile::Keep, b"1").unwrap();
        assert!(write_file(Path::new("/dev/full"), ExistingFile::Keep, b"1").is_err());
        assert!(!part_of(Path::new("/dev/null")).exists());
    }
}
