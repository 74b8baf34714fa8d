//! Coming back to what is gone: tries again on a thread of its own, less and less often.

use std::convert::Infallible;
use std::iter::successors;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::Duration;

use anyhow::anyhow;

/// Pause before the first attempt; each further one is twice as long.
const FIRST: Duration = Duration::from_millis(250);

/// Longest pause.
const LONGEST: Duration = Duration::from_secs(5);

/// Why an attempt failed.
#[derive(Debug)]
pub enum Setback {
    /// It is not there, or not ready: it may be later.
    Again(anyhow::Error),
    /// It is there and will not have it.
    Never(anyhow::Error),
}

impl From<Setback> for anyhow::Error {
    fn from(setback: Setback) -> Self {
        match setback {
            Setback::Again(error) | Setback::Never(error) => error,
        }
    }
}

/// The pauses before each attempt, without end.
fn pauses() -> impl Iterator<Item = Duration> {
    successors(Some(FIRST), |pause| Some((*pause * 2).min(LONGEST)))
}

/// Attempts that go on until one succeeds, or this is dropped.
pub struct Attempts<T> {
    found: Receiver<anyhow::Result<T>>,
    /// Nothing is ever sent: the thread wakes and ends when it is dropped.
    _end: Sender<Infallible>,
}

impl<T: Send + 'static> Attempts<T> {
    /// Begins to try, after the first pause.
    pub fn start(attempt: impl FnMut() -> Result<T, Setback> + Send + 'static) -> Self {
        Self::after(pauses(), attempt)
    }

    fn after(
        mut pauses: impl Iterator<Item = Duration> + Send + 'static,
        mut attempt: impl FnMut() -> Result<T, Setback> + Send + 'static,
    ) -> Self {
        let (give, found) = mpsc::sync_channel(1);
        let (end, is_over) = mpsc::channel::<Infallible>();
        let work = move || {
            let result = loop {
                let pause = pauses.next().unwrap_or(LONGEST);
                if is_over.recv_timeout(pause) != Err(RecvTimeoutError::Timeout) {
                    return;
                }
                match attempt() {
                    Ok(found) => break Ok(found),
                    Err(Setback::Never(error)) => break Err(error),
                    Err(Setback::Again(_)) => {}
                }
            };
            // Nobody waits any more: what was found is dropped, and so is closed.
            let _ = give.send(result);
        };
        // Without a thread the channel is closed, which `wait` tells.
        let _ = std::thread::Builder::new().name("reconnect".into()).spawn(work);
        Self { found, _end: end }
    }

    /// What was found, waiting for it at most `wait`; `None` while there is nothing.
    pub fn wait(&self, wait: Duration) -> Option<anyhow::Result<T>> {
        match self.found.recv_timeout(wait) {
            Ok(result) => Some(result),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => Some(Err(anyhow!("the thread that reconnects has ended"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Duration = Duration::from_secs(20);

    #[test]
    fn pauses_double_up_to_five_seconds() {
        let milliseconds: Vec<_> = pauses().take(7).map(|pause| pause.as_millis()).collect();
        assert_eq!(milliseconds, [250, 500, 1_000, 2_000, 4_000, 5_000, 5_000]);
    }

    #[test]
    fn it_goes_on_until_an_attempt_succeeds() {
        let mut left = 3;
        let attempts = Attempts::after(std::iter::repeat(Duration::ZERO), move || {
            left -= 1;
            if left == 0 { Ok("there") } else { Err(Setback::Again(anyhow!("not yet"))) }
        });
        assert_eq!(attempts.wait(LIMIT).unwrap().unwrap(), "there");
    }

    #[test]
    fn it_ends_where_trying_again_does_not_help() {
        let attempts = Attempts::<()>::after(std::iter::once(Duration::ZERO), || {
            Err(Setback::Never(anyhow!("refused")))
        });
        assert_eq!(attempts.wait(LIMIT).unwrap().unwrap_err().to_string(), "refused");
    }

    #[test]
    fn it_does_not_wait_longer_than_it_is_told() {
        let attempts = Attempts::<()>::after(std::iter::once(LIMIT), || unreachable!());
        assert!(attempts.wait(Duration::from_millis(1)).is_none());
    }

    #[test]
    fn nobody_tries_any_more_once_it_is_dropped() {
        let (ended, has_ended) = mpsc::channel::<Infallible>();
        let attempts = Attempts::<()>::after(std::iter::repeat(LIMIT), move || {
            let _ = &ended;
            unreachable!()
        });
        drop(attempts);
        assert_eq!(has_ended.recv_timeout(LIMIT), Err(RecvTimeoutError::Disconnected));
    }
}
