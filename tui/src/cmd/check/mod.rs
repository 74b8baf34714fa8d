//! `cobscope check`: captures judged by rules.

mod captures;
mod judge;

use std::io::{ErrorKind, Write as _};
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::finding::Severity;
use cobscope_decoder::rules::Setup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::findings::baseline::Baseline;
use cobscope_decoder::sink::findings::text::{self, TextOptions};
use cobscope_decoder::sink::findings::{Report, github, jsonl, junit, sarif};

use super::input::{catalogue, common_catalogue, options_of, setup};
use super::{complain, is_colored, output};
use crate::cli::{CheckArgs, FailOn, FindingFormat};
use crate::exit_code::Exit;

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

/// An error with the exit status it brings.
type Refusal = (Exit, anyhow::Error);

fn checked(arguments: &CheckArgs) -> Result<Exit, Refusal> {
    let (options, setup) = ready(arguments).map_err(|error| (Exit::Profile, error))?;
    for rule in &arguments.require_exercised {
        let known = setup.check_name(rule).map_err(anyhow::Error::msg);
        known.context("--require-exercised").map_err(|error| (Exit::Usage, error))?;
    }
    let baseline = match &arguments.baseline {
        Some(path) if !arguments.update_baseline => {
            Some(read_baseline(path).map_err(|error| (Exit::Profile, error))?)
        }
        _ => None,
    };
    // A file that cannot be written is said before hours of work.
    let mut output = output(arguments.output.as_deref()).map_err(|error| (Exit::Usage, error))?;

    let captures = captures::captures(&arguments.input.captures);
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
        let _ = writeln!(std::io::stderr(), "cobscope: {said}");
    }
    let least = match arguments.fail_on {
        FailOn::Error => Some(Severity::Error),
        FailOn::Warning => Some(Severity::Warning),
        FailOn::Never => None,
    };
    let captures = judged.into_iter().filter_map(|one| one.judged).collect();
    let mut report = Report { captures, least, ..Report::default() };
    report.require(&arguments.require_exercised);
    match (baseline, &arguments.baseline) {
        (Some(baseline), _) => baseline.compare(&mut report),
        (None, Some(path)) => {
            write_baseline(path, &mut report).map_err(|error| (Exit::Usage, error))?;
        }
        (None, None) => {}
    }
    if report.fails() {
        exit = exit.max(Exit::Findings);
    }
    let text = written(&report, arguments);
    match output.write_all(text.as_bytes()).and_then(|()| output.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            complain(&anyhow::Error::from(error).context("writing failed"));
            Ok(exit.max(Exit::Capture))
        }
        _ => Ok(exit),
    }
}

/// What the options say of buses and rules.
fn ready(arguments: &CheckArgs) -> anyhow::Result<(SessionOptions, Arc<Setup>)> {
    let folders = &arguments.input.profiles;
    let catalogue = if arguments.user_profiles { catalogue(folders) } else { common_catalogue(folders) };
    let options = options_of(&arguments.input, catalogue)?;
    let setup = setup(&arguments.input, &options.catalogue, arguments.today)?;
    Ok((options, Arc::new(setup)))
}

fn written(report: &Report, arguments: &CheckArgs) -> String {
    let mut text = String::new();
    match arguments.format {
        FindingFormat::Text => {
            let color = is_colored(arguments.color, arguments.output.is_some());
            let options = TextOptions { color, verbose: arguments.verbose, coverage: arguments.coverage };
            text::write(report, options, &mut text);
        }
        FindingFormat::Jsonl => jsonl::write(report, &mut text),
        FindingFormat::Junit => junit::write(report, &mut text),
        FindingFormat::Sarif => sarif::write(report, &mut text),
        FindingFormat::Github => github::write(report, &mut text),
    }
    text
}

fn read_baseline(path: &Path) -> anyhow::Result<Baseline> {
    let name = path.display();
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("{name}: cannot be read (--update-baseline writes it)"))?;
    Baseline::parse(&text).map_err(|error| anyhow::anyhow!("{name}: is no baseline: {}", escape(&error)))
}

/// Writes what was found, which is accepted from now on.
fn write_baseline(path: &Path, report: &mut Report) -> anyhow::Result<()> {
    let baseline = Baseline::of(report);
    std::fs::write(path, baseline.text())
        .with_context(|| format!("{}: cannot be written", path.display()))?;
    baseline.compare(report);
    Ok(())
}
