//! Which format a file is written in: the end of its name says it.

use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{WRITABLE, WritableFormat};

/// The end of a file's name behind its last point; empty where it has none.
pub fn suffix(path: &Path) -> &str {
    path.extension().and_then(|suffix| suffix.to_str()).unwrap_or_default()
}

/// The format of captures that a file's name says.
pub fn of(path: &Path) -> Option<&'static WritableFormat> {
    let suffix = suffix(path);
    WRITABLE.iter().find(|format| format.suffix == suffix)
}

/// One file of several that are named after `path`: `run.parquet` or `run` to `run.events.parquet`. None where the path
/// ends without a name.
pub fn part_of(path: &Path, content: &str, suffix: &str) -> Option<PathBuf> {
    let has_suffix = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(suffix));
    let mut name = if has_suffix { path.file_stem() } else { path.file_name() }?.to_owned();
    name.push(format!(".{content}.{suffix}"));
    Some(path.with_file_name(name))
}

/// Ends of names that say a format of captures, with its title.
pub fn suffixes() -> impl Iterator<Item = (&'static str, &'static str)> {
    WRITABLE.iter().map(|format| (format.suffix, format.title))
}

/// Whether a file's name, which may end in that of a compressed file, is like that of a capture.
pub fn is_of_captures(path: &Path) -> bool {
    const ONLY_READ: [&str; 5] = ["pcap", "blf", "mf4", "mdf", "crtd"];
    const COMPRESSED: [&str; 2] = ["gz", "zst"];
    let name = Path::new(if COMPRESSED.contains(&suffix(path)) {
        path.file_stem().unwrap_or_default()
    } else {
        path.as_os_str()
    });
    let suffix = suffix(name);
    ONLY_READ.contains(&suffix) || suffixes().any(|(known, _)| known == suffix)
}

/// What to say of a name that says no format, given those there are.
pub fn unknown(known: impl Iterator<Item = (&'static str, &'static str)>) -> String {
    let known: Vec<_> = known.map(|(suffix, title)| format!(".{suffix} ({title})")).collect();
    format!("the end of the name says the format: {}", known.join(", "))
}
