//! `cobscope lake`: tables of many captures.
//!
//! ```text
//! captures ─▶ content (hash) ─▶ add (decode, rules) ─▶ folder: _staging ─▶ TABLE/machine=…/day=…/HASH.parquet
//! ```

mod add;
mod arguments;
mod content;
mod folder;
mod machine;

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::available_parallelism;

use cobscope_decoder::words::{count_noun, group_digits};

use self::add::{AddInputs, LakeAddition};
use self::folder::{LakeFolder, ensure_lake};
use crate::exit_code::ExitStatus;
use crate::path_text::path_text;
use crate::run::captures::{self, SourceSeries};
use crate::run::input::{build_setup, common_catalogue, load_catalogue, options_of, with_user_folder};
use crate::run::messages::{Refusal, print_error, print_note, print_warning};
use crate::run::output::print_text;
pub use arguments::{LakeAddArgs, LakeArgs, LakeCommand};

/// Runs the command.
pub fn run(arguments: &LakeArgs) -> ExitStatus {
    let LakeCommand::Add(arguments) = &arguments.command;
    match run_add(arguments) {
        Ok(exit) => exit,
        Err((exit, error)) => {
            print_error(&error);
            exit
        }
    }
}

fn run_add(arguments: &LakeAddArgs) -> Result<ExitStatus, Refusal> {
    let usage = |error| (ExitStatus::Usage, error);
    let folders = &arguments.input.profiles;
    let profile = |error| (ExitStatus::Profile, with_user_folder(error, folders));
    if arguments.input.captures.is_empty() {
        return Err(usage(anyhow::anyhow!("found no capture, expected files or folders after the lake")));
    }
    if arguments.input.captures.iter().any(|path| path.as_os_str() == "-") {
        return Err(usage(anyhow::anyhow!(
            "a lake needs a capture twice; stdin cannot be read again, give a file"
        )));
    }
    let catalogue = if arguments.user_profiles { load_catalogue(folders) } else { common_catalogue(folders) };
    let options = options_of(&arguments.input, catalogue).map_err(profile)?;
    let setup = Arc::new(build_setup(&arguments.input, &options.catalogue, None).map_err(profile)?);
    machine::check_names(arguments, options.bus_file.machine.as_deref())?;
    ensure_lake(&arguments.lake).map_err(usage)?;
    let lake = LakeFolder::open(&arguments.lake).map_err(usage)?;
    let mut sources = captures::captures(&arguments.input.captures);
    let own = arguments.lake.canonicalize().ok();
    // The lake may be in the folder of the captures.
    sources.retain(|source| {
        own.as_ref().is_none_or(|own| !source.path.canonicalize().is_ok_and(|path| path.starts_with(own)))
    });
    let captures = captures::series(&sources, &arguments.input);
    let wanted = arguments.threads.or_else(|| available_parallelism().ok()).map_or(1, usize::from);
    let threads = wanted.min(captures.len()).max(1);
    let inputs =
        AddInputs { lake: &lake, arguments, options: &options, setup: &setup, is_alone: threads == 1 };
    let counts = add_all(&inputs, &captures, threads);
    let text = format!("{}: {}\n", path_text(&arguments.lake), counts.text());
    let exit = counts.exit();
    if counts.found() == 0 {
        print_warning("no captures");
        return Ok(ExitStatus::Capture);
    }
    Ok(exit.max(print_text(text.as_bytes())))
}

/// Numbers of captures by result.
#[derive(Default)]
struct AdditionCounts {
    added: usize,
    present: usize,
    /// Captures that were not read, or not to their end; those with a row in `captures` count as added, too.
    failed: usize,
    /// Captures for which the option names no machine.
    unnamed: usize,
}

impl AdditionCounts {
    fn found(&self) -> usize {
        self.added + self.present + self.failed + self.unnamed
    }

    fn exit(&self) -> ExitStatus {
        match self {
            Self { failed: 1.., .. } => ExitStatus::Capture,
            Self { unnamed: 1.., .. } => ExitStatus::Usage,
            _ => ExitStatus::Clean,
        }
    }

    fn text(&self) -> String {
        let mut parts = vec![format!("{} added", count_noun(self.added, "capture"))];
        if self.present > 0 {
            parts.push(format!("{} already in the lake", self.present));
        }
        if self.failed > 0 {
            parts.push(format!("{} unreadable or incomplete", self.failed));
        }
        if self.unnamed > 0 {
            parts.push(format!("{} without a machine", self.unnamed));
        }
        parts.join(", ")
    }

    fn join(mut self, other: &Self) -> Self {
        self.added = self.added.saturating_add(other.added);
        self.present = self.present.saturating_add(other.present);
        self.failed = self.failed.saturating_add(other.failed);
        self.unnamed = self.unnamed.saturating_add(other.unnamed);
        self
    }

    /// Adds and prints the result of a capture.
    fn count(&mut self, source: &SourceSeries, result: anyhow::Result<LakeAddition>) {
        let name = source.series.name();
        match result {
            Ok(LakeAddition::Added(one)) => {
                self.added += 1;
                self.failed += usize::from(one.failure.is_some());
                one.warnings.iter().for_each(|text| print_warning(text));
                if let Some(failure) = &one.failure {
                    print_warning(failure);
                }
                print_note(&format!(
                    "{name}: added to machine {}: {} {}, {}, {}",
                    one.machine,
                    group_digits(one.frames),
                    if one.frames == 1 { "frame" } else { "frames" },
                    count_noun(one.files, "file"),
                    one.outcome.name()
                ));
            }
            Ok(LakeAddition::Present(entry)) => {
                self.present += 1;
                let other = if entry.capture == name {
                    String::new()
                } else {
                    format!(" as {} of machine {}", entry.capture, entry.machine)
                };
                print_note(&format!("{name}: already in the lake{other}; --replace adds it again"));
            }
            Ok(LakeAddition::Skipped) => {}
            Ok(LakeAddition::Unnamed(error)) => {
                self.unnamed += 1;
                print_error(&error);
            }
            Err(error) => {
                self.failed += 1;
                print_error(&error);
            }
        }
    }
}

/// Adds all captures, each on one of the threads.
fn add_all(inputs: &AddInputs<'_>, captures: &[SourceSeries], threads: usize) -> AdditionCounts {
    let next = AtomicUsize::new(0);
    let work = || {
        let mut counts = AdditionCounts::default();
        loop {
            let place = next.fetch_add(1, Ordering::Relaxed);
            let Some(source) = captures.get(place) else { return counts };
            counts.count(source, inputs.add(source));
        }
    };
    if threads == 1 {
        return work();
    }
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().fold(AdditionCounts::default(), |counts, worker| match worker.join() {
            Ok(own) => counts.join(&own),
            Err(panic) => std::panic::resume_unwind(panic),
        })
    })
}
