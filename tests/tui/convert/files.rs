//! Output files: parts, rejected commands, unreadable inputs.

use std::fs;

use cobscope_decoder::capture::WRITABLE;
use cobscope_decoder::frame::Frame;

use super::{Content, Folder, fixture, log};
use crate::cli::run;

/// Frames without their numbers.
fn unnumbered(frames: &[Frame]) -> Vec<Frame> {
    frames.iter().map(|frame| Frame { number: 0, ..*frame }).collect()
}

#[test]
fn parts_by_size_are_whole_captures_and_together_the_whole() {
    let source = fixture("canopen/mid_run.log");
    let source = source.to_str().unwrap();
    for format in WRITABLE {
        let folder = Folder::new();
        let whole = format!("@whole.{}", format.suffix);
        let expected = folder.converted(&[source, &whole]).frames;
        let size = fs::metadata(folder.path(&whole[1..])).unwrap().len();
        // For compressed formats, the limit applies to the uncompressed size.
        let most = (size / 3).max(2_500);
        let out = format!("@part.{}", format.suffix);
        let output = folder.convert(&["--packing", "none", "--split-size", &most.to_string(), source, &out]);
        assert_eq!(output.code, 0, "{}", output.stderr);
        let parts: Vec<_> = folder.names().into_iter().filter(|name| name.starts_with("part")).collect();
        let numbered: Vec<_> =
            (1..=parts.len()).map(|number| format!("part-{number:04}.{}", format.suffix)).collect();
        assert_eq!(parts, numbered);
        assert!(parts.len() > 1, "{}: {parts:?}", format.name);
        let stated = format!("cobscope: 198 frames in {} files\n", parts.len());
        assert!(output.stderr.ends_with(&stated), "{}", output.stderr);
        let mut found = Vec::new();
        for part in &parts {
            let size = fs::metadata(folder.path(part)).unwrap().len();
            assert!(size <= most, "{part}: {size} bytes, at most {most}");
            let content = Content::read(&folder.path(part));
            assert_eq!((content.format, content.error), (format.name, None), "{part}");
            found.extend(content.frames);
        }
        assert_eq!(unnumbered(&found), unnumbered(&expected), "{}", format.name);
    }
}

#[test]
fn a_size_without_room_for_a_frame_is_refused() {
    let source = fixture("canopen/mid_run.log");
    let source = source.to_str().unwrap();
    for format in WRITABLE {
        let folder = Folder::new();
        let out = format!("@part.{}", format.suffix);
        let of = |size: u64| {
            folder.convert(&["--packing", "none", "--split-size", &size.to_string(), source, &out])
        };
        let refused = of(5);
        let least = refused.stderr.strip_prefix("cobscope: --split-size: found 5 bytes; expected ");
        let least = least
            .and_then(|rest| rest.split_once(" or more ("))
            .unwrap_or_else(|| panic!("{}", refused.stderr));
        assert_eq!((refused.code, folder.names().len()), (2, 0));
        let least: u64 = least.0.parse().unwrap();
        assert_eq!(of(least - 1).code, 2, "{}", format.name);
        assert_eq!(of(least).code, 0, "{}", format.name);
        for part in folder.names() {
            assert!(fs::metadata(folder.path(&part)).unwrap().len() <= least, "{part}");
        }
    }
}

#[test]
fn parts_by_event_begin_with_it() {
    let source = fixture("canopen/nmt_heartbeat.log");
    let source = source.to_str().unwrap();
    let folder = Folder::new();
    let output = folder.convert(&["--split-at", "kind == boot-up", source, "@part.pcapng"]);
    assert_eq!(output.code, 0);
    let whole = Content::read(source.as_ref());
    let parts = folder.names();
    let is_boot = |frame: &Frame| frame.id.number() & 0x780 == 0x700 && frame.data() == [0];
    let boots = whole.frames.iter().filter(|frame| is_boot(frame)).count();
    assert_eq!((parts.len(), boots), (7, 7));
    let mut found = Vec::new();
    for part in &parts {
        let content = Content::read(&folder.path(part));
        assert!(is_boot(&content.frames[0]), "{part}");
        assert_eq!(content.frames.iter().filter(|frame| is_boot(frame)).count(), 1, "{part}");
        found.extend(content.frames);
    }
    assert_eq!(unnumbered(&found), unnumbered(&whole.frames));
    let out = folder.convert(&["--split-at", "kind == boot-up", "-f", "candump", source, "-"]);
    assert_eq!((out.code, out.stderr.as_str()), (2, "cobscope: stdout cannot be split; give a file\n"));
}

#[test]
fn an_event_of_a_frame_that_is_left_out_splits_before_the_next_one() {
    let folder = Folder::new();
    folder.write("a.log", log(&["705#05", "706#00", "705#05", "705#05", "706#00", "706#05"]));
    let words = ["--split-at", "kind == boot-up && node == 6", "--only-node", "5", "@a.log", "@b.log"];
    let output = folder.convert(&words);
    assert_eq!(output.stderr, "cobscope: 3 frames in 2 files\n");
    assert_eq!(Content::read(&folder.path("b-0001.log")).frames.len(), 1);
    assert_eq!(Content::read(&folder.path("b-0002.log")).frames.len(), 2);
}

