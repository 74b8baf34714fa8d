//! Answers from the results of a whole capture.

use anyhow::bail;
use cobscope_decoder::answers::objects::ObjectRecord;
use cobscope_decoder::session::Buses;
use serde_json::{Map, Value, json};

use super::arguments::CallArguments;
use super::capture::{OpenedCapture, node_in};
use super::fit::fit_value;
use crate::run::arguments::NodeArg;
use crate::select::{BoundSide, RangeBound};

/// Overview of a capture.
pub(super) fn summary_answer(capture: &OpenedCapture) -> String {
    let mut answer = capture.results.statistics.clone();
    if let Some(members) = answer.as_object_mut() {
        let titles = value_list(&capture.results.why, "stories").iter().map(|story| {
            json!({"story": story["story"], "severity": story["severity"], "title": story["title"], "seconds": story["seconds"]})
        });
        members.insert("stories".into(), titles.collect());
        members.insert("findings".into(), finding_counts(&capture.results.findings));
        members.insert("warnings".into(), json!(capture.results.warnings));
    }
    fit_value(answer)
}

/// Number of findings of each rule and severity.
fn finding_counts(findings: &[Value]) -> Value {
    let mut counts: Map<String, Value> = Map::new();
    for finding in findings.iter().filter(|line| counts_as_finding(line)) {
        let text = |key: &str| finding[key].as_str().unwrap_or_default();
        let key = format!("{} {}", text("severity"), text("rule"));
        let count = counts.get(&key).and_then(Value::as_u64).unwrap_or(0);
        counts.insert(key, json!(count.saturating_add(1)));
    }
    Value::Object(counts)
}

/// Whether a line is a printed finding: the bus file does not suppress it.
fn counts_as_finding(line: &Value) -> bool {
    line["kind"] == "finding" && line.get("suppressed").is_none()
}

fn value_list<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

/// The stories.
///
/// # Errors
/// A bound is not valid in this capture, or no story is left.
pub(super) fn why_answer(capture: &OpenedCapture, arguments: &CallArguments) -> anyhow::Result<String> {
    let node = arguments.parse_argument::<NodeArg>("node")?;
    capture.ensure_node(node.as_ref())?;
    let at = seconds_of(capture, arguments)?;
    let wanted = arguments.number_argument("story");
    let mut stories: Vec<_> = value_list(&capture.results.why, "stories").to_vec();
    let count = stories.len();
    stories.retain(|story| {
        is_of(story, node.as_ref())
            && wanted.is_none_or(|wanted| story["story"] == wanted)
            && at.is_none_or(|at| is_by(story, at))
    });
    if at.is_some() {
        let began = |story: &Value| story["seconds"].as_f64().unwrap_or(0.0);
        let latest = stories.iter().map(began).fold(f64::MIN, f64::max);
        stories.retain(|story| began(story) >= latest);
    }
    if stories.is_empty() && count > 0 {
        bail!("none of the {count} stories of this capture is selected");
    }
    let mut answer = capture.results.why.clone();
    if let Some(members) = answer.as_object_mut() {
        if node.is_some() || at.is_some() || wanted.is_some() {
            // The rest describes the first story.
            members
                .retain(|key, _| ["capture", "notes", "suggestions", "not_canopen"].contains(&key.as_str()));
        }
        members.insert("stories".into(), json!(stories));
        // Without a story, a damaged capture must not look like a good one.
        members.insert("warnings".into(), json!(capture.results.warnings));
    }
    Ok(fit_value(answer))
}

/// A time after which a story begins is too late for it; a frame is compared by its number.
#[derive(Clone, Copy)]
enum LatestTime {
    Seconds(f64),
    Frame(u64),
}

fn seconds_of(capture: &OpenedCapture, arguments: &CallArguments) -> anyhow::Result<Option<LatestTime>> {
    let Some(at) = arguments.parse_argument::<RangeBound>("at")? else { return Ok(None) };
    #[expect(clippy::cast_precision_loss, reason = "only compared")]
    let seconds = |nanoseconds: i64| LatestTime::Seconds(nanoseconds as f64 / 1e9);
    Ok(Some(match capture.resolve_bound(at, BoundSide::At)? {
        RangeBound::Frame(frame) => LatestTime::Frame(frame),
        RangeBound::Offset(offset) => seconds(offset),
        RangeBound::Moment(moment) => seconds(moment.since(capture.zero().unwrap_or(moment))),
        RangeBound::Clock(_) => bail!("at: the capture has no date"),
    }))
}

fn is_by(story: &Value, latest: LatestTime) -> bool {
    match latest {
        LatestTime::Seconds(at) => story["seconds"].as_f64().is_none_or(|seconds| seconds <= at),
        LatestTime::Frame(frame) => {
            story["frames"].get(0).and_then(Value::as_u64).is_none_or(|first| first <= frame)
        }
    }
}

