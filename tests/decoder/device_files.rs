//! Device files: those of other projects compared with canopen-python and each other, our own with their
//! defects.

#![expect(clippy::disallowed_methods, reason = "the rule is for the decoder, not for what tests it")]
#![expect(clippy::panic, reason = "helpers of tests fail so")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cobscope_decoder::profile::DataType;
use cobscope_decoder::profile::device_file::{self, DescriptionKind, DeviceFile, DeviceObject, EntryValue};
use proptest::prelude::*;
use serde_json::Value;

use crate::harness;
use crate::pieces::pieces_moved;
use crate::support::{corpus, python, skip, workspace};

/// Value of `$NODEID`.
const NODE_ID: u8 = 5;

fn corpus_files() -> Vec<PathBuf> {
    let folder = corpus().join("eds");
    let Ok(entries) = fs::read_dir(&folder) else {
        skip("corpus", &format!("{} is not there", folder.display()));
        return Vec::new();
    };
    let mut found: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found
}

fn read(path: &Path) -> DeviceFile {
    device_file::parse_device_file(&fs::read(path).unwrap())
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn name(path: &Path) -> String {
    path.file_name().unwrap().to_string_lossy().into_owned()
}

/// A value as in the output of `tests/oracles/eds_values.py`.
fn show(given: Option<&EntryValue>) -> Value {
    let Some(given) = given else { return Value::Null };
    Value::String(match given.resolve_formula(NODE_ID) {
        EntryValue::Number(number) => format!("i:{number}"),
        EntryValue::Real(number) => format!("r:{number:?}"),
        EntryValue::Text(text) => format!("t:{text}"),
        EntryValue::Bytes(bytes) => {
            bytes.iter().fold("b:".to_owned(), |text, byte| format!("{text}{byte:02x}"))
        }
        EntryValue::Formula { .. } => unreachable!("resolved"),
    })
}

/// Number of a data type in CiA 301.
fn type_number(data_type: DataType) -> u64 {
    let all = [
        (0x01, "BOOLEAN"),
        (0x02, "INTEGER8"),
        (0x03, "INTEGER16"),
        (0x04, "INTEGER32"),
        (0x05, "UNSIGNED8"),
        (0x06, "UNSIGNED16"),
        (0x07, "UNSIGNED32"),
        (0x08, "REAL32"),
        (0x09, "VISIBLE_STRING"),
        (0x0A, "OCTET_STRING"),
        (0x0B, "UNICODE_STRING"),
        (0x0C, "TIME_OF_DAY"),
        (0x0D, "TIME_DIFFERENCE"),
        (0x0F, "DOMAIN"),
        (0x10, "INTEGER24"),
        (0x11, "REAL64"),
        (0x12, "INTEGER40"),
        (0x13, "INTEGER48"),
        (0x14, "INTEGER56"),
        (0x15, "INTEGER64"),
        (0x16, "UNSIGNED24"),
        (0x18, "UNSIGNED40"),
        (0x19, "UNSIGNED48"),
        (0x1A, "UNSIGNED56"),
        (0x1B, "UNSIGNED64"),
    ];
    all.into_iter().find(|(_, name)| *name == data_type.name()).unwrap().0
}

fn field(object: &DeviceObject, name: &str) -> Value {
    match name {
        "object" => object.object_name.clone().into(),
        "name" => object.entry_name.clone().into(),
        "type" => object.data_type.map(type_number).into(),
        "access" => object.access.map(device_file::EntryAccess::name).into(),
        "mappable" => object.mappable.unwrap_or(false).into(),
        "default" => show(object.default.as_ref()),
        "low" => show(object.low.as_ref()),
        "high" => show(object.high.as_ref()),
        "value" => show(object.value.as_ref()),
        _ => unreachable!("{name}"),
    }
}

const FIELDS: [&str; 9] = ["object", "name", "type", "access", "mappable", "default", "low", "high", "value"];

/// Reason for a difference from canopen-python 2.4.1; `None` if unexplained.
fn reason(object: &DeviceObject, field: &str, ours: &Value, theirs: &Value) -> Option<&'static str> {
    let is_compact = object.entry_name == Some(format!("{}{}", object.object_name, object.address.sub));
    let number = |value: &Value| value.as_str()?.strip_prefix("i:")?.parse::<i128>().ok();
    let bits = object.data_type.and_then(DataType::bits).unwrap_or(0);
    let is_text = ours.as_str().is_some_and(|text| text.starts_with("t:"));
    match field {
        "name" | "access" | "default" if object.entry_name.as_deref() == Some("NrOfObjects") => {
            Some("theirs has a name of its own for sub-index 0 of a compact object, rw and without default")
        }
        "name" if is_compact => Some("theirs does not number the names of a compact object"),
        "value" if is_compact && theirs.is_null() => Some("theirs does not read [1003Value]"),
        "name" | "default" | "value"
            if ours.is_null() && ["", "b:", "t:"].iter().any(|empty| theirs == empty) =>
        {
            Some("ours takes an empty value for none")
        }
        "access" if ours.is_null() && theirs == "unknown" => Some("theirs takes any word for an access"),
        "type" if ours.is_null() && theirs == 0x0F => Some("theirs takes an unknown type for DOMAIN"),
        "default" if object.data_type.is_none() && theirs.is_null() => {
            Some("theirs takes an unknown type for DOMAIN")
        }
        "default" if is_text && theirs.is_null() => Some("theirs drops what is not hexadecimal"),
        "default" if number(ours).map(|ours| ours + (1 << bits)) == number(theirs) => {
            Some("theirs takes hexadecimal of a signed type for positive")
        }
        "low" | "high" if theirs.is_null() && matches!(bits, 24 | 40 | 48 | 56) => {
            Some("theirs knows no limits of INTEGER24, 40, 48 and 56")
        }
        "low" if theirs.is_null() && object.data_type == Some(DataType::Real32) => {
            Some("theirs reads the limits of reals as whole numbers")
        }
        _ => None,
    }
}

