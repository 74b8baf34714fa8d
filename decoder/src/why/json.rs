//! The report as one JSON object; events have the form of `decode -f jsonl`.

use serde_json::{Value, json};

use super::{FaultGrade, Moment, NodeState, PointState, Reaction, Report, Rhythm, StoppedMessage};
use crate::diagnosis::{Story, StoryLine};
use crate::escape::escape_json;
use crate::event::{Certainty, Event};
use crate::finding::Occurrence;
use crate::frame::{BusIndex, Timestamp};
use crate::session::{Bus, Buses};
use crate::sink::EventSink as _;
use crate::sink::jsonl::Jsonl;
use crate::wire::NodeId;

/// One line without its end. Events are inserted as text, because their times have more digits than a float.
pub fn line(
    report: &Report,
    buses: Buses<'_>,
    first: Option<Timestamp>,
    at: Option<&str>,
    capture: &str,
) -> String {
    let page = Page { buses, first };
    let chosen = report.question.chosen.as_ref();
    let fault = report.moment.as_ref().map_or("null".to_owned(), |moment| page.moment(moment));
    let before = report.moment.as_ref().map_or(&[][..], |moment| &moment.before);
    let checks =
        report.checks.iter().map(|it| json!({"text": it.text, "section": it.section, "by": it.by.name()}));
    let suggestions = report.suggestions.iter().map(|it| {
        json!({
            "bus": page.bus_name(it.bus),
            "node": it.node.number(),
            "profile": it.profile,
            "title": it.title,
            "because": it.because,
        })
    });
    let doubts =
        report.doubts.iter().map(|(bus, reason)| json!({"bus": page.bus_name(*bus), "reason": reason}));
    let dialogues = report.dialogues.iter().map(|(bus, it)| {
        json!({
            "bus": page.bus_name(*bus),
            "request": it.request.to_string(),
            "response": it.response.to_string(),
            "node": it.node,
            "bus_file": it.bus_file(),
        })
    });
    let stories = (1..).zip(&report.diagnosis.stories).map(|(number, it)| page.story(number, it));
    let notes = report.diagnosis.notes.iter().map(|it| page.story_line(&it.line));
    let steps = report.diagnosis.stories.get(report.story).map(|story| &story.steps);
    let steps = steps.into_iter().flatten();
    let steps = steps.map(|it| json!({"text": it.text, "section": it.section, "by": it.by.name()}));
    let checks: Vec<_> = steps.chain(checks.filter(|_| report.diagnosis.stories.is_empty())).collect();
    let members = [
        ("capture", json!(capture).to_string()),
        ("node", json!(chosen.map(|chosen| chosen.node.number())).to_string()),
        ("at", json!(at).to_string()),
        ("stories", list(stories)),
        ("notes", list(notes)),
        ("fault", fault),
        ("presumed", report.is_presumed.to_string()),
        ("before", page.events(before)),
        ("since", page.events(&report.since)),
        ("silent", list(report.quiet.iter().map(quiet))),
        ("nodes", list(report.nodes.iter().map(|state| page.node(state)))),
        ("reactions", list(report.reactions.iter().map(|it| page.reaction(it)))),
        ("checks", list(checks.into_iter())),
        ("document", json!(report.document).to_string()),
        ("suggestions", list(suggestions)),
        ("not_canopen", list(doubts)),
        ("sdo_dialogues", list(dialogues)),
    ];
    escape_json(&object(&members)).into_owned()
}

/// A JSON object from members that are already JSON.
fn object(members: &[(&str, String)]) -> String {
    let members: Vec<_> = members.iter().map(|(key, value)| format!("\"{key}\":{value}")).collect();
    format!("{{{}}}", members.join(","))
}

fn list(values: impl Iterator<Item = Value>) -> String {
    let values: Vec<_> = values.map(|value| value.to_string()).collect();
    format!("[{}]", values.join(","))
}

struct Page<'a> {
    buses: Buses<'a>,
    first: Option<Timestamp>,
}

