//! Completions and the manual page, made from the command line's definition.

use clap::{Command, CommandFactory as _, ValueHint};

use super::messages::complain;
use super::output::print;
use crate::cli::Cli;
use crate::exit_code::Exit;

/// Writes completions for `shell`.
pub fn completions(shell: clap_complete::Shell) -> Exit {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut without_file_names(Cli::command()), "cobscope", &mut script);
    print(&script)
}

/// Values that are no paths get no names of files offered.
fn without_file_names(command: Command) -> Command {
    let command = command.mut_args(|arg| {
        let is_free = arg.get_value_hint() == ValueHint::Unknown && arg.get_possible_values().is_empty();
        let takes_values = arg.get_action().takes_values();
        if is_free && takes_values { arg.value_hint(ValueHint::Other) } else { arg }
    });
    command.mut_subcommands(without_file_names)
}

/// Without `help`, which has no page.
fn without_help(command: Command) -> Command {
    command.disable_help_subcommand(true).mut_subcommands(without_help)
}

/// Writes the manual page of a command, such as `check` or `profiles-import`, or of the program.
pub fn man(of: Option<&str>) -> Exit {
    let mut program = without_help(Cli::command());
    // Names of commands have the program's in front, and options of all commands are in each.
    program.build();
    let mut command = &program;
    for name in of.iter().flat_map(|of| of.split('-')) {
        let Some(found) = command.find_subcommand(name) else {
            complain(&anyhow::anyhow!("there is no command '{name}'; cobscope --help lists them"));
            return Exit::Usage;
        };
        command = found;
    }
    let command = command.clone();
    let title = of.map_or_else(|| "cobscope".to_owned(), |name| format!("cobscope-{name}"));
    let mut page = Vec::new();
    match clap_mangen::Man::new(command).title(title).render(&mut page) {
        Ok(()) => print(&page),
        Err(_) => Exit::Usage,
    }
}
