//! Content of a capture: the hash over all its files.

use std::fmt::Write as _;
use std::fs::{File, Metadata};
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context as _, ensure};
use sha2::{Digest as _, Sha256};

use crate::path_text::path_text;

/// Size of the blocks that are hashed, in bytes.
const BLOCK: usize = 256 * 1024;

/// Hash and size of all files of a capture, and their state when they were hashed.
pub(super) struct CaptureContent {
    /// SHA-256 over all files in order, as of `cat FILES | sha256sum`.
    pub(super) hash: String,
    /// Size of all files in bytes.
    pub(super) size: u64,
    states: Vec<(PathBuf, ContentVersion)>,
}

/// Length and time of the last change.
type ContentVersion = (u64, Option<SystemTime>);

impl CaptureContent {
    /// Hashes all files.
    ///
    /// # Errors
    /// One of them is not a file or cannot be read.
    pub(super) fn of(parts: &[PathBuf]) -> anyhow::Result<Self> {
        let mut hasher = Sha256::new();
        let mut block = vec![0; BLOCK];
        let (mut size, mut states) = (0_u64, Vec::new());
        for path in parts {
            let name = || path_text(path);
            let mut file = File::open(path).with_context(|| format!("{}: cannot be opened", name()))?;
            let found = file.metadata().with_context(name)?;
            ensure!(found.is_file(), "{}: not a file; a lake needs the whole content twice", name());
            states.push((path.clone(), state(&found)));
            loop {
                let read = file.read(&mut block).with_context(|| format!("{}: cannot be read", name()))?;
                if read == 0 {
                    break;
                }
                hasher.update(block.get(..read).unwrap_or_default());
                size = size.saturating_add(read as u64);
            }
        }
        let mut hash = String::new();
        for byte in hasher.finalize() {
            let _ = write!(hash, "{byte:02x}");
        }
        Ok(Self { hash, size, states })
    }

    /// Checks that no file changed since it was hashed.
    ///
    /// # Errors
    /// A file has another length or time of change.
    pub(super) fn ensure_unchanged(&self) -> anyhow::Result<()> {
        for (path, before) in &self.states {
            let now = Path::metadata(path).with_context(|| path_text(path))?;
            ensure!(state(&now) == *before, "{}: changed while it was read; not added", path_text(path));
        }
        Ok(())
    }
}

fn state(found: &Metadata) -> ContentVersion {
    (found.len(), found.modified().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_all_files_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let [one, two] = ["one", "two"].map(|name| folder.path().join(name));
        std::fs::write(&one, "ab").unwrap();
        std::fs::write(&two, "c").unwrap();
        let content = CaptureContent::of(&[one, two.clone()]).unwrap();
        // FIPS 180-4, example "abc".
        assert_eq!(content.hash, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!(content.size, 3);
        content.ensure_unchanged().unwrap();
        std::fs::write(&two, "cd").unwrap();
        let error = content.ensure_unchanged().unwrap_err().to_string();
        assert!(error.ends_with("two: changed while it was read; not added"), "{error}");
        assert!(CaptureContent::of(&[folder.path().to_owned()]).is_err());
    }
}
