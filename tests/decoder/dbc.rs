//! DBC files: those of other projects compared with cantools, our own with expected values derived by hand.

#![expect(clippy::disallowed_methods, reason = "the rule is for the decoder, not for what tests it")]
#![expect(clippy::panic, reason = "helpers of tests fail so")]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use cobscope_decoder::event::{EventKind, J1939Message};
use cobscope_decoder::frame::CanId;
use cobscope_decoder::profile::dbc::{self, Database, DatabaseFile, DatabaseMessage};
use cobscope_decoder::profile::{DecodedValue, PayloadLayout, SignalField, SignalId};
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::wire::j1939::Pgn;
use proptest::prelude::*;
use serde_json::Value as Json;

use crate::corpus::decode_with;
use crate::harness;
use crate::pieces::pieces_moved;
use crate::support::{corpus, python, skip, workspace};

fn corpus_files() -> Vec<PathBuf> {
    let folder = corpus().join("dbc");
    let Ok(entries) = fs::read_dir(&folder) else {
        skip("corpus", &format!("{} is not there", folder.display()));
        return Vec::new();
    };
    let mut found: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found
}

fn read(path: &Path) -> DatabaseFile {
    dbc::parse_database(&fs::read(path).unwrap())
        .unwrap_or_else(|problem| panic!("{}:{problem}", path.display()))
}

fn name(path: &Path) -> String {
    path.file_name().unwrap().to_string_lossy().into_owned()
}

/// An identifier as in a DBC.
fn number(id: CanId) -> u64 {
    match id {
        CanId::Standard(id) => u64::from(id),
        CanId::Extended(id) => u64::from(id) | 1 << 31,
    }
}

/// A name as in the corrected file: cantools rejects names that start with a digit.
fn mended(name: &str) -> String {
    if name.starts_with(|first: char| first.is_ascii_digit()) { format!("_{name}") } else { name.to_owned() }
}

/// Known differences by reason, and unexplained ones.
#[derive(Default)]
struct Differences {
    known: BTreeMap<&'static str, usize>,
    unknown: String,
    values: usize,
    labels: usize,
    selections: usize,
}

impl Differences {
    fn known(&mut self, reason: &'static str) {
        *self.known.entry(reason).or_default() += 1;
    }

    fn note(&mut self, place: &str, what: &str) {
        writeln!(self.unknown, "{place}: {what}").unwrap();
    }

    fn file(&mut self, file: &str, ours: &DatabaseFile, theirs: &Json) {
        let messages: BTreeMap<_, _> =
            ours.messages().map(|(id, message)| (number(id.unwrap()), message)).collect();
        let theirs = theirs["messages"].as_array().unwrap();
        assert_eq!(messages.len(), theirs.len(), "{file}");
        for entry in theirs {
            let place = format!("{file} {}", entry["name"]);
            let ours = messages[&entry["id"].as_u64().unwrap()];
            if mended(&ours.name) != entry["name"] || entry["length"] != ours.length.unwrap() {
                self.note(&place, &format!("{} of {:?} bytes", ours.name, ours.length));
            }
            self.message(&place, ours, entry);
        }
    }

    fn message(&mut self, place: &str, ours: &DatabaseMessage, theirs: &Json) {
        let signals = theirs["signals"].as_array().unwrap();
        let fields: Vec<_> = signals.iter().map(|signal| find(ours, signal)).collect();
        for (field, signal) in fields.iter().zip(signals) {
            match field {
                Some(field) => self.signal(&format!("{place} {}", signal["name"]), ours, field, signal),
                None if signal["length"].as_u64().unwrap() > 64 => self.known("ours reads at most 64 bits"),
                None => self.known("ours reads no signal that does not fit into its message"),
            }
        }
        for payload in theirs["payloads"].as_array().unwrap() {
            let data = bytes(payload["data"].as_str().unwrap());
            for ((field, signal), value) in
                fields.iter().zip(signals).zip(payload["values"].as_array().unwrap())
            {
                let Some(field) = field else { continue };
                self.value(&format!("{place} {} {}", signal["name"], payload["data"]), field, &data, value);
            }
            self.selection(place, ours, &fields, signals, &data, payload);
        }
    }

