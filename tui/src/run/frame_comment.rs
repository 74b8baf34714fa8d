//! Comment on a frame: the events that it causes, a line each.

use cobscope_decoder::event::{Event, EventKind, UndecodedFrame};
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::text::EventLine;

/// Adds an event to the comment on its frame. A frame without any known meaning has no comment.
pub fn add_event(comment: &mut String, event: &Event, bus: &Bus) {
    if matches!(&event.kind, EventKind::Frame(UndecodedFrame { name: None, message: None, .. })) {
        return;
    }
    let line = EventLine::describe_event(event, bus);
    if !comment.is_empty() {
        comment.push('\n');
    }
    for part in [line.who.as_str(), line.kind, line.what.as_str()].iter().filter(|part| !part.is_empty()) {
        if !comment.is_empty() && !comment.ends_with('\n') {
            comment.push(' ');
        }
        comment.push_str(&escape(part));
    }
}
