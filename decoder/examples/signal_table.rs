//! Prints the values of one signal of a node as a table: seconds, value, unit or label.
//!
//! `cargo run -p cobscope-decoder --example signal_table -- fixtures/devices/pve.log 32 danfoss-pve-ci "Spool position"`

#![expect(clippy::disallowed_methods, reason = "the library opens no files; its users do")]

use std::error::Error;
use std::fs::File;
use std::io::{Write as _, stdout};

use cobscope_decoder::{Bus, DecodedSignal, Event, NodeId, Reading};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [capture, node, profile, name] = &arguments[..] else {
        return Err("usage: signal_table CAPTURE NODE PROFILE SIGNAL".into());
    };
    let node: NodeId = node.parse()?;
    let mut table = String::new();
    let add_rows = |event: &Event, _: &Bus| {
        let time = event.time.map_or_else(|| "-".into(), |time| time.to_string());
        let wanted =
            event.decode_signals().filter(|signal| event.node == Some(node) && signal.name() == Some(name));
        table.extend(wanted.map(|signal| format!("{time}  {}\n", row(&signal))));
    };
    let mut reading = Reading::builder().device(node, profile).build(add_rows)?;
    reading.run(File::open(capture)?)?;
    drop(reading);
    Ok(stdout().write_all(table.as_bytes())?)
}

fn row(signal: &DecodedSignal<'_>) -> String {
    match (signal.label(), signal.scaled_value()) {
        (Some(label), _) => label.to_owned(),
        (None, Some(quantity)) => format!("{quantity:8.2} {}", signal.unit()),
        (None, None) => signal.value.to_string(),
    }
}
