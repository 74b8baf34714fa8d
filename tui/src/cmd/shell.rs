//! Completions and the manual page, made from the command line's definition.

use std::io::Write as _;

use clap::CommandFactory as _;

use crate::cli::Cli;
use crate::exit_code::Exit;

/// Writes completions for `shell`.
pub fn completions(shell: clap_complete::Shell) -> Exit {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "cobscope", &mut script);
    write(&script)
}

/// Writes the manual page.
pub fn man() -> Exit {
    let mut page = Vec::new();
    match clap_mangen::Man::new(Cli::command()).render(&mut page) {
        Ok(()) => write(&page),
        Err(_) => Exit::Usage,
    }
}

/// A closed pipe is no failure.
fn write(bytes: &[u8]) -> Exit {
    let _ = std::io::stdout().write_all(bytes);
    Exit::Clean
}