impl Page<'_> {
    fn bus(&self, index: BusIndex) -> Option<&Bus> {
        self.buses.iter().find(|bus| bus.index() == index)
    }

    fn reaction(&self, reaction: &Reaction) -> Value {
        let Reaction { bus, node, time } = reaction;
        let part = |part| time.times.percentile(part).map(millis);
        let (at, frame) = time.longest_at;
        json!({
            "bus": self.bus_name(*bus),
            "node": node.number(),
            "tpdo": time.tpdo.to_string(),
            "rpdo": time.rpdo.to_string(),
            "count": time.times.count(),
            "p50_ms": part(50),
            "p99_ms": part(99),
            "max_ms": millis(time.times.longest()),
            "max_at": self.first.map(|first| Timestamp(at.saturating_sub(first.0)).to_string()),
            "max_frame": frame,
        })
    }

    fn story(&self, number: usize, story: &Story) -> Value {
        json!({
            "story": number,
            "severity": story.severity.name(),
            "bus": self.bus_name(story.bus),
            "node": story.node.map(NodeId::number),
            "title": story.title,
            "cause_visible": story.is_cause_visible,
            "seconds": self.seconds(story.began),
            "frames": frames(story.began),
            "findings": story.findings,
            "rules": story.rules.iter().map(|rule| &**rule).collect::<Vec<_>>(),
            "lines": story.lines.iter().map(|line| self.story_line(line)).collect::<Vec<_>>(),
        })
    }

    fn story_line(&self, line: &StoryLine) -> Value {
        json!({
            "label": line.label.key(),
            "text": line.text,
            "seconds": self.seconds(line.at),
            "frames": frames(line.at),
        })
    }

    fn seconds(&self, at: Occurrence) -> Option<f64> {
        #[expect(clippy::cast_precision_loss, reason = "only for display")]
        let seconds = |nanoseconds: i64| nanoseconds as f64 / 1e9;
        Some(seconds(at.time?.since(self.first?)))
    }

    fn bus_name(&self, index: BusIndex) -> Option<&str> {
        self.bus(index).map(Bus::name)
    }

    fn events(&self, events: &[Event]) -> String {
        let lines: Vec<_> = events.iter().filter_map(|event| self.event(event)).collect();
        format!("[{}]", lines.join(","))
    }

    fn event(&self, event: &Event) -> Option<String> {
        let mut line = Vec::new();
        Jsonl::new(&mut line).write(event, self.bus(event.bus)?);
        Some(String::from_utf8(line).ok()?.trim_end().to_owned())
    }

    fn moment(&self, moment: &Moment) -> String {
        let kinds: Vec<_> = moment.kinds.iter().map(|kind| kind.name()).collect();
        let seconds =
            moment.time.zip(self.first).map(|(time, first)| Timestamp(time.since(first)).to_string());
        let grade = match moment.grade() {
            FaultGrade::Fault => "fault",
            FaultGrade::Minor => "minor",
            FaultGrade::Refused => "refused",
        };
        object(&[
            ("kinds", json!(kinds).to_string()),
            ("grade", json!(grade).to_string()),
            ("t", moment.time.map_or("null".into(), |time| time.to_string())),
            ("seconds", seconds.unwrap_or_else(|| "null".into())),
            ("frame", moment.frame.to_string()),
            ("bus", json!(self.bus_name(moment.bus)).to_string()),
            ("node", json!(moment.node.map(NodeId::number)).to_string()),
            ("events", self.events(&moment.events)),
            ("more", moment.more.to_string()),
        ])
    }

    fn node(&self, state: &NodeState) -> Value {
        let node = self.bus(state.bus).and_then(|bus| bus.node(state.node));
        let errors = state.errors.iter().map(|code| format!("0x{code:04X}"));
        let states = state.states.iter().map(|(channel, name)| json!({"channel": channel, "state": name}));
        json!({
            "bus": self.bus_name(state.bus),
            "node": state.node.number(),
            "name": node.and_then(|node| node.name()),
            "device": node.and_then(|node| node.device_id()),
            "nmt": state.nmt.map(|nmt| nmt.state.name()),
            "nmt_confirmed": state.nmt.is_some_and(|nmt| nmt.certainty == Certainty::Confirmed),
            "lost": state.lost,
            "states": states.collect::<Vec<_>>(),
            "active_errors": errors.collect::<Vec<_>>(),
            "active_dtcs": state.dtcs.iter().map(|(spn, fmi)| json!({"spn": spn, "fmi": fmi})).collect::<Vec<_>>(),
            "set_points": state.set_points.iter().map(point).collect::<Vec<_>>(),
        })
    }
}

fn frames(at: Occurrence) -> Option<[u64; 2]> {
    (at.frames.last > 0).then_some([at.frames.first, at.frames.last])
}

fn point(state: &PointState) -> Value {
    let gates = state.gates.iter().map(|gate| {
        json!({
            "gate": gate.gate,
            "status": gate.status.name(),
            "detail": gate.detail,
            "text": gate.text,
            "check": gate.check,
            "source": gate.source,
        })
    });
    let point = &state.point;
    json!({
        "object": format!("0x{}", point.object),
        "signal": point.signal,
        "channel": point.channel,
        "value": point.to.number,
        "text": point.to.text,
        "unit": point.unit,
        "assumed": point.assumed,
        "effective": state.effective.name(),
        "gates": gates.collect::<Vec<_>>(),
    })
}

fn quiet(quiet: &StoppedMessage) -> Value {
    let what = match quiet.what {
        Rhythm::Sync => "sync".to_owned(),
        Rhythm::Guarding => "guard-request".to_owned(),
        Rhythm::Rpdo(name) => name.to_string(),
    };
    #[expect(clippy::cast_precision_loss, reason = "only for display")]
    let seconds = |nanoseconds: i64| nanoseconds as f64 / 1e9;
    json!({
        "what": what,
        "gap": seconds(quiet.gap),
        "usual": seconds(quiet.usual),
        "last_frame": quiet.last_frame,
    })
}

#[expect(clippy::cast_precision_loss, reason = "only for display")]
fn millis(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e6
}
