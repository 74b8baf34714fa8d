//! Runs the program of `--on-trigger`, without delaying the recording.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;

use crate::run::messages::print_note;

/// Maximum number of captures that wait for the program.
const WAITING: usize = 100;

/// Interval between two checks whether the program has ended.
const POLL: Duration = Duration::from_millis(50);

/// Time that the program has after the end of the recording; then it continues alone.
const PATIENCE: Duration = Duration::from_secs(5);

/// The program, run once per capture on its own thread.
pub(super) struct ProgramRunner {
    program: PathBuf,
    captures: SyncSender<PathBuf>,
    is_ending: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl ProgramRunner {
    /// Starts the thread.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub(super) fn start(program: &Path) -> anyhow::Result<Self> {
        let (captures, inbox) = sync_channel(WAITING);
        let is_ending = Arc::new(AtomicBool::new(false));
        let (own, ends) = (program.to_owned(), Arc::clone(&is_ending));
        let thread = std::thread::Builder::new().name("on-trigger".into());
        let thread = thread.spawn(move || run_all(&own, &inbox, &ends)).context("cannot start a thread")?;
        Ok(Self { program: program.to_owned(), captures, is_ending, thread })
    }

    /// Runs the program for a capture after those before it.
    pub(super) fn run(&self, capture: &Path) {
        if self.captures.try_send(capture.to_owned()).is_err() {
            print_note(&format!(
                "--on-trigger {}: not run for {}; {WAITING} captures wait for it",
                self.program.display(),
                capture.display()
            ));
        }
    }

    /// Runs the program for the captures that wait; waits only briefly for its end.
    pub(super) fn finish(self) {
        let Self { captures, is_ending, thread, .. } = self;
        is_ending.store(true, Ordering::Relaxed);
        drop(captures);
        // A panic of the thread is already printed.
        let _ = thread.join();
    }
}

fn run_all(program: &Path, inbox: &Receiver<PathBuf>, is_ending: &AtomicBool) {
    let mut ending_since = None;
    for capture in inbox {
        let place = format!("--on-trigger {}: ", program.display());
        let capture_shown = capture.display();
        let mut command = Command::new(program);
        // Its output must not mix with JSON lines on stdout.
        command.arg(&capture).stdin(Stdio::null()).stdout(std::io::stderr());
        #[cfg(unix)]
        {
            // Ctrl-C ends the recording, not the program.
            std::os::unix::process::CommandExt::process_group(&mut command, 0);
        }
        #[cfg(windows)]
        {
            /// CREATE_NEW_PROCESS_GROUP: the same on Windows.
            const NEW_GROUP: u32 = 0x0200;
            std::os::windows::process::CommandExt::creation_flags(&mut command, NEW_GROUP);
        }
        match command.spawn() {
            Err(error) => print_note(&format!("{place}{error}; not run for {capture_shown}")),
            Ok(child) => match wait(child, is_ending, &mut ending_since) {
                Some(Ok(status)) if status.success() => (),
                Some(Ok(status)) => print_note(&format!("{place}{status} for {capture_shown}")),
                Some(Err(error)) => print_note(&format!("{place}{error} for {capture_shown}")),
                None => print_note(&format!("{place}still running for {capture_shown}")),
            },
        }
    }
}

/// Waits for a program; `None` if it runs longer than [`PATIENCE`] after the end of the recording.
fn wait(
    mut child: Child,
    is_ending: &AtomicBool,
    ending_since: &mut Option<Instant>,
) -> Option<std::io::Result<std::process::ExitStatus>> {
    loop {
        match child.try_wait() {
            Ok(None) => (),
            Ok(Some(status)) => return Some(Ok(status)),
            Err(error) => return Some(Err(error)),
        }
        if is_ending.load(Ordering::Relaxed) {
            let since = *ending_since.get_or_insert_with(Instant::now);
            if since.elapsed() >= PATIENCE {
                return None;
            }
        }
        std::thread::sleep(POLL);
    }
}
