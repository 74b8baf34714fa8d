//! Lines on triggers and their captures.
//!
//! ```text
//!     6.500  5/05              TRIG   guard-late: … → day/2026-11-22_073051.250_node5_guard-late.pcapng {10-12}
//!    16.601                    FILE   day/2026-11-22_073051.250_node5_guard-late.pcapng: 1234 frames, …
//! ```

use std::path::Path;

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::words::plural;
use serde_json::{Map, Value, json};

use crate::cli::PrintArgs;
use crate::figures::{bytes, seconds, seconds_to};
use crate::record::{CompleteCut, CutEnd, CutNews, RefusalReason, Trigger};

/// Form of the lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LineStyle {
    /// Text on stdout.
    Text,
    /// JSON on stdout.
    Json,
    /// Text on stderr, because stdout has another format.
    Note,
}

impl LineStyle {
    /// Form for the output format of the options.
    pub(super) fn of(arguments: &PrintArgs) -> Self {
        match arguments.format.0.map(|format| format.name) {
            Some("jsonl") => Self::Json,
            Some(name) if name != "text" && arguments.output.is_none() => Self::Note,
            _ => Self::Text,
        }
    }
}

/// News of captures as a line.
pub(super) struct CutLine<'a> {
    pub(super) news: &'a CutNews,
    /// Time of the first frame, from which text counts.
    pub(super) first: Option<Timestamp>,
    /// Time of the last frame.
    pub(super) now: Option<Timestamp>,
}

impl CutLine<'_> {
    /// The line as text.
    pub(super) fn text(&self) -> String {
        let (time, who, kind, what) = match self.news {
            CutNews::Triggered { trigger, path, late } => {
                let late = if *late > 0 {
                    format!("; its first {} s are missing: no longer in the ring", seconds(*late))
                } else {
                    String::new()
                };
                let what = format!("{} → {}{late}{}", words(trigger), path.display(), frames(trigger));
                (trigger.time, who(trigger), "TRIG", what)
            }
            CutNews::Refused { trigger, reason } => {
                let what = format!("{}; not recorded: {}{}", words(trigger), limit(*reason), frames(trigger));
                (trigger.time, who(trigger), "TRIG", what)
            }
            CutNews::Complete(cut) => (self.now, String::new(), "FILE", summary(cut)),
        };
        let since = |time: Timestamp| Some(seconds(time.0.checked_sub(self.first?.0)?));
        let time = time.and_then(since).unwrap_or_else(|| "–".to_owned());
        format!("{time:>9}  {who:<16}  {kind:<6} {}\n", escape(&what))
    }

    /// The line as JSON.
    pub(super) fn json(&self) -> String {
        let (time, fields) = match self.news {
            CutNews::Triggered { trigger, path, late } => {
                let mut fields = of_trigger(trigger);
                fields.insert("capture".to_owned(), json!(name(path)));
                fields.insert("late".to_owned(), json!(in_seconds(*late)));
                (trigger.time, fields)
            }
            CutNews::Refused { trigger, reason } => {
                let mut fields = of_trigger(trigger);
                fields.insert("capture".to_owned(), Value::Null);
                fields.insert("reason".to_owned(), json!(limit(*reason)));
                (trigger.time, fields)
            }
            CutNews::Complete(cut) => (self.now, of_cut(cut)),
        };
        // Seconds with nine digits exceed the precision of a floating-point number.
        let time = time.map_or_else(|| "null".to_owned(), |time| seconds_to(time.0, 9));
        let fields = Value::Object(fields).to_string();
        format!("{{\"t\":{time},{}\n", fields.trim_start_matches('{'))
    }
}

fn of_trigger(trigger: &Trigger) -> Map<String, Value> {
    let mut fields = Map::new();
    let mut add = |key: &str, value: Value| _ = fields.insert(key.to_owned(), value);
    add("bus", json!(trigger.bus));
    add("frames", json!([trigger.first_frame, trigger.last_frame]));
    add("kind", json!("trigger"));
    if let Some(NodeId::Canopen(node) | NodeId::J1939(node)) = trigger.node {
        add("node", json!(node));
    }
    add("cause", json!(trigger.cause));
    add("text", json!(trigger.text));
    fields
}

fn of_cut(cut: &CompleteCut) -> Map<String, Value> {
    let mut fields = Map::new();
    let mut add = |key: &str, value: Value| _ = fields.insert(key.to_owned(), value);
    let paths: Vec<String> = cut.paths.iter().map(|path| name(path)).collect();
    add("kind", json!("capture"));
    add("capture", json!(paths.first()));
    add("parts", json!(paths));
    add("count", json!(cut.frames));
    add("missing", json!(cut.missing));
    add("bytes", json!(cut.bytes));
    add("triggers", json!(cut.triggers));
    add("duration", json!(in_seconds(cut.duration)));
    add("end", json!(end(cut.end)));
    fields
}

#[expect(clippy::cast_precision_loss, reason = "the resolution of a long duration is no longer a nanosecond")]
fn in_seconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e9
}

fn name(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

fn end(end: CutEnd) -> &'static str {
    match end {
        CutEnd::Window => "window",
        CutEnd::Bytes => "size-limit",
        CutEnd::Stopped => "stopped",
    }
}

/// The limit that was reached.
pub(super) fn limit(reason: RefusalReason) -> &'static str {
    match reason {
        RefusalReason::Files => "limit of --trigger-files",
        RefusalReason::Bytes => "limit of --trigger-size",
    }
}

fn who(trigger: &Trigger) -> String {
    trigger.node.map_or_else(|| escape(&trigger.bus).into_owned(), NodeId::label)
}

fn words(trigger: &Trigger) -> String {
    format!("{}: {}", trigger.cause, trigger.text)
}

fn frames(trigger: &Trigger) -> String {
    match (trigger.first_frame, trigger.last_frame) {
        (0, _) => String::new(),
        (first, last) if first == last => format!(" {{{first}}}"),
        (first, last) => format!(" {{{first}-{last}}}"),
    }
}

fn summary(cut: &CompleteCut) -> String {
    let paths: Vec<String> = cut.paths.iter().map(|path| path.display().to_string()).collect();
    let paths = if paths.is_empty() { "no file".to_owned() } else { paths.join(", ") };
    let parts = [
        plural(cut.frames, "frame"),
        format!("{} s", seconds(cut.duration)),
        plural(cut.triggers, "trigger"),
        bytes(cut.bytes),
    ];
    let missing =
        if cut.missing > 0 { format!("; {} missing", plural(cut.missing, "frame")) } else { String::new() };
    let end = match cut.end {
        CutEnd::Window => "",
        CutEnd::Bytes => "; ended by --trigger-size",
        CutEnd::Stopped => "; stopped before the end of its window",
    };
    format!("{paths}: {}{missing}{end}", parts.join(", "))
}
