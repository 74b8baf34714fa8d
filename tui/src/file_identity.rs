//! Identity of files: two paths can be the same file, and a path can become another file.

use std::fs::File;
use std::io;
use std::path::Path;

/// Volume of a file, and its number there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StorageIdentity {
    volume: u64,
    number: u64,
}

#[cfg(unix)]
impl StorageIdentity {
    /// Identity of an open file.
    ///
    /// # Errors
    /// The system does not state it.
    pub fn of_file(file: &File) -> io::Result<Self> {
        Ok(Self::new(&file.metadata()?))
    }

    /// Identity of the file that a path names now.
    ///
    /// # Errors
    /// The file does not exist or is not accessible.
    pub fn of_path(path: &Path) -> io::Result<Self> {
        Ok(Self::new(&path.metadata()?))
    }

    /// Identity of standard input if it is a regular file.
    pub fn of_stdin() -> Option<Self> {
        Self::of_regular(Path::new("/dev/stdin"))
    }

    fn new(metadata: &std::fs::Metadata) -> Self {
        use std::os::unix::fs::MetadataExt as _;
        Self { volume: metadata.dev(), number: metadata.ino() }
    }
}

#[cfg(windows)]
impl StorageIdentity {
    /// Identity of an open file.
    ///
    /// # Errors
    /// The system does not state it.
    pub fn of_file(file: &File) -> io::Result<Self> {
        winapi_util::file::information(file).map(|found| Self::new(&found))
    }

    /// Identity of the file that a path names now.
    ///
    /// # Errors
    /// The file does not exist or is not accessible.
    pub fn of_path(path: &Path) -> io::Result<Self> {
        use std::os::windows::fs::OpenOptionsExt as _;
        /// FILE_FLAG_BACKUP_SEMANTICS: opens folders, too.
        const FOLDERS: u32 = 0x0200_0000;
        // No access: a file that another program keeps for itself can be identified.
        Self::of_file(&File::options().access_mode(0).custom_flags(FOLDERS).open(path)?)
    }

    /// Identity of standard input if it is a regular file.
    pub fn of_stdin() -> Option<Self> {
        let stdin = winapi_util::HandleRef::stdin();
        let is_file = winapi_util::file::typ(&stdin).is_ok_and(|kind| kind.is_disk());
        let found = if is_file { winapi_util::file::information(&stdin).ok() } else { None };
        found.map(|found| Self::new(&found))
    }

    fn new(found: &winapi_util::file::Information) -> Self {
        Self { volume: found.volume_serial_number(), number: found.file_index() }
    }
}

impl StorageIdentity {
    /// Identity of a regular file; `None` for a folder, a terminal, a device or a pipe.
    pub fn of_regular(path: &Path) -> Option<Self> {
        if crate::device_name::is_device(path) || !path.is_file() {
            return None;
        }
        Self::of_path(path).ok()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_keeps_its_identity_under_another_name() {
        let folder = tempfile::tempdir().unwrap();
        let [one, other] = ["a.log", "b.log"].map(|name| folder.path().join(name));
        fs::write(&one, "1").unwrap();
        let opened = StorageIdentity::of_file(&File::open(&one).unwrap()).unwrap();
        assert_eq!(StorageIdentity::of_regular(&one), Some(opened));
        fs::hard_link(&one, &other).unwrap();
        assert_eq!(StorageIdentity::of_path(&other).unwrap(), opened);
        fs::rename(&one, folder.path().join("c.log")).unwrap();
        // A new file of the same name, even of the same time.
        fs::write(&one, "1").unwrap();
        assert_ne!(StorageIdentity::of_path(&one).unwrap(), opened);
        assert_eq!(StorageIdentity::of_regular(folder.path()), None);
        assert!(StorageIdentity::of_path(&folder.path().join("d.log")).is_err());
    }
}
