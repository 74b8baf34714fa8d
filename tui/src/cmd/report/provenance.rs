//! How a report was made: command, version and hashes of the files.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::report::{HashedFile, Provenance};
use cobscope_decoder::session::{Bus, Buses};
use sha2::{Digest as _, Sha256};

use crate::run::arguments::InputArgs;
use crate::run::input::files_named;
use crate::source::CaptureSeries;

/// Size of the blocks that are hashed, in bytes.
const BLOCK: usize = 256 * 1024;

/// Command, version and hashes of all files that a report is made from.
pub(in crate::cmd) fn provenance(
    series: &CaptureSeries,
    input: &InputArgs,
    (catalogue, buses): (&Catalogue, Buses<'_>),
) -> Provenance {
    let mut files: Vec<_> = series.parts.iter().map(|path| hashed("capture", path)).collect();
    files.extend(input.bus.iter().map(|path| hashed("bus file", path)));
    let named = input.bus.as_deref().map(files_named).unwrap_or_default();
    files.extend(named.iter().map(|path| hashed("file of the bus file", path)));
    files.extend(input.eds.iter().map(|of_node| hashed("device file", &of_node.file)));
    files.extend(input.dbc.iter().map(|path| hashed("database", path)));
    files.extend(profiles(catalogue, buses));
    Provenance { command: command(), version: env!("CARGO_PKG_VERSION").to_owned(), files }
}

/// Profiles of the nodes that were present.
fn profiles(catalogue: &Catalogue, buses: Buses<'_>) -> Vec<HashedFile> {
    let nodes = buses.iter().flat_map(Bus::nodes);
    let used = nodes.filter(|node| node.last_seen().0 > 0 && node.assigned_by().is_some());
    let mut ids: Vec<String> = used.map(|node| node.device().id.clone()).collect();
    ids.sort_unstable();
    ids.dedup();
    let profile = |id: String| match catalogue.content_of(&id) {
        Some(path) if Path::new(path).is_file() => hashed("profile", Path::new(path)),
        Some(_) => {
            HashedFile { role: "profile", name: id, size: 0, sha256: "see the device file".to_owned() }
        }
        None => HashedFile { role: "profile", name: id, size: 0, sha256: "part of the program".to_owned() },
    };
    ids.into_iter().map(profile).collect()
}

/// The command line as typed, with quotes where a shell needs them.
pub(super) fn command() -> String {
    let words = std::env::args_os().skip(1).map(|word| quoted(&word.to_string_lossy()));
    std::iter::once("cobscope".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}

fn quoted(word: &str) -> String {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-_./:=,#@+%".contains(letter);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// A file with its size and hash, or why there is none.
fn hashed(role: &'static str, path: &Path) -> HashedFile {
    let name = path.display().to_string();
    match hash_of(path) {
        Ok((size, sha256)) => HashedFile { role, name, size, sha256 },
        Err(error) => HashedFile { role, name, size: 0, sha256: format!("not available: {error}") },
    }
}

fn hash_of(path: &Path) -> io::Result<(u64, String)> {
    let mut file = File::open(path)?;
    let mut hash = Sha256::new();
    let mut block = vec![0; BLOCK];
    let mut size: u64 = 0;
    loop {
        let read = file.read(&mut block)?;
        if read == 0 {
            return Ok((size, hex(&hash.finalize())));
        }
        hash.update(block.get(..read).unwrap_or_default());
        size = size.saturating_add(read as u64);
    }
}

/// SHA-256 of bytes in hexadecimal.
pub(super) fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    let mut text = String::new();
    for byte in bytes {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_of_the_empty_file() {
        // FIPS 180-4, example of the empty message.
        assert_eq!(sha256(b""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    }

    #[test]
    fn words_are_quoted_for_a_shell() {
        assert_eq!(quoted("--node"), "--node");
        assert_eq!(quoted("my file's.log"), "'my file'\\''s.log'");
        assert_eq!(quoted(""), "''");
    }
}
