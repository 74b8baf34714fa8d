//! State of live buses and their capture, for display.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::BusStatus;
use crate::record::RecordStatus;

/// State of live buses besides their frames.
#[derive(Debug, Clone, Default)]
pub struct LiveBusState {
    /// Status of each bus.
    pub buses: Vec<BusStatus>,
    /// Status of the `--record` capture, if there is one.
    pub record: Option<RecordStatus>,
    /// Reason for the failure of a source.
    pub failure: Option<String>,
    /// All sources have ended.
    pub has_ended: bool,
}

/// The state shared between threads.
#[derive(Debug, Clone, Default)]
pub struct SharedLiveState(Arc<Mutex<LiveBusState>>);

impl SharedLiveState {
    /// The present state.
    pub fn get(&self) -> MutexGuard<'_, LiveBusState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
