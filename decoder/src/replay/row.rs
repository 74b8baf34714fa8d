//! A row of the Events pane with its event.

use super::{EventPosition, PlacedEvent};
use crate::escape::escape;
use crate::event::{Event, EventKind, FrameRange};
use crate::frame::{BusIndex, CanId, Frame, FrameFlags};
use crate::sink::text::{EventLine, LineTone, MessageChanges, TransferWords};
use crate::wire::NodeId;
use crate::wire::j1939::{J1939Id, Pgn};

/// Number of payload bytes in a row.
const SHOWN_BYTES: usize = 8;

/// An event as text.
#[derive(Debug, Clone)]
pub struct ReplayRow {
    /// Position of the event.
    pub spot: EventPosition,
    /// The event, for the Detail pane.
    pub event: Event,
    /// Name of the bus.
    pub bus: String,
    /// The frame of the event; None for events without one.
    pub frame: Option<Frame>,
    /// Node, or source → destination.
    pub who: String,
    /// Kind in at most six characters.
    pub kind: &'static str,
    /// Object, signal or code; may be empty.
    pub object: String,
    /// Change or value; of a message its changed signals.
    pub value: String,
    /// Object and value as one text, with the name of the object last: `1003:00 = 1, Number of errors`.
    pub news: String,
    /// All of the event; of a message its changed signals.
    pub what: String,
    /// Signals that did not change; empty if only changes are shown.
    pub unchanged: String,
    /// Tone that decides the colour.
    pub tone: LineTone,
    /// The event is a change.
    pub is_news: bool,
}

impl ReplayRow {
    /// The row of an event with escaped texts. With `only_news` a message is compared with the last one that
    /// was news, else with the one before it.
    pub fn new(reported: &PlacedEvent<'_>, only_news: bool) -> Self {
        let line = EventLine::describe_event(reported.event, reported.bus);
        let RowTexts { object, value, news, unchanged } = row_texts(reported, &line, only_news);
        let presumed = if reported.event.presumed { "?" } else { "" };
        let news = format!("{}{presumed}", escape(&news));
        let is_message = MessageChanges::is_of(reported.event);
        Self {
            spot: reported.spot,
            event: reported.event.clone(),
            bus: escape(reported.bus.name()).into_owned(),
            frame: reported.frame.filter(|frame| reported.event.frames.last == frame.number).copied(),
            who: escape(&line.who).into_owned(),
            kind: line.kind,
            object: escape(&object).into_owned(),
            value: format!("{}{presumed}", escape(&value)),
            what: if is_message { news.clone() } else { format!("{}{presumed}", escape(&line.what)) },
            news,
            unchanged: escape(&unchanged).into_owned(),
            tone: line.tone,
            is_news: reported.is_news,
        }
    }

    /// A row that states why there are no rows at a position.
    pub fn unreadable_row(spot: EventPosition, reason: String) -> Self {
        let value = escape(&reason).into_owned();
        let kind = EventKind::Unreadable { file: None, line: None, offset: None, count: 1, reason };
        Self {
            spot,
            event: Event::new(BusIndex(0), FrameRange::one(0), kind),
            bus: String::new(),
            frame: None,
            who: String::new(),
            kind: "UNREAD",
            object: String::new(),
            news: value.clone(),
            what: value.clone(),
            value,
            unchanged: String::new(),
            tone: LineTone::Bad,
            is_news: true,
        }
    }

    /// Whether the event is a transfer of several messages.
    pub fn is_exchange(&self) -> bool {
        let kind = &self.event.kind;
        matches!(
            kind,
            EventKind::SdoTransfer(_)
                | EventKind::J1939Transfer(_)
                | EventKind::IsoTpTransfer(_)
                | EventKind::UdsExchange(_)
        )
    }

    /// Whether a frame between the first and last one belongs to the transfer.
    pub fn has_frame(&self, frame: &Frame) -> bool {
        let (event, id) = (&self.event, frame.id);
        if frame.bus != event.bus || !(event.frames.first..=event.frames.last).contains(&frame.number) {
            return false;
        }
        match &event.kind {
            EventKind::SdoTransfer(transfer) => [transfer.request, transfer.response].contains(&id),
            EventKind::IsoTpTransfer(transfer) => transfer.id == id || transfer.flow_control == Some(id),
            EventKind::UdsExchange(exchange) => {
                [&exchange.request, &exchange.response].into_iter().flatten().any(|message| message.id == id)
            }
            EventKind::J1939Transfer(transfer) => {
                let CanId::Extended(number) = id else { return false };
                let ends = (transfer.source, transfer.destination);
                J1939Id::from_identifier(number).is_some_and(|id| {
                    [Pgn::TP_CM, Pgn::TP_DT, Pgn::ETP_CM, Pgn::ETP_DT].contains(&id.pgn)
                        && ((id.source, id.destination) == ends || (id.destination, id.source) == ends)
                })
            }
            _ => false,
        }
    }