/// Known differences by reason, and unexplained ones.
#[derive(Default)]
struct Differences {
    known: BTreeMap<&'static str, usize>,
    unknown: String,
    equal: usize,
}

impl Differences {
    fn compare(&mut self, file: &str, ours: &DeviceFile, theirs: &serde_json::Map<String, Value>) {
        let ours: BTreeMap<_, _> =
            ours.objects.iter().map(|object| (object.address.to_string(), object)).collect();
        for address in theirs.keys().filter(|address| !ours.contains_key(*address)) {
            writeln!(self.unknown, "{file}: {address} is only theirs").unwrap();
        }
        for (address, object) in ours {
            let Some(entry) = theirs.get(&address) else {
                let section = "only ours: theirs reads sub-index 0 and 1 of a compact array, and nothing of a compact record";
                *self.known.entry(section).or_default() += 1;
                continue;
            };
            for name in FIELDS {
                let (ours, theirs) = (field(object, name), &entry[name]);
                match reason(object, name, &ours, theirs) {
                    _ if ours == *theirs => self.equal += 1,
                    Some(reason) => *self.known.entry(reason).or_default() += 1,
                    None => {
                        writeln!(self.unknown, "{file}: {address} {name} is {ours}, theirs {theirs}")
                            .unwrap();
                    }
                }
            }
        }
    }
}

/// Number of differences per reason in the corpus.
const DIFFERENCES: [(&str, usize); 11] = [
    ("only ours: theirs reads sub-index 0 and 1 of a compact array, and nothing of a compact record", 2712),
    ("ours takes an empty value for none", 519),
    ("theirs does not number the names of a compact object", 35),
    ("theirs does not read [1003Value]", 16),
    ("theirs drops what is not hexadecimal", 17),
    ("theirs has a name of its own for sub-index 0 of a compact object, rw and without default", 108),
    ("theirs knows no limits of INTEGER24, 40, 48 and 56", 8),
    ("theirs reads the limits of reals as whole numbers", 1),
    ("theirs takes an unknown type for DOMAIN", 2),
    ("theirs takes any word for an access", 21),
    ("theirs takes hexadecimal of a signed type for positive", 24),
];

/// Files that canopen-python 2.4.1 cannot read, with its error.
const UNREADABLE: [(&str, &str); 4] = [
    ("CANopenNode__DS301_profile.eds", "ValueError: invalid literal for int() with base 0: ''"),
    ("CANopenSocket__basicDevice.eds", "ValueError: invalid literal for int() with base 0: ''"),
    ("kacanopen__301.eds", "ValueError: invalid literal for int() with base 0: '0x07 # VAR'"),
    ("lely-core__co-gw_txt-master.dcf", "NoOptionError: No option 'Dummy0001' in section: 'DummyUsage'"),
];

