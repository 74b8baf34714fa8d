//! Converts every fixture to every format.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;

use cobscope_decoder::capture::{
    FORMATS, FormatCapabilities, LossCounter, Notice, WRITABLE, WritableFormat, WriteOptions,
};
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::sink::escape;

use super::{Content, Folder, fixture, log};
use crate::support::{step, workspace};

/// Folders of captures.
const FOLDERS: &[&str] =
    &["canopen", "devices", "dialects", "incidents", "j1939", "machine", "malformed", "recorders", "uds"];

/// Captures of these folders, and the synthetic captures of text formats. Inputs of a fuzzer have no suffix.
fn files() -> impl Iterator<Item = PathBuf> {
    let list = |folder: PathBuf| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let texts = FORMATS.iter().filter(|format| format.is_text);
    let made_up = texts.flat_map(move |format| list(fixture("fuzz").join(format.name)));
    let made_up = made_up.filter(|path| path.extension().is_some());
    FOLDERS.iter().flat_map(move |folder| list(fixture(folder))).chain(made_up)
}

/// Captures with their content.
fn captures() -> Vec<(PathBuf, Content)> {
    let mut captures = Vec::new();
    for path in files() {
        let suffix = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        // Only captures: scripts, bus files and expected events are skipped.
        if matches!(suffix.as_str(), "py" | "toml" | "sh") || path.to_string_lossy().contains(".expected.") {
            continue;
        }
        if let Some(content) = Content::of(&path) {
            captures.push((path, content));
        }
    }
    captures.sort_by(|(one, _), (other, _)| one.cmp(other));
    captures
}

/// Frames as read back, by the capabilities of a format; buses in order of their first frame.
fn kept(holds: &FormatCapabilities, content: &Content) -> (Vec<Frame>, Vec<String>) {
    let (mut first, mut last) = (None, Timestamp(0));
    let (mut frames, mut order): (Vec<Frame>, Vec<u8>) = (Vec::new(), Vec::new());
    for frame in &content.frames {
        let Some(mut kept) = holds.kept_frame(frame) else { continue };
        if let Some(time) = kept.time {
            let first = *first.get_or_insert(time);
            last = if holds.backwards { time } else { time.max(first) };
        }
        if !(kept.time.is_none() && holds.untimed) {
            kept.time = Some(last);
        }
        if !order.contains(&kept.bus.0) {
            order.push(kept.bus.0);
        }
        frames.push(Frame { number: 1 + frames.len() as u64, ..kept });
    }
    let named = order.iter().map(|bus| content.buses[usize::from(*bus)].clone()).collect();
    (frames, named)
}

/// Expected messages of a conversion, line by line.
fn texts(path: &Path, format: &WritableFormat, content: &Content) -> Vec<String> {
    let name = path.strip_prefix(workspace()).unwrap().display();
    let mut losses = LossCounter::new(format.holds);
    let mut writer = (format.writer)(Box::new(std::io::sink()), &WriteOptions::default());
    let (mut lines, mut unreadable) = (Vec::new(), 0);
    for notice in &content.notices {
        match notice {
            Notice::Unreadable { .. } => {
                unreadable += 1;
                if unreadable <= 10 {
                    lines.push(format!("{name}: {notice}"));
                }
            }
            Notice::CutOff { .. } => lines.push(format!("{name}: {notice}")),
            Notice::Assumption(text) => lines.push(format!("{name}: {text}")),
            other if !writer.notice(other, "").unwrap() => losses.miss_notice(),
            _ => {}
        }
    }
    lines.extend(content.error.iter().map(|error| format!("{name}: {error}")));
    if unreadable > 10 {
        lines.push(format!("{name}: {unreadable} lines or records unreadable"));
    }
    if content.frames.is_empty() {
        lines.push(format!("{name}: contains no frames"));
    }
    content.frames.iter().for_each(|frame| losses.count_frame(frame));
    let lost = losses.loss_texts();
    if !lost.is_empty() {
        lines.push(format!("{} cannot store all data: {}", format.title, lost.join("; ")));
    }
    lines
}

