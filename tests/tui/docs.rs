//! Generated documents: writes them or checks that they are current.

use std::env;
use std::fmt::Write as _;
use std::fs;

use cobscope_decoder::capture::{Batch, CaptureReader, FORMATS, Notice, ReadOptions, WRITABLE};
use cobscope_decoder::profile::Catalogue;

use crate::cli::run;
use crate::support::workspace;

/// Whether tests write the expected files instead of comparing with them: `COBSCOPE_BLESS=1`.
pub fn is_blessing() -> bool {
    env::var_os("COBSCOPE_BLESS").is_some()
}

/// Compares with a file of the workspace, or writes it with `COBSCOPE_BLESS=1`.
pub fn is_current(file: &str, text: &str) {
    let path = workspace().join(file);
    if is_blessing() {
        fs::write(&path, text).unwrap();
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    let differs = found.lines().zip(text.lines()).position(|(found, now)| found != now);
    let line = differs.unwrap_or_else(|| found.lines().count().min(text.lines().count())) + 1;
    assert!(found == text, "{file}:{line} is stale: COBSCOPE_BLESS=1 cargo test --workspace");
}

/// Names of the subcommands in the help of `command`.
fn subcommands(command: &[&str]) -> Vec<String> {
    let help = run(&[command, &["--help"]].concat(), "").stdout;
    let Some(list) = help.split("Commands:\n").nth(1) else { return Vec::new() };
    let list = list.split("\n\n").next().unwrap();
    let names = list.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    names
        .map(|line| line.split_whitespace().next().unwrap().to_owned())
        .filter(|name| name != "help")
        .collect()
}

#[test]
fn the_command_line_reference() {
    if !cfg!(all(feature = "mcap", feature = "parquet")) {
        return crate::support::skip("formats", "this build leaves out some");
    }
    let mut text = String::from("# Command line\n\nGenerated from the program's own help.\n");
    writeln!(text, "\n## cobscope\n\n```\n{}```", run(&["--help"], "").stdout).unwrap();
    let names = subcommands(&[]);
    assert!(names.contains(&"decode".to_owned()), "{names:?}");
    for name in names {
        writeln!(text, "\n## cobscope {name}\n\n```\n{}```", run(&[&name, "--help"], "").stdout).unwrap();
        for further in subcommands(&[&name]) {
            let help = run(&[&name, &further, "--help"], "").stdout;
            writeln!(text, "\n### cobscope {name} {further}\n\n```\n{help}```").unwrap();
        }
    }
    is_current("docs/cli.md", &text);
}

#[test]
fn the_formats_of_captures() {
    if WRITABLE.len() < 6 {
        return crate::support::skip("mcap", "this build leaves out MCAP");
    }
    let mut text = String::from(
        "# Formats of captures\n\nGenerated from the program's own tables. A capture is recognised by its content, \
         whatever its name; plain, gzip or zstd, text also in UTF-16. `cobscope convert IN OUT` writes the format of OUT's suffix, or `-f NAME`. \
         Data that a format cannot store is reported when it is lost. [columns.md](columns.md) describes the columns of CSV \
         and Parquet.\n\n\
         | name | format | suffix when written | cannot store |\n| --- | --- | --- | --- |\n",
    );
    for format in FORMATS {
        let written = WRITABLE.iter().find(|writable| writable.name == format.name);
        let suffix = written.map_or(String::new(), |written| format!("`.{}`", written.suffix));
        let lacks = written.map_or(String::new(), |written| written.holds.missing_data().join("; "));
        writeln!(text, "| {} | {} | {suffix} | {lacks} |", format.name, format.title).unwrap();
    }
    text.push_str(&format_examples());
    text.push_str(&program_texts());
    text.push_str(&inferred_layouts());
    is_current("docs/formats.md", &text);
}

/// The first lines of a capture in each format of text.
fn format_examples() -> String {
    let mut text = String::from(
        "\n## Examples\n\nThe first lines of a capture in each text format; a test reads them. Lines that are not frames are \
         skipped and counted. Bytes above 7F are escaped.\n",
    );
    for format in FORMATS.iter().filter(|format| format.is_text) {
        let bytes = sample_of(format.name);
        assert_reads(format.name, &bytes);
        let lines = bytes.split(|byte| matches!(byte, b'\n' | b'\r')).map(shown_line);
        let lines: Vec<_> = lines.filter(|line| !line.is_empty()).take(EXAMPLE_LINES).collect();
        writeln!(text, "\n{}:\n\n```\n{}\n```", format.name, lines.join("\n")).unwrap();
    }
    text
}

/// Maximum number of lines of an example.
const EXAMPLE_LINES: usize = 12;

/// The sample of a format; that of our own CSV for CSV.
fn sample_of(format: &str) -> Vec<u8> {
    let folder = workspace().join("fixtures/fuzz").join(format);
    let stem = if format == "csv" { "cobscope" } else { "sample" };
    let mut paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let path = paths.find(|path| path.file_stem().is_some_and(|found| found == stem));
    fs::read(path.unwrap()).unwrap()
}

fn assert_reads(format: &str, bytes: &[u8]) {
    let mut reader = CaptureReader::open(bytes, &ReadOptions::default()).unwrap();
    assert_eq!(reader.format().name, format);
    let (mut batch, mut frames) = (Batch::new(), 0);
    while reader.read(&mut batch).unwrap() {
        frames += batch.frames().len();
        for (_, notice) in batch.notices() {
            assert!(!matches!(notice, Notice::Unreadable { .. }), "{format}: {notice}");
        }
    }
    assert!(frames > 0, "{format}");
}

/// Frames that each file of `fixtures/programs/` contains in this order, possibly with others.
const PROGRAM_FRAMES: [&str; 3] = ["701#05", "181#3702", "18FEF100#FFFFFF7DA00FFFFF"];

/// Texts that programs, adapters and consoles print, with the format that reads them.
fn program_texts() -> String {
    let mut text = String::from(
        "\n## Texts of programs and adapters\n\nThe files of `fixtures/programs/` contain the frames 701#05, 181#3702 and \
         18FEF100#FFFFFF7DA00FFFFF as these programs print them; a test reads them. The name after the colon is that of \
         the format.\n\n```text\n",
    );
    let folder = fs::read_dir(workspace().join("fixtures/programs")).unwrap();
    let mut files: Vec<_> = folder.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    for path in files {
        let bytes = fs::read(&path).unwrap();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let mut reader = CaptureReader::open(&bytes[..], &ReadOptions::default()).unwrap();
        let format = reader.format().name;
        let (mut batch, mut found) = (Batch::new(), Vec::new());
        while reader.read(&mut batch).unwrap() {
            let bad = batch.notices().iter().find(|(_, notice)| matches!(notice, Notice::Unreadable { .. }));
            assert!(bad.is_none(), "{name}: {bad:?}");
            found.extend(batch.frames().iter().map(|frame| {
                let data = frame.data().iter().fold(String::new(), |text, byte| format!("{text}{byte:02X}"));
                format!("{}#{data}", frame.id)
            }));
        }
        let mut rest = found.iter();
        let has_all = PROGRAM_FRAMES.iter().all(|frame| rest.any(|other| other == frame));
        assert!(has_all, "{name}: {found:?}");
        writeln!(text, "{name}: {format}").unwrap();
        for line in bytes.split(|byte| *byte == b'\n').map(shown_line).filter(|line| !line.is_empty()).take(8)
        {
            writeln!(text, "    {line}").unwrap();
        }
    }
    text.push_str("```\n");
    text
}

/// A line as text; a byte that is not ASCII is escaped.
fn shown_line(line: &[u8]) -> String {
    let shown = |byte: &u8| match byte {
        b'\t' => "\t".to_owned(),
        b' '..=b'~' => char::from(*byte).to_string(),
        byte => format!("\\x{byte:02X}"),
    };
    line.iter().map(shown).collect::<String>().trim_end().to_owned()
}

/// The section about text without a known format: one example per layout, with its columns as the program reads them.
fn inferred_layouts() -> String {
    let mut text = String::from(
        "\n## Text without a known format\n\nIf no format matches, the columns are inferred from the first lines: \
         bytes whose number equals a length, identifiers, rising times, words for directions and frame types, names of \
         columns in English, German, French, Spanish and Chinese. One line on standard error states the columns, the \
         number of lines that fit, and the ignored columns. At least 90 % of the lines with bytes must fit, and no second \
         reading may fit as well; otherwise the capture is refused with the nearest layout and the first line that does \
         not fit.\n\n`--columns` states the columns, in the order of a line: `time`, `delta` (time since the frame \
         before), `date`, `id`, `len`, `data`, `bus`, `dir`, `kind`, `ext`, `rtr`, `skip`. Units follow a colon \
         (`time:ms`, default seconds), so does the base (`id:dec`, `data:dec`).\n\n\
         ```sh\ncobscope decode --columns 'time:ms id len data' log.txt\n\
         cobscope decode --columns 'skip id:dec data:dec' log.csv\n\
         cobscope check --columns 'delta:us bus id data' -\n```\n\n\
         An identifier has one to eight digits. It is extended if a word or bit 31 marks it, if its value exceeds 7FF, or if \
         it has more than four digits and others have fewer. Whole numbers without a unit are milliseconds if two frames \
         would be closer in microseconds than a bus permits; otherwise the times are ignored. Lines without a frame are \
         counted; `...` is a known gap.\n\n\
         The files of `fixtures/layouts/` have the same frames in these layouts:\n\n```text\n",
    );
    let mut files: Vec<_> = fs::read_dir(workspace().join("fixtures/layouts"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    for path in files {
        let content = fs::read_to_string(&path).unwrap();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        writeln!(text, "{name}: {}", inferred_columns(&content)).unwrap();
        // Each file has eight frames, after the names of the columns.
        let lines: Vec<&str> = content.lines().filter(|line| !line.is_empty()).collect();
        for line in lines.iter().take(lines.len() % 8 + lines.len() / 8) {
            writeln!(text, "    {line}").unwrap();
        }
    }
    text.push_str("```\n");
    text
}

/// Columns of a capture as the reader states them.
fn inferred_columns(content: &str) -> String {
    let mut reader = CaptureReader::open(content.as_bytes(), &ReadOptions::default()).unwrap();
    let mut batch = Batch::new();
    assert!(reader.read(&mut batch).unwrap());
    let stated = match batch.notices().first() {
        Some((_, Notice::Assumption(stated))) => stated.clone(),
        _ => String::new(),
    };
    assert!(!stated.is_empty(), "no columns: {content}");
    let columns = stated.split_once("columns: ").map_or(stated.as_str(), |(_, columns)| columns);
    columns.split(';').next().unwrap().to_owned()
}

/// Sections of a variant that differ from the first variant of its device, and titles of the equal ones.
fn differences(text: &str, first: &str) -> String {
    let known: Vec<&str> = first.split("\n### ").map(str::trim_end).collect();
    let parts = text.split("\n### ").map(str::trim_end);
    let (alike, own): (Vec<&str>, Vec<&str>) = parts.partition(|part| known.contains(part));
    let titles: Vec<&str> = alike.iter().filter_map(|part| part.lines().next()).collect();
    let name = first.lines().next().unwrap_or_default().trim_start_matches("## ");
    let alike =
        if titles.is_empty() { String::new() } else { format!("\n\nAs {name}: {}.", titles.join("; ")) };
    format!("{}{alike}", own.join("\n\n### "))
}

#[test]
fn the_profile_reference() {
    let mut text = String::from(
        "# Profiles\n\nGenerated by `cobscope profiles show --format markdown`. The objects of a device are printed by \
         `cobscope profiles show`, one of them by `cobscope explain OBJECT --device`. \
         [profile-counts.md](profile-counts.md) compares the counts with the manuals.\n",
    );
    let catalogue = Catalogue::default();
    for id in catalogue.ids() {
        let device = catalogue.device(&id).unwrap();
        let first = run(&["profiles", "show", "-f", "markdown", &id], "").stdout;
        writeln!(text, "\n{}", first.trim_end()).unwrap();
        for variant in device.variants.iter().skip(1) {
            let name = format!("{id}:{}", variant.id);
            let other = run(&["profiles", "show", "-f", "markdown", &name], "").stdout;
            writeln!(text, "\n{}", differences(&other, &first)).unwrap();
        }
    }
    is_current("docs/profiles.md", &text);
}

/// Number of a profile's entries that `profiles show --count` prints.
fn printed_count(profile: &str, entries: &str) -> String {
    let output = run(&["profiles", "show", "--count", profile], "").stdout;
    let line = output.lines().find_map(|line| line.trim_start().strip_prefix(entries));
    assert!(line.is_some(), "{profile}: no {entries} in {output}");
    line.unwrap().trim().to_owned()
}

/// Keeps the counts of the manuals; updates those of the profiles and adds rows for new profiles.
#[test]
fn the_counts_of_profiles_are_those_printed() {
    const FILE: &str = "docs/profile-counts.md";
    let document = fs::read_to_string(workspace().join(FILE)).unwrap();
    let (head, table) = document.split_once("| --- | --- | --- | --- | --- |\n").unwrap();
    let (table, tail) = table.split_once("\n\n").unwrap();
    let mut counted: Vec<[&str; 3]> = Vec::new();
    for row in table.lines() {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let [profile, objects, _, errors, _] = cells[..] else { panic!("{row}") };
        counted.push([profile, objects, errors]);
    }
    // A generic profile has no manual to count.
    let catalogue = Catalogue::default();
    let ids: Vec<String> = catalogue.ids().into_iter().filter(|id| !catalogue.is_generic(id)).collect();
    let device = |profile: &str| profile.split(':').next().unwrap_or_default().to_owned();
    counted.retain(|[profile, ..]| ids.contains(&device(profile)));
    let missing = ids.iter().filter(|id| !counted.iter().any(|[profile, ..]| device(profile) == **id));
    let missing: Vec<[&str; 3]> = missing.map(|id| [id.as_str(), "?", "?"]).collect();
    let mut text = format!("{head}| --- | --- | --- | --- | --- |\n");
    for [profile, objects, errors] in counted.into_iter().chain(missing) {
        let [objects_here, errors_here] =
            ["object entries", "EMCY codes"].map(|entries| printed_count(profile, entries));
        writeln!(text, "| {profile} | {objects} | {objects_here} | {errors} | {errors_here} |").unwrap();
    }
    is_current(FILE, &format!("{text}\n{tail}"));
    assert!(!text.contains("| ? |"), "{FILE}: count the manual of the profiles with ?");
}

#[test]
fn the_columns_of_tables() {
    let document = fs::read_to_string(workspace().join("docs/columns.md")).unwrap();
    let out = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("columns.csv");
    let capture = "fixtures/machine/machine.log";
    let values = run(&["decode", "-f", "csv", capture], "").stdout;
    run(&["convert", "--force", capture, out.to_str().unwrap()], "");
    for table in [values, fs::read_to_string(out).unwrap()] {
        let header = table.lines().next().unwrap().trim_end();
        assert!(document.contains(&format!("```text\n{header}\n```")), "{header}");
    }
    let wide = run(&["decode", "-f", "csv-wide", capture], "").stdout;
    assert!(wide.starts_with("time,bus,frame"), "{wide}");
}

#[test]
fn the_rules() {
    let text = run(&["rules", "-f", "markdown"], "").stdout;
    for line in text.lines().filter_map(|line| line.split_once("](../")) {
        let path = line.1.split(')').next().unwrap();
        assert!(workspace().join(path).exists(), "{path}");
    }
    is_current("docs/rules.md", &text);
}