    /// Names of the signals in a payload.
    fn selection(
        &mut self,
        place: &str,
        ours: &DatabaseMessage,
        fields: &[Option<&SignalField>],
        signals: &[Json],
        data: &[u8],
        payload: &Json,
    ) {
        let Some(names) = payload["names"].as_array() else {
            return self.known(if signals.iter().any(|signal| !signal["mux"].is_null()) {
                "theirs refuses a payload whose multiplexor has a value that selects nothing"
            } else {
                "theirs refuses a payload of signals that overlap or do not fit"
            });
        };
        let left_out: BTreeSet<_> = fields
            .iter()
            .zip(signals)
            .filter(|(field, _)| field.is_none())
            .map(|(_, it)| it["name"].as_str())
            .collect();
        let theirs: BTreeSet<_> = names
            .iter()
            .map(|name| name.as_str())
            .filter(|name| !left_out.contains(name))
            .map(|name| name.unwrap().to_owned())
            .collect();
        let ours: BTreeSet<_> =
            ours.layout.decode_signals(data).map(|it| mended(it.field.name().unwrap())).collect();
        self.selections += 1;
        if ours == theirs {
            return;
        }
        let is_unmarked = |name: &String| {
            let by = signals.iter().find(|signal| signal["name"] == **name).map(|signal| &signal["mux"][0]);
            signals.iter().any(|signal| Some(&signal["name"]) == by && signal["selects"] == false)
        };
        if ours.is_superset(&theirs) && ours.difference(&theirs).all(is_unmarked) {
            self.known("theirs shows nothing that a multiplexor without M selects");
        } else {
            self.note(place, &format!("{}: {ours:?} instead of {theirs:?}", payload["data"]));
        }
    }

    /// Compares a signal with the output of cantools.
    fn signal(&mut self, place: &str, message: &DatabaseMessage, ours: &SignalField, theirs: &Json) {
        let meaning = ours.meaning.as_deref().unwrap();
        let spn = match ours.id {
            SignalId::Spn(spn) => Some(spn),
            SignalId::Name | SignalId::Object(_) => None,
        };
        let limits = theirs["limits"].as_array().map(|limits| [real(&limits[0]), real(&limits[1])]);
        let limits = limits.filter(|[least, most]| least < most);
        let choices: BTreeMap<_, _> = meaning.values.iter().flat_map(|names| &names.0).collect();
        let choices: BTreeMap<_, _> =
            choices.into_iter().map(|(key, text)| (key.to_string(), text)).collect();
        let mux = ours.present.as_ref().map(|selector| {
            let by = message.layout.fields[selector.field].name().unwrap();
            let values: Vec<_> = selector.values.iter().cloned().flatten().collect();
            serde_json::json!([by, values])
        });
        for (what, ours, theirs) in [
            ("unit", Json::from(meaning.unit.clone()), theirs["unit"].clone()),
            ("width", ours.bits.into(), theirs["length"].clone()),
            ("SPN", spn.into(), theirs["spn"].clone()),
            ("limits", format!("{:?}", meaning.limits).into(), format!("{limits:?}").into()),
            ("names", serde_json::to_value(choices).unwrap(), theirs["choices"].clone()),
            ("multiplexor", mux.into(), theirs["mux"].clone()),
        ] {
            if ours != theirs {
                self.note(place, &format!("{what} is {ours}, theirs {theirs}"));
            }
        }
    }

    /// Compares the signals of a frame; `theirs` is a line of `tests/oracles/dbc_capture.py`.
    fn frame(&mut self, message: &J1939Message, layout: &PayloadLayout, theirs: &Json) {
        let place = format!("frame {}", theirs["frame"]);
        let mut ours: Vec<_> = layout.decode_signals(message.payload()).map(|signal| signal.field).collect();
        for value in theirs["values"].as_array().unwrap() {
            let value = value.as_array().unwrap();
            let is_it = |field: &&SignalField| {
                value[0] == mended(field.name().unwrap()) && value[1] == field.bit && value[2] == field.bits
            };
            let Some(at) = ours.iter().position(is_it) else {
                self.note(&place, &format!("{} is not there", value[0]));
                continue;
            };
            let field = ours.remove(at);
            let place = format!("{place} {}", value[0]);
            self.value(&place, field, message.payload(), &Json::from(&value[3..]));
        }
        for field in ours {
            self.note(&place, &format!("{:?} is not theirs", field.name()));
        }
    }

