//! Interface of the kinds of expectation.

use crate::event::Event;
use crate::rules::Context;

/// Checks one kind of expectation.
pub(super) trait Task: Send {
    /// Handles an event of the requested kinds and node.
    fn event(&mut self, event: &Event, context: &mut Context<'_>);

    /// Handles a silence of the bus or a step of the clock: intervals across it are unknown.
    fn interrupt(&mut self, _context: &mut Context<'_>) {}

    /// Handles a requested wake-up.
    fn wake(&mut self, _token: u64, _context: &mut Context<'_>) {}

    /// Ends the capture. If a name is not `known`, the absence of events is not a defect.
    fn finish(&mut self, _known: bool, _context: &mut Context<'_>) {}

    /// Reason why nothing was checked, although all names are known.
    fn idle(&self) -> String;
}