#[test]
fn every_entry_is_what_canopen_python_makes_of_it() {
    let files: Vec<_> = corpus_files().into_iter().filter(|path| !is_xml(path)).collect();
    if files.is_empty() {
        return;
    }
    let Some(python) = python() else {
        return skip("python", "device files are not compared with canopen-python");
    };
    let script = workspace().join("tests/oracles/eds_values.py");
    let output = Command::new(python).arg(script).arg(NODE_ID.to_string()).args(&files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut differences = Differences::default();
    let mut unreadable = Vec::new();
    let mut compared = 0;
    for (line, path) in String::from_utf8(output.stdout).unwrap().lines().zip(&files) {
        let answer: Value = serde_json::from_str(line).unwrap();
        assert_eq!(answer["file"], name(path));
        match answer["entries"].as_object() {
            Some(theirs) => {
                differences.compare(&name(path), &read(path), theirs);
                compared += 1;
            }
            None => unreadable.push((name(path), answer["error"].as_str().unwrap().to_owned())),
        }
    }
    assert!(differences.unknown.is_empty(), "\n{}", differences.unknown);
    let expected = UNREADABLE.map(|(name, error)| (name.to_owned(), error.to_owned()));
    assert_eq!(unreadable, expected);
    assert_eq!(differences.known, BTreeMap::from(DIFFERENCES));
    assert_eq!((compared, differences.equal), (54, 98_249));
}

fn is_xml(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "xdd" || extension == "xpd")
}

/// An XDD and the EDS of the same device, both written by the same editor.
const TWINS: [(&str, &str); 3] = [
    ("CANopenDemo__demoDevice.xdd", "CANopenDemo__demoDevice.eds"),
    ("CANopenSocket__basicDevice.xdd", "CANopenSocket__basicDevice.eds"),
    ("CANopen-tools-suite__sample_node_0x01.xdd", "CANopen-tools-suite__sample_node_0x01.eds"),
];

#[test]
fn an_xdd_says_what_the_eds_of_the_same_device_says() {
    let folder = corpus().join("eds");
    if !folder.exists() {
        return skip("corpus", &format!("{} is not there", folder.display()));
    }
    let mut compared = 0;
    let mut report = String::new();
    for (xdd_name, eds_name) in TWINS {
        let (xdd, eds) = (read(&folder.join(xdd_name)), read(&folder.join(eds_name)));
        assert_eq!((xdd.vendor_id, xdd.product_code), (eds.vendor_id, eds.product_code), "{xdd_name}");
        assert_eq!(
            (&xdd.vendor_name, &xdd.product_name),
            (&eds.vendor_name, &eds.product_name),
            "{xdd_name}"
        );
        assert_eq!(xdd.bit_rates, eds.bit_rates, "{xdd_name}");
        for object in &eds.objects {
            let Some(other) = xdd.find_object(object.address) else {
                writeln!(report, "{eds_name}: {} is not in the XDD", object.address).unwrap();
                continue;
            };
            for name in FIELDS {
                let (ours, other) = (field(object, name), field(other, name));
                // An XDD has BITSTRING for both types.
                let is_bits = name == "type" && ours == 0x0F && other == 0x0A;
                if ours != other && !is_bits {
                    writeln!(report, "{eds_name}: {} {name} is {ours}, in the XDD {other}", object.address)
                        .unwrap();
                }
                compared += 1;
            }
        }
    }
    assert!(report.is_empty(), "\n{report}");
    // 282, 279 and 74 entries.
    assert_eq!(compared, 635 * FIELDS.len());
}