    fn value(&mut self, place: &str, field: &SignalField, data: &[u8], theirs: &Json) {
        let Some([raw, scaled, label]) = theirs.as_array().map(Vec::as_slice) else {
            return self.note(place, "no value");
        };
        let meaning = field.meaning.as_deref().unwrap();
        let value = field.convert_raw(field.extract_bits(data).unwrap());
        if !is_same(&value, raw) {
            self.note(place, &format!("raw {value}, theirs {raw}"));
        }
        match (meaning.value_label(&value), label.as_str()) {
            (Some(ours), Some(theirs)) if ours == theirs => return self.labels += 1,
            (Some(ours @ ("not available" | "error")), None) if meaning.indicators.is_some() => {
                if indicator(raw, field.bits) != Some(ours) {
                    self.note(place, &format!("{ours}, raw {raw}"));
                }
                return self.known("ours names the codes above the largest value of a suspect parameter");
            }
            (None, None) => {}
            (ours, _) => return self.note(place, &format!("{ours:?}, theirs {label}")),
        }
        let ours = meaning.scaled_value(&value).map_or(value, DecodedValue::Real);
        self.values += 1;
        if !is_same(&ours, scaled) {
            self.note(place, &format!("{ours}, theirs {scaled}"));
        }
    }
}

/// Indicator of a code by J1939-71 §5.1.4: the upper byte FFh or FEh, in less than eight bits the two largest codes.
fn indicator(raw: &Json, bits: u16) -> Option<&'static str> {
    let raw: u64 = raw.as_str()?.strip_prefix("i:")?.parse().ok()?;
    let (code, largest) = if bits < 8 { (raw, (1 << bits) - 1) } else { (raw >> (bits - 8), 0xFF) };
    [(largest, "not available"), (largest - 1, "error")]
        .into_iter()
        .find(|(known, _)| *known == code)
        .map(|(_, name)| name)
}

/// The field of a signal, found by name and position, because neither is unique.
fn find<'a>(message: &'a DatabaseMessage, signal: &Json) -> Option<&'a SignalField> {
    let is_it = |field: &&SignalField| {
        signal["name"] == mended(field.name().unwrap())
            && signal["start"] == field.bit
            && signal["length"] == field.bits
    };
    message.layout.fields.iter().find(is_it)
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap()).collect()
}

/// A number as in the output of `tests/oracles/dbc_values.py`.
fn real(theirs: &Json) -> f64 {
    theirs.as_str().unwrap()[2..].parse().unwrap()
}

/// Whether two numbers are equal to the last bit. cantools scales exactly if factor and offset are integers;
/// our value has the precision of a double above 2^53.
fn is_same(ours: &DecodedValue, theirs: &Json) -> bool {
    let text = theirs.as_str().unwrap();
    match ours {
        DecodedValue::Unsigned(ours) => text == format!("i:{ours}"),
        DecodedValue::Integer(ours) => text == format!("i:{ours}"),
        DecodedValue::Real(ours) if ours.is_nan() => text == "r:nan",
        DecodedValue::Real(ours) if text.starts_with("i:") => {
            (ours - real(theirs)).abs() <= ours.abs() * f64::EPSILON
        }
        DecodedValue::Real(ours) => ours.to_bits() == real(theirs).to_bits(),
        DecodedValue::Text(_) | DecodedValue::Bytes(_) => unreachable!("a signal is a number"),
    }
}

/// Number of differences per reason in the corpus.
const DIFFERENCES: [(&str, usize); 6] = [
    ("ours names the codes above the largest value of a suspect parameter", 15),
    ("ours reads at most 64 bits", 18),
    ("ours reads no signal that does not fit into its message", 30),
    ("theirs refuses a payload of signals that overlap or do not fit", 208),
    ("theirs refuses a payload whose multiplexor has a value that selects nothing", 106),
    ("theirs shows nothing that a multiplexor without M selects", 8),
];

