//! The baseline of a run: compared with, or written anew.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::findings::Report;
use cobscope_decoder::sink::findings::baseline::Baseline;
use cobscope_decoder::words::plural;

use crate::cli::CheckArgs;
use crate::cmd::messages::{Refusal, note};
use crate::exit_code::Exit;

/// What is done with the file of `--baseline`.
pub(super) enum Known<'a> {
    /// There is none.
    Nothing,
    /// What is found is compared with it.
    /// Captures that lie in none of these paths are no part of this run.
    Compared(Baseline, &'a [PathBuf]),
    /// What is found takes its place.
    Replaced { path: &'a Path, before: Baseline },
}

impl<'a> Known<'a> {
    /// Reads the baseline, where there is one.
    ///
    /// # Errors
    /// When it cannot be read, or what would be replaced is no baseline.
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

    /// Compares what was found with it, or writes it where all captures could be read: `exit` tells.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn apply(self, report: &mut Report, exit: Exit) -> anyhow::Result<()> {
        match self {
            Self::Nothing => {}
            Self::Compared(baseline, paths) => {
                baseline.compare(report);
                let is_part =
                    |capture: &String| paths.iter().any(|path| Path::new(capture).starts_with(path));
                report.absent.retain(is_part);
            }
            Self::Replaced { path, .. } if exit == Exit::Capture => note(&format!(
                "{}: is left as it is: a capture could not be read, and what it holds would be forgotten",
                path.display()
            )),
            Self::Replaced { path, before } => replace(path, &before, report)?,
        }
        Ok(())
    }
}

fn compared(path: &Path) -> anyhow::Result<Baseline> {
    let name = path.display();
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("{name}: cannot be read (--update-baseline writes it)"))?;
    Baseline::parse(&text).map_err(|error| anyhow!("{name}: is no baseline: {}", escape(&error)))
}

/// What is in the file that is written anew; nothing where there is none or it is empty.
fn replaced(path: &Path) -> anyhow::Result<Baseline> {
    let name = path.display();
    let bytes = match std::fs::read(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Baseline::default()),
        bytes => bytes.with_context(|| format!("{name}: cannot be read"))?,
    };
    if bytes.is_empty() {
        return Ok(Baseline::default());
    }
    let expected = "is not written over: expected a baseline that --update-baseline wrote, or no file";
    let text = std::str::from_utf8(&bytes).map_err(|error| anyhow!("{name}: {expected}: {error}"))?;
    Baseline::parse(text).map_err(|error| anyhow!("{name}: {expected}: {}", escape(&error)))
}

/// Writes what was found, which is accepted from now on. What was known of captures that were not judged stays.
fn replace(path: &Path, before: &Baseline, report: &mut Report) -> anyhow::Result<()> {
    let name = path.display();
    let mut baseline = Baseline::of(report);
    // Standard input cannot be gone.
    let others = baseline.keep(before, report, |capture| capture == "-" || Path::new(capture).exists());
    std::fs::write(path, baseline.text()).with_context(|| format!("{name}: cannot be written"))?;
    baseline.compare(report);
    // What was kept is said here; it is no failure of this run.
    report.absent.clear();
    if others.kept > 0 {
        let captures = plural(others.kept, "capture");
        note(&format!("{name}: keeps what it has of {captures} that were not judged"));
    }
    for capture in others.dropped {
        note(&format!("{name}: drops {capture}, which is not there any more"));
    }
    Ok(())
}
