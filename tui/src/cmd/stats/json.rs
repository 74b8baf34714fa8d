//! Statistics as one JSON object per capture; times in s, intervals in ms.

use cobscope_decoder::event::Certainty;
use cobscope_decoder::session::{Bus, Node};
use cobscope_decoder::sink::escape_json;
use cobscope_decoder::statistics::{
    BusStatistics, CodeCounts, Distribution, Intervals, NodeStatistics, ReactionTime,
};
use cobscope_decoder::suggestion::{Suggestion, firm_suggestions};
use cobscope_decoder::wire::NodeId;
use serde_json::{Value, json};

use super::j1939;
use super::report::Report;

/// Writes the report of one capture.
pub fn write(report: &Report<'_>, output: &mut String) {
    let quality = &report.statistics.quality;
    let buses: Vec<Value> = report
        .decoder
        .buses()
        .iter()
        .zip(&report.statistics.buses)
        .map(|(bus, statistics)| bus_record(report, bus, statistics))
        .collect();
    let classes: serde_json::Map<String, Value> =
        quality.error_classes.iter().map(|(name, count)| (name.clone(), json!(count))).collect();
    let record = json!({
        "capture": report.capture,
        "format": report.format,
        "frames": quality.frames,
        "duration": quality.duration().map(seconds),
        "granularity_ms": quality.granularity().map(millis),
        "made_up_interval_ms": quality.made_up_interval().map(millis),
        "error_frames": quality.error_frames,
        "error_classes": classes,
        "unreadable": quality.unreadable,
        "lost_frames": quality.lost,
        "clock_steps": quality.clock_steps.0,
        "silences": quality.silences.0,
        "buses": buses,
    });
    output.push_str(&escape_json(&record.to_string()));
    output.push('\n');
}

fn bus_record(report: &Report<'_>, bus: &Bus, statistics: &BusStatistics) -> Value {
    let end = report.statistics.quality.last;
    let load = &statistics.load;
    let master = &statistics.master;
    let commands: serde_json::Map<String, Value> =
        master.commands.iter().map(|(service, count)| (service.name().to_owned(), json!(count))).collect();
    let present = statistics.nodes().filter(|(_, node)| node.is_present());
    let ids = statistics.ids().into_iter().map(|(id, is_remote, figures)| {
        json!({
            "id": id.to_string(),
            "remote": is_remote,
            "what": bus.describe_id(id),
            "frames": figures.frames,
            "period_ms": intervals(&figures.intervals),
            "silent_since": figures.intervals.silent_since(end).map(seconds),
        })
    });
    json!({
        "bus": bus.name(),
        "canopen": bus.is_canopen(),
        "j1939": bus.is_j1939(),
        "uds": bus.is_uds(),
        "unnamed_uds": bus.unnamed_uds().iter().map(|pair| json!({
            "request": pair.request.to_string(),
            "response": pair.response.to_string(),
            "answers": pair.answers,
        })).collect::<Vec<_>>(),
        "sdo_dialogues": bus.sdo_dialogues().iter().map(|pair| json!({
            "request": pair.request.to_string(),
            "response": pair.response.to_string(),
            "node": pair.node,
            "bus_file": pair.bus_file(),
        })).collect::<Vec<_>>(),
        "suggestions": firm_suggestions(bus).iter().map(suggestion).collect::<Vec<_>>(),
        "limits": bus.limits(),
        "doubt": bus.doubt(),
        "bit_rate": report.bit_rate(bus),
        "begins": statistics.beginning().map(|it| json!({
            "at": it.name(),
            "running": numbers(&it.running),
            "starting": numbers(&it.starting),
        })),
        "frames": load.frames,
        "bits": load.bits,
        "worst_second": {"frames": load.worst_frames().0, "bits": load.worst_bits().0},
        "undecoded": statistics.undecoded,
        "malformed": statistics.malformed,
        "nmt_commands": commands,
        "sync": {"count": master.syncs, "counter_gaps": master.sync_gaps, "period_ms": intervals(&master.sync)},
        "time": master.times,
        "guard_requests": master.guard_requests,
        "nodes": present.map(|(id, node)| node_record(bus, id, node, end)).collect::<Vec<_>>(),
        "j1939_devices": j1939::records(bus, statistics),
        "ids": ids.collect::<Vec<_>>(),
    })
}

