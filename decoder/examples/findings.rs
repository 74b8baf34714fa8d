//! Prints the findings of a capture; the exit status is 1 if one of them is an error.
//!
//! `cargo run -p cobscope-decoder --example findings -- fixtures/canopen/heartbeat_lost.log`

#![expect(clippy::disallowed_methods, reason = "the library opens no files; its users do")]

use std::error::Error;
use std::fs::File;
use std::io::{Write as _, stdout};
use std::process::ExitCode;

use cobscope_decoder::{NodeId, Reading, Severity};

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let capture = std::env::args_os().nth(1).ok_or("usage: findings CAPTURE")?;
    let mut reading = Reading::new(());
    reading.run(File::open(capture)?)?;
    let findings = reading.finish().findings;
    let mut out = stdout().lock();
    for group in findings.reported_groups() {
        let node = group.key.node.map_or_else(|| group.bus.to_string(), NodeId::label);
        let (severity, count) = (group.severity.name(), group.count);
        writeln!(out, "{severity:<8}  {node:<6}  {} [{}], count {count}", group.text, group.rule)?;
    }
    let has_errors = findings.reported_count(Severity::Error) > 0;
    Ok(if has_errors { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}
