//! Writes a capture of a machine of eight CANopen nodes to standard output.
//!
//! ```text
//! cargo run --release --example generate_machine -- --frames 1000000 > machine.log
//! ```
//!
//! Options: `--frames N` (1000000), `--seed N` (1), `--format candump|pcap|pcapng`, `--storm` (every second
//! SDO transfer aborted, every tenth frame an EMCY), `--mapping` (the SDO transfers include the PDO
//! mappings), `--devices` (a hydraulic machine instead, whose devices have profiles: printed to standard
//! error), `--j1939` (an engine and five other control units instead), `--faults` (one message in 64 is lost,
//! doubled, changed, late or early, or the clock steps).

#[path = "../benches/machine/mod.rs"]
mod machine;

use std::io::{self, BufWriter, Write};

use machine::devices::{DEVICES, Devices};
use machine::engine::Engine;
use machine::faults::Faulty;
use machine::formats::Format;
use machine::{Machine, Message, Options};

fn main() -> io::Result<()> {
    let mut frames = 1_000_000;
    let mut format = Format::Candump;
    let mut options = Options { seed: 1, storm: false, mapping: false };
    let (mut devices, mut j1939, mut faults) = (false, false, false);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--storm" => options.storm = true,
            "--mapping" => options.mapping = true,
            "--devices" => devices = true,
            "--j1939" => j1939 = true,
            "--faults" => faults = true,
            "--frames" => frames = number(arguments.next())?,
            "--seed" => options.seed = number(arguments.next())?,
            "--format" => {
                format = match arguments.next().as_deref() {
                    Some("candump") => Format::Candump,
                    Some("pcap") => Format::Pcap,
                    Some("pcapng") => Format::Pcapng,
                    _ => return Err(usage()),
                };
            }
            _ => return Err(usage()),
        }
    }
    let mut out = BufWriter::with_capacity(256 * 1024, io::stdout().lock());
    format.begin(&mut out)?;
    let seed = options.seed;
    let messages: Box<dyn Iterator<Item = Message>> = if devices {
        for (node, profile) in DEVICES {
            writeln!(io::stderr(), "--node {node}={profile}")?;
        }
        Box::new(Devices::new(seed))
    } else if j1939 {
        Box::new(Engine::new(seed))
    } else {
        Box::new(Machine::new(options))
    };
    let messages = if faults { Box::new(Faulty::new(messages, seed)) } else { messages };
    for message in messages.take(frames) {
        format.write(&message, &mut out)?;
    }
    out.flush()
}

fn number<T: std::str::FromStr>(text: Option<String>) -> io::Result<T> {
    text.and_then(|text| text.parse().ok()).ok_or_else(usage)
}

fn usage() -> io::Error {
    io::Error::other(
        "options: --frames N --seed N --format candump|pcap|pcapng --storm --mapping --devices --j1939 --faults",
    )
}
