//! Runs the commands of the README and the tutorial and compares their output.
//!
//! `COBSCOPE_BLESS=1` updates numbers. A line with any other difference must be edited by hand.

use std::fs;
use std::sync::Mutex;

use cobscope::keymap::default_bindings;

use crate::cli::run_in;
use crate::docs::is_blessing;
use crate::support::workspace;

/// One test at a time updates the documents.
static DOCUMENTS: Mutex<()> = Mutex::new(());

/// A line that marks omitted lines.
const LEFT_OUT: &str = "…";

/// Commands of a document with their output: `$ cobscope …` in blocks of `console`. After `; echo $?` the
/// last line is the exit code; without it, the exit code must be 0.
fn commands(document: &str) -> Vec<(String, Vec<String>)> {
    let text = fs::read_to_string(workspace().join(document)).unwrap();
    let mut commands: Vec<(String, Vec<String>)> = Vec::new();
    for block in text.split("```console\n").skip(1) {
        for line in block.split("```").next().unwrap().lines() {
            match line.strip_prefix("$ cobscope ") {
                Some(command) => commands.push((command.to_owned(), Vec::new())),
                None => commands.last_mut().unwrap().1.push(line.to_owned()),
            }
        }
    }
    commands
}

/// Words of a command line; text in single quotes is one word.
fn words(command: &str) -> Vec<&str> {
    let parts = command.split('\'').enumerate();
    parts
        .flat_map(|(at, part)| if at % 2 == 1 { vec![part] } else { part.split_whitespace().collect() })
        .collect()
}

/// Whether the output is as shown; `…` matches any number of lines.
fn fits(shown: &[String], lines: &[&str]) -> bool {
    let Some((first, rest)) = shown.split_first() else { return lines.is_empty() };
    let others = lines.get(1..).unwrap_or_default();
    if first == LEFT_OUT {
        return fits(rest, lines) || (!lines.is_empty() && fits(shown, others));
    }
    lines.first().is_some_and(|line| line == first) && fits(rest, others)
}

/// A line with 0 in place of each number and one blank in place of each gap.
fn shape(line: &str) -> String {
    let mut shape = String::new();
    for character in line.chars() {
        let character = if character.is_ascii_digit() { '0' } else { character };
        if !matches!(character, '0' | ' ') || !shape.ends_with(character) {
            shape.push(character);
        }
    }
    shape
}

/// The shown lines with current numbers; `None` if they differ in anything else.
fn with_current_numbers(shown: &[String], lines: &[&str]) -> Option<Vec<String>> {
    let Some((first, rest)) = shown.split_first() else { return lines.is_empty().then(Vec::new) };
    let others = lines.get(1..).unwrap_or_default();
    let (line, tail) = if first == LEFT_OUT {
        match with_current_numbers(rest, lines) {
            Some(tail) => (first.clone(), tail),
            None if lines.is_empty() => return None,
            None => return with_current_numbers(shown, others),
        }
    } else {
        let line = lines.first().filter(|line| shape(line) == shape(first))?;
        ((*line).to_owned(), with_current_numbers(rest, others)?)
    };
    Some([vec![line], tail].concat())
}

/// Updates numbers in a document; false if the output differs in anything else.
fn bless(document: &str, command: &str, shown: &[String], lines: &[&str]) -> bool {
    let Some(current) = with_current_numbers(shown, lines) else { return false };
    let block = |lines: &[String]| format!("$ cobscope {command}\n{}\n", lines.join("\n"));
    let path = workspace().join(document);
    let text = fs::read_to_string(&path).unwrap();
    fs::write(path, text.replace(&block(shown), &block(&current))).unwrap();
    true
}

#[test]
fn shown_output_is_current() {
    let _lock = DOCUMENTS.lock();
    let folder = tempfile::tempdir().unwrap();
    let shared = folder.path().join("fixtures");
    #[cfg(unix)]
    std::os::unix::fs::symlink(workspace().join("fixtures"), &shared).unwrap();
    #[cfg(not(unix))]
    std::os::windows::fs::symlink_dir(workspace().join("fixtures"), &shared).unwrap();
    for document in ["README.md", "docs/tutorial.md"] {
        let commands = commands(document);
        let text = fs::read_to_string(workspace().join(document)).unwrap();
        assert_eq!(commands.len(), text.matches("\n$ cobscope ").count(), "{document}");
        for (command, shown) in commands {
            let (arguments, shows_code) = match command.strip_suffix("; echo $?") {
                Some(arguments) => (arguments, true),
                None => (command.as_str(), false),
            };
            let output = run_in(folder.path(), &words(arguments), "");
            let code = output.code.to_string();
            let mut lines: Vec<&str> = output.stdout.lines().collect();
            if shows_code {
                lines.push(&code);
            } else {
                assert_eq!(output.code, 0, "{document}: {command}: {}", output.stderr);
            }
            let is_right =
                fits(&shown, &lines) || (is_blessing() && bless(document, &command, &shown, &lines));
            assert!(is_right, "{document}: {command}\n{}", lines.join("\n"));
        }
    }
}

