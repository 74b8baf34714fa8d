//! Replays inputs of the fuzzers through the functions that they test.

use std::fs;
use std::panic::RefUnwindSafe;
use std::path::Path;

use cobscope_decoder::capture::{FORMATS, ReadOptions};

use crate::harness::{self, TARGETS};
use crate::support::workspace;

/// Runs `target`; the message of a failure contains the name of the input.
fn replay(target: impl Fn(&[u8]) + RefUnwindSafe, path: &Path) {
    let bytes = fs::read(path).unwrap();
    let outcome = std::panic::catch_unwind(|| target(&bytes));
    assert!(outcome.is_ok(), "{} fails: see above", path.display());
}

#[test]
fn kept_inputs_of_every_target() {
    let inputs = |name: &str| {
        let folder = workspace().join("fixtures/fuzz").join(name);
        let inputs: Vec<_> = fs::read_dir(folder).unwrap().map(|input| input.unwrap().path()).collect();
        assert!(!inputs.is_empty(), "{name} has no inputs");
        inputs
    };
    for (name, target) in TARGETS {
        for path in inputs(name) {
            replay(target, &path);
        }
    }
    for format in FORMATS {
        let read = |bytes: &[u8]| harness::reader::holds_its_contract(format.name, bytes);
        for path in inputs(format.name) {
            replay(read, &path);
        }
    }
}

/// Every reader gets every capture, also those of other formats.
#[test]
fn malformed_captures_through_every_reader() {
    for entry in fs::read_dir(workspace().join("fixtures/malformed")).unwrap() {
        let path = entry.unwrap().path();
        for format in FORMATS {
            replay(|bytes: &[u8]| harness::reader::holds_its_contract(format.name, bytes), &path);
        }
        replay(harness::any, &path);
    }
}

#[test]
fn a_session_is_encoded_as_it_is_read() {
    let path = workspace().join("fixtures/canopen/sdo_abort.log");
    let bytes = fs::read(path).unwrap();
    let content = harness::reader::parse(
        &mut *(harness::reader::format("candump").parser)(&ReadOptions::default()),
        &bytes,
        || usize::MAX,
    );
    let again = harness::session::frames(harness::session::encode(&content.frames).get(1..).unwrap());
    assert_eq!(again.len(), content.frames.len());
    for (read, encoded) in content.frames.iter().zip(&again) {
        assert_eq!((read.id, read.data(), read.flags), (encoded.id, encoded.data(), encoded.flags));
    }
}
