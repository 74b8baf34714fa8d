//! Commands for other programs, such as the Python module: they return results and messages in place of printing them.
//!
//! The arguments are those of the command line, so that options have the same names, checks and errors.

mod answer;
mod source;

use std::ffi::OsString;
use std::sync::Arc;

use cobscope_decoder::answers::format_line;
use cobscope_decoder::finding::CaptureFindings;
use cobscope_decoder::profile::{DeviceProfile, ProfileError};
use cobscope_decoder::sink::findings::CaptureResult;
use serde_json::Value;

use super::check;
use super::diff::{self, DiffArgs};
use super::explain::{self, ExplainArgs};
use crate::exit_code::ExitStatus;
use crate::run::capture_answers::findings_of;
use crate::run::input::{common_catalogue, options_of};
pub use answer::{CommandError, EmbeddedAnswer};
use answer::{answered, check_arguments, check_folders, check_input, parse_options};
pub use source::{CaptureEnd, CaptureResults, CaptureSource};

/// The lines of `check -f jsonl`, the same as objects, and its exit status, with these arguments.
///
/// # Errors
/// Those of the command; a capture that cannot be read is a line.
pub fn check(
    arguments: &[OsString],
) -> Result<EmbeddedAnswer<(String, Vec<Value>, ExitStatus)>, CommandError> {
    answered(|| {
        let format = ["--format", "jsonl"].map(OsString::from);
        let arguments = check_arguments(&[&format[..], arguments].concat())?;
        let (lines, objects, exit) = check::lines(&arguments)?;
        Ok((String::from_utf8_lossy(&lines).into_owned(), objects, exit))
    })
}

/// The object of `diff -f json`, with these arguments.
///
/// # Errors
/// Those of the command, and a capture that cannot be read to its end.
pub fn diff(arguments: &[OsString]) -> Result<EmbeddedAnswer<String>, CommandError> {
    answered(|| {
        let arguments: DiffArgs = parse_options("diff", arguments)?;
        check_input(&arguments.input)?;
        let usage = |error| (ExitStatus::Usage, error);
        let pair = diff::pair(&arguments.input).map_err(usage)?;
        diff::ensure_start(&arguments).map_err(usage)?;
        let catalogue = common_catalogue(&arguments.input.profiles);
        let options =
            options_of(&arguments.input, catalogue).map_err(|error| (ExitStatus::Profile, error))?;
        let [good, bad] = &pair;
        let compared = diff::quiet::compared([good, bad], &arguments, &options);
        compared.map(|answer| format_line(&answer)).map_err(|error| (ExitStatus::Capture, error))
    })
}

/// The text of `explain` for a code, an identifier, an object, a frame or a rule.
///
/// # Errors
/// If the text has no meaning, or the profile is unknown.
pub fn explain(arguments: &[OsString]) -> Result<EmbeddedAnswer<String>, CommandError> {
    answered(|| {
        let ExplainArgs { thing, device, profiles } = parse_options("explain", arguments)?;
        check_folders(&profiles)?;
        let catalogue = common_catalogue(&profiles);
        let device: Option<Arc<DeviceProfile>> =
            device.map(|device| catalogue.device(&device)).transpose().map_err(|error| {
                let is_broken = matches!(error, ProfileError::Broken { .. });
                (if is_broken { ExitStatus::Profile } else { ExitStatus::Usage }, error.into())
            })?;
        explain::find_meanings(&thing, catalogue, device)
            .map_err(|text| (ExitStatus::Usage, anyhow::Error::msg(text)))
    })
}

/// The objects of `check -f jsonl` for the frames of live buses.
///
/// # Errors
/// If they cannot be written.
pub fn finding_lines(
    capture: &str,
    frames: u64,
    findings: CaptureFindings,
) -> Result<Vec<Value>, CommandError> {
    let judged = CaptureResult { capture: capture.to_owned(), frames, findings, ..CaptureResult::default() };
    findings_of(judged)
        .map_err(|error| CommandError { exit: ExitStatus::Capture, text: format!("{error:#}") })
}