#[test]
fn every_signal_is_what_cantools_makes_of_it() {
    let files = corpus_files();
    if files.is_empty() {
        return;
    }
    let Some(python) = python() else {
        return skip("python", "DBC files are not compared with cantools");
    };
    let script = workspace().join("tests/oracles/dbc_values.py");
    let output = Command::new(python).arg(script).args(&files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut differences = Differences::default();
    for (line, path) in String::from_utf8(output.stdout).unwrap().lines().zip(&files) {
        let theirs: Json = serde_json::from_str(line).unwrap();
        assert_eq!(theirs["file"], name(path));
        differences.file(&name(path), &read(path), &theirs);
    }
    let lines = differences.unknown.lines().count();
    assert!(
        lines == 0,
        "{lines} differences\n{}",
        differences.unknown.lines().take(40).fold(String::new(), |all, line| all + line + "\n")
    );
    let counts = (differences.values, differences.labels, differences.selections);
    assert_eq!(differences.known, BTreeMap::from(DIFFERENCES));
    assert_eq!(counts, (90_096, 6937, 21_446));
}

/// The truck with the largest J1939 database of the corpus, frame by frame.
#[test]
fn a_truck_shows_what_cantools_reads_in_its_frames() {
    const TRUCK: &str =
        "j1939/remora_ctrl_proto__candump-2021-07-21_220402-15-seconds-engine-on-big-truck.log";
    let path = corpus().join("dbc/canmatrix__j1939.dbc");
    if !path.exists() {
        return skip("corpus", &format!("{} is not there", path.display()));
    }
    let Some(python) = python() else {
        return skip("python", "signals of a capture are not compared with cantools");
    };
    let script = workspace().join("tests/oracles/dbc_capture.py");
    let output = Command::new(python).arg(script).arg(corpus().join(TRUCK)).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).unwrap();
    let theirs: BTreeMap<u64, Json> = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .map(|it: Json| (it["frame"].as_u64().unwrap(), it))
        .collect();
    let mut database = Database::default();
    database.add_file(read(&path));
    let options = SessionOptions { database: Arc::new(database), ..SessionOptions::default() };
    let mut differences = Differences::default();
    let mut compared = 0;
    decode_with(options, TRUCK, |event, _| {
        if let EventKind::J1939Message(message) = &event.kind
            && let Some(theirs) = theirs.get(&event.frames.last)
        {
            compared += 1;
            match &message.layout {
                Some(layout) => differences.frame(message, layout, theirs),
                None => differences.note(&theirs["frame"].to_string(), "no signals"),
            }
        }
    });
    assert_eq!(differences.unknown, "");
    assert_eq!((compared, theirs.len()), (542, 542));
    // Codes of J1939-71 without a label in the DBC are not among these values; `indicator` checks each of them.
    assert_eq!(differences.values, 1683);
}

