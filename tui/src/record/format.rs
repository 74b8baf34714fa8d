//! Output format by the suffix of the file name.

use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{WRITABLE, WritableFormat};

/// The suffix of a file name after its last dot, in lower case; empty without one.
pub fn suffix(path: &Path) -> String {
    path.extension().and_then(|suffix| suffix.to_str()).unwrap_or_default().to_ascii_lowercase()
}

/// The capture format of a file name.
pub fn format_of(path: &Path) -> Option<&'static WritableFormat> {
    let suffix = suffix(path);
    WRITABLE.iter().find(|format| format.suffix == suffix)
}

/// Name of one of several files of an output `path`: `run.parquet` or `run` to `run.events.parquet`. None if
/// the path has no file name.
pub fn part_of(path: &Path, content: &str, suffix: &str) -> Option<PathBuf> {
    let has_suffix = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(suffix));
    let mut name = if has_suffix { path.file_stem() } else { path.file_name() }?.to_owned();
    name.push(format!(".{content}.{suffix}"));
    Some(path.with_file_name(name))
}

/// Suffixes of capture formats with their titles.
pub fn all_suffixes() -> impl Iterator<Item = (&'static str, &'static str)> {
    WRITABLE.iter().map(|format| (format.suffix, format.title))
}

/// Whether a file name, possibly of a compressed file, has the suffix of a capture.
pub fn is_of_captures(path: &Path) -> bool {
    const ONLY_READ: [&str; 5] = ["pcap", "blf", "mf4", "mdf", "crtd"];
    const COMPRESSED: [&str; 2] = ["gz", "zst"];
    let name = Path::new(if COMPRESSED.contains(&suffix(path).as_str()) {
        path.file_stem().unwrap_or_default()
    } else {
        path.as_os_str()
    });
    let suffix = suffix(name);
    ONLY_READ.contains(&suffix.as_str()) || all_suffixes().any(|(known, _)| known == suffix)
}

/// Error text for an unknown suffix; `known` are the available ones.
pub fn unknown_suffix(known: impl Iterator<Item = (&'static str, &'static str)>) -> String {
    let known: Vec<_> = known.map(|(suffix, title)| format!(".{suffix} ({title})")).collect();
    format!("unknown suffix; expected {}", known.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suffixes_are_compared_without_case() {
        let format = |name: &str| format_of(Path::new(name)).map(|format| format.name);
        assert_eq!((format("RUN.LOG"), format("run.log")), (Some("candump"), Some("candump")));
        assert_eq!((format("run"), format("run.docx")), (None, None));
        assert!(is_of_captures(Path::new("RUN.BLF")) && is_of_captures(Path::new("run.Asc.GZ")));
        assert!(!is_of_captures(Path::new("run.GZ")));
    }
}
