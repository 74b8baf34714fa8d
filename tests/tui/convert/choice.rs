//! Selection of the frames to write.

use cobscope_decoder::words::UNKNOWN_ZONE;

use super::{Content, Folder, fixture, log};

/// Numbers of the frames that `convert` selects in a fixture.
fn chosen(capture: &str, options: &[&str]) -> Vec<u64> {
    let folder = Folder::new();
    let source = fixture(capture);
    let whole = Content::read(&source);
    let mut words = options.to_vec();
    words.extend([source.to_str().unwrap(), "@out.csv"]);
    let out = folder.converted(&words);
    // Frames are identified by their contents, in order.
    let mut rest = whole.frames.iter();
    let mut number = |frame: &cobscope_decoder::frame::Frame| {
        rest.find(|other| (other.time, other.id, other.data()) == (frame.time, frame.id, frame.data()))
            .unwrap()
            .number
    };
    out.frames.iter().map(&mut number).collect()
}

/// Numbers of the frames on one of these identifiers.
fn on(capture: &str, ids: &[&str]) -> Vec<u64> {
    let whole = Content::read(&fixture(capture));
    let is_one = |id: &str| ids.contains(&id);
    whole.frames.iter().filter(|frame| is_one(&frame.id.to_string())).map(|frame| frame.number).collect()
}

#[test]
fn a_filter_takes_frames_by_their_own_message() {
    let emcy = "canopen/emcy.log";
    assert_eq!(chosen(emcy, &["--filter", "id == 0x702"]), on(emcy, &["702"]));
    let found = chosen(emcy, &["--filter", "kind == emcy"]);
    assert!(!found.is_empty());
    // fixtures/README.md: EMCY of nodes 2 and 6; 086# also counts.
    let ids: Vec<_> = Content::read(&fixture(emcy)).ids();
    let expected: Vec<u64> =
        (1..).zip(&ids).filter(|(_, id)| id.starts_with("08")).map(|(at, _)| at).collect();
    assert_eq!(found, expected);
    let both = chosen(emcy, &["--filter", "kind == emcy || id == 0x702"]);
    let mut either = [found, on(emcy, &["702"])].concat();
    either.sort_unstable();
    either.dedup();
    assert_eq!(both, either);
    // A segment of a transfer is a plain frame with a node.
    let sdo = "canopen/sdo_segmented.log";
    assert_eq!(chosen(sdo, &["--filter", "kind == frame && node == 2"]), on(sdo, &["602", "582"]));
}

#[test]
fn a_filter_that_no_frame_can_match_is_refused() {
    let folder = Folder::new();
    folder.write("a.log", log(&["705#00"]));
    let output = folder.convert(&["--filter", "kind == sdo-transfer", "@a.log", "@b.log"]);
    assert_eq!(output.code, 2);
    assert!(output.stderr.contains("never true for a single frame"), "{}", output.stderr);
    assert_eq!(folder.names(), ["a.log"]);
    let nothing = folder.convert(&["--filter", "node == 9", "@a.log", "@b.log"]);
    assert_eq!((nothing.code, nothing.stderr.as_str()), (0, "cobscope: @b.log: no frames selected\n"));
}

#[test]
fn from_and_to_take_a_part() {
    let capture = "canopen/mid_run.log";
    let whole = Content::read(&fixture(capture));
    let first = whole.frames[0].time.unwrap();
    // Milliseconds.
    let between = |from: i64, to: i64| {
        let (from, to) = (from * 1_000_000, to.saturating_mul(1_000_000));
        let inside =
            |frame: &&cobscope_decoder::frame::Frame| (from..=to).contains(&frame.time.unwrap().since(first));
        whole.frames.iter().filter(inside).map(|frame| frame.number).collect::<Vec<_>>()
    };
    assert_eq!(chosen(capture, &["--from", "#5", "--to", "#7"]), [5, 6, 7]);
    assert_eq!(chosen(capture, &["--from", "0.5", "--to", "0.750"]), between(500, 750));
    assert_eq!(chosen(capture, &["--to", "0"]), between(0, 0));
    // 1700000000 is 2023-11-14 22:13:20 UTC.
    assert_eq!(chosen(capture, &["--from", "2023-11-14T22:13:21Z"]), between(1_000, i64::MAX));
    let folder = Folder::new();
    let output = folder.convert(&["--from", "9999", fixture(capture).to_str().unwrap(), "@a.log"]);
    assert_eq!((output.code, output.stderr.as_str()), (0, "cobscope: @a.log: no frames selected\n"));
    // Without timestamps, only frame numbers can be used.
    folder.write("b.log", "can0 705#00\ncan0 705#05\n");
    folder.write("b.csv", "ID,Data Bytes\n0x705,00\n0x705,05\n");
    let output = folder.convert(&["--from", "1", "@b.csv", "@c.csv"]);
    assert_eq!(output.code, 3, "{}", output.stderr);
    assert!(
        output.stderr.contains("@b.csv: has no timestamps; use frame numbers, such as --from #1234"),
        "{}",
        output.stderr
    );
}

