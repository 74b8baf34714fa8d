//! `cobscope decode`: captures to events.

use std::sync::Arc;

use super::decoding::decode_capture;
use super::input::{captures, check_rules_of, session_options, setup};
use super::messages::complain;
use super::output::{files_read, told};
use super::print::{Judging, Printer, engine};
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
    // Which files are read a bus file says too, so that one must be right before anything is written.
    let mut printer = match Printer::new(&arguments.print, &arguments.select, &files_read(&arguments.input)) {
        Ok(printer) => printer,
        Err(error) => {
            complain(&error);
            return Exit::Usage;
        }
    };
    printer.describe(&arguments.input);
    let captures = captures(&arguments.input);
    let several = captures.len() > 1;
    let mut exit = Exit::Clean;
    for path in &captures {
        if several {
            printer.begin_capture(&path.display().to_string());
        }
        let mut judging = Judging { engine: engine(&arguments.print, &setup), printer: &mut printer };
        let failure = match decode_capture(path, &arguments.input, &options, &mut judging) {
            Ok(decoded) => {
                judging.finish(decoded.decoder.buses());
                if !printer.has_events() {
                    decoded.tell_unreadable(path);
                }
                let (frame, last) = (decoded.decoder.frames(), decoded.decoder.last_time());
                if let Some(missed) = printer.missed(frame, last) {
                    complain(&anyhow::anyhow!("{}: {missed}", path.display()));
                }
                decoded.failure
            }
            Err(error) => Some(error),
        };
        if let Some(error) = failure {
            // What was decoded stands before what went wrong.
            let _ = printer.flush();
            complain(&error);
            exit = exit.max(Exit::Capture);
        }
        if printer.is_done() {
            break;
        }
    }
    exit.max(told(printer.finish()))
}
