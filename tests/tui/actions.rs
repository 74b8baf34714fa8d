//! Keys of the terminal UI: stories, filters of cells, refusals, visible columns.

use crate::screens::Screen;

/// A view with one pane, without colours.
fn view(options: &str, width: u16) -> Screen {
    Screen::open(&format!("cobscope view --layout one --color never {options}"), width, 30)
}

/// The line with the message or the command of the view: the last but one.
fn status(screen: &mut Screen) -> String {
    screen.text().lines().rev().nth(1).unwrap_or_default().trim().to_owned()
}

const PVE: &str = "--node 32=danfoss-pve-ci fixtures/devices/pve.log";

/// Two of the stories start in the same frame.
#[test]
fn stories_of_one_frame_are_reached_one_after_the_other() {
    let mut screen = view("--at 0 fixtures/j1939/bam.log", 140);
    for number in 1..=6 {
        screen.keys("}");
        let text = status(&mut screen);
        assert!(text.starts_with(&format!("story {number} of 6: ")), "{number}: {text}");
    }
    screen.keys("}");
    assert!(status(&mut screen).starts_with("no further story"));
    for number in (1..6).rev() {
        screen.keys("{");
        let text = status(&mut screen);
        assert!(text.starts_with(&format!("story {number} of 6: ")), "{number}: {text}");
    }
    // From the start of the capture, outside all stories, the previous one is also the first.
    let mut screen = view("--at 0 fixtures/j1939/bam.log", 140);
    screen.keys("{");
    assert!(status(&mut screen).starts_with("story 1 of 6: "));
}

#[test]
fn a_cell_is_filtered_by_its_value() {
    let (events, transfers) = (format!("--at #5 {PVE}"), format!("--pane transfers --at #5 {PVE}"));
    let findings = "--pane findings fixtures/j1939/bam.log";
    let frames = "--pane frames fixtures/j1939/bam.log";
    let upload = "kind == \"sdo-transfer\" && direction == \"upload\"";
    // Options, number of columns to the right, filter.
    let cases = [
        // {4}..{5}: No, Time, Δt, ID, Node, Kind, Object, Event.
        (events.as_str(), 1, "frames == 5"),
        (&events, 2, "node == 32 && kind == \"sdo-transfer\""),
        (&events, 4, "can.id == 0x5A0"),
        (&events, 5, "node == 32"),
        (&events, 6, upload),
        (&events, 7, "object == 0x1000:00"),
        // No, Time, ms, Nodes, Kind, Content, Size, Outcome.
        (&transfers, 0, "frames == 5"),
        (&transfers, 1, upload),
        (&transfers, 3, "node == 32"),
        (&transfers, 4, upload),
        (&transfers, 5, "object == 0x1000:00"),
        (&transfers, 7, "kind == \"sdo-transfer\" && outcome == \"complete\""),
        ("--pane transfers --at #2 fixtures/uds/single.log", 5, "service_id == 0x10"),
        // Severity, Node, ×, First, Last, Cursor, Rule, Subject, Finding.
        (findings, 0, "severity == \"error\""),
        (findings, 1, "source_address == 0x00"),
        (findings, 2, "source_address == 0x00"),
        (findings, 6, "rule == \"transport-violation\""),
        (findings, 7, "pgn == 65260"),
        (findings, 8, "source_address == 0x00"),
        // ID is selected at first; PGN, SA. The first row is ACK of SA00 or DM1.
        (frames, 2, "source_address == 0x00"),
    ];
    for (options, columns, expected) in cases {
        let mut screen = view(options, 220);
        screen.keys(&format!("{}=", "<right>".repeat(columns)));
        let text = status(&mut screen);
        let found = text.split("  ").next().unwrap_or_default();
        assert_eq!(found, format!("filter {expected}"), "{options} {columns}:\n{}", screen.text());
    }
}

#[test]
fn a_report_of_a_note_is_refused_before_its_name_is_typed() {
    let mut screen = view("--pane findings fixtures/uds/single.log", 140);
    screen.keys("R");
    let text = status(&mut screen);
    assert!(text.starts_with("finding 1: a note, in no story; a report needs a story"), "{text}");
    // The command line names the option.
    let folder = tempfile::tempdir().unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_cobscope"))
        .args(["report", "--finding", "1", "-o"])
        .arg(folder.path().join("page.html"))
        .arg(crate::support::workspace().join("fixtures/uds/single.log"))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("--finding 1: a note, in no story; a report needs a story"), "{text}");
    assert!(!output.status.success());
}

