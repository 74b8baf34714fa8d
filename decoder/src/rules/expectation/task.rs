//! What judges one kind of expectation.

use crate::event::Event;
use crate::rules::Context;

/// Judges one kind of expectation.
pub(super) trait Task {
    /// An event of its kinds and its node.
    fn event(&mut self, event: &Event, context: &mut Context<'_>);

    /// All traffic stopped for a while, or the clock was set: what was between two events is not known.
    fn interrupt(&mut self, _context: &mut Context<'_>) {}

    /// A time it asked for has passed.
    fn wake(&mut self, _token: u64, _context: &mut Context<'_>) {}

    /// Nothing more comes. Where a name is not `known`, what did not come says nothing.
    fn finish(&mut self, _known: bool, _context: &mut Context<'_>) {}

    /// Why it had nothing to judge, where all names are known.
    fn idle(&self) -> String;
}
