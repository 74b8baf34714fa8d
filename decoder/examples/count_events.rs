//! Counts the events of a capture, and those that report an error.
//!
//! `cargo run -p cobscope-decoder --example count_events -- fixtures/canopen/guarding.log`

#![expect(clippy::disallowed_methods, reason = "the library opens no files; its users do")]

use std::error::Error;
use std::fs::File;
use std::io::{Write as _, stdout};

use cobscope_decoder::{Bus, Event, Reading};

fn main() -> Result<(), Box<dyn Error>> {
    let capture = std::env::args_os().nth(1).ok_or("usage: count_events CAPTURE")?;
    let (mut events, mut errors) = (0_u64, 0_u64);
    let count = |event: &Event, _: &Bus| {
        events += 1;
        errors += u64::from(event.is_error());
    };
    let mut reading = Reading::builder().without_rules().build(count)?;
    reading.run(File::open(capture)?)?;
    let frames = reading.finish().frames();
    Ok(writeln!(stdout(), "frames: {frames}, events: {events}, errors: {errors}")?)
}
