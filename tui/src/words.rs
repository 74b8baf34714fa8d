//! Text on buses and captures, shared by `stats` and the bus pane.
//!
//! ```text
//! 181 frames, 29.5/s, 1691 bit/s; worst second 47 frames, 2436 bit from 2.849 s
//! SYNC 411 every 10.000 ms (9.812 to 14.200, worst from 3.211 s), jitter ±4.200 ms
//! ```

use cobscope_decoder::session::{Bus, Buses, SessionOptions};
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::{BusStatistics, CaptureQuality, IntervalStatistics, format_span};
use cobscope_decoder::why::NodeChoice;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::words::count_noun;

use crate::figures::{format_bits, format_millis, format_seconds, format_tenths};

/// Maximum number of nodes in a list.
const LISTED: usize = 20;

/// Protocols detected on a bus, or the reason why it is not detected as CANopen.
pub fn protocols_text(bus: &Bus) -> String {
    let seen = [
        (bus.protocols().is_canopen(), "CANopen"),
        (bus.protocols().is_j1939(), "J1939"),
        (bus.protocols().is_uds(), "UDS"),
    ];
    let seen: Vec<_> = seen.iter().filter(|(is_seen, _)| *is_seen).map(|(_, name)| *name).collect();
    match (seen.as_slice(), bus.protocols().detection_doubt()) {
        ([], Some(reason)) => format!("not detected as CANopen: {reason}"),
        ([], None) if bus.protocols().is_canopen_presumed() => "CANopen presumed, not confirmed".to_owned(),
        ([], None) => "no CANopen, J1939 or UDS messages".to_owned(),
        (seen, _) => seen.join(" and "),
    }
}

/// Granularity of the timestamps, or a note that they are synthetic.
pub fn granularity_text(quality: &CaptureQuality) -> Option<String> {
    if let Some(interval) = quality.made_up_interval() {
        return Some(format!("timestamps synthetic (every {}): timing unknown", step_text(interval)));
    }
    if quality.has_equal_stamps() {
        return Some("all timestamps equal: no times".to_owned());
    }
    quality.granularity().map(|granularity| format!("timestamps in steps of {}", step_text(granularity)))
}

/// A step of timestamps: `0.100 ms`, `100 ns`.
fn step_text(nanoseconds: i64) -> String {
    if nanoseconds < 1_000 {
        format!("{nanoseconds} ns")
    } else {
        format!("{} ms", format_millis(nanoseconds))
    }
}

/// `27 error frames: protocol 27, bus-error 27`.
pub fn error_frames(quality: &CaptureQuality) -> String {
    let classes: Vec<String> =
        quality.error_classes.iter().map(|(name, count)| format!("{name} {count}")).collect();
    format!("{}: {}", count_noun(quality.error_frames, "error frame"), classes.join(", "))
}

/// `1 line or record`, `2 lines or records`.
pub fn unreadable_text(count: u64) -> String {
    if count == 1 { "1 line or record".to_owned() } else { format!("{count} lines or records") }
}

/// Error for a bus name in `by` that occurs in no capture; `None` if the name exists.
pub fn unknown_bus(captures: &str, name: &str, by: &str, names: &[&str]) -> Option<String> {
    let (has, shown) = (names.join(", "), escape(name));
    let has = escape(&has);
    (!names.contains(&name)).then(|| format!("{captures}: unknown bus {shown} in {by}; buses present: {has}"))
}

/// Note on nodes that the user named and that sent no frame, with the nodes that did.
pub fn unheard_note(capture: &str, buses: Buses<'_>, options: &SessionOptions) -> Option<String> {
    unheard_until(capture, buses, options, None)
}

