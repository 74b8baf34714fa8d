//! Captures that change while `view` shows them.

use std::fs;

use crate::screens::Screen;
use crate::support::workspace;

/// A copy of a capture without device, and the command that shows it.
fn copied() -> (tempfile::TempDir, std::path::PathBuf, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.log");
    fs::copy(workspace().join("fixtures/devices/pve.log"), &path).unwrap();
    let command = format!("cobscope view --color never --at 0 {}", path.display());
    (folder, path, command)
}

#[test]
fn rows_of_a_shorter_file_are_not_shown_again() {
    let (_folder, path, command) = copied();
    let mut screen = Screen::open(&command, 200, 24);
    let before = screen.text();
    assert!(before.contains("#1/190"), "{before}");
    fs::File::options().write(true).open(&path).unwrap().set_len(800).unwrap();
    screen.keys("G");
    let after = screen.text();
    for text in [
        "CHANGED ",
        "UNREAD",
        "bytes are now 800; these frames cannot be read again",
        "bytes are now 800",
        "a.log changed while open",
    ] {
        assert!(after.contains(text), "{text}:\n{after}");
    }
    // Another key removes the message, not the state.
    screen.keys("j");
    let after = screen.text();
    assert!(after.contains("CHANGED ") && after.contains("UNREAD"), "{after}");
}

#[test]
fn a_capture_that_grows_or_is_touched_is_not_changed() {
    use std::io::Write as _;

    let (_folder, path, command) = copied();
    let mut screen = Screen::open(&command, 200, 24);
    let mut file = fs::File::options().append(true).open(&path).unwrap();
    writeln!(file, "(1700000100.000000) can0 185#00").unwrap();
    file.set_modified(std::time::SystemTime::UNIX_EPOCH).unwrap();
    screen.keys("G");
    let after = screen.text();
    assert!(after.contains("#190/190") && !after.contains("CHANGED") && !after.contains("UNREAD"), "{after}");
}
