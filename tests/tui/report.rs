//! `cobscope report` and `check --report`: pages that a browser reads without doing anything.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;

use html5gum::emitters::default::DefaultEmitter;
use html5gum::{Token, Tokenizer};

use crate::check::{check, folder, text};
use crate::cli::{Output, run};
use crate::support::workspace;

const PVE: &str = "fixtures/devices/pve.log";
const SYDFEC: &str = "fixtures/devices/sydfec.log";
const CLEAN: &str = "fixtures/devices/pve_reset_communication.log";

/// Names of elements and attributes that run nothing and load nothing.
const ELEMENTS: &str = "html head meta title style body header main section p h1 h2 h3 dl dt dd div span strong br a \
                        code pre ul li figure figcaption svg path line text table caption thead tbody tr th td";
const ATTRIBUTES: &str = "lang charset name content http-equiv class id href scope aria-labelledby aria-label \
                          aria-hidden role viewBox viewbox d x y x1 x2 y1 y2 text-anchor download colspan";

fn report(arguments: &[&str]) -> Output {
    run(&[&["report"], arguments].concat(), "")
}

/// An element with its attributes.
pub struct Element {
    name: String,
    attributes: Vec<(String, String)>,
}

impl Element {
    pub fn value(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }
}

/// Elements and text of a page, as a browser reads them.
pub fn parsed(page: &str) -> (Vec<Element>, String) {
    let mut emitter = DefaultEmitter::default();
    emitter.naively_switch_states(true);
    let owned = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    let (mut elements, mut text) = (Vec::new(), String::new());
    for token in Tokenizer::new_with_emitter(page, emitter) {
        match token.unwrap() {
            Token::StartTag(tag) => {
                let attributes = tag.attributes.iter().map(|(name, value)| (owned(name), owned(value)));
                elements.push(Element { name: owned(&tag.name), attributes: attributes.collect() });
            }
            Token::String(part) => text.push_str(&owned(&part)),
            other => assert!(matches!(other, Token::EndTag(_) | Token::Doctype(_)), "{other:?}"),
        }
    }
    (elements, text)
}

/// Checks that a page runs nothing, loads nothing and controls no terminal.
pub fn assert_inert(page: &str) {
    let elements: BTreeSet<&str> = ELEMENTS.split_whitespace().collect();
    let attributes: BTreeSet<&str> = ATTRIBUTES.split_whitespace().collect();
    for element in parsed(page).0 {
        assert!(elements.contains(element.name.as_str()), "<{}>", element.name);
        for (name, value) in &element.attributes {
            assert!(attributes.contains(name.as_str()), "<{} {name}>", element.name);
            let is_local = ["#", "./", "data:application/octet-stream;base64,"];
            let is_local = is_local.iter().any(|start| value.starts_with(start));
            assert!(name != "href" || is_local, "{value}");
        }
    }
    let is_terminal_control =
        |c: char| c != '\n' && (c.is_control() || ('\u{202a}'..='\u{202e}').contains(&c));
    assert!(!page.contains(is_terminal_control), "control character");
    assert!(!page.contains("url(") && !page.contains("@import"), "a style that loads something");
}

/// A capture, a bus file and a file name that try HTML, SVG, Markdown, formula and terminal injection.
fn hostile() -> (String, String) {
    let folder = folder("report_hostile");
    let capture = folder.join("=cmd|'x'!A1<b>&\u{1b}[2J\u{202e}`#.log");
    let bus = "\"><svg/onload=alert(1)>\u{1b}]0;x\u{7}`'";
    let mut frames = String::new();
    for (time, frame) in ["705#00", "000#0105", "705#05", "705#05", "085#3081110000000000"].iter().enumerate()
    {
        writeln!(frames, "(17000000{time:02}.{}00000) {bus} {frame}", time + 1).unwrap();
    }
    fs::write(&capture, frames).unwrap();
    let file = folder.join("bus.toml");
    let name = "<script>alert(1)</script>\\n# pwned\\n```\\n</style></title><img src=x onerror=alert(2)>\\u001B[31m@me";
    fs::write(&file, format!("[node.5]\nname = \"{name}\"\n")).unwrap();
    (text(&capture).to_owned(), text(&file).to_owned())
}

