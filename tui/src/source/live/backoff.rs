//! Reconnects in another thread at growing intervals.

use std::convert::Infallible;
use std::iter::successors;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::Duration;

use anyhow::anyhow;

/// Pause before the first attempt; it doubles for each further one.
const FIRST: Duration = Duration::from_millis(250);

/// Maximum pause.
const LONGEST: Duration = Duration::from_secs(5);

/// Failure of an attempt.
#[derive(Debug)]
pub enum ConnectError {
    /// The device is absent or not ready; retry.
    Again(anyhow::Error),
    /// The device refuses; do not retry.
    Never(anyhow::Error),
}

impl From<ConnectError> for anyhow::Error {
    fn from(setback: ConnectError) -> Self {
        match setback {
            ConnectError::Again(error) | ConnectError::Never(error) => error,
        }
    }
}

/// The pauses before the attempts, without end.
fn attempt_pauses() -> impl Iterator<Item = Duration> {
    successors(Some(FIRST), |pause| Some((*pause * 2).min(LONGEST)))
}

/// Attempts that continue until one succeeds or this is dropped.
pub struct ConnectAttempts<T> {
    found: Receiver<anyhow::Result<T>>,
    /// Nothing is ever sent: dropping it wakes and ends the thread.
    _end: Sender<Infallible>,
}

impl<T: Send + 'static> ConnectAttempts<T> {
    /// Starts the attempts after the first pause.
    pub fn start(attempt: impl FnMut() -> Result<T, ConnectError> + Send + 'static) -> Self {
        Self::start_after(attempt_pauses(), attempt)
    }

    fn start_after(
        mut pauses: impl Iterator<Item = Duration> + Send + 'static,
        mut attempt: impl FnMut() -> Result<T, ConnectError> + Send + 'static,
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
                    Err(ConnectError::Never(error)) => break Err(error),
                    Err(ConnectError::Again(_)) => {}
                }
            };
            // Without a receiver the new connection is dropped, which closes it.
            let _ = give.send(result);
        };
        // If the thread cannot be started, the channel is closed and `wait` reports it.
        let _ = std::thread::Builder::new().name("reconnect".into()).spawn(work);
        Self { found, _end: end }
    }

    /// The connection, waiting for it at most `wait`; `None` if there is none yet.
    pub fn wait_for(&self, wait: Duration) -> Option<anyhow::Result<T>> {
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
        let milliseconds: Vec<_> = attempt_pauses().take(7).map(|pause| pause.as_millis()).collect();
        assert_eq!(milliseconds, [250, 500, 1_000, 2_000, 4_000, 5_000, 5_000]);
    }

    #[test]
    fn attempts_continue_until_one_succeeds() {
        let mut left = 3;
        let attempts = ConnectAttempts::start_after(std::iter::repeat(Duration::ZERO), move || {
            left -= 1;
            if left == 0 { Ok("there") } else { Err(ConnectError::Again(anyhow!("not yet"))) }
        });
        assert_eq!(attempts.wait_for(LIMIT).unwrap().unwrap(), "there");
    }

    #[test]
    fn it_ends_where_trying_again_does_not_help() {
        let attempts = ConnectAttempts::<()>::start_after(std::iter::once(Duration::ZERO), || {
            Err(ConnectError::Never(anyhow!("refused")))
        });
        assert_eq!(attempts.wait_for(LIMIT).unwrap().unwrap_err().to_string(), "refused");
    }

    #[test]
    fn the_pause_does_not_exceed_the_limit() {
        let attempts = ConnectAttempts::<()>::start_after(std::iter::once(LIMIT), || unreachable!());
        assert!(attempts.wait_for(Duration::from_millis(1)).is_none());
    }

    #[test]
    fn no_attempt_follows_once_it_is_dropped() {
        let (ended, has_ended) = mpsc::channel::<Infallible>();
        let attempts = ConnectAttempts::<()>::start_after(std::iter::repeat(LIMIT), move || {
            let _ = &ended;
            unreachable!()
        });
        drop(attempts);
        assert_eq!(has_ended.recv_timeout(LIMIT), Err(RecvTimeoutError::Disconnected));
    }
}
