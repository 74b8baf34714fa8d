//! Prints one line per event of a capture.
//!
//! `cargo run -p cobscope-decoder --example print_events -- fixtures/canopen/guarding.log`

#![expect(clippy::disallowed_methods, reason = "the library opens no files; its users do")]

use std::error::Error;
use std::fs::File;
use std::io::{Write as _, stdout};

use cobscope_decoder::{Bus, Event, NodeId, Reading};

fn main() -> Result<(), Box<dyn Error>> {
    let capture = std::env::args_os().nth(1).ok_or("usage: print_events CAPTURE")?;
    let mut out = stdout().lock();
    let mut written = Ok(());
    let mut reading = Reading::new(|event: &Event, bus: &Bus| {
        let time = event.time.map_or_else(|| "-".into(), |time| time.to_string());
        let node = event.node.map_or_else(|| "-".into(), NodeId::label);
        let line = writeln!(out, "{time}  {}  {node:<6}  {}", bus.name(), event.kind.name());
        written = std::mem::replace(&mut written, Ok(())).and(line);
    });
    reading.run(File::open(capture)?)?;
    drop(reading);
    Ok(written?)
}
