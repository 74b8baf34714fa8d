//! The folders whose files may be read.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};

use crate::path_text::path_text;

/// Maximum number of files in a list.
pub(super) const MOST_FILES: usize = 500;

/// Maximum depth of subfolders in a list.
const DEEPEST: usize = 8;

/// Folders, as the operating system names them.
pub(super) struct AllowedFolders(Vec<PathBuf>);

impl AllowedFolders {
    /// # Errors
    /// A path names something else than a folder.
    pub(super) fn open(paths: &[PathBuf]) -> anyhow::Result<Self> {
        let open = |path: &PathBuf| {
            let real = path.canonicalize().with_context(|| path_text(path))?;
            ensure!(real.is_dir(), "{}: expected a folder", path_text(path));
            Ok(real)
        };
        paths.iter().map(open).collect::<anyhow::Result<_>>().map(Self)
    }

    /// The file of a request: absolute, or relative to one of the folders. Links are resolved first, so that none leads
    /// out of the folders.
    ///
    /// # Errors
    /// The file does not exist, is outside the folders, or is a device or a pipe.
    pub(super) fn find_file(&self, text: &str) -> anyhow::Result<PathBuf> {
        let path = Path::new(text);
        let candidates: Vec<_> = self.0.iter().map(|folder| folder.join(path)).collect();
        let real = candidates.iter().find_map(|candidate| candidate.canonicalize().ok());
        // Whether a file outside exists is not disclosed.
        let Some(real) = real.filter(|real| self.0.iter().any(|folder| real.starts_with(folder))) else {
            bail!("{}: no such file in the folders of this server", path_text(path));
        };
        ensure!(real.is_file(), "{}: expected a file", path_text(path));
        Ok(real)
    }

    /// Files in the folders and their subfolders, by name, and whether there are more. Links and hidden files are
    /// left out.
    pub(super) fn list_files(&self) -> (Vec<PathBuf>, bool) {
        let mut files = Vec::new();
        let is_complete = self.0.iter().all(|folder| add_files(folder, DEEPEST, &mut files));
        (files, !is_complete)
    }
}

/// Adds the files of a folder; false if there are more.
fn add_files(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> bool {
    // A folder without permission is skipped.
    let Ok(entries) = std::fs::read_dir(folder) else { return true };
    let mut entries: Vec<_> = entries.flatten().collect();
    entries.sort_by_key(std::fs::DirEntry::file_name);
    entries.iter().filter(|entry| !entry.file_name().as_encoded_bytes().starts_with(b".")).all(|entry| {
        match entry.file_type() {
            Ok(kind) if kind.is_dir() && depth > 0 => {
                add_files(&entry.path(), depth.saturating_sub(1), files)
            }
            Ok(kind) if kind.is_file() => {
                let has_room = files.len() < MOST_FILES;
                if has_room {
                    files.push(entry.path());
                }
                has_room
            }
            _ => true,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_in_the_folders_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        std::fs::create_dir(&inner).unwrap();
        std::fs::write(inner.join("a.log"), "").unwrap();
        std::fs::write(folder.path().join("secret"), "").unwrap();
        let folders = AllowedFolders::open(std::slice::from_ref(&inner)).unwrap();
        let real = inner.canonicalize().unwrap().join("a.log");
        assert_eq!(folders.find_file("a.log").unwrap(), real);
        assert_eq!(folders.find_file(real.to_str().unwrap()).unwrap(), real);
        assert_eq!(folders.list_files(), (vec![real], false));
        for path in ["../secret", "b.log", "/etc/passwd", "a.log/../../secret", "", "\0"] {
            let error = folders.find_file(path).unwrap_err().to_string();
            assert!(
                error.contains("no such file in the folders") || error.contains("expected a file"),
                "{error}"
            );
        }
    }

    #[cfg(unix)]
    #[test]
    fn no_link_leads_out() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        std::fs::create_dir(&inner).unwrap();
        std::fs::write(folder.path().join("secret"), "").unwrap();
        std::os::unix::fs::symlink("../secret", inner.join("link.log")).unwrap();
        std::os::unix::fs::symlink("..", inner.join("up")).unwrap();
        let folders = AllowedFolders::open(&[inner]).unwrap();
        assert!(folders.find_file("link.log").is_err());
        assert!(folders.find_file("up/secret").is_err());
        assert_eq!(folders.list_files(), (Vec::new(), false));
        assert!(AllowedFolders::open(&[folder.path().join("secret")]).is_err());
    }
}
