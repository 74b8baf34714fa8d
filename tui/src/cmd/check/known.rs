//! The baseline of a run: comparison and update.

use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};
use cobscope_decoder::rules::RuleSelection;
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::findings::FindingsReport;
use cobscope_decoder::sink::findings::baseline::{Baseline, BaselineComparison};
use cobscope_decoder::words::count_noun;

use super::arguments::CheckArgs;
use crate::exit_code::ExitStatus;
use crate::output_file::{self, ExistingFile};
use crate::path_text::path_text;
use crate::run::arguments::{NodeArg, SelectArgs};
use crate::run::input::limited;
use crate::run::messages::{Refusal, print_note};
use crate::run::output::ensure_folder;

/// Use of the file of `--baseline`.
pub(super) enum KnownFindings<'a> {
    /// No baseline.
    Nothing,
    /// Compare with the baseline; its captures outside the paths of these options are not part of the run.
    Compared(Baseline, &'a CheckArgs),
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
            let before = replaced(path).map_err(|error| (ExitStatus::Usage, error))?;
            return Ok(Self::Replaced { path, before });
        }
        compared(path)
            .map(|baseline| Self::Compared(baseline, arguments))
            .map_err(|error| (ExitStatus::Profile, error))
    }

    /// Compares the findings with the baseline, or updates it unless `exit` states that a capture is
    /// unreadable.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn apply(self, report: &mut FindingsReport, exit: ExitStatus) -> anyhow::Result<()> {
        match self {
            Self::Nothing => {}
            Self::Compared(baseline, arguments) => {
                baseline.compare_report(report);
                for judged in &mut report.captures {
                    keep_selected(&mut judged.comparison, arguments);
                }
                let paths = &arguments.input.captures;
                let is_below =
                    |capture: &String| paths.iter().any(|path| first_file(capture).starts_with(path));
                report.absent.retain(is_below);
            }
            Self::Replaced { path, .. } if exit == ExitStatus::Capture => print_note(&format!(
                "{}: not updated; a capture is unreadable, and its entries would be lost",
                path_text(path)
            )),
            Self::Replaced { path, before } => replace(path, &before, report)?,
        }
        Ok(())
    }
}

/// Removes rules that were not run and findings that the options cannot select.
fn keep_selected(comparison: &mut BaselineComparison, arguments: &CheckArgs) {
    let (select, ignore) = (arguments.selected_rules.clone(), arguments.ignored_rules.clone());
    let rules = RuleSelection { select, ignore };
    comparison.silent.retain(|rule| rules.admits_rule(rule));
    comparison.gone.retain(|known| {
        let (rule, place) = known.fingerprint.split_once('|').unwrap_or((&known.fingerprint, ""));
        rules.admits_rule(rule) && can_select(&arguments.select, place)
    });
}

/// Whether the options can select a finding of a baseline; `place` is its fingerprint after the rule: `can0|5|1018:01`.
fn can_select(select: &SelectArgs, place: &str) -> bool {
    // A baseline contains neither times nor the other fields.
    if select.filter.is_some() || select.from.is_some() || select.to.is_some() {
        return false;
    }
    let mut parts = place.split('|');
    let (bus, id) = (parts.next(), parts.next());
    let is_on = |node: &NodeArg| node.bus.is_none() || node.bus.as_deref() == bus;
    let is_chosen = |node: &NodeArg| is_on(node) && id == Some(node.id.to_string().as_str());
    select.only_node.is_empty() || select.only_node.iter().any(is_chosen)
}

/// Checks that `--update-baseline` has no option that selects rules or findings.
///
/// # Errors
/// Such an option is given: entries would be lost, or findings accepted that were not shown.
pub(super) fn check_update(arguments: &CheckArgs) -> anyhow::Result<()> {
    let select = &arguments.select;
    let options = [
        ("--select", !arguments.selected_rules.is_empty()),
        ("--ignore", !arguments.ignored_rules.is_empty()),
        ("--filter", select.filter.is_some()),
        ("--from", select.from.is_some()),
        ("--to", select.to.is_some()),
        ("--only-node", !select.only_node.is_empty()),
    ];
    let given = options.iter().filter(|(_, is_given)| *is_given && arguments.update_baseline);
    let given: Vec<&str> = given.map(|(option, _)| *option).collect();
    let names = given.join(", ");
    ensure!(given.is_empty(), "--update-baseline: a baseline covers all findings; without {names}");
    Ok(())
}

/// The file of a capture, or the first part of a series such as `log/run.log..run-0003.log`.
fn first_file(capture: &str) -> &Path {
    let first = capture.rsplit_once("..").map(|(first, _)| first);
    let first = first.filter(|first| !Path::new(capture).exists() && Path::new(first).is_file());
    Path::new(first.unwrap_or(capture))
}

fn compared(path: &Path) -> anyhow::Result<Baseline> {
    let name = path_text(path);
    if matches!(path.try_exists(), Ok(false)) {
        bail!("{name}: no such file; --update-baseline creates it");
    }
    let text = limited::read_text(path)?;
    Baseline::parse_baseline(&text)
        .map_err(|error| anyhow!("{name}: not a valid baseline: {}", escape(&error)))
}

/// Content of the baseline to update; empty if there is no file or an empty file.
fn replaced(path: &Path) -> anyhow::Result<Baseline> {
    let name = path_text(path);
    ensure_folder(path)?;
    let is_missing = matches!(path.try_exists(), Ok(false));
    let bytes = if is_missing { Vec::new() } else { limited::read_bytes(path)? };
    if bytes.is_empty() {
        return Ok(Baseline::default());
    }
    let expected = "not overwritten; expected a baseline written by --update-baseline, or no file";
    let text = std::str::from_utf8(&bytes).map_err(|error| anyhow!("{name}: {expected}: {error}"))?;
    Baseline::parse_baseline(text).map_err(|error| anyhow!("{name}: {expected}: {}", escape(&error)))
}

/// Writes the current findings as the new baseline. Entries of captures that were not checked are kept.
fn replace(path: &Path, before: &Baseline, report: &mut FindingsReport) -> anyhow::Result<()> {
    let name = path_text(path);
    let mut baseline = Baseline::baseline_of(report);
    // Stdin always exists.
    let others =
        baseline.keep_entries(before, report, |capture| capture == "-" || first_file(capture).exists());
    output_file::write_file(path, ExistingFile::Replace, baseline.baseline_text().as_bytes())
        .with_context(|| format!("{name}: cannot be written"))?;
    baseline.compare_report(report);
    // Kept entries are reported below; they do not fail the run.
    report.absent.clear();
    if others.kept > 0 {
        let captures = count_noun(others.kept, "capture");
        print_note(&format!("{name}: kept the entries of {captures} not checked in this run"));
    }
    for capture in others.dropped {
        print_note(&format!("{name}: dropped the entries of {capture}; the file does not exist"));
    }
    Ok(())
}
