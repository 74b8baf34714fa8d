//! Checks of the source code of the program.

use crate::support::modules::Modules;

/// Modules of `tui/src` with their permitted imports, which are all listed before them. `lib.rs` starts the
/// program and is exempt, like `main.rs`.
const LAYERS: &[(&str, &[&str])] = &[
    ("exit_code", &[]),
    ("bucket", &[]),
    ("ascii", &[]),
    ("theme", &["ascii"]),
    ("action", &[]),
    ("words", &[]),
    ("select", &[]),
    ("path_text", &[]),
    ("device_name", &[]),
    ("file_identity", &["device_name"]),
    ("output_file", &["device_name", "path_text"]),
    ("record", &["device_name", "output_file", "path_text"]),
    ("source", &["device_name", "file_identity", "path_text", "record"]),
    ("widgets", &["bucket", "theme"]),
    ("timeline", &["bucket", "output_file", "path_text", "record", "source"]),
    ("state", &["theme", "words", "select", "timeline"]),
    ("panes", &["bucket", "theme", "action", "words", "widgets", "timeline", "state"]),
    ("keymap", &["action", "panes"]),
    (
        "app",
        &["ascii", "theme", "action", "select", "source", "widgets", "timeline", "state", "panes", "keymap"],
    ),
    ("terminal", &["theme", "timeline", "app"]),
    ("config", &["path_text", "output_file", "theme", "panes", "keymap"]),
    (
        "run",
        &[
            "exit_code",
            "theme",
            "words",
            "select",
            "path_text",
            "file_identity",
            "output_file",
            "record",
            "source",
            "panes",
            "keymap",
            "app",
            "terminal",
            "config",
        ],
    ),
    (
        "cmd",
        &[
            "exit_code",
            "words",
            "select",
            "path_text",
            "device_name",
            "output_file",
            "record",
            "source",
            "timeline",
            "app",
            "terminal",
            "run",
        ],
    ),
];

/// Files that start the terminal UI or prepare its settings; no others of their folder may import it.
const START_UI: [(&str, &str, &[&str]); 4] = [
    ("cmd", "app", &["cmd/live/screen", "cmd/view", "cmd/view/against", "cmd/view/page_writer"]),
    ("cmd", "terminal", &["cmd/live/screen", "cmd/view"]),
    ("run", "app", &["run/screen/reassign", "run/screen/settings"]),
    ("run", "terminal", &["run/screen/settings"]),
];

/// Modules of `bindings/web/src` with their permitted imports, which are all listed before them. `abi` only starts the
/// session.
const WEB_LAYERS: &[(&str, &[&str])] = &[
    ("files", &[]),
    ("counts", &[]),
    ("matcher", &[]),
    ("state", &[]),
    ("request", &["files"]),
    ("input", &["files", "request"]),
    ("unpack", &["files"]),
    ("capture", &["files"]),
    ("survey", &["counts", "files"]),
    ("seek", &["capture", "files", "survey"]),
    ("overview", &["capture", "survey"]),
    ("rows", &["capture", "counts", "files", "matcher", "seek", "survey"]),
    ("filter", &["counts", "files", "matcher", "rows"]),
    ("search", &["files", "matcher"]),
    ("plot", &["files", "request"]),
    ("report", &["capture", "files", "request", "survey"]),
    ("export", &["files"]),
    ("cut", &["export", "files"]),
    ("jobs", &["cut", "export", "filter", "plot", "report", "rows", "search"]),
    ("opening", &["capture", "files", "input", "report", "request", "survey", "unpack"]),
    (
        "session",
        &[
            "capture", "counts", "cut", "export", "files", "filter", "jobs", "matcher", "opening",
            "overview", "plot", "report", "request", "rows", "search", "seek", "state", "survey",
        ],
    ),
    ("abi", &["files", "session"]),
];

#[test]
fn every_layer_imports_only_those_before_it() {
    for (folder, layers) in [("tui/src", LAYERS), ("bindings/web/src", WEB_LAYERS)] {
        let report = Modules::read(folder).violations(layers);
        assert!(report.is_empty(), "{folder}\n{report}");
    }
}

#[test]
fn only_commands_that_start_the_ui_import_it() {
    let modules = Modules::read("tui/src");
    for (folder, layer, permitted) in START_UI {
        assert_eq!(modules.importers(folder, layer), permitted, "{folder}: {layer}");
    }
}

#[test]
fn no_folder_has_a_circle_of_imports() {
    let crates = ["tui/src", "bindings/web/src", "bindings/python/src"];
    let cycles: Vec<_> = crates.iter().flat_map(|folder| Modules::read(folder).cycles()).collect();
    let report: Vec<_> = cycles.iter().map(|cycle| format!("{}: {}", cycle.folder, cycle.chain)).collect();
    assert!(report.is_empty(), "\n{}", report.join("\n"));
}