/// Every device file of the corpus: entries and problems. The entries were counted by sections, elements and
/// `CompactSubObj` with another program; each problem was checked by hand.
const CORPUS: [(&str, DescriptionKind, usize, usize); 63] = [
    ("CANopen-monitor__GPS_OD.eds", DescriptionKind::Eds, 473, 269),
    ("CANopen-monitor__battery.dcf", DescriptionKind::Dcf, 594, 0),
    ("CANopen-monitor__gps.xdd", DescriptionKind::Xdd, 608, 0),
    ("CANopen-tools-suite__sample_node_0x01.eds", DescriptionKind::Eds, 74, 21),
    ("CANopen-tools-suite__sample_node_0x01.xdd", DescriptionKind::Xdd, 74, 0),
    ("CANopenDemo__demoDevice.eds", DescriptionKind::Eds, 282, 0),
    ("CANopenDemo__demoDevice.xdd", DescriptionKind::Xdd, 286, 0),
    ("CANopenNode__DS301_profile.eds", DescriptionKind::Eds, 170, 0),
    ("CANopenNode__DS301_profile.xpd", DescriptionKind::Xdd, 241, 0),
    ("CANopenSocket__basicDevice.eds", DescriptionKind::Eds, 279, 0),
    ("CANopenSocket__basicDevice.xdd", DescriptionKind::Xdd, 279, 0),
    ("PyTrinamic__TMCC160-CANopen_Hw1.00_Fw3.00.eds", DescriptionKind::Eds, 242, 0),
    ("PyTrinamic__TMCM-1636-CANopen_Hw1.1_Fw1.08.eds", DescriptionKind::Eds, 230, 0),
    ("PyTrinamic__TMCM_1270_V3.22.eds", DescriptionKind::Eds, 245, 0),
    ("PyTrinamic__TMCM_1617_Hw1.2_Fw1.06.eds", DescriptionKind::Eds, 230, 0),
    ("PyTrinamic__TMCM_1670_Hw1.2_Fw2.00.eds", DescriptionKind::Eds, 213, 0),
    ("PyTrinamic__TMCM_6212_V.3.22.eds", DescriptionKind::Eds, 1152, 0),
    ("canopen__datatypes.eds", DescriptionKind::Eds, 28, 1),
    ("canopen__e35.eds", DescriptionKind::Dcf, 995, 6),
    ("canopen__sample.eds", DescriptionKind::Dcf, 136, 50),
    ("cob_robots__Elmo.dcf", DescriptionKind::Dcf, 458, 0),
    ("cob_robots__Schunk_0_63.dcf", DescriptionKind::Dcf, 206, 0),
    ("gocanopen__base.eds", DescriptionKind::Eds, 206, 29),
    ("kacanopen__301.eds", DescriptionKind::Eds, 102, 16),
    ("kacanopen__3301001_0.eds", DescriptionKind::Eds, 209, 0),
    ("kacanopen__3301001_3.eds", DescriptionKind::Eds, 193, 0),
    ("kacanopen__3301001_6.eds", DescriptionKind::Eds, 219, 0),
    ("kacanopen__3301002_1.eds", DescriptionKind::Eds, 238, 0),
    ("kacanopen__401.eds", DescriptionKind::Eds, 453, 0),
    ("kacanopen__402.eds", DescriptionKind::Eds, 258, 1),
    ("kacanopen__406.eds", DescriptionKind::Eds, 201, 1),
    ("kacanopen__605.3150.51-V-EK-2-60.eds", DescriptionKind::Eds, 156, 1),
    ("kacanopen__605.3150.52-V-EK-2-60.eds", DescriptionKind::Eds, 157, 1),
    ("kacanopen__605.3150.60-B-EK-2-60.eds", DescriptionKind::Eds, 156, 1),
    ("kacanopen__605.3150.67-B-EK-2-60.eds", DescriptionKind::Eds, 273, 0),
    ("kacanopen__605.3150.71-A-EK-3-60.eds", DescriptionKind::Eds, 156, 1),
    ("kacanopen__IoX3_24DO.eds", DescriptionKind::Eds, 103, 0),
    ("kacanopen__IoX6_8AO.eds", DescriptionKind::Eds, 190, 0),
    ("kacanopen__MM217_V3Y_2.eds", DescriptionKind::Eds, 144, 0),
    ("kacanopen__MM217_V3Y_5.eds", DescriptionKind::Eds, 139, 0),
    ("kacanopen__MM217_Y_1.eds", DescriptionKind::Eds, 238, 0),
    ("kacanopen__MM217_Y_4.eds", DescriptionKind::Eds, 233, 0),
    ("kacanopen__epos2_347717.eds", DescriptionKind::Eds, 431, 0),
    ("lely-core__co-emcy.dcf", DescriptionKind::Dcf, 148, 0),
    ("lely-core__co-gw_txt-master.dcf", DescriptionKind::Dcf, 145, 0),
    ("lely-core__co-nmt-slave.dcf", DescriptionKind::Dcf, 17, 0),
    ("lely-core__co-pdo-receive.dcf", DescriptionKind::Dcf, 15, 0),
    ("lely-core__co-pdo-transmit.dcf", DescriptionKind::Dcf, 15, 0),
    ("lely-core__co-sdo-client.dcf", DescriptionKind::Dcf, 11, 0),
    ("lely-core__co-sdo-server.dcf", DescriptionKind::Dcf, 8, 0),
    ("lely-core__co-sync.dcf", DescriptionKind::Eds, 10, 0),
    ("lely-core__co-time.dcf", DescriptionKind::Dcf, 9, 0),
    ("lely-core__coapp-lss-slave.dcf", DescriptionKind::Eds, 7, 0),
    ("lely-core__cocatd.dcf", DescriptionKind::Eds, 287, 0),
    ("python-objdictgen__slave.eds", DescriptionKind::Eds, 130, 0),
    ("ros2_canopen__cia402_slave.eds", DescriptionKind::Eds, 154, 0),
    ("ros2_canopen__master.dcf", DescriptionKind::Dcf, 2225, 0),
    ("ros2_canopen__simple.eds", DescriptionKind::Eds, 299, 0),
    ("sick_line_guidance__CiA401_IO_Node3.eds", DescriptionKind::Eds, 187, 0),
    ("sick_line_guidance__CiA401_minimal.eds", DescriptionKind::Eds, 7, 3),
    ("sick_line_guidance__CiA402_Stepper_Node8.eds", DescriptionKind::Eds, 138, 0),
    ("sick_line_guidance__SICK-MLS.eds", DescriptionKind::Eds, 49, 0),
    ("sick_line_guidance__SICK_OLS20_CO.eds", DescriptionKind::Eds, 85, 0),
];