#[test]
fn pages_of_a_hostile_capture_are_inert() {
    let (capture, bus) = hostile();
    let output = report(&["--bus", &bus, &capture]);
    assert_eq!(output.code, 0, "{}", output.stderr);
    assert_inert(&output.stdout);
    let (_, text) = parsed(&output.stdout);
    // The names are there, as text.
    for name in [
        "<script>alert(1)</script>",
        "<img src=x onerror=alert(2)>",
        "<svg/onload=alert(1)>",
        "=cmd|'x'!A1<b>&",
    ] {
        assert!(text.contains(name), "{name}");
    }
    let markdown = report(&["-f", "md", "--bus", &bus, &capture]).stdout;
    assert!(!markdown.contains(|c: char| c != '\n' && c.is_control()));
    let mut fence = None;
    for line in markdown.lines() {
        let ticks = line.chars().take_while(|letter| *letter == '`').count();
        match fence {
            None if ticks >= 3 => fence = Some(ticks),
            Some(length) if ticks >= length && line.len() == ticks => fence = None,
            // Outside of code blocks, names are in code spans.
            None if line.contains("alert(1)") => assert!(line.contains('`'), "{line}"),
            _ => assert!(!line.starts_with("# pwned"), "{line}"),
        }
    }
    assert_eq!(fence, None, "a code block without an end");
    let pages = folder("report_hostile_pages");
    let output = report(&[
        "--bus",
        &bus,
        &capture,
        "fixtures/malformed/interface_names.log",
        "-o",
        crate::check::text(&pages),
    ]);
    assert_eq!(output.code, 0, "{}", output.stderr);
    for entry in fs::read_dir(&pages).unwrap() {
        assert_inert(&fs::read_to_string(entry.unwrap().path()).unwrap());
    }
    assert!(!output.stderr.contains(|c: char| c != '\n' && c.is_control()));
}

#[test]
fn every_device_fixture_has_a_sound_page() {
    let mut pages = 0;
    for entry in fs::read_dir(workspace().join("fixtures/devices")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "log") {
            continue;
        }
        let output = report(&[text(&path)]);
        assert_eq!(output.code, 0, "{}: {}", path.display(), output.stderr);
        assert!(output.stdout.len() < 1_000_000, "{}", path.display());
        assert_inert(&output.stdout);
        let (elements, _) = parsed(&output.stdout);
        let ids: Vec<_> = elements.iter().filter_map(|element| element.value("id")).collect();
        let unique: BTreeSet<_> = ids.iter().collect();
        assert_eq!(ids.len(), unique.len(), "{}", path.display());
        let links = elements.iter().filter_map(|element| element.value("href")?.strip_prefix('#'));
        for link in links.chain(elements.iter().filter_map(|element| element.value("aria-labelledby"))) {
            assert!(ids.contains(&link), "{}: {link}", path.display());
        }
        let mut level = 0;
        for element in &elements {
            let heading = element.name.strip_prefix('h').and_then(|rest| rest.parse::<u8>().ok());
            if let Some(heading) = heading {
                assert!(heading <= level + 1, "{}: h{heading} after h{level}", path.display());
                assert!(heading > 1 || level == 0, "{}: two h1", path.display());
                level = heading;
            }
            let is_described = element.value("aria-label").is_some_and(|text| text.len() > 20)
                || element.value("aria-hidden") == Some("true");
            assert!(element.name != "svg" || is_described, "{}", path.display());
        }
        pages += 1;
    }
    assert!(pages > 15, "{pages}");
}

