//! Interface of the kinds of expectation.

use crate::event::Event;
use crate::rules::RuleContext;

/// Checks one kind of expectation.
pub(super) trait ExpectationTask: Send {
    /// Handles an event of the requested kinds and node.
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>);

    /// Handles a silence of the bus or a step of the clock: intervals across it are unknown.
    fn on_gap(&mut self, _context: &mut RuleContext<'_>) {}

    /// Handles a requested wake-up.
    fn on_wake(&mut self, _token: u64, _context: &mut RuleContext<'_>) {}

    /// Ends the capture. If a name is not `known`, the absence of events is not a defect.
    fn on_end(&mut self, _known: bool, _context: &mut RuleContext<'_>) {}

    /// Reason why nothing was checked, although all names are known.
    fn idle_reason(&self) -> String;
}
