//! File system access of `--record`; tests simulate failures.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;

use crate::output_file;

/// File system for the parts of a capture.
pub(super) trait RecordDisk: Send {
    /// Creates a file; fails if it exists.
    fn create_file(&mut self, path: &Path) -> io::Result<Box<dyn RecordFile>>;

    /// Opens a file for reading.
    fn read(&mut self, path: &Path) -> io::Result<Box<dyn Read + Send>>;

    /// Removes a file.
    fn remove_file(&mut self, path: &Path) -> io::Result<()>;

    /// Renames a file; replaces the file `to`.
    fn rename_file(&mut self, from: &Path, to: &Path) -> io::Result<()>;
}

/// A file of the capture. Written bytes go to the system at once.
pub(super) trait RecordFile: Write + Send {
    /// Waits until the content is on the disk.
    fn sync_to_disk(&mut self) -> io::Result<()>;

    /// Truncates the file to `length` bytes.
    fn truncate_to(&mut self, length: u64) -> io::Result<()>;
}

/// The real file system.
pub(super) struct RealDisk;

impl RecordDisk for RealDisk {
    fn create_file(&mut self, path: &Path) -> io::Result<Box<dyn RecordFile>> {
        // Fails for the name of a device of Windows.
        output_file::is_device(path)?;
        let file = File::options().write(true).create_new(true).open(path)?;
        sync_folder_of(path);
        Ok(Box::new(file))
    }

    fn read(&mut self, path: &Path) -> io::Result<Box<dyn Read + Send>> {
        Ok(Box::new(File::open(path)?))
    }

    fn remove_file(&mut self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }

    fn rename_file(&mut self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)?;
        sync_folder_of(to);
        Ok(())
    }
}

/// The name of a file is safe only after a sync of its folder. Where folders cannot be opened, the system does
/// it.
fn sync_folder_of(path: &Path) {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
}

impl RecordFile for File {
    fn sync_to_disk(&mut self) -> io::Result<()> {
        match self.sync_data() {
            // Files without a disk report this error.
            Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
            result => result,
        }
    }

    fn truncate_to(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)
    }
}
