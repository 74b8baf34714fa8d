//! Statistics as tables.

use std::fmt::Write as _;

use crate::escape::escape;
use crate::event::StateCertainty;
use crate::profile;
use crate::session::{Bus, Buses, Node};
use crate::sink::table::{CellAlignment, TextTable};
use crate::statistics::{
    BusStatistics, CaptureBeginning, CaptureQuality, DurationDistribution, IntervalStatistics,
    NodeStatistics, Statistics, dtc_of_key,
};
use crate::suggestion::firm_suggestions;
use crate::wire::NodeId;
use crate::words::count_noun;

use super::addresses::{dtc_words, push_table};
use super::phrases::{
    capture_defects, command_texts, error_frames, format_since, granularity_text, period_text,
    protocols_text, rate_texts,
};
use crate::figures::{format_millis, format_seconds};

/// Reason why CANopen is only presumed, and what confirms it.
const UNCONFIRMED: &str = "no heartbeat, NMT command or SDO response; --protocol canopen, --node ID=PROFILE or a bus file \
                           with the nodes (convert --bus-file writes one) confirms CANopen";

/// Statistics of a capture, and its buses after the last frame.
pub struct StatisticsReport<'a> {
    /// Name of the capture.
    pub capture: &'a str,
    /// Title of the capture format.
    pub format: &'a str,
    /// Figures of frames and events.
    pub statistics: &'a Statistics,
    /// Names, NMT states and active errors of nodes.
    pub buses: Buses<'a>,
    /// Bit rate of a bus.
    pub bit_rate: &'a dyn Fn(&Bus) -> Option<u32>,
}

/// Writes the report of one capture.
pub fn write_report(report: &StatisticsReport<'_>, output: &mut String) {
    let mut text = String::new();
    let start = report.statistics.quality.first.unwrap_or(0);
    let _ = writeln!(text, "== {} ({})", escape(report.capture), report.format);
    push_quality(report, &mut text);
    for (bus, statistics) in report.buses.iter().zip(&report.statistics.buses) {
        let _ = writeln!(text);
        push_load(report, bus, statistics, start, &mut text);
        push_master(statistics, &report.statistics.quality, &mut text);
        let end = report.statistics.quality.last;
        push_nodes(bus, statistics, end, start, &mut text);
        push_table(bus, statistics, &mut text);
        push_sdo(statistics, &mut text);
        push_reactions(statistics, start, &mut text);
        push_codes(bus, statistics, &mut text);
        push_ids(bus, statistics, end, start, &mut text);
    }
    for line in text.lines() {
        output.push_str(&escape(line.trim_end()));
        output.push('\n');
    }
}

fn push_quality(report: &StatisticsReport<'_>, text: &mut String) {
    let quality = &report.statistics.quality;
    if quality.frames == 0 {
        // Timestamps and error frames of the capture are unknown without a frame.
        let _ = writeln!(text, "capture   no frame selected");
    } else {
        let duration = quality
            .duration()
            .map_or("without timestamps".into(), |duration| format!("in {} s", format_seconds(duration)));
        let _ = write!(text, "capture   {} {duration}", count_noun(quality.frames, "frame"));
        if let Some(stamps) = granularity_text(quality) {
            let _ = write!(text, "; {stamps}");
        }
        let _ = writeln!(text);
    }
    if quality.error_frames == 0 && quality.frames > 0 {
        let _ = writeln!(text, "          no error frames recorded: quality of the wiring unknown");
    } else if quality.error_frames > 0 {
        let _ = writeln!(text, "          {}", error_frames(quality));
    }
    for fault in capture_defects(quality) {
        let _ = writeln!(text, "          {fault}");
    }
}

fn push_load(
    report: &StatisticsReport<'_>,
    bus: &Bus,
    statistics: &BusStatistics,
    start: i64,
    text: &mut String,
) {
    let _ = writeln!(text, "bus {:<5} {}", bus.name(), protocols_text(bus));
    let quality = &report.statistics.quality;
    if quality.frames > 0 {
        for line in
            rate_texts(statistics, quality.duration(), start, (report.bit_rate)(bus), "--bitrate 250k")
        {
            let _ = writeln!(text, "          {line}");
        }
        if let Some(beginning) = statistics.capture_beginning() {
            let _ = writeln!(text, "          {}", beginning_text(&beginning));
        }
    }
    if bus.protocols().is_canopen_presumed() {
        let _ = writeln!(text, "          {UNCONFIRMED}");
    }
    if statistics.undecoded + statistics.malformed > 0 {
        // Services other than SYNC, TIME and PDO are decoded only on a confirmed bus.
        let known = if bus.protocols().is_canopen_presumed() { "known or confirmed" } else { "known" };
        let _ = writeln!(
            text,
            "          {} of no {known} service, {} malformed",
            count_noun(statistics.undecoded, "frame"),
            statistics.malformed
        );
    }
    for suggestion in firm_suggestions(bus) {
        let is_only = report.buses.len() == 1;
        let _ = writeln!(text, "          {}", suggestion.text(bus, is_only));
    }
    for hint in bus.hints().sdo_dialogues() {
        let _ = writeln!(text, "          {hint}");
        for line in hint.bus_file().lines() {
            let _ = writeln!(text, "          {line}");
        }
    }
    for hint in bus.hints().unnamed_uds() {
        let _ = writeln!(text, "          {hint}");
    }
}