#[test]
fn a_node_is_taken_with_its_services_and_what_goes_to_all() {
    let folder = Folder::new();
    // From node 5: boot-up, heartbeat, EMCY, TPDO1, RPDO1, SDO in both directions, NMT to it. To all: NMT,
    // SYNC, TIME, LSS.
    let own = [
        "705#00",
        "705#05",
        "085#1010010000000000",
        "185#01",
        "205#01",
        "605#4000100000000000",
        "585#4300100000000000",
        "000#0105",
        "000#0100",
        "080#",
        "100#000000000000",
        "7E5#0401000000000000",
    ];
    let others = [
        "706#05",
        "706#00",
        "086#1010010000000000",
        "186#01",
        "606#4000100000000000",
        "586#4300100000000000",
        "000#0106",
        "7F0#00",
    ];
    let mixed: Vec<&str> =
        own.iter().zip(others.iter().cycle()).flat_map(|(own, other)| [*own, *other]).collect();
    folder.write("a.log", log(&mixed));
    let out = folder.converted(&["--only-node", "5", "@a.log", "@b.csv"]);
    let frames = |content: &Content| {
        let text = |frame: &cobscope_decoder::frame::Frame| {
            let data = frame.data().iter().fold(String::new(), |text, byte| format!("{text}{byte:02X}"));
            format!("{}#{data}", frame.id)
        };
        content.frames.iter().map(text).collect::<Vec<_>>()
    };
    assert_eq!(frames(&out), own);
    // Two nodes, and a node of a missing bus.
    let both = folder.converted(&["--only-node", "5", "--only-node", "6", "@a.log", "@c.csv"]);
    assert_eq!(both.frames.len(), mixed.iter().filter(|frame| !frame.starts_with("7F0")).count());
    let none = folder.convert(&["--only-node", "can9:5", "@a.log", "@d.csv"]);
    let stated = "cobscope: @a.log: unknown bus can9 in --only-node; buses present: can0\n\
                cobscope: @d.csv: no frames selected\n";
    assert_eq!(none.stderr, stated);
    assert!(!folder.path("d.csv").exists(), "a file without frames would be taken for a capture");
    let profile = folder.convert(&["--only-node", "5=danfoss-pve-ci", "@a.log", "@e.csv"]);
    assert_eq!(profile.code, 2);
    assert!(profile.stderr.contains("use --node to assign its profile"), "{}", profile.stderr);
}

#[test]
fn a_node_of_j1939_is_an_address() {
    let folder = Folder::new();
    // From 80; to 80; to all; from another address.
    folder.write(
        "a.log",
        log(&[
            "18FECA80#00FF00000000FFFF",
            "18EA80F1#CAFE00",
            "18EAFFF1#CAFE00",
            "18FECA81#00FF00000000FFFF",
            "18EA81F1#CAFE00",
        ]),
    );
    let out = folder.converted(&["--only-node", "sa:0x80", "@a.log", "@b.csv"]);
    // A J1939 broadcast belongs to its sender.
    assert_eq!(out.ids(), ["18FECA80", "18EA80F1"]);
}

#[test]
fn lss_belongs_to_the_node_it_is_about() {
    // fixtures/README.md: LSS frames of the master have no destination.
    let capture = "canopen/lss.log";
    let found = chosen(capture, &["--only-node", "5"]);
    let lss = on(capture, &["7E5", "7E4"]);
    assert!(lss.iter().all(|number| found.contains(number)), "{found:?}");
}

