//! `cobscope decode`: prints events.

use std::sync::Arc;

use clap::Args;
use cobscope_decoder::reading::{Borrowed, ReadingPart as _};
use cobscope_decoder::session::Buses;

use crate::exit_code::ExitStatus;
use crate::run::arguments::{InputArgs, SelectArgs, examples};
use crate::run::capture_job::CaptureJob;
use crate::run::input::{build_setup, capture_series, check_rules_of, session_options};
use crate::run::messages::{print_error, print_note, print_warning};
use crate::run::output::{files_read, write_result};
use crate::run::print::{EventPrinter, PrintArgs, prints_findings};
use crate::run::remarks;

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope decode customer.log",
    "cobscope decode --filter 'kind == emcy && node == 5' --from 10 --to 60 customer.log",
    "cobscope decode -f csv -o values.csv --node 2=rexroth-sydfec customer.log",
];

/// Print events, one line per event
///
/// Columns: seconds from the first frame, node (or source → destination), kind, description, {frames}. A
/// ? marks presumed values. Lines of further buses start with the bus name. Repeated events (heartbeat,
/// SYNC, unchanged PDOs) are omitted; --all prints them.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct DecodeArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub select: SelectArgs,
    #[command(flatten)]
    pub print: PrintArgs,
}

/// Runs the command.
pub fn run(arguments: &DecodeArgs) -> ExitStatus {
    let ready = session_options(&arguments.input)
        .and_then(|options| Ok((build_setup(&arguments.input, &options.catalogue, None)?, options)));
    let (options, setup) = match ready {
        Ok((setup, options)) => (options, Arc::new(setup)),
        Err(error) => {
            print_error(&error);
            return ExitStatus::Profile;
        }
    };
    if let Err(error) = check_rules_of(arguments.select.filter.as_ref(), &setup) {
        print_error(&error);
        return ExitStatus::Usage;
    }
    // The bus file names further input files, so it must be valid before the output is opened.
    let mut printer =
        match EventPrinter::new(&arguments.print, &arguments.select, false, &files_read(&arguments.input)) {
            Ok(printer) => printer,
            Err(error) => {
                print_error(&error);
                return ExitStatus::Usage;
            }
        };
    printer.describe(&arguments.input);
    let captures = capture_series(&arguments.input);
    let several = captures.len() > 1;
    let mut exit = ExitStatus::Clean;
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
                read.warnings.iter().for_each(|text| print_warning(text));
                if let Some(text) = read.unreadable.as_ref().filter(|_| !read.summary.part.is_done()) {
                    print_warning(text);
                }
                let (frame, last) = (read.summary.frames(), read.summary.last_time());
                if let Some(missed) = read.summary.part.0.missed(frame, last) {
                    print_error(&anyhow::anyhow!("{name}: {missed}"));
                }
                print_remarks(&name, read.summary.buses(), read.summary.part.0.hides_notes());
                read.failure
            }
            Err(error) => Some(error),
        };
        if let Some(error) = failure {
            // Print decoded events before the error.
            let _ = printer.flush();
            print_error(&error);
            exit = exit.max(ExitStatus::Capture);
        }
        if printer.is_done() {
            break;
        }
    }
    exit.max(write_result(printer.finish()))
}

/// Prints suggested profiles, and frames without values if the output format has no notes.
fn print_remarks(name: &str, buses: Buses<'_>, hides_notes: bool) {
    let mut texts = remarks::possible_profiles(name, buses);
    if hides_notes {
        texts.extend(remarks::without_values(name, buses));
    }
    for text in &texts {
        print_note(text);
    }
}