/// The picture of the README is the upper part of a tested screen, with the row of all pane titles.
#[test]
fn the_picture_is_a_tested_screen() {
    use crate::docs::is_current;
    use crate::screens::tab_bar;

    let _lock = DOCUMENTS.lock();
    let session = fs::read_to_string(workspace().join("tests/tui/screens/nodes_machine.txt")).unwrap();
    let (_, screen) = session.split_once("\n> keys <left><right>\n").unwrap();
    let readme = fs::read_to_string(workspace().join("README.md")).unwrap();
    let (before, rest) = readme.split_once("```text\n  can0 ").unwrap();
    let (shown, after) = rest.split_once("```\n").unwrap();
    let titles = tab_bar();
    let mut lines: Vec<&str> = screen.lines().take(shown.lines().count() - 1).collect();
    lines.insert(1, &titles);
    is_current("README.md", &format!("{before}```text\n{}\n```\n{after}", lines.join("\n")));
}

/// The suffixes of all formats that the export accepts are in the row of its key.
#[cfg(all(feature = "mcap", feature = "parquet"))]
#[test]
fn every_format_that_the_terminal_ui_writes_is_listed() {
    use cobscope_decoder::capture::WRITABLE;
    use cobscope_decoder::sink::EVENT_FORMATS;

    use crate::docs::is_current;

    let _lock = DOCUMENTS.lock();
    let listed = |suffixes: Vec<&str>| format!("(`.{}`)", suffixes.join("`, `."));
    let frames = listed(WRITABLE.iter().map(|format| format.suffix).collect());
    let events = listed(EVENT_FORMATS.iter().map(|format| format.suffix).collect());
    let row = format!("| `V`, `w` | select from here on; write frames {frames} or events {events} |");
    let readme = fs::read_to_string(workspace().join("README.md")).unwrap();
    let lines = readme.lines().map(|line| if line.starts_with("| `V`, `w` |") { &row } else { line });
    is_current("README.md", &(lines.collect::<Vec<_>>().join("\n") + "\n"));
}

/// The first column of the table of keys has only keys of the UI.
#[test]
fn each_key_of_the_table_exists() {
    let readme = fs::read_to_string(workspace().join("README.md")).unwrap();
    let table = readme.split_once("| keys | action |").unwrap().1;
    let rows = table.lines().skip(2).take_while(|line| line.starts_with('|'));
    let known: Vec<_> = default_bindings().flat_map(|binding| binding.keys).collect();
    let mut count = 0;
    for row in rows {
        for key in row.split('|').nth(1).unwrap().split('`').skip(1).step_by(2) {
            assert!(known.contains(&&key), "{key} in {row}");
            count += 1;
        }
    }
    assert!(count >= 15, "{count}");
}

#[test]
fn the_command_to_begin_with_names_a_fixture_that_exists() {
    let readme = fs::read_to_string(workspace().join("README.md")).unwrap();
    let line = readme.lines().find(|line| line.starts_with("cargo run --release -- ")).unwrap();
    let fixture = line.trim_start_matches("cargo run --release -- ").split(' ').next().unwrap();
    assert!(workspace().join(fixture).exists(), "{fixture}");
}

#[test]
fn only_marked_lines_may_be_omitted() {
    let shown = |text: &str| text.lines().map(str::to_owned).collect::<Vec<_>>();
    let lines = ["a", "b", "c"];
    for (text, is_so) in [("a\nb\nc", true), ("…\nc", true), ("a\n…", true), ("a\nc", false), ("…\nb", false)]
    {
        assert_eq!(fits(&shown(text), &lines), is_so, "{text}");
    }
    let renewed =
        |text: &str, lines: &[&str]| with_current_numbers(&shown(text), lines).map(|lines| lines.join("\n"));
    assert_eq!(renewed("a 7\n…\nd  8 ms", &["a 12", "b", "d 10 ms"]).as_deref(), Some("a 12\n…\nd 10 ms"));
    assert_eq!(renewed("a 7\n…", &["b 7", "c"]), None);
    assert_eq!(words("decode --filter 'node == 32' x.log"), ["decode", "--filter", "node == 32", "x.log"]);
}
