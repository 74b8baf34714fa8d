//! `cobscope decode`: prints events.

use std::sync::Arc;

use cobscope_decoder::session::Buses;

use super::decoding::decode_capture;
use super::input::{check_rules_of, series, session_options, setup};
use super::messages::{complain, note};
use super::output::{files_read, write_result};
use super::print::{JudgingObserver, Printer, engine};
use super::remarks;
use crate::cli::DecodeArgs;
use crate::exit_code::Exit;

/// Runs the command.
pub fn run(arguments: &DecodeArgs) -> Exit {
    let ready = session_options(&arguments.input)
        .and_then(|options| Ok((setup(&arguments.input, &options.catalogue, None)?, options)));
    let (options, setup) = match ready {
        Ok((setup, options)) => (options, Arc::new(setup)),
        Err(error) => {
            complain(&error);
            return Exit::Profile;
        }
    };
    if let Err(error) = check_rules_of(arguments.select.filter.as_ref(), &setup) {
        complain(&error);
        return Exit::Usage;
    }
    // The bus file names further input files, so it must be valid before the output is opened.
    let mut printer =
        match Printer::new(&arguments.print, &arguments.select, false, &files_read(&arguments.input)) {
            Ok(printer) => printer,
            Err(error) => {
                complain(&error);
                return Exit::Usage;
            }
        };
    printer.describe(&arguments.input);
    let captures = series(&arguments.input);
    let several = captures.len() > 1;
    let mut exit = Exit::Clean;
    for capture in &captures {
        let name = capture.name();
        if several {
            printer.begin_capture(&name);
        }
        let mut judging = JudgingObserver { engine: engine(&arguments.print, &setup), printer: &mut printer };
        let failure = match decode_capture(capture, &arguments.input, &options, &mut judging) {
            Ok(decoded) => {
                judging.finish(decoded.decoder.buses());
                if !printer.is_done() {
                    decoded.report_unreadable(&name);
                }
                let (frame, last) = (decoded.decoder.frames(), decoded.decoder.last_time());
                if let Some(missed) = printer.missed(frame, last) {
                    complain(&anyhow::anyhow!("{name}: {missed}"));
                }
                let buses = decoded.decoder.buses();
                print_remarks(&name, buses, printer.hides_notes());
                decoded.failure
            }
            Err(error) => Some(error),
        };
        if let Some(error) = failure {
            // Print decoded events before the error.
            let _ = printer.flush();
            complain(&error);
            exit = exit.max(Exit::Capture);
        }
        if printer.is_done() {
            break;
        }
    }
    exit.max(write_result(printer.finish()))
}

/// Prints suggested profiles, and frames without values if the output format has no notes.
fn print_remarks(name: &str, buses: Buses<'_>, hides_notes: bool) {
    let mut texts = remarks::profiles(name, buses);
    if hides_notes {
        texts.extend(remarks::without_values(name, buses));
    }
    for text in &texts {
        note(text);
    }
}
