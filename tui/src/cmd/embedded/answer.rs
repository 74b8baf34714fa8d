//! Command lines from words, and answers with their messages.

use std::ffi::OsString;
use std::path::PathBuf;

use anyhow::anyhow;

use crate::cmd::check::CheckArgs;
use crate::exit_code::ExitStatus;
use crate::run::arguments::{InputArgs, NodeOption, parse_words};
use crate::run::messages::{Refusal, collect_messages};

/// A result, and the messages that the command prints on stderr.
#[derive(Debug)]
pub struct EmbeddedAnswer<T> {
    /// The result.
    pub value: T,
    /// Messages, one per cause and capture.
    pub messages: Vec<String>,
}

/// Error of a command: its exit status, place and reason.
#[derive(Debug)]
pub struct CommandError {
    /// Status with which the command ends.
    pub exit: ExitStatus,
    /// File, line or option, and the reason; in one line unless it lists several.
    pub text: String,
}

/// The options of a command.
///
/// # Errors
/// If one is not valid.
pub(super) fn parse_options<A: clap::Args>(
    command: &'static str,
    arguments: &[OsString],
) -> Result<A, Refusal> {
    parse_words(command, arguments.iter().cloned()).map_err(|error| {
        let text = error.to_string();
        let lines = text.lines().take_while(|line| !line.is_empty());
        let text = lines.map(str::trim).collect::<Vec<_>>().join(" ");
        (ExitStatus::Usage, anyhow!(text.trim_start_matches("error: ").to_owned()))
    })
}

/// Checks the nodes and the folders of profiles of a command that reads captures.
///
/// # Errors
/// If a node has no profile or two profiles, or a folder does not exist.
pub(super) fn check_input(input: &InputArgs) -> Result<(), Refusal> {
    let usage = |error| (ExitStatus::Usage, anyhow::Error::msg(error));
    input.check_nodes(Some(NodeOption::Decode)).map_err(usage)?;
    check_folders(&input.profiles)
}

/// Checks the folders of profiles.
///
/// # Errors
/// If one does not exist.
pub(super) fn check_folders(profiles: &[PathBuf]) -> Result<(), Refusal> {
    match profiles.iter().find(|folder| !folder.is_dir()) {
        Some(folder) => Err((ExitStatus::Profile, anyhow!("--profiles {}: not a folder", folder.display()))),
        None => Ok(()),
    }
}

/// The options of `check`.
///
/// # Errors
/// If one is not valid.
pub(super) fn check_arguments(arguments: &[OsString]) -> Result<CheckArgs, Refusal> {
    let arguments: CheckArgs = parse_options("check", arguments)?;
    check_input(&arguments.input)?;
    Ok(arguments)
}

/// Runs a command with its messages.
///
/// # Errors
/// Those of the command.
pub(super) fn answered<T>(
    work: impl FnOnce() -> Result<T, Refusal>,
) -> Result<EmbeddedAnswer<T>, CommandError> {
    let (result, messages) = collect_messages(work);
    match result {
        Ok(value) => Ok(EmbeddedAnswer { value, messages }),
        Err((exit, error)) => Err(CommandError { exit, text: format!("{error:#}") }),
    }
}
