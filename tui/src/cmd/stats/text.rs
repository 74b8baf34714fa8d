//! Statistics as tables.

use std::fmt::Write as _;

use cobscope_decoder::event::Certainty;
use cobscope_decoder::profile;
use cobscope_decoder::session::{Bus, Node};
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::table::{Align, Table};
use cobscope_decoder::statistics::{
    Beginning, BusStatistics, Distribution, Intervals, NodeStatistics, Quality, dtc_of_key,
};
use cobscope_decoder::suggestion::firm_suggestions;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::words::plural;

use super::j1939;
use super::report::Report;
use crate::figures::{millis, seconds};
use crate::words::{commands, error_frames, faults, period, protocols, rates, since, stamps};

/// Reason why CANopen is only presumed, and what confirms it.
const UNCONFIRMED: &str = "no heartbeat, NMT command or SDO response; --protocol canopen, --node ID=PROFILE or a bus file \
                           with the nodes (convert --bus-file writes one) confirms CANopen";

/// Writes the report of one capture.
pub fn write(report: &Report<'_>, output: &mut String) {
    let mut text = String::new();
    let start = report.statistics.quality.first.unwrap_or(0);
    let _ = writeln!(text, "== {} ({})", escape(&report.capture), report.format);
    quality(report, &mut text);
    for (bus, statistics) in report.decoder.buses().iter().zip(&report.statistics.buses) {
        let _ = writeln!(text);
        load(report, bus, statistics, start, &mut text);
        master(statistics, &report.statistics.quality, &mut text);
        let end = report.statistics.quality.last;
        nodes(bus, statistics, end, start, &mut text);
        j1939::table(bus, statistics, &mut text);
        sdo(statistics, &mut text);
        reactions(statistics, start, &mut text);
        codes(bus, statistics, &mut text);
        ids(bus, statistics, end, start, &mut text);
    }
    for line in text.lines() {
        output.push_str(&escape(line.trim_end()));
        output.push('\n');
    }
}

fn quality(report: &Report<'_>, text: &mut String) {
    let quality = &report.statistics.quality;
    if quality.frames == 0 {
        // Timestamps and error frames of the capture are unknown without a frame.
        let _ = writeln!(text, "capture   no frame selected");
    } else {
        let duration = quality
            .duration()
            .map_or("without timestamps".into(), |duration| format!("in {} s", seconds(duration)));
        let _ = write!(text, "capture   {} {duration}", plural(quality.frames, "frame"));
        if let Some(stamps) = stamps(quality) {
            let _ = write!(text, "; {stamps}");
        }
        let _ = writeln!(text);
    }
    if quality.error_frames == 0 && quality.frames > 0 {
        let _ = writeln!(text, "          no error frames recorded: quality of the wiring unknown");
    } else if quality.error_frames > 0 {
        let _ = writeln!(text, "          {}", error_frames(quality));
    }
    for fault in faults(quality) {
        let _ = writeln!(text, "          {fault}");
    }
}

fn load(report: &Report<'_>, bus: &Bus, statistics: &BusStatistics, start: i64, text: &mut String) {
    let _ = writeln!(text, "bus {:<5} {}", bus.name(), protocols(bus));
    let quality = &report.statistics.quality;
    if quality.frames > 0 {
        for line in rates(statistics, quality.duration(), start, report.bit_rate(bus), "--bitrate 250k") {
            let _ = writeln!(text, "          {line}");
        }
        if let Some(beginning) = statistics.beginning() {
            let _ = writeln!(text, "          {}", begins(&beginning));
        }
    }
    if bus.is_canopen_presumed() {
        let _ = writeln!(text, "          {UNCONFIRMED}");
    }
    if statistics.undecoded + statistics.malformed > 0 {
        // Services other than SYNC, TIME and PDO are decoded only on a confirmed bus.
        let known = if bus.is_canopen_presumed() { "known or confirmed" } else { "known" };
        let _ = writeln!(
            text,
            "          {} of no {known} service, {} malformed",
            plural(statistics.undecoded, "frame"),
            statistics.malformed
        );
    }
    for suggestion in firm_suggestions(bus) {
        let is_only = report.decoder.buses().len() == 1;
        let _ = writeln!(text, "          {}", suggestion.text(bus, is_only));
    }
    for hint in bus.sdo_dialogues() {
        let _ = writeln!(text, "          {hint}");
        for line in hint.bus_file().lines() {
            let _ = writeln!(text, "          {line}");
        }
    }
    for hint in bus.unnamed_uds() {
        let _ = writeln!(text, "          {hint}");
    }
}