#[test]
fn a_page_answers_what_when_proof_and_section() {
    let page = report(&[PVE]).stdout;
    let (_, text) = parsed(&page);
    let summary = [
        "What32/20  EMCY 8305 spool position error {104}node 32/20 (PVEA, danfoss-pve-ci:pvea), bus can0",
        "When7.204 s after the first frame, 2023-11-14 22:13:27.204 UTC",
        "Proof{104} 0A0 [05 83 21 03 00 00 00 00] 32/20  EMCY  8305 spool position error",
        "SectionPVEA-CI and PVEO-CI Series 6, Technical Information, Object descriptions; Fault handling",
        // The set point is scaled by a default, which is an assumption.
        "Assumptions (?)",
        "claim 1, {110 111 112 113 114 150 151 152 153 154}: 32/20  PDO  RPDO1 0F 00 00 18",
        "wiring: no error frames, and the capture does not show whether they were recorded",
        "zone: UTC",
        "cobscope report fixtures/devices/pve.log",
    ];
    for part in summary {
        assert!(text.contains(part), "{part}\n{text}");
    }
    // Set point and actual value in one plot, with the facts of the story.
    assert!(page.contains(
        "aria-label=\"Plot from 2.204 to 13.804 s after the first frame. Spool set point?: -50 to 37.5 %"
    ));
}

#[test]
fn a_capture_without_findings_states_what_was_checked() {
    let (_, text) = parsed(&report(&[CLEAN]).stdout);
    assert!(text.contains("no finding with a warning or an error"), "{text}");
    assert!(text.contains("Not exercised") && text.contains("duplicate-node-id"), "{text}");
    assert!(!text.contains("Claim 1"));
    let stdin = run(&["check", "--report", "pages", "-"], "(1700000000.000000) can0 705#00\n");
    assert_eq!(stdin.code, 2);
    assert!(stdin.stderr.contains("reads a capture twice"), "{}", stdin.stderr);
}

#[test]
fn a_page_without_claims_states_its_selection() {
    // `check` reports 5 findings: of node 2 at 0.023, 0.045, 0.111 and 0.181 s, of node 3 at 0.527 s.
    const CAPTURE: &str = "fixtures/canopen/sdo_abort.log";
    for (words, scope) in [
        (&["--from", "0.9"][..], "from 0.900 s on"),
        (&["--to", "0.01"], "up to 0.010 s"),
        (&["--filter", "node == 1"], "that matches --filter; 5 findings not selected"),
        (&["--node", "9", "--to", "0.01"], "of node 9/09 up to 0.010 s"),
    ] {
        let page = report(&[words, &["-f", "md", CAPTURE]].concat()).stdout;
        assert!(page.starts_with(&format!("# cobscope: `no finding {scope}`\n")), "{page}");
        assert!(page.contains(&format!("\nno fault {scope}\n")), "{page}");
        let page = report(&[words, &[CAPTURE]].concat()).stdout;
        assert!(page.contains(&format!("<h1>no finding {scope}</h1>")), "{page}");
        assert!(page.contains(&format!("<title>no finding {scope} – {CAPTURE}</title>")), "{page}");
        assert!(page.contains(&format!("no finding with a warning or an error {scope}<")), "{page}");
    }
    let unknown = report(&["--only-node", "can9:63", "-f", "md", CAPTURE]).stderr;
    let text = format!("cobscope: {CAPTURE}: unknown bus can9 in --only-node; buses present: can0\n");
    assert_eq!(unknown, text);
}

#[cfg(feature = "gzip")]
#[test]
fn an_incomplete_capture_is_marked() {
    const CUT_OFF: &str = "fixtures/malformed/cut_off.log.gz";
    let output = report(&[CUT_OFF]);
    assert_eq!(output.code, 3);
    let (_, text) = parsed(&output.stdout);
    let reason =
        "fixtures/malformed/cut_off.log.gz: the file is cut off: incomplete gzip member at byte 1571";
    assert!(text.contains(&format!("INCOMPLETE {reason}")), "{text}");
    assert!(text.contains(&format!("incomplete: {reason}")), "{text}");
    assert!(report(&["-f", "md", CUT_OFF]).stdout.contains(&format!("\nIncomplete: `{reason}`\n")));
}

