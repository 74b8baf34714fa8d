//! Completions and the manual page, made from the command line's definition.

use clap::CommandFactory as _;

use super::complain;
use super::output::print;
use crate::cli::Cli;
use crate::exit_code::Exit;

/// Writes completions for `shell`.
pub fn completions(shell: clap_complete::Shell) -> Exit {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "cobscope", &mut script);
    print(&script)
}

/// Writes the manual page of a command, or of the program.
pub fn man(of: Option<&str>) -> Exit {
    let mut program = Cli::command();
    // Names of commands have the program's in front, and options of all commands are in each.
    program.build();
    let command = match of {
        None => program,
        Some(name) => {
            let Some(command) = program.find_subcommand(name) else {
                complain(&anyhow::anyhow!("there is no command '{name}'; cobscope --help lists them"));
                return Exit::Usage;
            };
            command.clone()
        }
    };
    let title = of.map_or_else(|| "cobscope".to_owned(), |name| format!("cobscope-{name}"));
    let mut page = Vec::new();
    match clap_mangen::Man::new(command).title(title).render(&mut page) {
        Ok(()) => print(&page),
        Err(_) => Exit::Usage,
    }
}
