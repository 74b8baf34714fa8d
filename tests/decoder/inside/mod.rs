//! Unit tests that create events, which is possible only inside the library.

#![expect(clippy::disallowed_methods, reason = "what is expected is in a file")]

mod events;
mod fields;
mod filters;
mod j1939;

use std::fs;
use std::path::Path;

use crate::sink::EventSink as _;
use crate::sink::jsonl::JsonlSink;

/// An event of every kind as JSON; `tests/decoder/schema.rs` checks the lines against the schema.
#[test]
fn events_of_all_kinds_as_json() {
    let (mut output, bus) = (Vec::new(), events::bus());
    let mut sink = JsonlSink::new(&mut output);
    sink.begin_capture("a.log");
    for event in &events::all() {
        sink.write_event(event, &bus);
    }
    sink.finish_output().unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/decoder/inside/events.jsonl");
    if std::env::var_os("COBSCOPE_BLESS").is_some() {
        fs::write(&path, &output).unwrap();
    }
    assert_eq!(String::from_utf8(output).unwrap(), fs::read_to_string(path).unwrap_or_default());
}
