//! Captures with random changes are judged without a panic, within bounds and with reproducible results.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::{CaptureFindings, GROUP_LIMIT, KEPT_OCCURRENCES};

use crate::mutations::remarks;
use crate::mutator::{Dice, Line, lines, text};
use crate::rules::{Annotated, judge, parse};
use crate::support::workspace;

/// Total number of captures with random changes.
const ROUNDS: u64 = 300;

/// Our own captures with their options and bus file lines.
fn sources() -> Vec<(PathBuf, String)> {
    let mut sources = Vec::new();
    for folder in ["canopen", "devices", "j1939", "uds", "rules", "rules/clean"] {
        for entry in fs::read_dir(workspace().join("fixtures").join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "log") {
                continue;
            }
            let nodes = fs::read_to_string(path.with_extension("expected.txt")).unwrap_or_default();
            let nodes = nodes.lines().filter_map(|line| line.strip_prefix("# node:"));
            let nodes = nodes.flat_map(str::split_whitespace).map(|node| format!("#! --node {node}\n"));
            let bus_file = fs::read_to_string(path.with_extension("bus.toml")).unwrap_or_default();
            let bus_file = bus_file.lines().map(|line| format!("#| {line}\n"));
            let mut known = remarks(&fs::read_to_string(&path).unwrap());
            known.extend(nodes.chain(bus_file));
            sources.push((path, known));
        }
    }
    sources.sort();
    sources
}

fn change(dice: &mut Dice, lines: &mut Vec<Line>) {
    let (count, place) = (lines.len(), dice.roll(lines.len()));
    if count == 0 {
        return;
    }
    match dice.roll(8) {
        0 => drop(lines.drain(place..(place + dice.roll(count / 4 + 1)).min(count))),
        1 => {
            // Clock steps by days and years, too.
            let scale = [1, 1, 1, 1_000, 100_000_000][dice.roll(5)];
            let by = (i64::try_from(dice.roll(4_000_000)).unwrap() - 1_000_000) * scale;
            lines[place..].iter_mut().for_each(|line| line.time += by);
        }
        2 => {
            let line = lines[place].clone();
            let times = dice.roll(40);
            lines.splice(place..place, std::iter::repeat_n(line, times));
        }
        3 => {
            let other = dice.roll(count);
            lines.swap(place, other);
        }
        4 if lines[place].has_payload() => lines[place].body.truncate(dice.roll(8) * 2),
        5 if lines[place].id.len() == 3 => lines[place].id = format!("{:03X}", dice.roll(0x800)),
        5 => lines[place].id = format!("{:08X}", dice.roll(0x2000_0000)),
        6 => {
            let id = lines[dice.roll(count)].id.clone();
            let body = format!("{:016X}", dice.number())[..dice.roll(9) * 2].to_owned();
            let line = Line { id, body, ..lines[place].clone() };
            lines.insert(place, line);
        }
        _ if lines[place].has_payload() && !lines[place].body.is_empty() => {
            let at = dice.roll(lines[place].body.len() / 2) * 2;
            lines[place].body.replace_range(at..at + 2, &format!("{:02X}", dice.roll(256)));
        }
        _ => {}
    }
}

/// All findings, as text.
fn finding_texts(capture: &Annotated) -> (String, CaptureFindings) {
    let (news, findings) = judge(&capture.frames, &capture.options, capture.setup.clone());
    let mut reported = String::new();
    for (number, Event { kind, .. }) in &news {
        if let EventKind::FindingOpened(news) | EventKind::FindingClosed(news) = kind {
            writeln!(reported, "{number} {} {news:?}", kind.name()).unwrap();
        }
    }
    for group in &findings.groups {
        writeln!(reported, "{group:?}").unwrap();
    }
    writeln!(reported, "{:?} {:?} {:?}", findings.tallies, findings.cases, findings.quality).unwrap();
    (reported, findings)
}

#[test]
fn captures_changed_at_random_are_judged_within_bounds_and_always_the_same() {
    let sources = sources();
    let mut found = 0;
    for round in 0..ROUNDS {
        let mut dice = Dice::new(round);
        let (path, known) = &sources[dice.roll(sources.len())];
        let name = format!("{} changed in round {round}", path.display());
        let mut frames = lines(&fs::read_to_string(path).unwrap());
        for _ in 0..=dice.roll(12) {
            change(&mut dice, &mut frames);
        }
        let capture = parse(&name, &format!("{known}{}", text(&frames)));
        let (first, findings) = finding_texts(&capture);
        assert_eq!(first, finding_texts(&capture).0, "{name}");
        assert!(findings.groups.len() <= GROUP_LIMIT, "{name}");
        for group in &findings.groups {
            let kept = group.first.len() + group.last.len();
            assert!(kept <= 2 * KEPT_OCCURRENCES, "{name}: {group:?}");
            assert!(kept as u64 <= group.count && !group.text.is_empty(), "{name}: {group:?}");
            assert!(group.text.len() < 400 && !group.text.contains('\n'), "{name}: {group:?}");
        }
        found += findings.groups.len();
    }
    assert!(found > 50, "{found}");
}
