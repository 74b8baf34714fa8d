//! Compares captures in `fixtures/devices/`, with the nodes' profiles, with the hand-written events next to
//! them.
//!
//! The notation is described in `fixtures/README.md`.

use std::fs;
use std::path::Path;

use cobscope_decoder::bus_file::BusFile;
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::session::{AssignedBy, Assignment, SessionOptions};

use crate::scene::{Expected, captures, events};

/// Profiles from the remarks, and the bus file next to the capture.
pub fn options(name: &Path, expected: &Expected, catalogue: &Catalogue) -> SessionOptions {
    let nodes = expected.remarks.iter().filter_map(|remark| remark.strip_prefix("node:"));
    let assignments = nodes.flat_map(str::split_whitespace).map(|node| {
        let (id, device) = node.split_once('=').unwrap();
        let device = catalogue.device(device).unwrap();
        Assignment { bus: None, node: id.parse().unwrap(), device, by: AssignedBy::Option }
    });
    let bus_file = fs::read_to_string(name.with_extension("bus.toml"));
    SessionOptions {
        assignments: assignments.collect(),
        bus_file: bus_file.map_or_else(|_| BusFile::default(), |text| BusFile::parse(&text).unwrap()),
        ..SessionOptions::default()
    }
}

/// First frame of a cut capture.
pub fn cut(expected: &Expected) -> u64 {
    let mut cuts = expected.remarks.iter().filter_map(|remark| remark.strip_prefix("cut:"));
    cuts.next().map_or(1, |cut| cut.trim().parse().unwrap())
}

#[test]
fn every_capture_of_a_device_gives_the_events_written_beside_it() {
    let catalogue = Catalogue::default();
    let names = captures("devices");
    assert!(names.len() >= 15);
    let mut report = String::new();
    let mut count = 0;
    for name in &names {
        for end in ["expected.txt", "cut.expected.txt"] {
            let path = name.with_extension(end);
            if !path.exists() {
                continue;
            }
            let expected = Expected::read(&path);
            let options = options(name, &expected, &catalogue);
            assert!(!options.assignments.is_empty(), "{}", path.display());
            let found = events(&name.with_extension("log"), options, cut(&expected));
            expected.compare(&path.file_name().unwrap().to_string_lossy(), &found, &mut report);
            count += 1;
        }
    }
    assert!(count >= 20);
    assert!(report.is_empty(), "\n{report}");
}
