//! Command lines from words, and answers with their messages.

use std::ffi::OsString;

use anyhow::anyhow;
use clap::Parser as _;

use crate::cli::{CheckArgs, Cli, CliCommand};
use crate::cmd::messages::{Refusal, collect_messages};
use crate::exit_code::ExitStatus;

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

/// The command line of a command.
///
/// # Errors
/// If an option is not valid.
pub(super) fn parsed(command: &str, arguments: &[OsString]) -> Result<CliCommand, Refusal> {
    let words = ["cobscope", command].into_iter().map(OsString::from);
    let cli = Cli::try_parse_from(words.chain(arguments.iter().cloned())).map_err(|error| {
        let text = error.to_string();
        let lines = text.lines().take_while(|line| !line.is_empty());
        let text = lines.map(str::trim).collect::<Vec<_>>().join(" ");
        (ExitStatus::Usage, anyhow!(text.trim_start_matches("error: ").to_owned()))
    })?;
    cli.command.check_nodes().map_err(|error| (ExitStatus::Usage, anyhow::Error::msg(error)))?;
    if let Some(folder) = cli.command.profile_folders().iter().find(|folder| !folder.is_dir()) {
        return Err((ExitStatus::Profile, anyhow!("--profiles {}: not a folder", folder.display())));
    }
    Ok(cli.command)
}

/// The options of `check`.
///
/// # Errors
/// If one is not valid.
pub(super) fn check_arguments(arguments: &[OsString]) -> Result<CheckArgs, Refusal> {
    match parsed("check", arguments)? {
        CliCommand::Check(arguments) => Ok(arguments),
        _ => Err((ExitStatus::Usage, anyhow!("expected the options of check"))),
    }
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
