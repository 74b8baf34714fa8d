//! The baseline of a run: comparison and update.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::findings::Report;
use cobscope_decoder::sink::findings::baseline::Baseline;
use cobscope_decoder::words::plural;

use crate::cli::CheckArgs;
use crate::cmd::input::limited;
use crate::cmd::messages::{Refusal, note};
use crate::cmd::output::ensure_folder;
use crate::exit_code::Exit;
use crate::output_file::{self, Existing};
use crate::path_text::shown;

/// Use of the file of `--baseline`.
pub(super) enum KnownFindings<'a> {
    /// No baseline.
    Nothing,
    /// Compare with the baseline; its captures outside these paths are not part of the run.
    Compared(Baseline, &'a [PathBuf]),
    /// Overwrite the baseline with the current findings.
    Replaced { path: &'a Path, before: Baseline },
}

impl<'a> KnownFindings<'a> {
    /// Reads the baseline.
    ///
    /// # Errors
    /// If the file is unreadable, or the file to overwrite is not a baseline.
    pub(super) fn read(arguments: &'a CheckArgs) -> Result<Self, Refusal> {
        let Some(path) = arguments.baseline.as_deref() else { return Ok(Self::Nothing) };
        if arguments.update_baseline {
            let before = replaced(path).map_err(|error| (Exit::Usage, error))?;
            return Ok(Self::Replaced { path, before });
        }
        compared(path)
            .map(|baseline| Self::Compared(baseline, &arguments.input.captures))
            .map_err(|error| (Exit::Profile, error))
    }

    /// Compares the findings with the baseline, or updates it unless `exit` states that a capture is
    /// unreadable.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn apply(self, report: &mut Report, exit: Exit) -> anyhow::Result<()> {
        match self {
            Self::Nothing => {}
            Self::Compared(baseline, paths) => {
                baseline.compare(report);
                let is_below =
                    |capture: &String| paths.iter().any(|path| first_file(capture).starts_with(path));
                report.absent.retain(is_below);
            }
            Self::Replaced { path, .. } if exit == Exit::Capture => note(&format!(
                "{}: not updated; a capture is unreadable, and its entries would be lost",
                shown(path)
            )),
            Self::Replaced { path, before } => replace(path, &before, report)?,
        }
        Ok(())
    }
}

/// The file of a capture, or the first part of a series such as `log/run.log..run-0003.log`.
fn first_file(capture: &str) -> &Path {
    let first = capture.rsplit_once("..").map(|(first, _)| first);
    let first = first.filter(|first| !Path::new(capture).exists() && Path::new(first).is_file());
    Path::new(first.unwrap_or(capture))
}

fn compared(path: &Path) -> anyhow::Result<Baseline> {
    let name = shown(path);
    if matches!(path.try_exists(), Ok(false)) {
        bail!("{name}: no such file; --update-baseline creates it");
    }
    let text = limited::text(path)?;
    Baseline::parse(&text).map_err(|error| anyhow!("{name}: not a valid baseline: {}", escape(&error)))
}

/// Content of the baseline to update; empty if there is no file or an empty file.
fn replaced(path: &Path) -> anyhow::Result<Baseline> {
    let name = shown(path);
    ensure_folder(path)?;
    let is_missing = matches!(path.try_exists(), Ok(false));
    let bytes = if is_missing { Vec::new() } else { limited::bytes(path)? };
    if bytes.is_empty() {
        return Ok(Baseline::default());
    }
    let expected = "not overwritten; expected a baseline written by --update-baseline, or no file";
    let text = std::str::from_utf8(&bytes).map_err(|error| anyhow!("{name}: {expected}: {error}"))?;
    Baseline::parse(text).map_err(|error| anyhow!("{name}: {expected}: {}", escape(&error)))
}

/// Writes the current findings as the new baseline. Entries of captures that were not checked are kept.
fn replace(path: &Path, before: &Baseline, report: &mut Report) -> anyhow::Result<()> {
    let name = shown(path);
    let mut baseline = Baseline::of(report);
    // Stdin always exists.
    let others = baseline.keep(before, report, |capture| capture == "-" || first_file(capture).exists());
    output_file::write(path, Existing::Replace, baseline.text().as_bytes())
        .with_context(|| format!("{name}: cannot be written"))?;
    baseline.compare(report);
    // Kept entries are reported below; they do not fail the run.
    report.absent.clear();
    if others.kept > 0 {
        let captures = plural(others.kept, "capture");
        note(&format!("{name}: kept the entries of {captures} not checked in this run"));
    }
    for capture in others.dropped {
        note(&format!("{name}: dropped the entries of {capture}; the file does not exist"));
    }
    Ok(())
}