/// As [`unheard_note`], for a capture of which only the part up to `end` was read.
pub fn unheard_until(
    capture: &str,
    buses: Buses<'_>,
    options: &SessionOptions,
    end: Option<&str>,
) -> Option<String> {
    let mut missing: Vec<NodeId> = Vec::new();
    for bus in buses.iter() {
        for (node, is_own) in options.named_nodes(bus.name()) {
            let is_present =
                if is_own { has_sent(bus, node) } else { buses.iter().any(|bus| has_sent(bus, node)) };
            if !is_present && !missing.contains(&node) {
                missing.push(node);
            }
        }
    }
    let end = end.map_or_else(String::new, |end| format!(" up to {end}"));
    no_frame_of(capture, buses, &missing, &end)
}

/// Notes on nodes of `--only-node` that sent no frame, and on their buses that do not exist; empty if each node sent one.
pub fn absent_choices(capture: &str, buses: Buses<'_>, choices: &[NodeChoice]) -> Vec<String> {
    let names: Vec<&str> = buses.iter().map(Bus::name).collect();
    let (mut notes, mut missing) = (Vec::new(), Vec::new());
    for choice in choices {
        let wanted = choice.bus.as_deref();
        if let Some(note) = wanted.and_then(|name| unknown_bus(capture, name, "--only-node", &names)) {
            if !notes.contains(&note) {
                notes.push(note);
            }
            continue;
        }
        let is_on = |bus: &Bus| wanted.is_none_or(|name| name == bus.name());
        let is_present = buses.iter().any(|bus| is_on(bus) && has_sent(bus, choice.node));
        if !is_present && !missing.contains(&choice.node) {
            missing.push(choice.node);
        }
    }
    notes.extend(no_frame_of(capture, buses, &missing, ""));
    notes
}

/// Note on `missing` nodes; `None` if there are none.
fn no_frame_of(capture: &str, buses: Buses<'_>, missing: &[NodeId], end: &str) -> Option<String> {
    let first = missing.first()?;
    let (subject, others) = match missing {
        [_] => (first.sentence_label(), String::new()),
        several => ("named nodes".to_owned(), format!(" {}", node_list(several.iter().copied()))),
    };
    let present = present_nodes(buses);
    Some(format!("{capture}: {subject}{others} sent no frame{end}; nodes present: {present}"))
}

/// Labels of the nodes that sent a frame, with their buses if there are several: `can0 1/01, can1 5/05`.
pub fn present_nodes(buses: Buses<'_>) -> String {
    let mut all = Vec::new();
    for bus in buses.iter() {
        let nodes = bus.nodes().filter(|node| node.last_seen().0 > 0).map(|node| node.id().label());
        if buses.len() > 1 {
            all.extend(nodes.map(|node| format!("{} {node}", escape(bus.name()))));
        } else {
            all.extend(nodes);
        }
    }
    if all.is_empty() { "none".to_owned() } else { shorten_labels(all) }
}

/// Whether a node sent a frame, also under a later node-ID, or was present before the capture.
fn has_sent(bus: &Bus, node: NodeId) -> bool {
    bus.node_table().present_or_former(node).is_some_and(|node| node.last_seen().0 > 0 || node.was_present())
}

fn node_list(nodes: impl Iterator<Item = NodeId>) -> String {
    shorten_labels(nodes.map(NodeId::label).collect())
}

/// Labels separated by commas, of many only the first.
fn shorten_labels(labels: Vec<String>) -> String {
    let more = if labels.len() > LISTED { ", …" } else { "" };
    let shown: Vec<String> = labels.into_iter().take(LISTED).collect();
    format!("{}{more}", shown.join(", "))
}

/// Defects of a capture.
pub fn capture_defects(quality: &CaptureQuality) -> Vec<String> {
    let mut faults = Vec::new();
    if quality.unreadable > 0 {
        faults.push(format!("{} unreadable", unreadable_text(quality.unreadable)));
    }
    if quality.lost > 0 {
        faults.push(format!("{} lost by the recorder", count_noun(quality.lost, "frame")));
    }
    if quality.clock_steps.0 > 0 {
        let (steps, largest) = (quality.clock_steps.0, format_span(quality.clock_steps.1.saturating_neg()));
        faults.push(format!("{} of the timestamps, largest {largest}", count_noun(steps, "backward step")));
    }
    if quality.silences.0 > 0 {
        let longest = format_seconds(quality.silences.1);
        faults.push(format!(
            "{} without any frame, longest {longest} s",
            count_noun(quality.silences.0, "gap")
        ));
        faults.extend(quality.gap_texts());
    }
    faults
}