#[test]
fn all_of_the_corpus_is_read() {
    let files = corpus_files();
    if files.is_empty() {
        return;
    }
    let mut found = Vec::new();
    for path in &files {
        let file = read(path);
        println!("{}: {} entries, {} problems", name(path), file.objects.len(), file.problems.len());
        found.push((name(path), file.kind, file.objects.len(), file.problems.len()));
    }
    let expected: Vec<_> = CORPUS
        .iter()
        .map(|(name, kind, entries, problems)| ((*name).to_owned(), *kind, *entries, *problems))
        .collect();
    assert_eq!(found, expected);
}

/// Contents of a file: one line per entry and problem.
fn describe(file: &DeviceFile) -> String {
    let DeviceFile { kind, vendor_name, vendor_id, product_name, product_code, revision, .. } = file;
    let DeviceFile { node_id, node_name, bit_rate, bit_rates, .. } = file;
    let mut text =
        format!("{kind:?} vendor {vendor_name:?} {vendor_id:X?} product {product_name:?} {product_code:X?}");
    writeln!(text, " revision {revision:X?} rates {bit_rates:?}").unwrap();
    if node_id.is_some() || !node_name.is_empty() || bit_rate.is_some() {
        writeln!(text, "node {node_id:?} {node_name:?} at {bit_rate:?}").unwrap();
    }
    for object in &file.objects {
        let data_type = object.data_type.map_or("-".to_owned(), DataType::name);
        let access = object.access.map_or("-", device_file::EntryAccess::name);
        write!(text, "{} {:?}", object.address, object.object_name).unwrap();
        if let Some(name) = &object.entry_name {
            write!(text, " {name:?}").unwrap();
        }
        write!(text, " {data_type} {access}").unwrap();
        let values = [
            ("default", &object.default),
            ("low", &object.low),
            ("high", &object.high),
            ("value", &object.value),
        ];
        for (name, value) in values.iter().filter_map(|(name, value)| Some((name, value.as_ref()?))) {
            write!(text, " {name} {value:?}").unwrap();
        }
        if let Some(mappable) = object.mappable {
            text += if mappable { " mappable" } else { " unmappable" };
        }
        if let Some(denotation) = &object.denotation {
            write!(text, " called {denotation:?}").unwrap();
        }
        writeln!(text, " @{}", object.line).unwrap();
    }
    for problem in &file.problems {
        writeln!(text, "! {problem}").unwrap();
    }
    text
}

#[test]
fn fixtures_are_read_as_expected() {
    let mut compared = 0;
    for entry in fs::read_dir(workspace().join("fixtures/device_files")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "txt" || extension == "md") {
            continue;
        }
        let expected = fs::read_to_string(path.with_file_name(format!("{}.expected.txt", name(&path))))
            .unwrap_or_default();
        let found = describe(&read(&path));
        assert_eq!(found, expected, "{}\n{found}", name(&path));
        compared += 1;
    }
    assert_eq!(compared, 12);
}

/// A device file of ours with bytes copied over it, so that the defects are not only in the first lines.
fn damaged() -> impl Strategy<Value = Vec<u8>> {
    let entries = fs::read_dir(workspace().join("fixtures/device_files")).unwrap();
    pieces_moved(entries.map(|entry| fs::read(entry.unwrap().path()).unwrap()).collect())
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..500)) {
        harness::device_file(&bytes);
    }

    #[test]
    fn any_text_is_read_or_refused(text in "(\\[?[0-9A-Fa-fsubM]{0,9}\\]?|[A-Za-z]{1,9}=|[$NODEID0x+; #<>&\"'/]{0,9}|\n){0,40}") {
        harness::device_file(text.as_bytes());
    }

    #[test]
    fn damaged_files_are_read_or_refused(bytes in damaged()) {
        harness::device_file(&bytes);
    }
}