#[test]
fn times_before_the_first_of_a_part_are_reported() {
    let folder = Folder::new();
    // The second part starts at 12; 11 is after the first frame of the capture, but before that of its part.
    folder.write(
        "a.csv",
        "time,bus,id,extended,remote,error,fd,brs,esi,direction,dlc,length,data,comment\n\
         10.0,1,701,0,0,0,0,0,0,rx,1,1,05,\n12.0,1,702,0,0,0,0,0,0,rx,1,1,00,\n11.0,1,701,0,0,0,0,0,0,rx,1,1,05,\n",
    );
    let backwards = WRITABLE.iter().find(|format| !format.holds.backwards).unwrap();
    let whole = folder.convert(&["@a.csv", &format!("@b.{}", backwards.suffix)]);
    assert_eq!((whole.code, whole.stderr.as_str()), (0, ""));
    let out = format!("@c.{}", backwards.suffix);
    let parts = folder.convert(&["--split-at", "kind == boot-up", "@a.csv", &out]);
    let stated = format!(
        "cobscope: {} cannot store all data: 1 timestamps before the first frame, written as that of the first frame\n\
         cobscope: 3 frames in 2 files\n",
        backwards.title
    );
    assert_eq!(parts.stderr, stated);
}

#[test]
fn nothing_is_written_over_unasked_and_never_what_is_read() {
    let folder = Folder::new();
    let text = log(&["705#00", "705#05"]);
    folder.write("a.log", &text);
    folder.write("there.log", "mine");
    let refused = folder.convert(&["@a.log", "@there.log"]);
    assert_eq!(
        (refused.code, refused.stderr.as_str()),
        (2, "cobscope: @there.log: file exists; use --force to overwrite it\n")
    );
    assert_eq!(fs::read_to_string(folder.path("there.log")).unwrap(), "mine");
    assert_eq!(folder.convert(&["--force", "@a.log", "@there.log"]).code, 0);
    assert_eq!(fs::read_to_string(folder.path("there.log")).unwrap(), text);

    folder.write("part-0003.log", "mine");
    let refused = folder.convert(&["--split-size", "1k", "@a.log", "@part.log"]);
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("part-0003.log: part of an earlier capture"), "{}", refused.stderr);

    fs::hard_link(folder.path("a.log"), folder.path("twin.log")).unwrap();
    fs::copy(folder.path("a.log"), folder.path("run-0001.log")).unwrap();
    for words in [
        &["--force", "@a.log", "@a.log"][..],
        &["@a.log", "@a.log"],
        &["--force", "@a.log", "@twin.log"],
        &["--force", "@there.log", "@a.log", "@there.log"],
        &["--force", "--split-size", "1k", "@run-0001.log", "@run.log"],
    ] {
        let refused = folder.convert(words);
        assert_eq!(refused.code, 2, "{words:?}: {}", refused.stderr);
        assert!(
            refused.stderr.contains("is also an input; choose another output file"),
            "{words:?}: {}",
            refused.stderr
        );
    }
    for name in ["a.log", "twin.log", "run-0001.log", "there.log"] {
        assert_eq!(fs::read_to_string(folder.path(name)).unwrap(), text, "{name}");
    }
}

#[test]
fn impossible_requests_are_reported() {
    let folder = Folder::new();
    folder.write("a.log", log(&["705#00"]));
    for (words, says) in [
        (&["@a.log", "@b.xyz"][..], "@b.xyz: unknown suffix; expected .log (candump text), "),
        (&["@a.log", "@b"], "or use -f"),
        (&["@a.log", "-"], "or use -f"),
        (&["-o", "@b.log"], "captures or output file missing"),
        (&["@a.log"], "captures or output file missing"),
        (&["-f", "xyz", "@a.log", "@b"], "possible values: candump, pcapng, asc, trc, csv"),
        (
            &["--comments", "@a.log", "@b.log"],
            "candump text cannot store comments; formats that can: pcapng, ",
        ),
        (&["@a.log", "@no/b.log"], "folder @no does not exist; create it first"),
        (&["--filter", "kind =", "@a.log", "@b.log"], "--filter"),
        (&["--split-size", "0", "@a.log", "@b.log"], "expected a size such as 100M or 2G"),
    ] {
        let output = folder.convert(words);
        assert_eq!(output.code, 2, "{words:?}: {}", output.stderr);
        let stderr = output.stderr.replace(&folder.0.path().display().to_string(), "@");
        assert!(stderr.replace("@/", "@").contains(says), "{words:?}: {stderr}");
    }
    assert_eq!(folder.names(), ["a.log"]);
    assert_eq!(folder.convert(&["-f", "pcapng", "@a.log", "-o", "@b.bin"]).code, 0);
    assert_eq!(Content::read(&folder.path("b.bin")).format, "pcapng");
    let missing = folder.convert(&["@no.log", "@c.log"]);
    assert_eq!(missing.code, 3);
    assert!(missing.stderr.contains("@no.log: cannot be opened"), "{}", missing.stderr);
    assert_eq!(folder.convert(&[fixture("README.md").to_str().unwrap(), "@c.log"]).code, 3);
    assert_eq!(folder.names(), ["a.log", "b.bin"], "what could not be read leaves no file");
}

