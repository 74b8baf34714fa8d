//! `cobscope check`: captures judged by rules.

mod captures;
mod judge;
mod known;

use std::io::{self, Write};
use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::rules::Setup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::findings::{Report, TextOptions};

use super::input::{catalogue, common_catalogue, options_of, setup};
use super::messages::{Refusal, complain};
use super::output::{ensure_not_read, files_read, is_colored, output, told};
use crate::cli::CheckArgs;
use crate::exit_code::Exit;
use captures::Source;
use known::Known;

/// Runs the command.
pub fn run(arguments: &CheckArgs) -> Exit {
    match checked(arguments) {
        Ok(exit) => exit,
        Err((exit, error)) => {
            complain(&error);
            exit
        }
    }
}

fn checked(arguments: &CheckArgs) -> Result<Exit, Refusal> {
    let (options, setup) = ready(arguments).map_err(|error| (Exit::Profile, error))?;
    for rule in &arguments.require_exercised {
        let known = setup.check_name(rule).map_err(anyhow::Error::msg);
        known.context("--require-exercised").map_err(|error| (Exit::Usage, error))?;
    }
    let captures = captures_to_read(arguments).map_err(|error| (Exit::Usage, error))?;
    let known = Known::read(arguments)?;
    // A file that cannot be written is said before hours of work.
    let mut output =
        output(arguments.output.as_deref(), &arguments.baseline).map_err(|error| (Exit::Usage, error))?;

    let judged = judge::judge_all(&captures, arguments, &options, &setup);
    let mut exit = Exit::Clean;
    let mut said: Vec<String> = judged.iter().flat_map(|one| one.said.clone()).collect();
    let found: Vec<_> = captures.iter().zip(&judged).filter(|(_, one)| one.judged.is_some()).collect();
    let found: Vec<_> = found.into_iter().map(|(source, _)| source).collect();
    let empty = captures::without_captures(&arguments.input.captures, &found);
    if !empty.is_empty() || judged.iter().any(|one| one.has_failed) {
        exit = exit.max(Exit::Capture);
    }
    said.extend(empty.iter().map(|folder| format!("{}: holds no capture", folder.display())));
    for said in said {
        let _ = writeln!(io::stderr(), "cobscope: {said}");
    }
    let captures = judged.into_iter().filter_map(|one| one.judged).collect();
    let mut report = Report { captures, least: arguments.fail_on.least(), ..Report::default() };
    report.require(&arguments.require_exercised);
    known.apply(&mut report, exit).map_err(|error| (Exit::Usage, error))?;
    if report.fails() {
        exit = exit.max(Exit::Findings);
    }
    let written = write(&report, arguments, &mut output).and_then(|()| output.flush());
    Ok(exit.max(told(written)))
}

/// The captures to judge, of which nothing is written over. What is written into a folder is no capture of it.
fn captures_to_read(arguments: &CheckArgs) -> anyhow::Result<Vec<Source>> {
    let mut captures = captures::captures(&arguments.input.captures);
    let baseline = arguments.baseline.iter().filter(|_| arguments.update_baseline);
    for path in arguments.output.iter().chain(baseline) {
        ensure_not_read(path, &files_read(&arguments.input))?;
        for source in &captures {
            let other = ensure_not_read(path, [&source.path]);
            if other.is_err() && judge::is_capture(source, &arguments.input) {
                other?;
            }
        }
        captures.retain(|source| ensure_not_read(path, [&source.path]).is_ok());
    }
    Ok(captures)
}

/// What the options say of buses and rules.
fn ready(arguments: &CheckArgs) -> anyhow::Result<(SessionOptions, Arc<Setup>)> {
    let folders = &arguments.input.profiles;
    let catalogue = if arguments.user_profiles { catalogue(folders) } else { common_catalogue(folders) };
    let options = options_of(&arguments.input, catalogue)?;
    let setup = setup(&arguments.input, &options.catalogue, arguments.today)?;
    Ok((options, Arc::new(setup)))
}

fn write(report: &Report, arguments: &CheckArgs, output: &mut dyn Write) -> io::Result<()> {
    let color = is_colored(arguments.color, arguments.output.is_some());
    let options = TextOptions { color, verbose: arguments.verbose, coverage: arguments.coverage };
    (arguments.format.write)(report, options, output)
}
