//! A line that waits for a finding about the same fact: both are printed as one line.
//!
//! ```text
//! EMCY   8305 spool position error {104}         event
//! EMCY   EMCY 8305 spool position error {104}    finding
//! EMCY   8305 spool position error; warning [emcy-raised] {104}
//! ```

use crate::event::{Event, EventKind, FindingNews, FrameRange};
use crate::frame::BusIndex;
use crate::wire::NodeId;

/// Line without its end.
#[derive(Debug, Default)]
pub(super) struct HeldLine {
    /// Where the line is from; `None` if none is held.
    place: Option<HeldLineKey>,
    pub(super) frames: FrameRange,
    /// ANSI colours must be reset after the text.
    pub(super) colored: bool,
    /// Lines below it.
    pub(super) below: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct HeldLineKey {
    bus: BusIndex,
    node: Option<NodeId>,
    frame: u64,
    word: &'static str,
}

/// Whether a finding may state the same fact as an event. PDOs and messages are too frequent to be held, and no
/// finding repeats them.
pub(super) fn may_be_judged(event: &Event) -> bool {
    !matches!(event.kind, EventKind::Pdo(_) | EventKind::J1939Message(_) | EventKind::Frame(_))
}

impl HeldLine {
    /// Holds the line of an event.
    pub(super) fn hold_line(&mut self, event: &Event, word: &'static str) {
        self.frames = event.frames;
        self.place = Some(line_key(event, word));
    }

    /// Whether a line is held.
    pub(super) fn is_held(&self) -> bool {
        self.place.is_some()
    }

    /// Ends holding.
    pub(super) fn release_line(&mut self) {
        self.place = None;
    }

    /// Whether a finding event is about the held line.
    pub(super) fn is_about(&self, event: &Event, news: &FindingNews) -> bool {
        self.place == Some(line_key(event, news.word))
    }
}

fn line_key(event: &Event, word: &'static str) -> HeldLineKey {
    HeldLineKey { bus: event.bus, node: event.node, frame: event.frames.last, word }
}

/// The part of a finding text that a line does not contain yet.
pub(super) fn news_of<'a>(line: &str, word: &str, text: &'a str) -> &'a str {
    let own = text.strip_prefix(word).map_or(text, str::trim_start);
    if line.contains(own) {
        return "";
    }
    let mut common = 0;
    for (known, new) in line.split(' ').zip(own.split(' ')) {
        let bare = |part: &str| part.trim_end_matches([',', ';', ':']).to_owned();
        if bare(known) != bare(new) {
            break;
        }
        common += 1;
    }
    if common < 2 {
        return own;
    }
    let skipped: usize = own.split(' ').take(common).map(|part| part.len().saturating_add(1)).sum();
    own.get(skipped..).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_new_is_added() {
        let emcy = "8305 spool position error → FAULT HOLD, register 21";
        assert_eq!(news_of(emcy, "EMCY", "EMCY 8305 spool position error"), "");
        let state = "ACTIVE → FAULT HOLD, cause EMCY 8305 {12}";
        let text = "ACTIVE → FAULT HOLD although control word 0F commands ACTIVE";
        assert_eq!(news_of(state, "STATE", text), "although control word 0F commands ACTIVE");
        let lost = "silent for 0.400 s (heartbeat)";
        assert_eq!(news_of(lost, "LOST", "no heartbeat after {40}"), "no heartbeat after {40}");
        assert_eq!(news_of("", "EMCY", ""), "");
    }
}
