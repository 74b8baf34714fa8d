//! Documents that are generated, and whether they are up to date.

use std::env;
use std::fmt::Write as _;
use std::fs;

use crate::cli::run;
use crate::support::workspace;

/// Compares with a file of `docs/`, or writes it with `COBSCOPE_BLESS=1`.
fn is_current(name: &str, text: &str) {
    let path = workspace().join("docs").join(name);
    if env::var_os("COBSCOPE_BLESS").is_some() {
        fs::write(&path, text).unwrap();
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(found, text, "docs/{name} is stale: COBSCOPE_BLESS=1 cargo test --workspace");
}

/// Names of the subcommands, as the help lists them.
fn subcommands() -> Vec<String> {
    let help = run(&["--help"], "").stdout;
    let list = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    let names = list.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    names
        .map(|line| line.split_whitespace().next().unwrap().to_owned())
        .filter(|name| name != "help")
        .collect()
}

#[test]
fn the_command_line_reference() {
    let mut text = String::from("# Command line\n\nGenerated from the program's own help.\n");
    writeln!(text, "\n## cobscope\n\n```\n{}```", run(&["--help"], "").stdout).unwrap();
    let names = subcommands();
    assert!(names.contains(&"decode".to_owned()), "{names:?}");
    for name in names {
        writeln!(text, "\n## cobscope {name}\n\n```\n{}```", run(&[&name, "--help"], "").stdout).unwrap();
    }
    is_current("cli.md", &text);
}
