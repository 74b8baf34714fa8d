//! Checks of all events and of all lines printed for them.

use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::session::{Bus, Observer};
use cobscope_decoder::sink::EventSink as _;
use cobscope_decoder::sink::jsonl::JsonlSink;
use cobscope_decoder::sink::text::{PdoLines, TextOptions, TextSink};
use cobscope_decoder::wire::NodeId;

/// Escape sequences of cobscope's own colours.
const COLOURS: &[&str] = &["\x1b[2m", "\x1b[31m", "\x1b[32m", "\x1b[33m", "\x1b[0m"];

/// Writes each event with all sinks and checks the output.
pub struct Checker {
    json: JsonlSink<Shared>,
    json_bytes: Shared,
    texts: Vec<(TextSink<Shared>, Shared)>,
    reads_back: bool,
    /// Number of the last frame pushed.
    pub last_frame: u64,
    /// Number of events so far.
    pub events: usize,
    /// Number of bytes written so far.
    pub written: usize,
    /// JSON lines, if they are kept.
    pub kept: Option<Vec<String>>,
    /// Kinds of state evicted at a limit, from the events.
    pub evicted: Vec<&'static str>,
}

/// A buffer shared by its writer and its reader.
#[derive(Clone, Default)]
struct Shared(std::rc::Rc<std::cell::RefCell<Vec<u8>>>);

impl std::io::Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Shared {
    fn take(&self) -> String {
        let bytes = std::mem::take(&mut *self.0.borrow_mut());
        String::from_utf8(bytes).unwrap()
    }
}

impl Default for Checker {
    fn default() -> Self {
        Self::new()
    }
}

impl Checker {
    /// A checker before the first event.
    pub fn new() -> Self {
        let all = TextOptions {
            pdo: PdoLines::All,
            all: true,
            frames: true,
            verbose: true,
            color: false,
            ..TextOptions::default()
        };
        let text = |options| {
            let bytes = Shared::default();
            (TextSink::new(bytes.clone(), options), bytes)
        };
        let json_bytes = Shared::default();
        Self {
            json: JsonlSink::new(json_bytes.clone()),
            json_bytes,
            // Colours are removed for the check; the text without them is the same as without the option.
            texts: vec![text(TextOptions { color: true, ..all })],
            reads_back: true,
            last_frame: 0,
            events: 0,
            written: 0,
            kept: None,
            evicted: Vec::new(),
        }
    }

    /// A checker that keeps the JSON lines.
    pub fn keeping() -> Self {
        Self { kept: Some(Vec::new()), ..Self::new() }
    }

    /// A checker that keeps the JSON lines without checking them, to compare them with checked lines.
    pub fn comparing() -> Self {
        Self { texts: Vec::new(), reads_back: false, ..Self::keeping() }
    }

    fn json_line(&mut self, event: &Event) {
        let line = self.json_bytes.take();
        if self.reads_back {
            Self::check_json(event, &line);
        }
        self.written += line.len();
        if let Some(kept) = &mut self.kept {
            kept.push(line);
        }
    }

    fn check_json(event: &Event, line: &str) {
        let value: serde_json::Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
        assert!(line.ends_with('\n') && line.matches('\n').count() == 1, "{line}");
        assert_eq!(value["kind"], event.kind.name(), "{line}");
        assert!(value["bus"].is_string() && value["frames"].is_array(), "{line}");
    }
}

impl Observer for Checker {
    fn on_event(&mut self, event: &Event, bus: &Bus) {
        let frames = event.frames;
        assert!(frames.first <= frames.last, "{event:?}");
        assert!(frames.last <= self.last_frame, "{event:?} after frame {}", self.last_frame);
        assert!(event.node.is_none_or(NodeId::is_valid), "{event:?}");
        self.events += 1;
        if let EventKind::Evicted { what, .. } = &event.kind {
            self.evicted.push(what.name());
        }
        self.json.write_event(event, bus);
        self.json_line(event);
        for (text, bytes) in &mut self.texts {
            text.write_event(event, bus);
            let printed = bytes.take();
            let plain = COLOURS.iter().fold(printed, |text, colour| text.replace(colour, ""));
            assert!(!plain.chars().any(|c| c.is_control() && c != '\n'), "{}", plain.escape_debug());
            self.written += plain.len();
        }
    }
}
