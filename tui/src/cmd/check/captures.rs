//! Which captures are judged: those named, and all below the folders named.

use std::path::{Path, PathBuf};

/// A file to judge.
pub(super) struct Source {
    pub(super) path: PathBuf,
    /// The folder it was found in or below: it may be anything.
    pub(super) folder: Option<PathBuf>,
}

/// Files of a folder that are looked at.
const MOST_FILES: usize = 100_000;

/// Captures in the order of the command line; standard input without any.
pub(super) fn captures(named: &[PathBuf]) -> Vec<Source> {
    if named.is_empty() {
        return vec![Source { path: "-".into(), folder: None }];
    }
    let mut all = Vec::new();
    for path in named {
        if path.is_dir() {
            let mut found = Vec::new();
            files_below(path, &mut found);
            found.sort();
            let folder = Some(path.clone());
            all.extend(found.into_iter().map(|path| Source { path, folder: folder.clone() }));
        } else {
            all.push(Source { path: path.clone(), folder: None });
        }
    }
    all
}

/// Folders among what is named in which none of the captures judged was found.
pub(super) fn without_captures<'a>(named: &'a [PathBuf], judged: &[&Source]) -> Vec<&'a PathBuf> {
    let folders = named.iter().filter(|path| path.is_dir());
    folders.filter(|path| judged.iter().all(|source| source.folder.as_ref() != Some(path))).collect()
}

/// Files in and below a folder but hidden ones; links to folders are not followed, they may lead in a circle.
fn files_below(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let is_hidden = entry.file_name().to_string_lossy().starts_with('.');
            let Ok(kind) = entry.file_type() else { continue };
            let path = entry.path();
            match () {
                () if is_hidden || found.len() >= MOST_FILES => {}
                () if kind.is_dir() => folders.push(path),
                () if path.is_file() => found.push(path),
                () => {}
            }
        }
    }
}
