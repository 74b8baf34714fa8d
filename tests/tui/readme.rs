//! What the README shows is what the program does.

use std::fs;

use crate::cli::run;
use crate::support::workspace;

#[test]
fn the_screens_are_real() {
    let readme = fs::read_to_string(workspace().join("README.md")).unwrap();
    let blocks: Vec<&str> = readme.split("```console\n").skip(1).collect();
    assert_eq!(blocks.len(), 2);
    for block in blocks {
        let (command, screen) = block.split("```").next().unwrap().split_once('\n').unwrap();
        let arguments: Vec<&str> = command.trim_start_matches("$ cobscope ").split(' ').collect();
        let output = run(&arguments, "");
        assert_eq!(output.stdout, screen);
        assert_eq!(output.code, 0);
    }
}

#[test]
fn the_command_to_begin_with_names_a_fixture_that_exists() {
    let readme = fs::read_to_string(workspace().join("README.md")).unwrap();
    let line = readme.lines().find(|line| line.starts_with("cargo run --release -- ")).unwrap();
    let fixture = line.trim_start_matches("cargo run --release -- ").split(' ').next().unwrap();
    assert!(workspace().join(fixture).exists(), "{fixture}");
}