/// `begins in operation: nodes 2/02, 5/05 running; node 7/07 starting later`.
fn begins(beginning: &Beginning) -> String {
    let Beginning { running, starting, .. } = beginning;
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
        number => plural(number, "node"),
    }
}

fn master(statistics: &BusStatistics, quality: &Quality, text: &mut String) {
    let parts = commands(statistics, quality);
    for (index, part) in parts.iter().enumerate() {
        let _ = writeln!(text, "{:<9} {part}", if index == 0 { "master" } else { "" });
    }
}

fn nodes(bus: &Bus, statistics: &BusStatistics, end: Option<i64>, start: i64, text: &mut String) {
    let mut table = Table::new(&[
        ("ID/hex", Align::Right),
        ("name", Align::Left),
        ("NMT", Align::Left),
        ("boots", Align::Right),
        ("lost", Align::Right),
        ("heartbeat ms (min to max)", Align::Left),
        ("worst from", Align::Right),
        ("EMCY", Align::Right),
        ("active", Align::Right),
        ("", Align::Left),
    ]);
    let present = || statistics.nodes().filter(|(_, node)| node.is_present());
    for (id, node) in present() {
        let known = bus.node(id);
        let state = known.and_then(Node::nmt).map_or("?".to_owned(), |nmt| {
            let mark = if nmt.certainty == Certainty::Confirmed { "" } else { "?" };
            format!("{}{mark}", nmt.state.name())
        });
        let (beat, worst) = heartbeat(node, start);
        let emcy = node.emcy.codes.iter().map(|(_, count)| count).sum::<u64>() + node.emcy.others;
        table.row([
            id.label(),
            known.and_then(|node| node.name()).unwrap_or("").to_owned(),
            state,
            node.boots.to_string(),
            node.lost.to_string(),
            beat,
            worst,
            emcy.to_string(),
            known.map_or(0, |node| node.active_errors().len()).to_string(),
            silent(&node.heartbeat, end, start),
        ]);
    }
    if table.is_empty() {
        return;
    }
    text.push('\n');
    table.write(1, text);
    for (id, node) in present() {
        let mut ids = node.pdo_ids.clone();
        ids.sort_unstable();
        let ids: Vec<String> = ids.iter().map(|(name, id)| format!("{name} {id}")).collect();
        if !ids.is_empty() {
            let _ = writeln!(text, " {:>6}  PDOs: {}", id.label(), ids.join(", "));
        }
        let (requests, replies) = node.guarding;
        if requests > 0 {
            let every = period(&node.guard_requests, start);
            let _ = writeln!(
                text,
                " {:>6}  guarding: {replies} responses to {};{every}",
                id.label(),
                plural(requests, "request")
            );
        }
    }
}

/// `100.0 (99.4 to 113.0)`: median, shortest and longest interval; and the start of the longest one.
fn heartbeat(node: &NodeStatistics, start: i64) -> (String, String) {
    let beat = &node.heartbeat;
    let (Some(shortest), Some((longest, began))) = (beat.shortest(), beat.longest()) else {
        return ("–".into(), String::new());
    };
    let median = node.heartbeat_distribution.percentile(50).unwrap_or(0).clamp(shortest, longest);
    let (median, shortest, longest) = (millis(median), millis(shortest), millis(longest));
    (format!("{median} ({shortest} to {longest})"), format!("{} s", since(began, start)))
}