/// Frames and bits per second, mean and maximum; and the bus load, or `hint` on how to set the bit rate.
pub fn rate_texts(
    statistics: &BusStatistics,
    duration: Option<i64>,
    start: i64,
    rate: Option<u32>,
    hint: &str,
) -> Vec<String> {
    let load = &statistics.load;
    let Some(duration) = duration.filter(|duration| *duration > 0) else {
        return vec![count_noun(load.frames, "frame")];
    };
    let per_second = |count: u64, times: u128| {
        u128::from(count) * times * 1_000_000_000 / u128::from(duration.unsigned_abs())
    };
    let (frames, mean) = (per_second(load.frames, 10), per_second(load.bits, 1));
    let (worst, at) = load.worst_frames();
    let first = format!(
        "{}, {}/s, {}/s; worst second {}, {} from {} s",
        count_noun(load.frames, "frame"),
        format_tenths(frames),
        format_bits(mean),
        count_noun(worst, "frame"),
        format_bits(u128::from(load.worst_bits().0)),
        format_since(at, start)
    );
    let second = match rate {
        Some(rate) => {
            let percent = |bits: u128| format_tenths(bits * 1000 / u128::from(rate.max(1)));
            let (mean, worst) = (percent(mean), percent(u128::from(load.worst_bits().0)));
            format!("load {mean} % of {} kbit/s, worst second {worst} %", rate / 1000)
        }
        None => format!("load in % unknown without the bit rate; {hint}"),
    };
    vec![first, second]
}

/// Messages of the NMT master, one line per kind.
pub fn command_texts(statistics: &BusStatistics, quality: &CaptureQuality) -> Vec<String> {
    let start = quality.first.unwrap_or(0);
    let is_synthetic = !quality.is_timed();
    let master = &statistics.master;
    let mut parts: Vec<String> =
        master.commands.iter().map(|(service, count)| format!("NMT {} {count}", service.name())).collect();
    if master.syncs > 0 {
        let gaps = if master.sync_gaps > 0 {
            format!(", {}", count_noun(master.sync_gaps, "counter gap"))
        } else {
            String::new()
        };
        // Synthetic timestamps have no jitter, and an interval with a silence is not one.
        let jitter = master.sync.jitter().filter(|_| !is_synthetic && master.sync.is_regular());
        let jitter = jitter.map_or(String::new(), |jitter| format!(", jitter ±{} ms", format_millis(jitter)));
        parts.push(format!("SYNC {}{}{jitter}{gaps}", master.syncs, period_text(&master.sync, start)));
    }
    if master.times > 0 {
        parts.push(format!("TIME {}", master.times));
    }
    if master.guard_requests > 0 {
        parts.push(format!("guarding requests {}", master.guard_requests));
    }
    parts
}

/// ` every 10.000 ms (9.812 to 14.200, worst from 3.211 s)`.
pub fn period_text(intervals: &IntervalStatistics, start: i64) -> String {
    let (Some(mean), Some(shortest), Some((longest, began))) =
        (intervals.mean(), intervals.shortest(), intervals.longest())
    else {
        return String::new();
    };
    let (mean, shortest, longest) = (format_millis(mean), format_millis(shortest), format_millis(longest));
    format!(" every {mean} ms ({shortest} to {longest}, worst from {} s)", format_since(began, start))
}

/// Time since the first frame, in seconds.
pub fn format_since(time: i64, start: i64) -> String {
    format_seconds(time.saturating_sub(start))
}
