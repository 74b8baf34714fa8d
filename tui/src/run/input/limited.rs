//! Files of limited size: a device that never ends, or a capture given by mistake, must not fill the memory.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use anyhow::Context as _;

use crate::path_text::path_text;

/// Maximum size in bytes of a file that describes buses or devices, or of a baseline; the largest known one has 0.5 MB.
const LARGEST: u64 = 64 << 20;

/// Reads a file.
///
/// # Errors
/// If the file is unreadable or too large.
pub fn read_bytes(path: &Path) -> anyhow::Result<Vec<u8>> {
    let name = path_text(path);
    let mut bytes = Vec::new();
    let file = File::open(path).with_context(|| format!("{name}: cannot be read"))?;
    file.take(LARGEST + 1).read_to_end(&mut bytes).with_context(|| format!("{name}: cannot be read"))?;
    anyhow::ensure!(
        bytes.len() as u64 <= LARGEST,
        "{name}: larger than {} MiB; expected a smaller file",
        LARGEST >> 20
    );
    Ok(bytes)
}

/// Reads a text file.
///
/// # Errors
/// If the file is unreadable, too large, or not UTF-8.
pub fn read_text(path: &Path) -> anyhow::Result<String> {
    String::from_utf8(read_bytes(path)?).map_err(|error| {
        let place = error.utf8_error().valid_up_to();
        let found = match error.as_bytes() {
            [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] => "UTF-16; expected UTF-8",
            _ => "no UTF-8; expected text",
        };
        anyhow::anyhow!("{}: byte {place}: found {found}", path_text(path))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_file_without_end_is_too_large() {
        let error = read_bytes(Path::new("/dev/zero")).unwrap_err();
        assert_eq!(error.to_string(), "/dev/zero: larger than 64 MiB; expected a smaller file");
    }

    #[test]
    fn bytes_that_are_no_text_have_a_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bus.toml");
        std::fs::write(&path, b"a\n\xff").unwrap();
        assert!(read_text(&path).unwrap_err().to_string().ends_with("byte 2: found no UTF-8; expected text"));
        std::fs::write(&path, b"\xff\xfea\0").unwrap();
        assert!(read_text(&path).unwrap_err().to_string().ends_with("byte 0: found UTF-16; expected UTF-8"));
    }
}
