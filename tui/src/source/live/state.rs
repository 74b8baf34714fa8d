//! How a live bus and its record are, for whoever shows it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::BusStatus;
use crate::record::RecordStatus;

/// What is known besides what came.
#[derive(Debug, Clone, Default)]
pub struct Live {
    /// Each bus.
    pub buses: Vec<BusStatus>,
    /// The record, if there is one.
    pub record: Option<RecordStatus>,
    /// Why a source ended, if one did.
    pub failure: Option<String>,
    /// Nothing more will come.
    pub has_ended: bool,
}

/// The same, shared between threads.
#[derive(Debug, Clone, Default)]
pub struct LiveState(Arc<Mutex<Live>>);

impl LiveState {
    /// What is known now.
    pub fn get(&self) -> MutexGuard<'_, Live> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