#[test]
fn positions_without_timestamps_are_frames() {
    let capture = folder("report_no_times").join("frames.log");
    let frames = "can0  705   [1]  00\ncan0  085   [8]  30 81 11 00 00 00 00 00\ncan0  705   [1]  05\n";
    fs::write(&capture, frames).unwrap();
    let output = report(&["--node", "5=cia301", text(&capture)]);
    let output = if output.code == 0 { output } else { report(&[text(&capture)]) };
    assert_eq!(output.code, 0, "{}", output.stderr);
    let (_, text) = parsed(&output.stdout);
    assert!(text.contains("Whenframe 2; the capture has no timestamps"), "{text}");
    assert!(text.contains("no timestamps; positions are numbers of frames"), "{text}");
}

#[test]
fn hashes_are_those_of_the_files() {
    let folder = folder("report_hash");
    let (capture, bus) = (folder.join("boot.log"), folder.join("bus.toml"));
    fs::write(&capture, "(1700000000.000000) can0 705#00\n").unwrap();
    fs::write(&bus, "").unwrap();
    let (_, page) = parsed(&report(&["--bus", text(&bus), text(&capture)]).stdout);
    // sha256sum of both files; the second one is empty.
    assert!(page.contains("3dfeee295c701bb4cdff5f09b4243bc5c43647753373802407ee48b6a659a2d7"), "{page}");
    assert!(page.contains("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"), "{page}");
}

#[test]
fn the_cut_out_capture_has_the_frames_and_comments() {
    let folder = folder("report_attach");
    let page = folder.join("case.html");
    let output = report(&[PVE, "-o", text(&page), "--attach"]);
    assert_eq!((output.code, output.stderr.as_str()), (0, ""));
    let attached = folder.join("case.pcapng");
    let bytes = fs::read(&attached).unwrap();
    let comment = b"claim 1: 32/20  EMCY 8305 spool position error {104}";
    assert!(bytes.windows(comment.len()).any(|part| part == comment));
    // From 5 s before the claim at 7.204 s on.
    let decoded = run(&["decode", "--from", "#1", "--frames", "-f", "jsonl", text(&attached)], "").stdout;
    assert!(decoded.starts_with("{\"t\":1700000002."), "{decoded}");
    assert!(decoded.contains("\"kind\":\"emcy\""), "{decoded}");
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("case.pcapng, next to this page<br>read with --bus case.bus.toml"), "{html}");
    let state = fs::read_to_string(folder.join("case.bus.toml")).unwrap();
    assert!(state.starts_with("# State before frame "), "{state}");
    assert!(state.contains("device = \"danfoss-pve-ci:pvea\"\n"), "{state}");
    assert!(state.contains("nmt = \"operational\"\n"), "{state}");

    let embedded = report(&[PVE, "--attach=embedded"]).stdout;
    assert_inert(&embedded);
    let (elements, _) = parsed(&embedded);
    let link = elements.iter().find(|element| element.value("download").is_some()).unwrap();
    assert_eq!(link.value("download"), Some("report.pcapng"));
    assert!(link.value("href").unwrap().starts_with("data:application/octet-stream;base64,Cg0NC"));

    let refused = report(&[PVE, "--attach"]);
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("stdout has no folder"), "{}", refused.stderr);
    let refused = report(&[PVE, "--attach=embedded", "-f", "md"]);
    assert_eq!(refused.code, 2);
}

#[test]
fn stories_are_selected() {
    let claims = |arguments: &[&str]| {
        let output = report(&[&["-f", "md", "--node", "2=rexroth-sydfec", SYDFEC], arguments].concat());
        assert_eq!(output.code, 0, "{}", output.stderr);
        let title = output.stdout.lines().next().unwrap().to_owned();
        (output.stdout.matches("\n## Claim").count(), title)
    };
    assert_eq!(claims(&[]).0, 3);
    let second = claims(&["--story", "2"]);
    assert_eq!(second, (1, "# cobscope: `2/02  EMCY FF01 control deviation for 1.5 s {242}`".to_owned()));
    let (count, title) = claims(&["--finding", "sdo-download-refused"]);
    assert!(count == 1 && title.contains("5208:02"), "{title}");
    let (count, title) = claims(&["--from", "130"]);
    assert!(count == 1 && title.contains("guarding requests missing"), "{title}");
    assert_eq!(claims(&["--only-node", "7"]).0, 0);
    let missing = report(&[SYDFEC, "--story", "9"]);
    assert_eq!(missing.code, 2);
    assert!(missing.stderr.contains(": --story 9: no such story; stories: "), "{}", missing.stderr);
    let unknown = report(&[SYDFEC, "--finding", "no-such-rule"]);
    assert_eq!(unknown.code, 2, "{}", unknown.stderr);
    let absent = report(&[SYDFEC, "--finding", "node-lost"]);
    assert_eq!(absent.code, 2, "{}", absent.stderr);
    let stdin = run(&["report", "-"], "(1700000000.000000) can0 705#00\n");
    assert_eq!(stdin.code, 2);
    assert!(stdin.stderr.contains("reads a capture twice"), "{}", stdin.stderr);
}

