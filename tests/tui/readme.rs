//! What the README and the tutorial show is what the program does.
//!
//! `COBSCOPE_BLESS=1` writes numbers that have changed; a line that differs in more is written by hand.

use std::fs;

use crate::cli::run_in;
use crate::docs::is_blessing;
use crate::support::workspace;

/// A line that stands for lines left out.
const LEFT_OUT: &str = "…";

/// Commands of a document with what they print: `$ cobscope …` in blocks of `console`. Behind `; echo $?` the exit code
/// is the last line, else it is 0.
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

/// Words of a command line; those in single quotes are one.
fn words(command: &str) -> Vec<&str> {
    let parts = command.split('\'').enumerate();
    parts
        .flat_map(|(at, part)| if at % 2 == 1 { vec![part] } else { part.split_whitespace().collect() })
        .collect()
}

/// Whether lines are as shown, where any number may be left out.
fn fits(shown: &[String], lines: &[&str]) -> bool {
    let Some((first, rest)) = shown.split_first() else { return lines.is_empty() };
    let others = lines.get(1..).unwrap_or_default();
    if first == LEFT_OUT {
        return fits(rest, lines) || (!lines.is_empty() && fits(shown, others));
    }
    lines.first().is_some_and(|line| line == first) && fits(rest, others)
}

/// A line with each of its numbers as 0 and each gap as one blank.
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

/// The lines as they are now, as far as they differ from those shown in numbers only.
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

/// Writes the lines that a command prints now into the document that shows it, unless they differ in more than numbers.
fn bless(document: &str, command: &str, shown: &[String], lines: &[&str]) -> bool {
    let Some(current) = with_current_numbers(shown, lines) else { return false };
    let block = |lines: &[String]| format!("$ cobscope {command}\n{}\n", lines.join("\n"));
    let path = workspace().join(document);
    let text = fs::read_to_string(&path).unwrap();
    fs::write(path, text.replace(&block(shown), &block(&current))).unwrap();
    true
}

#[test]
fn the_screens_are_real() {
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
            let (arguments, tells) = match command.strip_suffix("; echo $?") {
                Some(arguments) => (arguments, true),
                None => (command.as_str(), false),
            };
            let output = run_in(folder.path(), &words(arguments), "");
            let code = output.code.to_string();
            let mut lines: Vec<&str> = output.stdout.lines().collect();
            if tells {
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

/// The README's row for the key that writes: the endings of all formats, which choose one.
#[cfg(all(feature = "mcap", feature = "parquet"))]
#[test]
fn every_format_that_the_terminal_ui_writes_is_listed() {
    use cobscope_decoder::capture::WRITABLE;
    use cobscope_decoder::sink::EVENT_FORMATS;

    use crate::docs::is_current;

    let listed = |suffixes: Vec<&str>| format!("(`.{}`)", suffixes.join("`, `."));
    let frames = listed(WRITABLE.iter().map(|format| format.suffix).collect());
    let events = listed(EVENT_FORMATS.iter().map(|format| format.suffix).collect());
    let row = format!("| `V`, `w` | select from here on; write frames {frames} or events {events} |");
    let readme = fs::read_to_string(workspace().join("README.md")).unwrap();
    let lines = readme.lines().map(|line| if line.starts_with("| `V`, `w` |") { &row } else { line });
    is_current("README.md", &(lines.collect::<Vec<_>>().join("\n") + "\n"));
}

#[test]
fn the_command_to_begin_with_names_a_fixture_that_exists() {
    let readme = fs::read_to_string(workspace().join("README.md")).unwrap();
    let line = readme.lines().find(|line| line.starts_with("cargo run --release -- ")).unwrap();
    let fixture = line.trim_start_matches("cargo run --release -- ").split(' ').next().unwrap();
    assert!(workspace().join(fixture).exists(), "{fixture}");
}

#[test]
fn lines_may_be_left_out_but_not_others() {
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