fn numbers(nodes: &[NodeId]) -> Vec<u8> {
    nodes.iter().map(|id| id.number()).collect()
}

fn suggestion(one: &Suggestion) -> Value {
    json!({"node": one.node.number(), "profile": one.profile, "title": one.title, "because": one.because})
}

fn node_record(bus: &Bus, id: NodeId, node: &NodeStatistics, end: Option<i64>) -> Value {
    let known = bus.node(id);
    let nmt = known.and_then(Node::nmt);
    json!({
        "node": id.number(),
        "name": known.and_then(|node| node.name()),
        "nmt": nmt.map(|nmt| nmt.state.name()),
        "nmt_confirmed": nmt.map(|nmt| nmt.certainty == Certainty::Confirmed),
        "boots": node.boots,
        "lost": node.lost,
        "heartbeat_ms": intervals(&node.heartbeat),
        "heartbeat_median_ms": node.heartbeat_distribution.percentile(50).map(millis),
        "silent_since": node.heartbeat.silent_since(end).map(seconds),
        "guard_period_ms": intervals(&node.guard_requests),
        "guard_requests": node.guarding.0,
        "guard_replies": node.guarding.1,
        "sdo": {
            "complete": node.sdo.complete,
            "aborted": node.sdo.aborted,
            "timeout": node.sdo.timeout,
            "other": node.sdo.other,
            "duration_ms": distribution(&node.sdo_duration),
            "think_time_ms": distribution(&node.think_time),
            "abort_codes": codes(&node.aborts, 8),
        },
        "reactions": node.reactions.pairs().iter().map(reaction).collect::<Vec<_>>(),
        "emcy_codes": codes(&node.emcy, 4),
        "emcy_active": known.map_or(0, |node| node.active_errors().len()),
        "pdos": node.pdos,
        "pdo_ids": node.pdo_ids.iter().map(|(name, id)| [name.to_string(), id.to_string()]).collect::<Vec<_>>(),
    })
}

fn reaction(pair: &ReactionTime) -> Value {
    let (time, frame) = pair.longest_at;
    json!({
        "tpdo": pair.tpdo.to_string(),
        "rpdo": pair.rpdo.to_string(),
        "time_ms": distribution(&pair.times),
        "max_at": seconds(time),
        "max_frame": frame,
    })
}

fn codes(counts: &CodeCounts, digits: usize) -> Value {
    let all = counts.sorted().into_iter();
    all.map(|(code, count)| (format!("0x{code:0digits$X}"), json!(count)))
        .collect::<serde_json::Map<_, _>>()
        .into()
}

fn intervals(intervals: &Intervals) -> Value {
    match (intervals.shortest(), intervals.mean(), intervals.longest()) {
        (Some(shortest), Some(mean), Some((longest, began))) => json!({
            "min": millis(shortest), "mean": millis(mean), "max": millis(longest), "worst_from": seconds(began),
        }),
        _ => Value::Null,
    }
}

fn distribution(of: &Distribution) -> Value {
    if of.count() == 0 {
        return Value::Null;
    }
    let part = |part| of.percentile(part).map(millis);
    json!({"count": of.count(), "p50": part(50), "p90": part(90), "p99": part(99), "max": millis(of.longest())})
}

#[expect(clippy::cast_precision_loss, reason = "only for display")]
fn millis(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e6
}

#[expect(clippy::cast_precision_loss, reason = "only for display")]
fn seconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e9
}
