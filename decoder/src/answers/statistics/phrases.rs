//! Phrases on buses and captures, shared by the text and by displays.
//!
//! ```text
//! 181 frames, 29.5/s, 1691 bit/s; worst second 47 frames, 2436 bit from 2.849 s
//! SYNC 411 every 10.000 ms (9.812 to 14.200, worst from 3.211 s), jitter ±4.200 ms
//! ```

use crate::figures::{format_bits, format_load, format_millis, format_seconds, format_tenths};
use crate::session::Bus;
use crate::statistics::{BusStatistics, CaptureQuality, IntervalStatistics, format_span};
use crate::words::count_noun;

/// One second in ns.
const SECOND: u128 = 1_000_000_000;

/// Protocols that the traffic of a bus confirms.
pub fn protocol_names(bus: &Bus) -> Vec<&'static str> {
    let protocols = bus.protocols();
    let all =
        [(protocols.is_canopen(), "CANopen"), (protocols.is_j1939(), "J1939"), (protocols.is_uds(), "UDS")];
    all.into_iter().filter(|(is_confirmed, _)| *is_confirmed).map(|(_, name)| name).collect()
}

/// Protocols detected on a bus, or the reason why it is not detected as CANopen.
pub fn protocols_text(bus: &Bus) -> String {
    let seen = protocol_names(bus);
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
            let mean = format_load(u128::from(load.bits), u128::from(duration.unsigned_abs()), rate);
            let worst = format_load(u128::from(load.worst_bits().0), SECOND, rate);
            format!("mean load {mean} of {} kbit/s, worst second {worst}", rate / 1000)
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
