//! What a bus and a capture come to, in words: `stats` and the bus pane say the same.
//!
//! ```text
//! 181 frames, 29.5/s, 1691 bit/s; worst second 47 frames, 2436 bit from 2.849 s
//! SYNC 411 every 10.000 ms (9.812 to 14.200, worst from 3.211 s), jitter ±4.200 ms
//! ```

use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::{BusStatistics, Intervals, Quality, span};
use cobscope_decoder::words::plural;

use crate::figures::{bits, millis, seconds, tenths};

/// What a bus is taken for, and why not for CANopen.
pub fn protocols(bus: &Bus) -> String {
    let seen = [(bus.is_canopen(), "CANopen"), (bus.is_j1939(), "J1939"), (bus.is_uds(), "UDS")];
    let seen: Vec<_> = seen.iter().filter(|(is_seen, _)| *is_seen).map(|(_, name)| *name).collect();
    match (seen.as_slice(), bus.doubt()) {
        ([], Some(reason)) => format!("not CANopen: {reason}"),
        ([], None) => "no sign of CANopen, J1939 or UDS".to_owned(),
        (seen, _) => seen.join(" and "),
    }
}

/// How fine stamps are, or that they say nothing.
pub fn stamps(quality: &Quality) -> Option<String> {
    if let Some(interval) = quality.made_up_interval() {
        return Some(format!("stamps are made up: every {} ms, so times say nothing", millis(interval)));
    }
    quality.granularity().map(|step| format!("stamps in steps of {} ms", millis(step)))
}

/// `27 error frames: protocol 27, bus-error 27`.
pub fn error_frames(quality: &Quality) -> String {
    let classes: Vec<String> =
        quality.error_classes.iter().map(|(name, count)| format!("{name} {count}")).collect();
    format!("{}: {}", plural(quality.error_frames, "error frame"), classes.join(", "))
}

/// `1 line or record`, `2 lines or records`.
pub fn unreadable(count: u64) -> String {
    if count == 1 { "1 line or record".to_owned() } else { format!("{count} lines or records") }
}

/// What is said of a bus that `by` names and captures do not have: most likely another name is meant.
pub fn unknown_bus(captures: &str, name: &str, by: &str, names: &[&str]) -> Option<String> {
    let (has, shown) = (names.join(", "), escape(name));
    let has = escape(&has);
    (!names.contains(&name))
        .then(|| format!("{captures}: has no bus {shown}, which {by} names; it has {has}"))
}

/// What else is wrong with a capture.
pub fn faults(quality: &Quality) -> Vec<String> {
    let mut faults = Vec::new();
    if quality.unreadable > 0 {
        faults.push(format!("{} unreadable", unreadable(quality.unreadable)));
    }
    if quality.lost > 0 {
        faults.push(format!("{} lost by the recorder", plural(quality.lost, "frame")));
    }
    if quality.clock_steps.0 > 0 {
        let (steps, largest) = (quality.clock_steps.0, span(quality.clock_steps.1.saturating_neg()));
        faults.push(format!("{} of the stamps, the largest {largest}", plural(steps, "backward step")));
    }
    if quality.silences.0 > 0 {
        let longest = seconds(quality.silences.1);
        faults.push(format!(
            "{} of all traffic, the longest {longest} s",
            plural(quality.silences.0, "silence")
        ));
    }
    faults
}

/// Frames and bits of a bus by the second, in the mean and at worst; and its load where the bit rate is known, else
/// how it is given.
pub fn rates(
    statistics: &BusStatistics,
    duration: Option<i64>,
    start: i64,
    rate: Option<u32>,
    hint: &str,
) -> Vec<String> {
    let load = &statistics.load;
    let Some(duration) = duration.filter(|duration| *duration > 0) else {
        return vec![plural(load.frames, "frame")];
    };
    let per_second = |count: u64, times: u128| {
        u128::from(count) * times * 1_000_000_000 / u128::from(duration.unsigned_abs())
    };
    let (frames, mean) = (per_second(load.frames, 10), per_second(load.bits, 1));
    let (worst, at) = load.worst_frames;
    let first = format!(
        "{}, {}/s, {}/s; worst second {}, {} from {} s",
        plural(load.frames, "frame"),
        tenths(frames),
        bits(mean),
        plural(worst, "frame"),
        bits(u128::from(load.worst_bits.0)),
        since(at, start)
    );
    let second = match rate {
        Some(rate) => {
            let percent = |bits: u128| tenths(bits * 1000 / u128::from(rate.max(1)));
            let (mean, worst) = (percent(mean), percent(u128::from(load.worst_bits.0)));
            format!("load {mean} % of {} kbit/s, worst second {worst} %", rate / 1000)
        }
        None => format!("load in % needs the bit rate: {hint}"),
    };
    vec![first, second]
}

/// What the NMT master sent, a kind a line.
pub fn commands(statistics: &BusStatistics, start: i64) -> Vec<String> {
    let master = &statistics.master;
    let mut parts: Vec<String> =
        master.commands.iter().map(|(service, count)| format!("NMT {} {count}", service.name())).collect();
    if master.syncs > 0 {
        let gaps = if master.sync_gaps > 0 {
            format!(", {}", plural(master.sync_gaps, "counter gap"))
        } else {
            String::new()
        };
        let jitter =
            master.sync.jitter().map_or(String::new(), |jitter| format!(", jitter ±{} ms", millis(jitter)));
        parts.push(format!("SYNC {}{}{jitter}{gaps}", master.syncs, period(&master.sync, start)));
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
pub fn period(intervals: &Intervals, start: i64) -> String {
    let (Some(mean), Some(shortest), Some((longest, began))) =
        (intervals.mean(), intervals.shortest(), intervals.longest())
    else {
        return String::new();
    };
    let (mean, shortest, longest) = (millis(mean), millis(shortest), millis(longest));
    format!(" every {mean} ms ({shortest} to {longest}, worst from {} s)", since(began, start))
}

/// Seconds since the first frame.
pub fn since(time: i64, start: i64) -> String {
    seconds(time.saturating_sub(start))
}
