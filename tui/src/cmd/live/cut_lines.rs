//! Lines on triggers and their captures.
//!
//! ```text
//!     6.500  5/05              TRIG   guard-late: … → day/2026-11-22_073051.250_node5_guard-late.pcapng {10-12}
//!    16.601                    FILE   day/2026-11-22_073051.250_node5_guard-late.pcapng: 1234 frames, …
//! ```

use std::path::Path;

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::sink::{escape, escape_json};
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::words::count_noun;
use serde_json::{Map, Value, json};

use crate::record::{CaptureTrigger, CompleteCut, CutEnd, CutNews, RefusalReason};
use crate::run::print::PrintArgs;
use cobscope_decoder::figures::{format_bytes, format_seconds, seconds_to};

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
}

impl CutLine<'_> {
    /// The line as text.
    pub(super) fn text(&self) -> String {
        let (time, who, kind, what) = match self.news {
            CutNews::Triggered { trigger, path, late } => {
                let late = if *late > 0 {
                    format!("; its first {} s are missing: no longer in the ring", format_seconds(*late))
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
            CutNews::Complete(cut) => (cut.last_time, String::new(), "FILE", summary(cut)),
        };
        let since = |time: Timestamp| Some(format_seconds(time.0.checked_sub(self.first?.0)?));
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
            CutNews::Complete(cut) => (cut.last_time, of_cut(cut)),
        };
        // Seconds with nine digits exceed the precision of a floating-point number.
        let time = time.map_or_else(|| "null".to_owned(), |time| seconds_to(time.0, 9));
        let fields = Value::Object(fields).to_string();
        format!("{{\"t\":{time},{}\n", escape_json(fields.trim_start_matches('{')))
    }
}

fn of_trigger(trigger: &CaptureTrigger) -> Map<String, Value> {
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
    add("bus_file", json!(cut.bus_file.as_deref().map(name)));
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

fn who(trigger: &CaptureTrigger) -> String {
    let subject = if trigger.subject.is_empty() { &trigger.bus } else { &trigger.subject };
    escape(subject).into_owned()
}

fn words(trigger: &CaptureTrigger) -> String {
    format!("{}: {}", trigger.cause, trigger.text)
}

fn frames(trigger: &CaptureTrigger) -> String {
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
        count_noun(cut.frames, "frame"),
        format!("{} s", format_seconds(cut.duration)),
        count_noun(cut.triggers, "trigger"),
        format_bytes(cut.bytes),
    ];
    let missing = if cut.missing > 0 {
        format!("; {} missing", count_noun(cut.missing, "frame"))
    } else {
        String::new()
    };
    let end = match cut.end {
        CutEnd::Window => "",
        CutEnd::Bytes => "; ended by --trigger-size",
        CutEnd::Stopped => "; stopped before the end of its window",
    };
    format!("{paths}: {}{missing}{end}", parts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trigger(text: &str) -> CaptureTrigger {
        CaptureTrigger {
            bus: "can0".to_owned(),
            node: Some(NodeId::Canopen(5)),
            subject: "5/05 boom".to_owned(),
            cause: "guard-late".to_owned(),
            text: text.to_owned(),
            time: Some(Timestamp(1_700_000_006_500_000_001)),
            first_frame: 10,
            last_frame: 12,
        }
    }

    fn line(news: &CutNews) -> CutLine<'_> {
        CutLine { news, first: Some(Timestamp(1_700_000_000_000_000_000)) }
    }

    #[test]
    fn a_trigger_names_its_capture() {
        let news = CutNews::Triggered { trigger: trigger("late"), path: "day/a.pcapng".into(), late: 0 };
        let text = "    6.500  5/05 boom         TRIG   guard-late: late → day/a.pcapng {10-12}\n";
        assert_eq!(line(&news).text(), text);
        assert_eq!(
            line(&news).json(),
            "{\"t\":1700000006.500000001,\"bus\":\"can0\",\"capture\":\"day/a.pcapng\",\"cause\":\"guard-late\",\
             \"frames\":[10,12],\"kind\":\"trigger\",\"late\":0.0,\"node\":5,\"text\":\"late\"}\n"
        );
        let late = CutNews::Triggered { trigger: trigger("late"), path: "a".into(), late: 1_500_000_000 };
        let missing = "a; its first 1.500 s are missing: no longer in the ring {10-12}\n";
        assert!(line(&late).text().ends_with(missing), "{}", line(&late).text());
        assert!(line(&late).json().contains("\"late\":1.5,"));
    }

    #[test]
    fn a_trigger_without_a_capture_has_a_reason() {
        let news = CutNews::Refused { trigger: trigger("late"), reason: RefusalReason::Files };
        let text = line(&news).text();
        assert!(
            text.ends_with("guard-late: late; not recorded: limit of --trigger-files {10-12}\n"),
            "{text}"
        );
        let json = line(&news).json();
        assert!(
            json.contains("\"capture\":null") && json.contains("\"reason\":\"limit of --trigger-files\"")
        );
    }

    #[test]
    fn a_complete_capture_has_a_summary() {
        let mut cut = CompleteCut {
            paths: vec!["day/a.pcapng".into()],
            bus_file: Some("day/a.toml".into()),
            frames: 1_234,
            missing: 0,
            bytes: 60_000,
            triggers: 2,
            last_time: Some(Timestamp(1_700_000_007_000_000_000)),
            duration: 40_000_000_000,
            end: CutEnd::Window,
        };
        let text =
            "    7.000                    FILE   day/a.pcapng: 1234 frames, 40.000 s, 2 triggers, 60.0 kB\n";
        assert_eq!(line(&CutNews::Complete(cut.clone())).text(), text);
        assert_eq!(
            line(&CutNews::Complete(cut.clone())).json(),
            "{\"t\":1700000007.000000000,\"bus_file\":\"day/a.toml\",\"bytes\":60000,\"capture\":\"day/a.pcapng\",\
             \"count\":1234,\"duration\":40.0,\"end\":\"window\",\"kind\":\"capture\",\"missing\":0,\
             \"parts\":[\"day/a.pcapng\"],\"triggers\":2}\n"
        );
        cut.paths.clear();
        (cut.missing, cut.end) = (3, CutEnd::Stopped);
        let text = line(&CutNews::Complete(cut)).text();
        let end = "no file: 1234 frames, 40.000 s, 2 triggers, 60.0 kB; 3 frames missing; stopped before the end of its \
                   window\n";
        assert!(text.ends_with(end), "{text}");
    }

    #[test]
    fn text_of_the_bus_is_escaped() {
        let mut hostile = trigger("\u{1b}[2J\n\"");
        (hostile.subject, hostile.node, hostile.time) = ("\u{1b}]0;x\u{7}".to_owned(), None, None);
        let news = CutNews::Triggered { trigger: hostile, path: "a".into(), late: 0 };
        let (text, json) = (line(&news).text(), line(&news).json());
        assert!(text.chars().filter(|it| it.is_control()).eq(['\n']), "{text:?}");
        assert!(json.chars().filter(|it| it.is_control()).eq(['\n']), "{json:?}");
        let value: Value = serde_json::from_str(&json).unwrap();
        assert_eq!((&value["t"], &value["text"]), (&Value::Null, &json!("\u{1b}[2J\n\"")));
    }
}
