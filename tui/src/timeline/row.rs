//! A row of the Events pane with its event.

use cobscope_decoder::event::{Event, EventKind, FrameRange};
use cobscope_decoder::frame::{BusIndex, CanId, Frame, FrameFlags};
use cobscope_decoder::replay::{EventPosition, PlacedEvent};
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::text::{Line, Tone};
use cobscope_decoder::wire::j1939::{J1939Id, Pgn};

/// Number of payload bytes in a row.
const SHOWN_BYTES: usize = 8;

/// An event as text.
#[derive(Debug, Clone)]
pub struct Row {
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
    /// Change or value.
    pub value: String,
    /// Tone that decides the colour.
    pub tone: Tone,
    /// The event is a change.
    pub is_news: bool,
}

impl Row {
    /// The row of an event with escaped texts.
    pub fn new(told: &PlacedEvent<'_>) -> Self {
        let line = Line::of(told.event, told.bus);
        let (object, value) = columns(told.event, &line);
        let presumed = if told.event.presumed { "?" } else { "" };
        Self {
            spot: told.spot,
            event: told.event.clone(),
            bus: escape(told.bus.name()).into_owned(),
            frame: told.frame.filter(|frame| told.event.frames.last == frame.number).copied(),
            who: escape(&line.who).into_owned(),
            kind: line.kind,
            object: escape(object).into_owned(),
            value: format!("{}{presumed}", escape(value)),
            tone: line.tone,
            is_news: told.is_news,
        }
    }

    /// A row that states why there are no rows at a position.
    pub fn unreadable(spot: EventPosition, reason: String) -> Self {
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
            value,
            tone: Tone::Bad,
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
                J1939Id::of(number).is_some_and(|id| {
                    [Pgn::TP_CM, Pgn::TP_DT, Pgn::ETP_CM, Pgn::ETP_DT].contains(&id.pgn)
                        && ((id.source, id.destination) == ends || (id.destination, id.source) == ends)
                })
            }
            _ => false,
        }
    }

    /// Object and value as one text.
    pub fn what(&self) -> String {
        match (self.object.is_empty(), self.value.is_empty()) {
            (true, _) => self.value.clone(),
            (_, true) => self.object.clone(),
            _ => format!("{} {}", self.object, self.value),
        }
    }

    /// Identifier of the frame.
    pub fn id(&self) -> Option<CanId> {
        self.frame.filter(|frame| !frame.flags.contains(FrameFlags::ERROR)).map(|frame| frame.id)
    }

    /// First bytes of the frame.
    pub fn data(&self) -> String {
        let Some(frame) = &self.frame else { return String::new() };
        if frame.flags.contains(FrameFlags::REMOTE) {
            return "remote".into();
        }
        let shown = frame.data().iter().take(SHOWN_BYTES).map(|byte| format!("{byte:02X}"));
        let more = if frame.data().len() > SHOWN_BYTES { " …" } else { "" };
        format!("{}{more}", shown.collect::<Vec<_>>().join(" "))
    }

    /// The row as one line, for search and clipboard.
    pub fn text(&self) -> String {
        let id = self.id().map_or(String::new(), |id| id.to_string());
        format!("{} {id} {} {} {} {}", self.bus, self.who, self.kind, self.what(), self.data())
    }
}

/// Object and value of an event.
fn columns<'a>(event: &Event, line: &'a Line) -> (&'a str, &'a str) {
    let what = line.what.as_str();
    match &event.kind {
        EventKind::SdoTransfer(_) | EventKind::UdsExchange(_) => what.split_once(" = ").unwrap_or((what, "")),
        EventKind::Pdo(_) => match what.split_once(' ') {
            Some((name, rest)) => (name, rest.split_once(": ").map_or(rest, |(_, signals)| signals)),
            None => (what, ""),
        },
        EventKind::Emcy(_) | EventKind::ObjectChange(_) => what.split_once(' ').unwrap_or((what, "")),
        _ => ("", what),
    }
}
