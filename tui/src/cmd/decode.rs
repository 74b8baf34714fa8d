//! `cobscope decode`: prints events.

use std::sync::Arc;

use cobscope_decoder::reading::{Borrowed, ReadingPart as _};
use cobscope_decoder::session::Buses;

use super::decoding::CaptureJob;
use super::input::{check_rules_of, series, session_options, setup};
use super::messages::{complain, note, warn};
use super::output::{files_read, write_result};
use super::print::{Printer, prints_findings};
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
        let setup = prints_findings(&arguments.print).then_some(&setup);
        let job = CaptureJob::new(capture, &arguments.input, &options, setup).quiet(printer.is_on_terminal());
        let read = job.read_from(Borrowed(&mut printer), |printer, first, span| printer.0.begin(first, span));
        let failure = match read {
            Ok(read) => {
                read.warnings.iter().for_each(|text| warn(text));
                if let Some(text) = read.unreadable.as_ref().filter(|_| !read.summary.part.is_done()) {
                    warn(text);
                }
                let (frame, last) = (read.summary.frames(), read.summary.last_time());
                if let Some(missed) = read.summary.part.0.missed(frame, last) {
                    complain(&anyhow::anyhow!("{name}: {missed}"));
                }
                print_remarks(&name, read.summary.buses(), read.summary.part.0.hides_notes());
                read.failure
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
