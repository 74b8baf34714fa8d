//! Progress of a long file on standard error, if that is a terminal.

use std::io::{IsTerminal as _, Write as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// File size from which progress is shown.
const LONG: u64 = 64 * 1024 * 1024;

/// Number of bytes between two updates.
const STEP: u64 = 8 * 1024 * 1024;

/// The progress line.
pub struct ProgressLine {
    size: u64,
    taken: Arc<AtomicU64>,
    next: u64,
    shown: bool,
}

impl ProgressLine {
    /// Progress of a file of `size` bytes, of which `taken` are read; hidden if standard error is not a
    /// terminal.
    pub fn new(size: Option<u64>, taken: Arc<AtomicU64>) -> Self {
        let size = size.unwrap_or(0);
        let seen = size >= LONG && std::io::stderr().is_terminal();
        Self { size, taken, next: if seen { STEP } else { u64::MAX }, shown: false }
    }

    /// Hides the progress, so that it does not disturb text on the same terminal.
    pub fn hide_line(&mut self) {
        self.next = u64::MAX;
    }

    /// Updates the line at intervals.
    pub fn update_line(&mut self) {
        let taken = self.taken.load(Ordering::Relaxed);
        if taken < self.next {
            return;
        }
        self.next = taken.saturating_add(STEP);
        self.shown = true;
        let percent = taken.saturating_mul(100) / self.size.max(1);
        let _ = write!(std::io::stderr(), "\r{percent:>3} % of {} MiB", self.size / 1024 / 1024);
    }

    /// Removes the line.
    pub fn remove_line(&mut self) {
        if std::mem::take(&mut self.shown) {
            let _ = write!(std::io::stderr(), "\r\x1b[K");
        }
    }
}