#[test]
fn a_folder_gives_an_index() {
    let pages = folder("report_folder");
    let output = report(&["fixtures/devices", "-o", text(&pages)]);
    assert_eq!(output.code, 0, "{}", output.stderr);
    let (elements, index) = parsed(&fs::read_to_string(pages.join("index.html")).unwrap());
    assert!(index.contains("emcy-raised") && index.contains("fixtures/devices/pve.log"), "{index}");
    let links: Vec<_> = elements.iter().filter_map(|element| element.value("href")).collect();
    assert_eq!(links.len(), fs::read_dir(&pages).unwrap().count() - 1);
    for link in links {
        assert!(pages.join(link).exists(), "{link}");
    }
    let refused = report(&["fixtures/devices"]);
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("give a folder"), "{}", refused.stderr);
    // A capture is never overwritten.
    let copy = folder("report_overwrite").join("a.log");
    fs::write(&copy, "(1700000000.000000) can0 705#00\n").unwrap();
    let refused = report(&[text(&copy), "-o", text(&copy)]);
    assert_eq!((refused.code, fs::read(&copy).unwrap().len()), (2, 32), "{}", refused.stderr);
}

#[test]
fn a_folder_without_captures_has_no_index() {
    let empty = folder("report_empty");
    let pages = folder("report_empty_pages");
    // At first without a file, then with a text file.
    for _ in 0..2 {
        for words in [&["report", text(&empty), "-o"][..], &["check", text(&empty), "--report"]] {
            let output = run(&[words, &[text(&pages)]].concat(), "");
            let stated = format!("cobscope: {}: no captures\n", text(&empty));
            assert_eq!((output.code, output.stderr), (3, stated), "{words:?}");
            assert_eq!(fs::read_dir(&pages).unwrap().count(), 0, "{words:?}");
        }
        fs::write(empty.join("notes.md"), "not a capture").unwrap();
    }
    // Other captures are reported.
    let output = report(&[text(&empty), CLEAN, "-o", text(&pages)]);
    assert_eq!(output.code, 3, "{}", output.stderr);
    assert!(output.stderr.contains(": no captures\n"), "{}", output.stderr);
    assert_eq!(fs::read_dir(&pages).unwrap().count(), 2);
}

#[test]
fn check_writes_a_page_per_failed_capture() {
    let pages = folder("report_check").join("new").join("pages");
    let output = check(&[PVE, CLEAN, "--report", text(&pages)]);
    assert_eq!(output.code, 1, "{}", output.stderr);
    let names: BTreeSet<_> = fs::read_dir(&pages)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    assert_eq!(names, BTreeSet::from(["fixtures_devices_pve.log.html".to_owned(), "index.html".to_owned()]));
    let (_, index) = parsed(&fs::read_to_string(pages.join("index.html")).unwrap());
    assert!(index.contains("fixtures/devices/pve_reset_communication.logpass"), "{index}");
    // Findings of the baseline are not reported.
    let known = folder("report_baseline").join("known.json");
    let output = check(&[PVE, "--baseline", text(&known), "--update-baseline"]);
    assert_eq!(output.code, 0, "{}", output.stderr);
    let pages = folder("report_known");
    let output = check(&[PVE, "--baseline", text(&known), "--report", text(&pages)]);
    assert_eq!((output.code, fs::read_dir(&pages).unwrap().count()), (0, 1), "{}", output.stderr);
}