/// `begins in operation: nodes 2/02, 5/05 running; node 7/07 starting later`.
fn beginning_text(beginning: &CaptureBeginning) -> String {
    let CaptureBeginning { running, starting, .. } = beginning;
    match (running.is_empty(), starting.is_empty(), beginning.is_reset) {
        (true, _, true) => format!("begins at an NMT reset: {} starting", nodes_of(starting)),
        (true, _, false) => format!("begins before power-on: {} starting", nodes_of(starting)),
        (false, true, _) => format!("begins in operation: {} running", nodes_of(running)),
        (false, false, _) => {
            format!(
                "begins in operation: {} running; {} starting later",
                nodes_of(running),
                nodes_of(starting)
            )
        }
    }
}

/// `node 2/02`, `nodes 2/02, 5/05`, `23 nodes`.
fn nodes_of(nodes: &[NodeId]) -> String {
    const LISTED: usize = 6;
    let labels: Vec<_> = nodes.iter().map(|id| id.label()).collect();
    match nodes.len() {
        1 => format!("node {}", labels.join("")),
        2..=LISTED => format!("nodes {}", labels.join(", ")),
        number => count_noun(number, "node"),
    }
}

fn push_master(statistics: &BusStatistics, quality: &CaptureQuality, text: &mut String) {
    let parts = command_texts(statistics, quality);
    for (index, part) in parts.iter().enumerate() {
        let _ = writeln!(text, "{:<9} {part}", if index == 0 { "master" } else { "" });
    }
}

fn push_nodes(bus: &Bus, statistics: &BusStatistics, end: Option<i64>, start: i64, text: &mut String) {
    let mut table = TextTable::new(&[
        ("ID/hex", CellAlignment::Right),
        ("name", CellAlignment::Left),
        ("NMT", CellAlignment::Left),
        ("boots", CellAlignment::Right),
        ("lost", CellAlignment::Right),
        ("heartbeat ms (min to max)", CellAlignment::Left),
        ("worst from", CellAlignment::Right),
        ("EMCY", CellAlignment::Right),
        ("active", CellAlignment::Right),
        ("", CellAlignment::Left),
    ]);
    let present = || statistics.nodes().filter(|(_, node)| node.is_present());
    for (id, node) in present() {
        let known = bus.node(id);
        let state = known.and_then(Node::nmt).map_or("?".to_owned(), |nmt| {
            let mark = if nmt.certainty == StateCertainty::Confirmed { "" } else { "?" };
            format!("{}{mark}", nmt.state.name())
        });
        let (beat, worst) = heartbeat_texts(node, start);
        let emcy = node.emcy.codes.iter().map(|(_, count)| count).sum::<u64>() + node.emcy.others;
        table.add_row([
            id.label(),
            known.and_then(|node| node.name()).unwrap_or("").to_owned(),
            state,
            node.boots.to_string(),
            node.lost.to_string(),
            beat,
            worst,
            emcy.to_string(),
            known.map_or(0, |node| node.active_errors().len()).to_string(),
            silence_text(&node.heartbeat, end, start),
        ]);
    }
    if table.is_empty() {
        return;
    }
    text.push('\n');
    table.write_table(1, text);
    for (id, node) in present() {
        let mut ids = node.pdo_ids.clone();
        ids.sort_unstable();
        let ids: Vec<String> = ids.iter().map(|(name, id)| format!("{name} {id}")).collect();
        if !ids.is_empty() {
            let _ = writeln!(text, " {:>6}  PDOs: {}", id.label(), ids.join(", "));
        }
        let (requests, replies) = node.guarding;
        if requests > 0 {
            let every = period_text(&node.guard_requests, start);
            let _ = writeln!(
                text,
                " {:>6}  guarding: {replies} responses to {};{every}",
                id.label(),
                count_noun(requests, "request")
            );
        }
    }
}

/// `100.0 (99.4 to 113.0)`: median, shortest and longest interval; and the start of the longest one.
fn heartbeat_texts(node: &NodeStatistics, start: i64) -> (String, String) {
    let beat = &node.heartbeat;
    let (Some(shortest), Some((longest, began))) = (beat.shortest(), beat.longest()) else {
        return ("–".into(), String::new());
    };
    let median = node.heartbeat_distribution.percentile(50).unwrap_or(0).clamp(shortest, longest);
    let (median, shortest, longest) =
        (format_millis(median), format_millis(shortest), format_millis(longest));
    (format!("{median} ({shortest} to {longest})"), format!("{} s", format_since(began, start)))
}

/// `silent since 4.900 s`.
fn silence_text(intervals: &IntervalStatistics, end: Option<i64>, start: i64) -> String {
    intervals
        .silent_since(end)
        .map_or(String::new(), |last| format!("silent since {} s", format_since(last, start)))
}

