//! The report that a new one replaces.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use anyhow::{Context as _, ensure};
use cobscope_decoder::sink::findings::FINDING_FORMATS;

use crate::path_text::shown;

/// Bytes of the start and of the end of a report that contain its mark.
const SEARCHED: u64 = 64 * 1024;

/// Checks that an output file is new, empty, no file, or a report.
///
/// # Errors
/// If it has other content, or cannot be read.
pub(super) fn ensure_report(path: &Path) -> anyhow::Result<()> {
    let size = match path.metadata() {
        Ok(found) if found.is_file() && found.len() > 0 => found.len(),
        _ => return Ok(()),
    };
    let name = shown(path);
    let text = ends(path, size).with_context(|| format!("{name}: cannot be read"))?;
    let is_report = FINDING_FORMATS.iter().any(|format| text.contains(format.mark));
    ensure!(is_report, "{name}: not overwritten; expected a report of cobscope check, or no file");
    Ok(())
}

/// Start and end of a file.
fn ends(path: &Path, size: u64) -> std::io::Result<String> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::new();
    Read::by_ref(&mut file).take(SEARCHED).read_to_end(&mut bytes)?;
    file.seek(SeekFrom::Start(size.saturating_sub(SEARCHED)))?;
    file.take(SEARCHED).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
