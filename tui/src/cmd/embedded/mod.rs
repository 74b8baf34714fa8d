//! Commands for other programs, such as the Python module: they return results and messages in place of printing them.
//!
//! The arguments are those of the command line, so that options have the same names, checks and errors.

mod source;

use std::ffi::OsString;
use std::sync::Arc;

use anyhow::{Context as _, anyhow, ensure};
use clap::Parser as _;
use cobscope_decoder::pipeline::{Pipeline, Summary};
use cobscope_decoder::profile::{Device, ProfileError};
use cobscope_decoder::sink::findings::CaptureResult;
use serde_json::Value;

pub use source::{CaptureEnd, CaptureReader, CaptureSource, WholeCapture};

use super::input::{common_catalogue, options_of};
use super::messages::{Refusal, collected};
use super::results::findings_of;
use super::{check, diff, explain};
use crate::cli::{CheckArgs, Cli, Command};
use crate::exit_code::Exit;

/// A result, and the messages that the command prints on stderr.
#[derive(Debug)]
pub struct Answer<T> {
    /// The result.
    pub value: T,
    /// Messages, one per cause and capture.
    pub messages: Vec<String>,
}

/// Error of a command: its exit status, place and reason.
#[derive(Debug)]
pub struct CommandError {
    /// Status with which the command ends.
    pub exit: Exit,
    /// File, line or option, and the reason; in one line unless it lists several.
    pub text: String,
}

/// The command line of a command.
fn parsed(command: &str, arguments: &[OsString]) -> Result<Command, Refusal> {
    let words = ["cobscope", command].into_iter().map(OsString::from);
    let cli = Cli::try_parse_from(words.chain(arguments.iter().cloned())).map_err(|error| {
        let text = error.to_string();
        let lines = text.lines().take_while(|line| !line.is_empty());
        let text = lines.map(str::trim).collect::<Vec<_>>().join(" ");
        (Exit::Usage, anyhow!(text.trim_start_matches("error: ").to_owned()))
    })?;
    cli.command.check_nodes().map_err(|error| (Exit::Usage, anyhow::Error::msg(error)))?;
    if let Some(folder) = cli.command.profile_folders().iter().find(|folder| !folder.is_dir()) {
        return Err((Exit::Profile, anyhow!("--profiles {}: not a folder", folder.display())));
    }
    Ok(cli.command)
}

fn check_arguments(arguments: &[OsString]) -> Result<CheckArgs, Refusal> {
    match parsed("check", arguments)? {
        Command::Check(arguments) => Ok(arguments),
        _ => Err((Exit::Usage, anyhow!("expected the options of check"))),
    }
}

fn answered<T>(work: impl FnOnce() -> Result<T, Refusal>) -> Result<Answer<T>, CommandError> {
    let (result, messages) = collected(work);
    match result {
        Ok(value) => Ok(Answer { value, messages }),
        Err((exit, error)) => Err(CommandError { exit, text: format!("{error:#}") }),
    }
}

/// The lines of `check -f jsonl`, with these arguments.
///
/// # Errors
/// Those of the command; a capture that cannot be read is a line.
pub fn check(arguments: &[OsString]) -> Result<Answer<String>, CommandError> {
    answered(|| {
        let format = ["--format", "jsonl"].map(OsString::from);
        let arguments = check_arguments(&[&format[..], arguments].concat())?;
        let lines = check::lines(&arguments)?;
        Ok(String::from_utf8_lossy(&lines).into_owned())
    })
}

/// The object of `diff -f json`, with these arguments.
///
/// # Errors
/// Those of the command, and a capture that cannot be read to its end.
pub fn diff(arguments: &[OsString]) -> Result<Answer<String>, CommandError> {
    answered(|| {
        let Command::Diff(arguments) = parsed("diff", arguments)? else {
            return Err((Exit::Usage, anyhow!("expected the options of diff")));
        };
        let usage = |error| (Exit::Usage, error);
        let pair = diff::pair(&arguments.input).map_err(usage)?;
        let catalogue = common_catalogue(&arguments.input.profiles);
        let options = options_of(&arguments.input, catalogue).map_err(|error| (Exit::Profile, error))?;
        let [good, bad] = &pair;
        diff::quiet::compared([good, bad], &arguments, &options).map_err(|error| (Exit::Capture, error))
    })
}

/// The text of `explain` for a code, an identifier, an object, a frame or a rule.
///
/// # Errors
/// If the text has no meaning, or the profile is unknown.
pub fn explain(arguments: &[OsString]) -> Result<Answer<String>, CommandError> {
    answered(|| {
        let Command::Explain { thing, device, profiles } = parsed("explain", arguments)? else {
            return Err((Exit::Usage, anyhow!("expected the options of explain")));
        };
        let catalogue = common_catalogue(&profiles);
        let device: Option<Arc<Device>> =
            device.map(|device| catalogue.device(&device)).transpose().map_err(|error| {
                let is_broken = matches!(error, ProfileError::Broken { .. });
                (if is_broken { Exit::Profile } else { Exit::Usage }, error.into())
            })?;
        explain::meaning(&thing, catalogue, device).map_err(|text| (Exit::Usage, anyhow::Error::msg(text)))
    })
}

/// The objects of `check -f jsonl` for the frames of live buses.
///
/// # Errors
/// If they cannot be written.
pub fn finding_lines(capture: &str, summary: Summary) -> Result<Vec<Value>, CommandError> {
    let judged = CaptureResult {
        capture: capture.to_owned(),
        frames: summary.frames,
        findings: summary.findings,
        ..CaptureResult::default()
    };
    findings_of(judged).map_err(|error| CommandError { exit: Exit::Capture, text: format!("{error:#}") })
}

impl CaptureSource {
    /// Opens a capture with the options of `check`: a file, or the parts of one capture.
    ///
    /// # Errors
    /// An option, bus file, profile, device file or database is invalid, or the capture cannot be opened.
    pub fn open(arguments: &[OsString]) -> Result<Answer<Self>, CommandError> {
        answered(|| {
            let source = Self::of(check_arguments(arguments)?)?;
            source.probe().map_err(|error| (Exit::Capture, error))?;
            Ok(source)
        })
    }

    /// Options of live buses: those of `check` without a capture.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn pipeline(arguments: &[OsString]) -> Result<Answer<Pipeline>, CommandError> {
        answered(|| {
            let (options, setup) =
                check::ready(&check_arguments(arguments)?).map_err(|error| (Exit::Profile, error))?;
            Ok(Pipeline::of_options(options, Some(setup)))
        })
    }

    fn of(arguments: CheckArgs) -> Result<Self, Refusal> {
        let (options, setup) = check::ready(&arguments).map_err(|error| (Exit::Profile, error))?;
        let series = one_capture(&arguments).map_err(|error| (Exit::Usage, error))?;
        Ok(Self { series, input: arguments.input, options, setup })
    }
}

/// The capture of the arguments: a file, several parts, or a folder with the parts of one capture.
fn one_capture(arguments: &CheckArgs) -> anyhow::Result<crate::source::Series> {
    let input = &arguments.input;
    if let [path] = input.captures.as_slice() {
        return diff::one(path, input);
    }
    let mut all = super::input::series(input);
    ensure!(
        all.len() == 1,
        "the {} files are {} captures, expected the parts of one (join=True)",
        input.captures.len(),
        all.len()
    );
    all.pop().context("no capture")
}