#[test]
fn several_captures_are_one_in_order_of_time() {
    let folder = Folder::new();
    let line = |time: &str, frame: &str| format!("(1700000000.{time}) {frame}\n");
    folder.write("front.log", line("100000", "can0 101#01") + &line("300000", "can0 103#03"));
    folder.write("rear.log", line("200000", "can0 102#02") + &line("400000", "can1 104#04"));
    let out = folder.converted(&["@front.log", "@rear.log", "@all.log"]);
    assert_eq!(out.named(), ["can0 101", "can0@2 102", "can0 103", "can1 104"]);
    // Parts of one capture share their buses, in any order of their names.
    folder.write("run-0002.log", line("200000", "can0 102#02"));
    folder.write("run-0001.log", line("100000", "can0 101#01"));
    let out = folder.converted(&["@run-0002.log", "@run-0001.log", "@run.pcapng"]);
    assert_eq!(out.named(), ["can0 101", "can0 102"]);
    let numbered = folder.convert(&["@front.log", "@rear.log", "@all.trc"]);
    let expected = "PEAK TRC stores bus numbers: can0 is 1, can0@2 is 2, can1 is 3\n";
    assert!(numbered.stderr.ends_with(expected), "{}", numbered.stderr);
}

#[test]
fn numbers_of_buses_are_those_of_the_file() {
    let folder = Folder::new();
    folder.write("a.log", "(1.0) can0 101#01\n(2.0) can1 705#05\n(3.0) can2 706#05\n");
    let texts = |words: &[&str]| folder.convert(words).stderr;
    let some = texts(&["--only-node", "can1:5", "--only-node", "can2:6", "@a.log", "@some.trc"]);
    assert!(some.ends_with("PEAK TRC stores bus numbers: can1 is 1, can2 is 2\n"), "{some}");
    let parts = texts(&["--split-at", "node == 6", "@a.log", "@part.asc"]);
    let expected =
        "Vector ASC stores bus numbers, assigned per file; comments in the files contain the names";
    assert!(parts.contains(expected), "{parts}");
}

#[test]
fn common_notes_of_several_captures_are_printed_once() {
    let folder = Folder::new();
    let lines = |first: u32| {
        (0..6)
            .map(|step| format!("({}.000000) can0 705#05\n", 1_700_000_000 + first + step))
            .collect::<Vec<_>>()
            .concat()
    };
    for (name, first) in [("a", 0), ("b", 10), ("c", 20)] {
        folder.write(&format!("{name}.log"), lines(first));
        folder.converted(&[&format!("@{name}.log"), &format!("@{name}.asc")]);
    }
    let texts = |words: &[&str]| folder.convert(words).stderr;
    let assumed = format!("{UNKNOWN_ZONE}\n");
    assert_eq!(texts(&["@a.asc", "@one.pcapng"]), format!("cobscope: @a.asc: {assumed}"));
    assert_eq!(
        texts(&["--separate", "@a.asc", "@b.asc", "@c.asc", "@all.pcapng"]),
        format!("cobscope: all 3 captures: {assumed}")
    );
    // 5 s from the last frame of a part to the first of the next one: a series.
    let joined = texts(&["@a.asc", "@b.asc", "@c.asc", "@joined.pcapng"]);
    assert!(joined.contains("3 parts of one capture"), "{joined}");
    assert!(joined.ends_with(&format!("cobscope: @a.asc..c.asc: {assumed}")), "{joined}");
    assert_eq!(
        texts(&["--separate", "@a.log", "@b.asc", "@c.asc", "@some.pcapng"]),
        format!("cobscope: 2 of 3 captures, first @b.asc: {assumed}")
    );
    // An unreadable line belongs to its capture.
    folder.write("b.log", lines(10) + "rubbish\n");
    let found = texts(&["--separate", "@a.log", "@b.log", "@broken.log"]);
    assert!(found.starts_with("cobscope: @b.log: line 7: ") && found.lines().count() == 1, "{found}");
    let found = texts(&["--only-node", "can7:5", "@a.log", "@c.log", "@none.log"]);
    assert!(found.contains("cobscope: all 2 captures: "), "{found}");
}

#[test]
fn captures_without_a_common_clock_are_aligned_where_asked_for() {
    let folder = Folder::new();
    folder.write("dated.log", "(1700000000.000000) can0 101#01\n(1700000002.000000) can0 103#03\n");
    folder.write("zero.log", "(5.000000) can0 102#02\n(6.000000) can0 104#04\n");
    let refused = folder.convert(&["@dated.log", "@zero.log", "@all.log"]);
    assert_eq!(refused.code, 3);
    assert!(refused.stderr.contains("--align"), "{}", refused.stderr);
    let out = folder.converted(&["--align", "@dated.log", "@zero.log", "@all.log"]);
    assert_eq!(out.ids(), ["101", "102", "104", "103"]);
    let times: Vec<_> = out.frames.iter().map(|frame| frame.time.unwrap().0 / 1_000_000_000).collect();
    assert_eq!(times, [1_700_000_000, 1_700_000_000, 1_700_000_001, 1_700_000_002]);
}