    /// Identifier of the frame.
    pub fn id(&self) -> Option<CanId> {
        self.frame.filter(|frame| !frame.flags.contains(FrameFlags::ERROR)).map(|frame| frame.id)
    }

    /// Filter expression for events like this one: of its node, and of its kind.
    pub fn filter_expression(&self) -> String {
        let kind = format!("kind == {:?}", self.event.kind.name());
        match self.event.node {
            Some(node) => format!("{} && {kind}", node_filter(node)),
            None => kind,
        }
    }

    /// First bytes of the frame.
    pub fn data_text(&self) -> String {
        let Some(frame) = &self.frame else { return String::new() };
        if frame.flags.contains(FrameFlags::REMOTE) {
            return "remote".into();
        }
        let shown = frame.data().iter().take(SHOWN_BYTES).map(|byte| format!("{byte:02X}"));
        let more = if frame.data().len() > SHOWN_BYTES { " …" } else { "" };
        format!("{}{more}", shown.collect::<Vec<_>>().join(" "))
    }

    /// The row as one line, for search and clipboard.
    pub fn row_text(&self) -> String {
        let id = self.id().map_or(String::new(), |id| id.to_string());
        let (what, unchanged) = (&self.what, &self.unchanged);
        format!("{} {id} {} {} {what} {unchanged} {}", self.bus, self.who, self.kind, self.data_text())
    }
}

/// Filter expression for the events of a node.
pub fn node_filter(node: NodeId) -> String {
    match node {
        NodeId::Canopen(id) => format!("node == {id}"),
        NodeId::J1939(address) => format!("source_address == 0x{address:02X}"),
    }
}

/// Texts of an event in the order of their columns.
#[derive(Default)]
struct RowTexts {
    object: String,
    value: String,
    news: String,
    unchanged: String,
}

impl RowTexts {
    /// An object, which may be empty, and a value.
    fn new(object: &str, value: &str) -> Self {
        let blank = if object.is_empty() || value.is_empty() { "" } else { " " };
        let news = format!("{object}{blank}{value}");
        Self { object: object.to_owned(), value: value.to_owned(), news, unchanged: String::new() }
    }
}

fn row_texts(reported: &PlacedEvent<'_>, line: &EventLine, only_news: bool) -> RowTexts {
    let earlier = reported.earlier.news.filter(|_| only_news).or(reported.earlier.last);
    if let Some(changes) = MessageChanges::changes_in(reported.event, reported.bus, earlier) {
        return of_message(changes, only_news);
    }
    if let Some(words) = TransferWords::of_event(reported.event, reported.bus) {
        return of_transfer(&words);
    }
    let what = line.what.as_str();
    let (object, value) = match &reported.event.kind {
        EventKind::Pdo(_) | EventKind::Emcy(_) | EventKind::ObjectChange(_) => {
            what.split_once(' ').unwrap_or((what, ""))
        }
        _ => ("", what),
    };
    RowTexts::new(object, value)
}

/// Changed signals, and the unchanged ones if all are shown or none changed.
fn of_message(changes: MessageChanges, only_news: bool) -> RowTexts {
    let MessageChanges { name, changed, unchanged, note } = changes;
    let (value, unchanged) = match (changed.is_empty(), only_news) {
        (true, true) => (unchanged, String::new()),
        (_, true) => (changed, String::new()),
        (_, false) => (changed, unchanged),
    };
    RowTexts { unchanged, ..RowTexts::new(&name, format!("{value}{note}").trim_start()) }
}

/// Object with its name, and the result of a transfer.
fn of_transfer(words: &TransferWords) -> RowTexts {
    let news = words.joined_text();
    let TransferWords { object, name, result } = words;
    let blank = if name.is_empty() { "" } else { " " };
    let value = result.strip_prefix("= ").unwrap_or(result).to_owned();
    RowTexts { object: format!("{object}{blank}{name}"), value, news, unchanged: String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(changed: &str, unchanged: &str) -> MessageChanges {
        MessageChanges {
            name: "TPDO1".into(),
            changed: changed.into(),
            unchanged: unchanged.into(),
            note: " (to 5/05)".into(),
        }
    }

    #[test]
    fn changed_signals_precede_the_note_and_unchanged_ones_are_apart() {
        let texts = |changed, unchanged, only_news| {
            let texts = of_message(message(changed, unchanged), only_news);
            (texts.value, texts.unchanged)
        };
        let text = |value: &str, unchanged: &str| (value.to_owned(), unchanged.to_owned());
        assert_eq!(texts("p 1 → 2 bar", "q 3", true), text("p 1 → 2 bar (to 5/05)", ""));
        assert_eq!(texts("p 1 → 2 bar", "q 3", false), text("p 1 → 2 bar (to 5/05)", "q 3"));
        assert_eq!(texts("", "q 3", false), text("(to 5/05)", "q 3"));
        assert_eq!(texts("", "q 3", true), text("q 3 (to 5/05)", ""), "never an empty row");
    }
}