/// Every file of the corpus: messages, signals and problems. Without problems the numbers are those of
/// cantools; each problem was checked by hand.
const CORPUS: [(&str, usize, usize, usize); 56] = [
    ("SavvyCAN__LeafPowertrainBus.dbc", 10, 21, 0),
    ("SavvyCAN__ThinkCity.dbc", 501, 548, 0),
    ("SavvyCAN__bms.dbc", 6, 30, 0),
    ("api-examples__CSS-Electronics-SAE-J1939-DEMO.dbc", 2, 2, 0),
    ("api-examples__tp_j1939.dbc", 1, 1, 0),
    ("api-examples__tp_nmea.dbc", 1, 18, 0),
    ("api-examples__tp_uds.dbc", 2, 7, 0),
    ("api-examples__tp_uds_nissan.dbc", 1, 6, 0),
    ("canboat__canboat.dbc", 345, 1382, 0),
    ("canmatrix__j1939.dbc", 357, 2358, 40),
    ("cantools__BU_BO_REL_.dbc", 1, 1, 0),
    ("cantools__attributes.dbc", 2, 2, 0),
    ("cantools__bad_message_length.dbc", 1, 0, 1),
    ("cantools__bus_comment.dbc", 1, 12, 0),
    ("cantools__cp1252.dbc", 0, 0, 0),
    ("cantools__emc32.dbc", 1, 5, 0),
    ("cantools__empty_choice.dbc", 1, 3, 0),
    ("cantools__floating_point.dbc", 2, 3, 0),
    ("cantools__foobar.dbc", 5, 8, 1),
    ("cantools__issue_168.DBC", 5, 8, 1),
    ("cantools__issue_184_extended_mux_cascaded.dbc", 1, 5, 0),
    ("cantools__issue_184_extended_mux_multiple_values.dbc", 1, 4, 0),
    ("cantools__issue_199.dbc", 11, 25, 12),
    ("cantools__issue_63.dbc", 1, 6, 0),
    ("cantools__j1939.dbc", 2, 2, 0),
    ("cantools__long_names.dbc", 10, 13, 0),
    ("cantools__message-dlc-zero.dbc", 1, 0, 0),
    ("cantools__motohawk.dbc", 1, 3, 0),
    ("cantools__motohawk_fd.dbc", 1, 3, 0),
    ("cantools__multiplex_2.dbc", 4, 19, 0),
    ("cantools__sig_groups.dbc", 4, 10, 0),
    ("cantools__socialledge.dbc", 5, 19, 0),
    ("cantools__timing.dbc", 2, 2, 0),
    ("cantools__val_table.dbc", 1, 1, 0),
    ("cantools__variable_dlc.dbc", 2, 8, 0),
    ("cantools__vehicle.dbc", 217, 462, 1),
    ("opendbc__ESR.dbc", 80, 868, 0),
    ("opendbc__acura_ilx_2016_nidec.dbc", 36, 69, 0),
    ("opendbc__bmw_e9x_e8x.dbc", 326, 165, 0),
    ("opendbc__cadillac_ct6_chassis.dbc", 6, 23, 0),
    ("opendbc__chrysler_cusw.dbc", 26, 97, 2),
    ("opendbc__comma_body.dbc", 14, 60, 0),
    ("opendbc__fca_giorgio.dbc", 37, 155, 1),
    ("opendbc__ford_cgea1_2_bodycan_2011.dbc", 102, 829, 0),
    ("opendbc__ford_fusion_2018_adas.dbc", 64, 256, 0),
    ("opendbc__hyundai_i30_2014.dbc", 32, 415, 0),
    ("opendbc__luxgen_s5_2015.dbc", 21, 59, 0),
    ("opendbc__mazda_2017.dbc", 102, 514, 1),
    ("opendbc__mercedes_benz_e350_2010.dbc", 16, 97, 0),
    ("opendbc__nissan_xterra_2011.dbc", 15, 30, 0),
    ("opendbc__tesla_can.dbc", 44, 572, 1),
    ("opendbc__toyota_prius_2010_pt.dbc", 26, 78, 0),
    ("opendbc__volvo_v40_2017_pt.dbc", 51, 165, 0),
    ("opendbc__vw_mqb.dbc", 113, 1348, 0),
    ("opendbc__vw_pq.dbc", 86, 1317, 14),
    ("remora_ctrl_proto__remora.dbc", 14, 17, 0),
];

/// Problems in files that other readers reject, or read with a warning.
const DEFECTS: [(&str, &str); 9] = [
    (
        "cantools__bad_message_length.dbc",
        "40:2: signal \"Signal1\" skipped: it exceeds the message length of 1 byte",
    ),
    (
        "opendbc__mazda_2017.dbc",
        "290:2: signal \"NEW_SIGNAL_4\" skipped: it exceeds the message length of 8 bytes",
    ),
    ("opendbc__tesla_can.dbc", "783:1: skipped: the message has no signal \"UI_mapSpeedLimit\""),
    (
        "cantools__issue_199.dbc",
        "45:1: \"274923520\" treated as a 29-bit identifier, although bit 31 is clear",
    ),
    (
        "opendbc__chrysler_cusw.dbc",
        "182:1: \"103596083\" treated as a 29-bit identifier, although bit 31 is clear",
    ),
    (
        "opendbc__fca_giorgio.dbc",
        "228:1: \"506855454\" treated as a 29-bit identifier, although bit 31 is clear",
    ),
    ("canmatrix__j1939.dbc", "198:2: signal \"Text_Display_Character\" skipped: 1600 bits; expected 1 to 64"),
    (
        "canmatrix__j1939.dbc",
        "374:2: duplicate signal \"Differential_Lock_State___Front_\": its attributes apply to both",
    ),
    (
        "opendbc__vw_pq.dbc",
        "553:2: signal \"LH1_EPS_Diagmode\" skipped: it exceeds the message length of 2 bytes",
    ),
];

