//! Compares captures in `fixtures/canopen/` with the hand-written events next to them.
//!
//! The notation is described in `fixtures/README.md`.

use cobscope_decoder::session::SessionOptions;

use crate::scene::{Expected, captures, events};

#[test]
fn every_capture_gives_the_events_written_beside_it() {
    let names = captures("canopen");
    assert!(names.len() >= 20);
    let mut report = String::new();
    for name in &names {
        let expected = Expected::read(&name.with_extension("expected.txt"));
        let found = events(&name.with_extension("log"), SessionOptions::default(), 1);
        expected.compare(&name.file_name().unwrap().to_string_lossy(), &found, &mut report);
    }
    assert!(report.is_empty(), "\n{report}");
}