fn is_of(value: &Value, node: Option<&NodeArg>) -> bool {
    node.is_none_or(|node| {
        let is_on = node.bus.as_deref().is_none_or(|bus| value["bus"] == bus);
        is_on && value["node"] == node.id.number()
    })
}

/// Violations of rules.
///
/// # Errors
/// An argument is not valid.
pub(super) fn findings_answer(capture: &OpenedCapture, arguments: &CallArguments) -> anyhow::Result<String> {
    const ORDER: [&str; 3] = ["error", "warning", "note"];
    let node = arguments.parse_argument::<NodeArg>("node")?;
    capture.ensure_node(node.as_ref())?;
    let rank = |severity: &str| ORDER.iter().position(|known| *known == severity).unwrap_or(ORDER.len());
    let least = arguments.text_argument("severity").map_or(ORDER.len(), rank);
    let rule = arguments.text_argument("rule");
    capture.ensure_rule(rule)?;
    let found = capture.results.findings.iter().filter(|line| counts_as_finding(line)).filter(|line| {
        rank(line["severity"].as_str().unwrap_or_default()) <= least
            && rule.is_none_or(|rule| line["rule"] == rule)
            && is_of(line, node.as_ref())
    });
    let found: Vec<_> = found.cloned().collect();
    let summary =
        capture.results.findings.iter().find(|line| line["kind"] == "summary").unwrap_or(&Value::Null);
    let rows = value_list(summary, "rules");
    let mut verdicts: Map<String, Value> = Map::new();
    for row in rows {
        let verdict = row["verdict"].as_str().unwrap_or_default();
        let count = verdicts.get(verdict).and_then(Value::as_u64).unwrap_or(0);
        verdicts.insert(verdict.to_owned(), json!(count.saturating_add(1)));
    }
    // A rule without a finding passed, or was not exercised: that is a difference.
    let row = rule.and_then(|rule| rows.iter().find(|row| row["rule"] == rule));
    let warnings = &capture.results.warnings;
    Ok(fit_value(json!({
        "findings": found, "rules": verdicts, "rule": row, "quality": summary["quality"], "warnings": warnings,
    })))
}

/// Object values of nodes.
///
/// # Errors
/// The node is not known, or the time is not in the capture.
pub(super) fn objects_answer(capture: &OpenedCapture, arguments: &CallArguments) -> anyhow::Result<String> {
    let at = arguments.parse_argument::<RangeBound>("at")?;
    let Some(at) = at else { return objects_of(capture.results.decoder.buses(), capture, arguments) };
    let at = capture.resolve_bound(at, BoundSide::At)?;
    let mut walk = capture.indexed.walk_from(capture.walk_start(Some(at)))?;
    let first = capture.zero();
    loop {
        let is_over = walk.peek_frame()?.is_some_and(|frame| at.is_before(frame, first));
        if is_over || !walk.step_item(&mut |_| ())? {
            return objects_of(walk.world.buses(), capture, arguments);
        }
    }
}

fn objects_of(
    buses: Buses<'_>,
    capture: &OpenedCapture,
    arguments: &CallArguments,
) -> anyhow::Result<String> {
    let Some(node) = arguments.parse_argument::<NodeArg>("node")? else {
        let nodes = buses.iter().flat_map(|bus| {
            let count = |node: &cobscope_decoder::session::Node| {
                json!({"bus": bus.name(), "node": node.id().to_string(), "name": node.name(), "device": node.device_id(), "objects": node.store().len()})
            };
            // NMT commands and guarding requests also create nodes that never send.
            let shown = bus.nodes().filter(|node| node.last_seen().0 > 0 || !node.store().is_empty());
            shown.map(count).collect::<Vec<_>>()
        });
        return Ok(fit_value(json!({"nodes": nodes.collect::<Vec<_>>()})));
    };
    let prefix = arguments.text_argument("object").unwrap_or_default().to_uppercase();
    let prefix = prefix.strip_prefix("0X").unwrap_or(&prefix);
    let (bus, found) = node_in(buses, &node)?;
    let all = found.store().sorted();
    let chosen = all.into_iter().filter(|(object, _)| object.to_string().starts_with(prefix));
    let records = chosen
        .map(|object| {
            let mut record = serde_json::to_value(ObjectRecord::new((bus, found), object, ""))?;
            if let Some(members) = record.as_object_mut() {
                members.retain(|key, value| {
                    !["capture", "bus", "node"].contains(&key.as_str()) && !value.is_null()
                });
            }
            Ok(record)
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    Ok(fit_value(
        json!({"capture": capture.name, "bus": bus.name(), "node": node.id.to_string(), "objects": records}),
    ))
}
