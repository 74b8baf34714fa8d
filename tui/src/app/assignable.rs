//! What can be assigned to a node: profiles, and files in the folder that is typed.

use std::path::Path;

use super::added::is_file;
use super::candidates::Candidate;
use crate::state::UiState;

/// Maximum number of entries read from a folder.
const MOST: usize = 1_000;

/// Profiles and files that complete a text.
pub(super) fn assignable_names(core: &UiState, before: &str) -> Vec<Candidate> {
    let typed = before.to_lowercase();
    let mut words = core.timeline.options().catalogue.ids();
    words.sort();
    words.retain(|id| id.starts_with(&typed) && *id != typed);
    words.extend(matching_files(before));
    words.into_iter().map(|word| Candidate::new(&word, None)).collect()
}

/// Paths of device files, databases and folders that complete a path.
fn matching_files(before: &str) -> Vec<String> {
    // On Windows both slashes separate, and a folder keeps its last one: `C:` alone is another folder than `C:\`.
    let name = before.rsplit_once(std::path::is_separator).map_or(before, |(_, name)| name);
    let shown = before.get(..before.len() - name.len()).unwrap_or_default();
    let path = if shown.is_empty() { "." } else { shown };
    let Ok(entries) = std::fs::read_dir(Path::new(path)) else { return Vec::new() };
    let mut found = Vec::new();
    for entry in entries.flatten().take(MOST) {
        // Other names than UTF-8 cannot be typed.
        let Ok(entry_name) = entry.file_name().into_string() else { continue };
        if !entry_name.starts_with(name) || (name.is_empty() && entry_name.starts_with('.')) {
            continue;
        }
        if entry.path().is_dir() {
            found.push(format!("{shown}{entry_name}/"));
        } else if is_file(&entry_name) && entry_name != name {
            found.push(format!("{shown}{entry_name}"));
        }
    }
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_completed_folder_by_folder() {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("devices")).unwrap();
        for name in ["pump.eds", "pump.txt", "valve.DBC", ".hidden.eds"] {
            std::fs::write(root.path().join("devices").join(name), "").unwrap();
        }
        let root = root.path().to_str().unwrap();
        let rest = |text: &str| -> Vec<String> {
            let found = matching_files(&format!("{root}{text}"));
            found.iter().map(|path| path.strip_prefix(root).unwrap().to_owned()).collect()
        };
        assert_eq!(rest("/dev"), ["/devices/"]);
        assert_eq!(rest("/devices/"), ["/devices/pump.eds", "/devices/valve.DBC"]);
        assert_eq!(rest("/devices/p"), ["/devices/pump.eds"]);
        assert_eq!(rest("/none/p"), [""; 0]);
    }
}