#[test]
fn requests_without_a_wanted_response_are_not_incomplete() {
    // 14 exchanges: 10 positive, 1 negative, 2 suppressed, 1 unfinished at the end of the capture.
    let mut screen = view("--pane transfers --at 0 fixtures/uds/single.log", 140);
    let text = screen.text();
    assert!(text.contains("14 transfers, 1 refused or aborted, 0 without response, 1 incomplete"), "{text}");
}

#[test]
fn only_periodic_identifiers_are_overdue() {
    let machine = "--bus fixtures/machine/machine.bus.toml fixtures/machine/machine.log";
    let mut screen = Screen::open(
        &format!("cobscope view --layout one --color never --pane frames --at 136 {machine}"),
        120,
        70,
    );
    let text = screen.text();
    let overdue: Vec<&str> = text
        .lines()
        .filter(|line| line.contains('⚠'))
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    // Node 63 sends no PDO after 126.5 s; the SDO of node 1 at 119.7 s needs no successor.
    assert!(overdue.contains(&"1BF"), "{text}");
    // NMT, EMCY and LSS; requests and responses of SDO and UDS.
    let is_event_driven = |id: &str| {
        u16::from_str_radix(id, 16)
            .is_ok_and(|id| matches!(id, 0 | 0x81..=0xFF | 0x581..=0x67F | 0x7E4 | 0x7E5))
    };
    assert!(!overdue.iter().any(|id| is_event_driven(id)), "{overdue:?}");
}

#[test]
fn any_other_key_closes_the_help() {
    let mut screen = view(PVE, 100);
    for key in ["q", "<f10>", "z", "<esc>"] {
        screen.keys("?");
        assert!(screen.text().contains("any other key closes"));
        screen.keys(key);
        assert!(!screen.text().contains("any other key closes"), "{key}");
        assert!(!screen.quits(), "{key}");
    }
    screen.keys("q");
    assert!(screen.quits());
}

#[test]
fn a_key_without_effect_names_the_panes_that_have_it() {
    let cases = [
        ("0", "p", "nothing to plot here; p works in Nodes, Events, Frames, Detail, Signals"),
        ("6", "p", "nothing to plot here; p works in Nodes, Events, Frames, Detail, Signals"),
        ("7", "p", "nothing to plot here; p works in Nodes, Events, Frames, Detail, Signals"),
        ("8", "p", "nothing to plot here; p works in Nodes, Events, Frames, Detail, Signals"),
        ("9", "p", "nothing to plot here; p works in Nodes, Events, Frames, Detail, Signals"),
        ("0", "s", "nothing to sort here; s works in Nodes, Frames, Transfers, Objects, Findings"),
        ("3", "x", "nothing to expand here; x works in Why, Events, Detail, Signals, Objects, Findings"),
        ("6", "h", "nothing to highlight here; h works in Events, Frames"),
        ("2", "+", "nothing to zoom here; + works in Signals, Bus"),
        ("2", "b", "no plot here; b works in Signals"),
        ("2", "s", "events are always in time order"),
        ("2", "<space>", "the capture is complete; no new frames to follow"),
    ];
    let mut screen = view(PVE, 140);
    for (pane, key, expected) in cases {
        screen.keys(&format!("{pane}{key}"));
        let text = status(&mut screen);
        assert!(text.starts_with(expected), "{pane}{key}: {text}");
    }
}

#[test]
fn enter_shows_the_frame_of_an_object_in_the_detail() {
    let mut screen = view(&format!("--pane objects --at 7 {PVE}"), 140);
    assert!(screen.text().lines().any(|line| line.starts_with("▶ 1000:00")), "{}", screen.text());
    screen.keys("<enter>");
    let text = screen.text();
    // The SDO upload of 1000:00 ends in frame 5.
    assert!(text.contains("--pane detail") && text.contains("--at '#5'"), "{text}");
    screen.keys("<esc>");
    assert!(screen.text().contains("--pane objects"));
}

#[test]
fn hidden_columns_are_skipped() {
    // With one bus there is no column Bus: the fifth column is Kind.
    let mut screen = view("--pane transfers --at 0 fixtures/uds/single.log", 100);
    screen.keys("<right><right><right><right>s");
    assert!(screen.text().contains("Kind▲"), "{}", screen.text());
    // In a narrow pane only some columns are left: each press selects a visible one.
    for (pane, narrow) in [("transfers", 50), ("frames", 60), ("findings", 60), ("objects", 60)] {
        let mut screen = view(&format!("--pane {pane} --at 7 {PVE}"), narrow);
        for _ in 0..3 {
            screen.keys("s");
            assert!(screen.text().contains('▲'), "{pane}:\n{}", screen.text());
            screen.keys("<right>");
        }
    }
}
