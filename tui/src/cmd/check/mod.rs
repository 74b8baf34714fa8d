//! `cobscope check`: captures judged by rules.

use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;

use cobscope_decoder::event::Event;
use cobscope_decoder::finding::Severity;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::rules::{Engine, Setup};
use cobscope_decoder::session::{Bus, Observer, SessionOptions};
use cobscope_decoder::sink::findings::{Judged, text};

use super::input::{captures, session_options, setup};
use super::{Watcher, complain, decode_capture};
use crate::cli::{CheckArgs, FailOn, InputArgs};
use crate::exit_code::Exit;

/// Runs the command.
pub fn run(arguments: &CheckArgs) -> Exit {
    let today = jiff::Zoned::now().date().to_string();
    let ready = session_options(&arguments.input)
        .and_then(|options| Ok((options, setup(&arguments.input, Some(today))?)));
    let (options, setup) = match ready {
        Ok((options, setup)) => (options, Arc::new(setup)),
        Err(error) => {
            complain(&error);
            return Exit::Profile;
        }
    };
    let mut exit = Exit::Clean;
    let mut output = String::new();
    for path in captures(&arguments.input) {
        match judge(&path, &arguments.input, &options, &setup) {
            Ok(judged) => {
                text::write(&judged, &mut output);
                if fails(&judged, arguments.fail_on) {
                    exit = exit.max(Exit::Findings);
                }
                if judged.failure.is_some() {
                    exit = exit.max(Exit::Capture);
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

fn fails(judged: &Judged, fail_on: FailOn) -> bool {
    let least = match fail_on {
        FailOn::Error => Severity::Error,
        FailOn::Warning => Severity::Warning,
        FailOn::Never => return false,
    };
    judged.findings.counting().any(|group| group.severity >= least)
}

/// Judges one capture.
fn judge(
    path: &Path,
    input: &InputArgs,
    options: &SessionOptions,
    setup: &Arc<Setup>,
) -> anyhow::Result<Judged> {
    let mut watch = Watch { engine: Engine::new(Arc::clone(setup)), first: None, last: None };
    let decoded = decode_capture(path, input, options, &mut watch)?;
    if let Some(failure) = &decoded.failure {
        complain(failure);
    }
    let Watch { engine, first, last } = watch;
    let findings = engine.finish(decoded.decoder.buses(), &mut |_: &Event, _: &Bus| {});
    Ok(Judged {
        capture: path.display().to_string(),
        frames: decoded.decoder.frames(),
        first,
        last,
        findings,
        failure: decoded.failure.map(|failure| format!("{failure:#}")),
    })
}

/// Feeds the engine.
struct Watch {
    engine: Engine,
    first: Option<Timestamp>,
    last: Option<Timestamp>,
}

impl Observer for Watch {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.engine.event(event, bus, &mut |_: &Event, _: &Bus| {});
    }
}

impl Watcher for Watch {
    fn begin(&mut self, first: &Frame) -> anyhow::Result<()> {
        self.first = first.time;
        Ok(())
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame) -> bool {
        self.last = frame.time;
        self.engine.frame(frame);
        true
    }
}
