//! `cobscope stats`: who is on the bus, how often, how late.

mod json;
mod text;

use std::io::Write as _;
use std::path::Path;

use cobscope_decoder::capture::{Batch, Item};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::session::{Bus, SessionOptions};
use cobscope_decoder::statistics::Statistics;

use super::{captures, complain, read_options, session_options};
use crate::cli::{InputArgs, ReportFormat, StatsArgs};
use crate::exit_code::Exit;
use crate::source;

/// Figures of one capture and the decoder behind its last frame.
struct Report<'a> {
    capture: String,
    format: &'static str,
    statistics: Statistics,
    decoder: Decoder,
    arguments: &'a StatsArgs,
}

impl Report<'_> {
    /// Bit rate of a bus, if the user gave it: on the command line, else in the bus file.
    fn bit_rate(&self, bus: &Bus) -> Option<u32> {
        let rates = &self.arguments.bitrate;
        let own = rates.iter().find(|rate| rate.bus.as_deref() == Some(bus.name()));
        let given = own.or_else(|| rates.iter().find(|rate| rate.bus.is_none()));
        given.map(|rate| rate.rate).or_else(|| bus.bit_rate())
    }
}

/// Runs the command.
pub fn run(arguments: &StatsArgs) -> Exit {
    let options = match session_options(&arguments.input) {
        Ok(options) => options,
        Err(error) => {
            complain(&error);
            return Exit::Profile;
        }
    };
    let mut exit = Exit::Clean;
    let mut output = String::new();
    for path in captures(&arguments.input) {
        match count(&path, &arguments.input, &options) {
            Ok((statistics, decoder, format)) => {
                let capture = path.display().to_string();
                let report = Report { capture, format, statistics, decoder, arguments };
                match arguments.format {
                    ReportFormat::Text => text::write(&report, &mut output),
                    ReportFormat::Json => json::write(&report, &mut output),
                }
            }
            Err(error) => {
                complain(&error);
                exit = exit.max(Exit::Capture);
            }
        }
    }
    // A closed pipe is no failure.
    let _ = std::io::stdout().write_all(output.as_bytes());
    exit
}

fn count(
    path: &Path,
    input: &InputArgs,
    options: &SessionOptions,
) -> anyhow::Result<(Statistics, Decoder, &'static str)> {
    let mut capture = source::open(path, &read_options(input))?;
    let mut decoder = Decoder::new(options.clone());
    let mut statistics = Statistics::default();
    let mut batch = Batch::new();
    while capture.reader.read(&mut batch)? {
        for item in batch.items() {
            if let Item::Frame(frame) = item {
                statistics.frame(frame);
            }
            let mut see = |event: &Event, _: &Bus| statistics.event(event);
            match item {
                Item::Frame(frame) => decoder.push(frame, capture.reader.buses(), &mut see),
                Item::Notice(notice) => decoder.notice(notice, capture.reader.buses(), &mut see),
            }
        }
        capture.progress.tick();
    }
    capture.progress.finish();
    decoder.finish(capture.reader.buses(), &mut |event: &Event, _: &Bus| statistics.event(event));
    statistics.quality.unreadable = decoder.unreadable();
    anyhow::ensure!(statistics.quality.frames > 0, "{}: holds no frame", path.display());
    Ok((statistics, decoder, capture.reader.format().title))
}