fn push_sdo(statistics: &BusStatistics, text: &mut String) {
    let served: Vec<_> = statistics
        .nodes()
        .filter(|(_, node)| node.sdo.complete + node.sdo.aborted + node.sdo.timeout + node.sdo.other > 0)
        .collect();
    if served.is_empty() {
        return;
    }
    let _ = writeln!(
        text,
        "\n SDO server    ok  aborted  no response  other   ms p50     p90     p99     max   think ms p50"
    );
    for (id, node) in served {
        let part = |of: &DurationDistribution, part| of.percentile(part).map_or("–".into(), format_millis);
        let times = &node.sdo_duration;
        let _ = writeln!(
            text,
            "{:>6}    {:>6}  {:>7}  {:>11}  {:>5}  {:>7} {:>7} {:>7} {:>7}  {:>13}",
            id.label(),
            node.sdo.complete,
            node.sdo.aborted,
            node.sdo.timeout,
            node.sdo.other,
            part(times, 50),
            part(times, 90),
            part(times, 99),
            part(times, 100),
            part(&node.think_time, 50),
        );
    }
}

/// Time from a changed TPDO to the next changed RPDO of the same node.
fn push_reactions(statistics: &BusStatistics, start: i64, text: &mut String) {
    let mut table = TextTable::new(&[
        ("reaction", CellAlignment::Left),
        ("PDOs", CellAlignment::Left),
        ("count", CellAlignment::Right),
        ("ms p50", CellAlignment::Right),
        ("p99", CellAlignment::Right),
        ("max", CellAlignment::Right),
        ("at", CellAlignment::Right),
        ("", CellAlignment::Left),
    ]);
    for (id, node) in statistics.nodes() {
        for pair in node.reactions.pairs() {
            let part = |part| pair.times.percentile(part).map(format_millis).unwrap_or_default();
            let (time, frame) = pair.longest_at;
            table.add_row([
                id.label(),
                format!("{} → {}", pair.tpdo, pair.rpdo),
                pair.times.duration_count().to_string(),
                part(50),
                part(99),
                part(100),
                format!("{} s", format_since(time, start)),
                format!("{{{frame}}}"),
            ]);
        }
    }
    if !table.is_empty() {
        text.push('\n');
        table.write_table(1, text);
    }
}

fn push_codes(bus: &Bus, statistics: &BusStatistics, text: &mut String) {
    let mut lines = Vec::new();
    for (id, node) in statistics.nodes() {
        for (code, count) in node.aborts.sort_by_count() {
            let words = profile::abort_codes().code_text(code);
            lines.push(format!("{:>6}   SDO abort {code:08X} {words}: {count}", id.label()));
        }
        for (code, count) in node.emcy.sort_by_count() {
            let code = u16::try_from(code).unwrap_or(0);
            let device = bus.node(id).map_or(profile::plain_device(), |node| node.device());
            let words = device.error_text(code);
            lines.push(format!("{:>6}   EMCY {code:04X} {words}: {count}", id.label()));
        }
        for (key, count) in node.dtcs.sort_by_count() {
            let (spn, fmi) = dtc_of_key(key);
            let words = dtc_words(bus.node(id), spn, fmi);
            lines.push(format!("{:>6}   SPN {spn} FMI {fmi} {words}: {count}", id.label()));
        }
        let others = node.aborts.others + node.emcy.others + node.dtcs.others;
        if others > 0 {
            lines.push(format!("{:>6}   further codes: {others}", id.label()));
        }
    }
    if !lines.is_empty() {
        let _ = writeln!(text, "\n errors\n{}", lines.join("\n"));
    }
}

fn push_ids(bus: &Bus, statistics: &BusStatistics, end: Option<i64>, start: i64, text: &mut String) {
    let mut table = TextTable::new(&[
        ("ID", CellAlignment::Left),
        ("meaning", CellAlignment::Left),
        ("frames", CellAlignment::Right),
        ("ms min", CellAlignment::Right),
        ("mean", CellAlignment::Right),
        ("max", CellAlignment::Right),
        ("worst from", CellAlignment::Right),
        ("", CellAlignment::Left),
    ]);
    let ids = statistics.ids();
    for (id, is_remote, figures) in &ids {
        let intervals = &figures.intervals;
        let longest = intervals.longest();
        table.add_row([
            if *is_remote { format!("{id} R") } else { id.to_string() },
            bus.describe_id(*id),
            figures.frames.to_string(),
            intervals.shortest().map(format_millis).unwrap_or_default(),
            intervals.mean().map(format_millis).unwrap_or_default(),
            longest.map_or(String::new(), |(length, _)| format_millis(length)),
            longest.map_or(String::new(), |(_, began)| format!("{} s", format_since(began, start))),
            silence_text(intervals, end, start),
        ]);
    }
    if !table.is_empty() {
        text.push('\n');
        table.write_table(1, text);
    }
    if ids.iter().any(|(_, is_remote, _)| *is_remote) {
        let _ = writeln!(text, " R: remote frames");
    }
    if statistics.other_ids > 0 {
        let _ = writeln!(text, " further identifiers: {}", count_noun(statistics.other_ids, "frame"));
    }
}