#[test]
fn what_can_be_read_before_damage_is_converted() {
    let folder = Folder::new();
    let cut = folder.convert(&["fixtures/malformed/packet_cut_off.pcap", "@cut.log"]);
    let stated = "cobscope: fixtures/malformed/packet_cut_off.pcap: byte 49: the capture ends inside a packet: found 23 of 25 bytes\n";
    assert_eq!((cut.code, cut.stderr.as_str()), (3, stated));
    assert_eq!(Content::read(&folder.path("cut.log")).frames.len(), 1);
    if cfg!(feature = "gzip") {
        let name = "fixtures/malformed/cut_off.log.gz";
        let broken = folder.convert(&[name, "@broken.log"]);
        let stated = format!("cobscope: {name}: the file is cut off: incomplete gzip member at byte 1571\n");
        assert_eq!((broken.code, broken.stderr.as_str()), (3, stated.as_str()));
        assert_eq!(Content::read(&folder.path("broken.log")).frames.len(), 338);
        // The error does not affect the other capture, and names the broken one.
        folder.write("whole.log", log(&["705#00", "705#05"]));
        let merged = folder.convert(&["--align", "@whole.log", name, "@merged.log"]);
        assert_eq!((merged.code, merged.stderr.as_str()), (3, stated.as_str()));
        assert_eq!(Content::read(&folder.path("merged.log")).frames.len(), 340);
        let name = "fixtures/malformed/not_gzip.log.gz";
        let nothing = folder.convert(&["@whole.log", name, "@nothing.log"]);
        assert_eq!(nothing.code, 3);
        assert!(nothing.stderr.contains("invalid gzip header"), "{}", nothing.stderr);
    }
    let lines = folder.convert(&["fixtures/malformed/candump_errors.log", "@lines.log"]);
    assert_eq!(lines.code, 0);
    assert_eq!(lines.stderr.lines().count(), 11, "{}", lines.stderr);
    assert!(
        lines.stderr.starts_with("cobscope: fixtures/malformed/candump_errors.log: line "),
        "{}",
        lines.stderr
    );
    assert!(
        lines.stderr.ends_with("candump_errors.log: 35 lines or records unreadable\n"),
        "{}",
        lines.stderr
    );
    assert_eq!(Content::read(&folder.path("lines.log")).frames.len(), 41);
    let empty = folder.convert(&["fixtures/malformed/header_only.pcap", "@empty.log"]);
    let stated = "cobscope: fixtures/malformed/header_only.pcap: contains no frames\n";
    assert_eq!((empty.code, empty.stderr.as_str()), (3, stated));
}

/// A comment before the next frame keeps the text of a line that could not be read; the name of the bus, which a line of
/// ASC and TRC lacks, is in a comment too.
#[test]
fn unreadable_lines_and_bus_names_are_kept_where_the_format_has_comments() {
    let folder = Folder::new();
    fs::write(folder.path("run.log"), "not a line\n(1.000000) front 705#05\n(1.100000) front 705#05\n")
        .unwrap();
    for format in WRITABLE {
        let out = format!("@out.{}", format.suffix);
        let output = folder.convert(&["@run.log", &out]);
        assert!(output.stderr.contains("line 1: not a candump line"), "{}", output.stderr);
        let bytes = fs::read(folder.path(&out[1..])).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        let is_kept = text.contains("line 1: not a candump line") && text.contains("not a line");
        assert_eq!(is_kept, format.holds.comments, "{}", format.name);
        assert_eq!(Content::read(&folder.path(&out[1..])).buses, ["front"], "{}", format.name);
    }
}

/// Frames without times get equal ones in formats that need a time; no rule judges them, before or after.
#[test]
fn no_times_stay_no_times() {
    let folder = Folder::new();
    // A heartbeat of 100 ms (1017:00) that is never late in frames without times.
    let written = "can0  605   [8]  2B 17 10 00 64 00 00 00\ncan0  585   [8]  60 17 10 00 00 00 00 00\n";
    fs::write(folder.path("run.log"), written.to_owned() + &"can0  705   [1]  05\n".repeat(30)).unwrap();
    let judged = |name: &str| {
        let path = folder.path(name);
        let output = run(&["check", path.to_str().unwrap(), "--coverage"], "");
        assert_eq!(output.code, 0, "{}", output.stdout);
        assert!(output.stdout.contains("timing rules not exercised"), "{name}: {}", output.stdout);
        let row = output.stdout.lines().find(|line| line.contains("heartbeat-period")).unwrap().to_owned();
        row.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let before = judged("run.log");
    for format in WRITABLE {
        let out = format!("@out.{}", format.suffix);
        assert_eq!(folder.convert(&["@run.log", &out]).code, 0);
        assert_eq!(judged(&out[1..]), before, "{}", format.name);
    }
}
