//! Extcap: Wireshark shows buses and captures of any format as interfaces, with the meaning of each frame as its comment.
//!
//! ```text
//! Wireshark ─ --extcap-interfaces, --extcap-dlts, --extcap-config ─▶ sentences
//!           ─ --capture --fifo PIPE ─▶ pcapng with comments, until it closes the pipe
//! ```
//! The protocol of the sentences is described in `doc/extcap.4` of Wireshark.

mod arguments;
mod install;
mod sentences;

use std::ffi::OsString;

use anyhow::{Context as _, bail};
use cobscope_decoder::query::Filter;

use super::convert::{self, ConvertArgs};
use super::live::{self, LiveArgs};
use crate::exit_code::ExitStatus;
use crate::run::arguments::parse_words;
use crate::run::messages::{Refusal, print_error};
use crate::run::output::print_text;
pub use arguments::{ExtcapArgs, ExtcapCall, is_extcap_call};
pub use install::set_program;
use sentences::ExtcapInterface;

/// Runs the command.
pub fn run(arguments: &ExtcapArgs) -> ExitStatus {
    install::install_link(arguments.dir.as_deref()).unwrap_or_else(|error| {
        print_error(&error);
        ExitStatus::Usage
    })
}

/// Answers a call by Wireshark.
pub fn answer_call(call: &ExtcapCall) -> ExitStatus {
    try_answer(call).unwrap_or_else(|(exit, error)| {
        print_error(&error);
        exit
    })
}

fn try_answer(call: &ExtcapCall) -> Result<ExitStatus, Refusal> {
    if call.extcap_interfaces {
        return Ok(print_text(sentences::interface_sentences().as_bytes()));
    }
    let interface = call_interface(call).map_err(|error| (ExitStatus::Usage, error))?;
    if call.extcap_dlts {
        return Ok(print_text(sentences::LINK_TYPES.as_bytes()));
    }
    if call.extcap_config {
        return Ok(print_text(interface.option_sentences().as_bytes()));
    }
    if call.capture {
        return write_frames(call, &interface);
    }
    // Wireshark asks whether a filter is valid: no output means that it is.
    let filter = call.extcap_capture_filter.as_deref().unwrap_or_default();
    Ok(match filter.parse::<Filter>() {
        Err(error) if !filter.is_empty() => print_text(format!("{error}\n").as_bytes()),
        _ => ExitStatus::Clean,
    })
}

fn call_interface(call: &ExtcapCall) -> anyhow::Result<ExtcapInterface> {
    let name = call.extcap_interface.as_deref().context("--extcap-interface is missing")?;
    ExtcapInterface::find_interface(name)
        .with_context(|| format!("--extcap-interface {name}: unknown; see --extcap-interfaces"))
}

/// Writes frames to the pipe until it is closed or the capture ends.
fn write_frames(call: &ExtcapCall, interface: &ExtcapInterface) -> Result<ExitStatus, Refusal> {
    let usage = |error| (ExitStatus::Usage, error);
    let pipe = call.fifo.as_deref().context("--capture: --fifo is missing").map_err(usage)?;
    let words = command_words(call, interface, pipe.as_os_str().to_owned()).map_err(usage)?;
    if matches!(interface, ExtcapInterface::File) {
        let arguments: ConvertArgs = parse_words("convert", words).map_err(|error| usage(error.into()))?;
        return Ok(convert::run(&arguments));
    }
    let arguments: LiveArgs = parse_words("live", words).map_err(|error| usage(error.into()))?;
    live::commented(&arguments, pipe)
}

/// The options of `convert` or `live` that do the same on the command line.
fn command_words(
    call: &ExtcapCall,
    interface: &ExtcapInterface,
    pipe: OsString,
) -> anyhow::Result<Vec<OsString>> {
    let mut words: Vec<OsString> = Vec::new();
    let source = match interface {
        ExtcapInterface::File => {
            let file = call.file.as_ref().context("no capture selected in the options of the interface")?;
            words.extend(["--comments", "-f", "pcapng", "-o"].map(OsString::from));
            words.push(pipe);
            file.as_os_str().to_owned()
        }
        ExtcapInterface::Source => {
            let source = call.source.as_ref().context("no source given in the options of the interface")?;
            words.push("--follow".into());
            source.into()
        }
        ExtcapInterface::Can(name) => name.into(),
    };
    for node in call.node.iter().flat_map(|nodes| nodes.split_whitespace()) {
        words.extend(["--node".into(), node.into()]);
    }
    for (option, file) in [("--bus", &call.bus), ("--dbc", &call.dbc)] {
        if let Some(file) = file.as_ref().filter(|file| !file.as_os_str().is_empty()) {
            words.extend([option.into(), file.as_os_str().to_owned()]);
        }
    }
    if let Some(filter) = call.extcap_capture_filter.as_ref().filter(|filter| !filter.is_empty()) {
        match interface {
            ExtcapInterface::File => words.extend(["--filter".into(), filter.into()]),
            ExtcapInterface::Can(_) | ExtcapInterface::Source => {
                bail!(
                    "capture filter {filter}: only for a capture; use the filters of the source: can0,123:7FF"
                )
            }
        }
    }
    words.extend(["--".into(), source]);
    Ok(words)
}
