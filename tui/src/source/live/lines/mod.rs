//! Captures that are still being written: text on standard input, a growing file.
//!
//! Reading and parsing happen in another thread, because neither a pipe nor a growing file reports when more
//! data will arrive. The thread is at most a few batches ahead.

mod follow;
mod outlet;
#[cfg(test)]
mod tests;

use std::io::Read;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use cobscope_decoder::capture::{BATCH_FRAMES, BusNames, CaptureError, Notice, ReadOptions};
use cobscope_decoder::frame::LinkState;

use super::{Arrival, Arrivals, BusStatus, LiveSource, SourceClock, SourceEnd};
use outlet::{ThreadDelivery, ThreadOutlet};

/// Maximum delay of frames: an ssh connection stalls, a writer buffers lines.
const LAG: Duration = Duration::from_secs(1);

/// Maximum number of frames and notices per delivery.
const MOST: usize = 4_096;

/// Maximum number of batches read ahead.
const AHEAD: usize = MOST / BATCH_FRAMES;

/// Frames from standard input, in any format that can be read while it is written.
///
/// Relative candump timestamps need many lines for an interpretation: without the option that selects it, the
/// first 1,000 lines are held back.
///
/// # Errors
/// A thread cannot be started.
pub fn stdin(options: ReadOptions) -> anyhow::Result<Box<dyn LiveSource>> {
    Ok(Box::new(Lines::read(std::io::stdin(), options)?))
}

/// Frames of a growing file from its start, and of its replacements.
///
/// # Errors
/// A thread cannot be started.
pub fn follow(path: &Path, options: ReadOptions) -> anyhow::Result<Box<dyn LiveSource>> {
    let path = path.to_path_buf();
    Ok(Box::new(Lines::start(move |outlet| follow::follow_file(&path, &options, outlet))?))
}

/// A source of text.
struct Lines {
    deliveries: Receiver<ThreadDelivery>,
    /// Ends the thread.
    is_over: Arc<AtomicBool>,
    names: BusNames,
    /// Number of lost frames per bus, as stated by the text.
    lost: Vec<u64>,
    ended: Option<SourceEnd>,
}

impl Lines {
    /// Reads `source` to its end.
    fn read(source: impl Read + Send + 'static, options: ReadOptions) -> anyhow::Result<Self> {
        Self::start(move |outlet| match outlet.pump_capture(source, &options) {
            // A pipe that was closed without data.
            Ok(()) | Err(CaptureError::Empty) => SourceEnd::Complete,
            Err(error) => SourceEnd::Failed(anyhow::Error::new(error).context("standard input")),
        })
    }

    fn start(work: impl FnOnce(&mut ThreadOutlet) -> SourceEnd + Send + 'static) -> anyhow::Result<Self> {
        let (give, deliveries) = mpsc::sync_channel(AHEAD);
        let is_over = Arc::new(AtomicBool::new(false));
        let mut outlet = ThreadOutlet::new(give, Arc::clone(&is_over));
        let work = move || {
            let ended = work(&mut outlet);
            // The receiver may have ended.
            outlet.report_end(ended);
        };
        std::thread::Builder::new().name("lines".into()).spawn(work).context("cannot start a thread")?;
        Ok(Self { deliveries, is_over, names: BusNames::default(), lost: Vec::new(), ended: None })
    }

    fn take(&mut self, names: BusNames, items: Vec<Arrival>, arrivals: &mut Arrivals) {
        self.names = names;
        self.lost.resize(self.names.names().len(), 0);
        for item in &items {
            if let Arrival::Notice(Notice::LostFrames { bus, count, .. }) = item
                && let Some(lost) = self.lost.get_mut(usize::from(bus.0))
            {
                *lost = lost.saturating_add(count.unwrap_or(1));
            }
        }
        arrivals.items.extend(items);
    }
}

impl LiveSource for Lines {
    fn receive_items(&mut self, arrivals: &mut Arrivals, wait: Duration) -> Result<(), SourceEnd> {
        let begin = Instant::now();
        let before = arrivals.items.len();
        // A delivery contains at most as many frames, and as many notices, as a batch.
        let most = before.saturating_add(MOST - 2 * BATCH_FRAMES);
        while self.ended.is_none() && arrivals.items.len() <= most {
            // Only the first delivery is waited for.
            let left = if arrivals.items.len() > before {
                Duration::ZERO
            } else {
                wait.saturating_sub(begin.elapsed())
            };
            match self.deliveries.recv_timeout(left) {
                Ok(ThreadDelivery::Items(names, items)) => self.take(names, items, arrivals),
                Ok(ThreadDelivery::Ended(ended)) => self.ended = Some(ended),
                Err(RecvTimeoutError::Timeout) => break,
                Err(RecvTimeoutError::Disconnected) => self.ended = Some(SourceEnd::Complete),
            }
        }
        if arrivals.names != self.names {
            arrivals.names = self.names.clone();
        }
        match self.ended.take() {
            Some(ended) if arrivals.items.len() == before => Err(ended),
            ended => {
                self.ended = ended;
                Ok(())
            }
        }
    }

    fn bus_status(&mut self) -> Vec<BusStatus> {
        let status = |(name, lost): (&String, &u64)| BusStatus {
            name: name.clone(),
            state: LinkState::Up,
            bit_rate: None,
            controller: None,
            mode: None,
            stamps: SourceClock::Recorded,
            lost: *lost,
        };
        self.names.names().iter().zip(&self.lost).map(status).collect()
    }

    fn max_lag(&self) -> Duration {
        LAG
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}