/// `silent since 4.900 s`.
fn silent(intervals: &Intervals, end: Option<i64>, start: i64) -> String {
    intervals.silent_since(end).map_or(String::new(), |last| format!("silent since {} s", since(last, start)))
}

fn sdo(statistics: &BusStatistics, text: &mut String) {
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
        let part = |of: &Distribution, part| of.percentile(part).map_or("–".into(), millis);
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
fn reactions(statistics: &BusStatistics, start: i64, text: &mut String) {
    let mut table = Table::new(&[
        ("reaction", Align::Left),
        ("PDOs", Align::Left),
        ("count", Align::Right),
        ("ms p50", Align::Right),
        ("p99", Align::Right),
        ("max", Align::Right),
        ("at", Align::Right),
        ("", Align::Left),
    ]);
    for (id, node) in statistics.nodes() {
        for pair in node.reactions.pairs() {
            let part = |part| pair.times.percentile(part).map(millis).unwrap_or_default();
            let (time, frame) = pair.longest_at;
            table.row([
                id.label(),
                format!("{} → {}", pair.tpdo, pair.rpdo),
                pair.times.count().to_string(),
                part(50),
                part(99),
                part(100),
                format!("{} s", since(time, start)),
                format!("{{{frame}}}"),
            ]);
        }
    }
    if !table.is_empty() {
        text.push('\n');
        table.write(1, text);
    }
}

fn codes(bus: &Bus, statistics: &BusStatistics, text: &mut String) {
    let mut lines = Vec::new();
    for (id, node) in statistics.nodes() {
        for (code, count) in node.aborts.sorted() {
            let words = profile::abort_codes().text(code);
            lines.push(format!("{:>6}   SDO abort {code:08X} {words}: {count}", id.label()));
        }
        for (code, count) in node.emcy.sorted() {
            let code = u16::try_from(code).unwrap_or(0);
            let device = bus.node(id).map_or(profile::plain_device(), |node| node.device());
            let words = device.error_text(code);
            lines.push(format!("{:>6}   EMCY {code:04X} {words}: {count}", id.label()));
        }
        for (key, count) in node.dtcs.sorted() {
            let (spn, fmi) = dtc_of_key(key);
            let words = j1939::dtc_words(bus.node(id), spn, fmi);
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

fn ids(bus: &Bus, statistics: &BusStatistics, end: Option<i64>, start: i64, text: &mut String) {
    let mut table = Table::new(&[
        ("ID", Align::Left),
        ("meaning", Align::Left),
        ("frames", Align::Right),
        ("ms min", Align::Right),
        ("mean", Align::Right),
        ("max", Align::Right),
        ("worst from", Align::Right),
        ("", Align::Left),
    ]);
    let ids = statistics.ids();
    for (id, is_remote, figures) in &ids {
        let intervals = &figures.intervals;
        let longest = intervals.longest();
        table.row([
            if *is_remote { format!("{id} R") } else { id.to_string() },
            bus.describe_id(*id),
            figures.frames.to_string(),
            intervals.shortest().map(millis).unwrap_or_default(),
            intervals.mean().map(millis).unwrap_or_default(),
            longest.map_or(String::new(), |(length, _)| millis(length)),
            longest.map_or(String::new(), |(_, began)| format!("{} s", since(began, start))),
            silent(intervals, end, start),
        ]);
    }
    if !table.is_empty() {
        text.push('\n');
        table.write(1, text);
    }
    if ids.iter().any(|(_, is_remote, _)| *is_remote) {
        let _ = writeln!(text, " R: remote frames");
    }
    if statistics.other_ids > 0 {
        let _ = writeln!(text, " further identifiers: {}", plural(statistics.other_ids, "frame"));
    }
}