#[test]
fn every_file_is_read_and_its_defects_are_named() {
    let files: BTreeMap<_, _> = corpus_files().into_iter().map(|path| (name(&path), read(&path))).collect();
    if files.is_empty() {
        return;
    }
    let count = |file: &DatabaseFile| file.messages().map(|(_, message)| message.layout.fields.len()).sum();
    let found: Vec<(_, _, usize, _)> = files
        .iter()
        .map(|(name, file)| (name.as_str(), file.len(), count(file), file.problems.len()))
        .collect();
    assert_eq!(found, CORPUS);
    for (name, problem) in DEFECTS {
        let problems: Vec<_> = files[name].problems.iter().map(ToString::to_string).collect();
        assert!(problems.iter().any(|it| it == problem), "{name}: {problems:#?}");
    }
}

/// Decoded payload: one line per signal, then the signals that exceed the payload.
fn decode(message: Option<&Arc<DatabaseMessage>>, payload: &[u8], out: &mut String) {
    let Some(message) = message else {
        writeln!(out, "no message").unwrap();
        return;
    };
    let title = |field: &SignalField| match field.id {
        SignalId::Name => field.name().unwrap().to_owned(),
        id => format!("{id} {}", field.name().unwrap()),
    };
    for signal in message.layout.decode_signals(payload) {
        let meaning = signal.field.meaning.as_deref().unwrap();
        let outside = if meaning.is_outside(&signal.value) { " (outside)" } else { "" };
        writeln!(out, "{}: {}{outside}", title(signal.field), meaning.format_value(&signal.value)).unwrap();
    }
    for field in message.layout.missing_fields(payload) {
        writeln!(out, "missing: {}", title(field)).unwrap();
    }
}

/// Problems with `!`, then the decoded payloads of the lines with `>` in `expected`.
fn describe(file: DatabaseFile, expected: &str) -> String {
    let mut out = String::new();
    for problem in &file.problems {
        writeln!(out, "! {problem}").unwrap();
    }
    let mut database = Database::default();
    database.add_file(file);
    for asked in expected.lines().filter_map(|line| line.strip_prefix("> ")) {
        writeln!(out, "> {asked}").unwrap();
        let (id, data) = asked.split_once('#').unwrap();
        let hex = |text: &str| u32::from_str_radix(text, 16).unwrap();
        let message = match (id.strip_prefix("PGN "), id.len()) {
            (Some(pgn), _) => database.message_by_pgn(Pgn::new(hex(pgn))),
            (None, 3) => database.message_by_id(CanId::from_standard(u16::try_from(hex(id)).unwrap())),
            (None, _) => database.message_by_id(CanId::from_extended(hex(id))),
        };
        decode(message, &bytes(data), &mut out);
    }
    out
}

#[test]
fn fixtures_are_read_as_expected() {
    let mut compared = 0;
    for entry in fs::read_dir(workspace().join("fixtures/dbc")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "txt" || extension == "md") {
            continue;
        }
        let expected =
            fs::read_to_string(path.with_file_name(format!("{}.expected.txt", name(&path)))).unwrap();
        let found = describe(read(&path), &expected);
        assert_eq!(found, expected, "{}\n{found}", name(&path));
        compared += 1;
    }
    assert_eq!(compared, 5);
}

/// A database of ours with parts of it copied over others, so that the defects are not only in the first
/// lines.
fn damaged() -> impl Strategy<Value = Vec<u8>> {
    let files = fs::read_dir(workspace().join("fixtures/dbc"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "dbc" || extension == "json"))
        .map(|path| fs::read(path).unwrap());
    pieces_moved(files.collect())
}

proptest! {
    #[test]
    fn any_bytes_are_read_to_their_end(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        harness::dbc(&bytes);
    }

    #[test]
    fn damaged_files_are_read_to_their_end(bytes in damaged()) {
        harness::dbc(&bytes);
    }
}