fn check(path: &Path, content: &Content, format: &WritableFormat, folder: &Folder) {
    let name = format!("{} to {}", path.display(), format.name);
    let out = folder.path(&format!("{}.{}", path.to_string_lossy().replace('/', "_"), format.suffix));
    let output = Command::new(env!("CARGO_BIN_EXE_cobscope"))
        .args(["convert".as_ref(), path.strip_prefix(workspace()).unwrap().as_os_str(), out.as_os_str()])
        .current_dir(workspace())
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    let is_cut = content.notices.iter().any(|notice| matches!(notice, Notice::CutOff { .. }));
    // CAN XL frames cannot be kept.
    let is_xl = |notice: &Notice| notice.to_string().contains("CAN XL frame");
    let is_cut = is_cut || content.notices.iter().any(is_xl);
    let is_whole = content.error.is_none() && !is_cut && !content.frames.is_empty();
    assert_eq!(output.status.code(), Some(if is_whole { 0 } else { 3 }), "{name}: {stderr}");
    let mut found: Vec<_> = stderr.lines().map(|line| line.trim_start_matches("cobscope: ")).collect();
    // A separate test covers the numbers of bus names.
    found.retain(|line| !line.contains(" stores bus numbers: "));
    assert_eq!(found, texts(path, format, content), "{name}");
    let (frames, names) = kept(&format.holds, content);
    if frames.is_empty() {
        return;
    }
    let read = Content::read(&out);
    assert_eq!(read.format, format.name, "{name}");
    assert!(!read.notices.iter().any(|notice| matches!(notice, Notice::Unreadable { .. })), "{name}");
    assert_eq!(read.frames.len(), frames.len(), "{name}");
    let bus_of = |frame: &Frame| read.buses[usize::from(frame.bus.0)].clone();
    let names = match format.name {
        // Names in lines of text contain neither blanks nor control characters.
        "candump" => names.iter().map(|name| plain(name)).collect(),
        // Comments with names contain no control characters.
        "asc" | "trc" => names.iter().map(|name| escape(name).into_owned()).collect(),
        // Names in CSV must not be formulas in a spreadsheet.
        "csv" => names.iter().map(|name| safe(name)).collect(),
        _ => names,
    };
    let mut order: Vec<String> = Vec::new();
    // Text with decreasing times that start at zero is read as differences, as printed by candump.
    let has_date = |frame: &Frame| frame.time.is_none_or(|time| time.0 >= 100_000_000_000_000_000);
    let is_reported = format.name != "candump"
        || frames.first().is_some_and(has_date)
        || frames.is_sorted_by_key(|frame| frame.time);
    for (read, kept) in read.frames.iter().zip(&frames) {
        let time = if is_reported { kept.time } else { read.time };
        assert_eq!(Frame { bus: read.bus, time, ..*kept }, *read, "{name}");
        if !order.contains(&bus_of(read)) {
            order.push(bus_of(read));
        }
    }
    assert_eq!(order, names, "{name}");
}

fn plain(name: &str) -> String {
    name.bytes().map(|byte| if byte.is_ascii_graphic() { char::from(byte) } else { '_' }).collect()
}

fn safe(name: &str) -> String {
    let is_terminal_control = |character: char| character.is_control() || character == '\u{202e}';
    let escaped: String = name
        .chars()
        .map(|letter| {
            if is_terminal_control(letter) { letter.escape_unicode().to_string() } else { letter.to_string() }
        })
        .collect();
    if name.starts_with('=') { format!("'{escaped}") } else { escaped }
}

#[test]
fn every_capture_is_read_back_from_every_format_and_its_losses_are_printed_once() {
    let captures = captures();
    assert!(captures.len() > 150, "{}", captures.len());
    let folder = Folder::new();
    thread::scope(|scope| {
        for part in 0..2 {
            let (captures, folder) = (&captures, &folder);
            scope.spawn(move || {
                for (path, content) in captures.iter().skip(part).step_by(2).step_by(step(3)) {
                    for format in WRITABLE {
                        check(path, content, format, folder);
                    }
                }
            });
        }
    });
}

/// Whether this build supports the format of a file name.
fn can_write(out: &str) -> bool {
    WRITABLE.iter().any(|format| out.ends_with(&format!(".{}", format.suffix)))
}

#[test]
fn losses_are_counted_by_hand() {
    let folder = Folder::new();
    // FD; an error frame with details; nanoseconds; a classic DLC of 9; no direction in any frame.
    folder.write(
        "a.log",
        "(1700000000.000000001) can0 705#05\n(1700000000.000001000) can0 123##311\n\
         (1700000000.000002000) can1 20000088#0000800000000000\n\
         (1700000000.000003000) can0 185#1122334455667788_9\n",
    );
    let texts = |out: &str| {
        let output = folder.convert(&["@a.log", out]);
        assert_eq!(output.code, 0, "{}", output.stderr);
        output.stderr
    };
    assert_eq!(texts("@a.pcapng"), "");
    if can_write("@a.mcap") {
        assert_eq!(texts("@a.mcap"), "");
    }
    assert_eq!(texts("@a.csv"), "");
    assert_eq!(texts("@b.log"), "");
    let asc = texts("@a.asc");
    assert!(asc.contains("3 frames of unknown direction, written as received"), "{asc}");
    assert!(asc.ends_with("cobscope: Vector ASC stores bus numbers: can0 is 1, can1 is 2\n"), "{asc}");
    let trc = texts("@a.trc");
    assert!(trc.starts_with("cobscope: PEAK TRC cannot store all data: "), "{trc}");
    assert!(trc.contains("timestamps truncated to "), "{trc}");
    assert_eq!(trc.lines().count(), 2, "{trc}");
}

