//! Error codes that a node raised and did not clear.

use crate::session::limits::ACTIVE_ERROR_LIMIT;

/// Active error codes of a node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct ActiveErrors {
    /// Oldest first.
    codes: Vec<u16>,
    /// Code raised last, also if it is cleared.
    pub(in crate::session) last: Option<u16>,
}

impl ActiveErrors {
    /// Codes raised and not cleared, oldest first.
    pub(in crate::session) fn codes(&self) -> &[u16] {
        &self.codes
    }

    /// Adds a code; `false` if the oldest one was evicted.
    pub(in crate::session) fn raise_error(&mut self, code: u16) -> bool {
        self.last = Some(code);
        if self.codes.contains(&code) {
            return true;
        }
        let fits = self.codes.len() < ACTIVE_ERROR_LIMIT;
        if !fits {
            self.codes.remove(0);
        }
        self.codes.push(code);
        fits
    }

    /// Clears all codes.
    pub(in crate::session) fn clear_all(&mut self) {
        self.codes.clear();
    }

    /// Bytes held by the list.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.codes.capacity() * size_of::<u16>()
    }
}
