//! Files of a record. Tests have a disk that fails.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

/// Where parts of a record are made.
pub(super) trait Disk: Send {
    /// Makes a file; never takes one that is there.
    fn create(&mut self, path: &Path) -> io::Result<Box<dyn PartFile>>;

    /// Takes a file away.
    fn remove(&mut self, path: &Path) -> io::Result<()>;
}

/// A file of a record. What is written is with the system at once.
pub(super) trait PartFile: Write + Send {
    /// Waits until it is on the disk.
    fn sync(&mut self) -> io::Result<()>;

    /// Cuts it to so many bytes.
    fn cut(&mut self, length: u64) -> io::Result<()>;
}

/// The computer's own files.
pub(super) struct Files;

impl Disk for Files {
    fn create(&mut self, path: &Path) -> io::Result<Box<dyn PartFile>> {
        let file = File::options().write(true).create_new(true).open(path)?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // A file's name is safe with its folder only; where folders cannot be opened the system sees to it.
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
        Ok(Box::new(file))
    }

    fn remove(&mut self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }
}

impl PartFile for File {
    fn sync(&mut self) -> io::Result<()> {
        match self.sync_data() {
            // What has no disk behind it says so.
            Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
            result => result,
        }
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)
    }
}