#[test]
fn negative_times_are_reported_by_formats_without_them() {
    let folder = Folder::new();
    folder.write(
        "a.csv",
        "time,bus,id,extended,remote,error,fd,brs,esi,direction,dlc,length,data,comment\n\
         -5.000000000,can0,705,0,0,0,0,0,0,,1,1,05,\n",
    );
    let lost = "cannot store all data: 1 negative timestamps, written as 0";
    let outs = [("@a.log", "candump text"), ("@a.pcapng", "pcapng"), ("@a.mcap", "MCAP")];
    for (out, title) in outs.into_iter().filter(|(out, _)| can_write(out)) {
        assert_eq!(folder.convert(&["@a.csv", out]).stderr, format!("cobscope: {title} {lost}\n"));
    }
    assert_eq!(folder.convert(&["@a.csv", "@b.csv"]).stderr, "");
}

#[test]
fn links_lost_frames_and_quiet_times_go_where_there_is_a_place() {
    let folder = Folder::new();
    let source = fixture("dialects/dropped_ta_d.txt");
    let source = source.to_str().unwrap();
    let before = Content::read(source.as_ref());
    let lost = |content: &Content| {
        content.notices.iter().filter(|notice| matches!(notice, Notice::LostFrames { .. })).count()
    };
    assert_eq!(lost(&before), 1);
    let outs = [("@a.pcapng", true), ("@a.mcap", true), ("@a.csv", false), ("@a.log", false)];
    for (out, kept) in outs.into_iter().filter(|(out, _)| can_write(out)) {
        let output = folder.convert(&[source, out]);
        assert_eq!(output.code, 0);
        assert_eq!(lost(&Content::read(&folder.path(&out[1..]))), usize::from(kept), "{out}");
        let is_stated =
            output.stderr.contains("1 notices dropped (lost frames, link changes, quiet periods)");
        assert_eq!(is_stated, !kept, "{out}: {}", output.stderr);
    }
}

#[cfg(feature = "mcap")]
#[test]
fn packing_changes_the_size_only() {
    let folder = Folder::new();
    let source = fixture("canopen/mid_run.log");
    let source = source.to_str().unwrap();
    let mut sizes = Vec::new();
    let expected = Content::read(source.as_ref());
    for packing in ["none", "lz4", "zstd"] {
        let out = format!("@{packing}.mcap");
        assert_eq!(
            folder.converted(&["--packing", packing, source, &out]),
            Content { format: "mcap", ..Content::read(source.as_ref()) }
        );
        sizes.push(fs::metadata(folder.path(&out[1..])).unwrap().len());
    }
    assert!(sizes[0] > sizes[1] && sizes[1] > sizes[2], "{sizes:?}");
    assert_eq!(expected.frames.len(), 198);
    assert_eq!(folder.convert(&["--packing", "brotli", source, "@x.mcap"]).code, 2);
}

#[test]
fn packed_captures_and_standard_input_and_output() {
    let folder = Folder::new();
    let text = log(&["705#00", "185#1122"]);
    let plain = folder.write("a.log", &text);
    let whole = Content::read(&plain);
    let tool = |program: &str, name: &str| {
        let packed = Command::new(program).args(["-c".as_ref(), plain.as_os_str()]).output();
        packed.ok().filter(|packed| packed.status.success()).map(|packed| folder.write(name, packed.stdout))
    };
    if cfg!(feature = "gzip") && tool("gzip", "a.log.gz").is_some() {
        assert_eq!(folder.converted(&["@a.log.gz", "@gz.log"]), whole);
    }
    if cfg!(feature = "zstd") && tool("zstd", "a.log.zst").is_some() {
        assert_eq!(folder.converted(&["@a.log.zst", "@zst.log"]), whole);
    }
    let out = folder.path("in.log");
    let output = crate::cli::run(&["convert", "-", out.to_str().unwrap()], &text);
    assert_eq!((output.code, output.stderr.as_str()), (0, ""));
    assert_eq!(Content::read(&out), whole);
    let output = crate::cli::run(&["convert", "-f", "candump", "-", "-"], &text);
    assert_eq!((output.code, output.stdout), (0, text));
    let binary = Command::new(env!("CARGO_BIN_EXE_cobscope"))
        .args(["convert".as_ref(), "-f".as_ref(), "pcapng".as_ref(), plain.as_os_str(), "-".as_ref()])
        .output()
        .unwrap();
    let out = folder.write("out.pcapng", binary.stdout);
    assert_eq!(Content::read(&out).frames, whole.frames);
}
