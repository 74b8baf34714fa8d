//! Completions and manual pages, generated from the definition of the command line.

use clap::{Args, Command, ValueHint};

use crate::exit_code::ExitStatus;
use crate::run::messages::print_error;
use crate::run::output::print_text;

/// Print shell completions
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// Shell
    pub shell: clap_complete::Shell,
}

/// Print a manual page (`cobscope man | man -l -`)
#[derive(Debug, Args)]
pub struct ManArgs {
    /// Command, such as check or profiles-import (default: the whole program)
    #[arg(value_name = "COMMAND")]
    pub of: Option<String>,
}

/// Prints completions for a shell; `program` is the definition of the command line.
pub fn print_completions(arguments: &CompletionsArgs, program: Command) -> ExitStatus {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut without_file_names(program), "cobscope", &mut script);
    print_text(&script)
}

/// Disables file name completion for values other than paths.
fn without_file_names(command: Command) -> Command {
    let command = command.mut_args(|arg| {
        let is_free = arg.get_value_hint() == ValueHint::Unknown && arg.get_possible_values().is_empty();
        let takes_values = arg.get_action().takes_values();
        if is_free && takes_values { arg.value_hint(ValueHint::Other) } else { arg }
    });
    command.mut_subcommands(without_file_names)
}

/// Removes the `help` subcommand, which has no page.
fn without_help(command: Command) -> Command {
    command.disable_help_subcommand(true).mut_subcommands(without_help)
}

/// Prints the manual page of a command, such as `check` or `profiles-import`, or of the program.
pub fn print_manual(arguments: &ManArgs, program: Command) -> ExitStatus {
    let of = arguments.of.as_deref();
    let mut program = without_help(program);
    // `build` prefixes command names with the program name and adds global options to each command.
    program.build();
    let mut command = &program;
    for name in of.iter().flat_map(|of| of.split('-')) {
        let Some(found) = command.find_subcommand(name) else {
            print_error(&anyhow::anyhow!("unknown command '{name}'; see cobscope --help"));
            return ExitStatus::Usage;
        };
        command = found;
    }
    let command = command.clone();
    let title = of.map_or_else(|| "cobscope".to_owned(), |name| format!("cobscope-{name}"));
    let mut page = Vec::new();
    match clap_mangen::Man::new(command).title(title).render(&mut page) {
        Ok(()) => print_text(&page),
        Err(_) => ExitStatus::Usage,
    }
}
