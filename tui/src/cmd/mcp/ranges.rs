//! Answers from a second look at a part of a capture: events, and signals over time.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use anyhow::{Context as _, ensure};
use cobscope_decoder::answers::signals::{RangeSample, RangeSignal};
use cobscope_decoder::answers::{EventObject, format_line};
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::query::Filter;
use cobscope_decoder::reading::ListedSignal;
use cobscope_decoder::replay::EventPosition;
use cobscope_decoder::session::Bus;
use serde_json::json;

use super::arguments::CallArguments;
use super::capture::OpenedCapture;
use super::fit::{fit_value, fit_within, json_length};
use crate::run::arguments::NodeArg;
use crate::select::{BoundSide, RangeBound, ensure_order};
use crate::timeline::WalkStart;

/// Maximum number of frames that are read for an answer; it takes about half a second.
const MOST_FRAMES: u64 = 1_500_000;

/// Events and length of their texts in an answer.
const EVENTS: usize = 50;
const MOST_TEXT: usize = 62 * 1024;

/// Samples of a signal in an answer, and signals.
const SAMPLES: usize = 20;
const MOST_TRACKS: usize = 20;

/// Bounds of a request in one capture.
struct RequestRange {
    from: Option<RangeBound>,
    to: Option<RangeBound>,
    zero: Option<Timestamp>,
}

impl RequestRange {
    fn range_of(capture: &OpenedCapture, arguments: &CallArguments) -> anyhow::Result<Self> {
        let resolve = |name: &str, side| {
            arguments
                .parse_argument::<RangeBound>(name)?
                .map(|bound| capture.resolve_bound(bound, side))
                .transpose()
        };
        let (from, to) = (resolve("from", BoundSide::From)?, resolve("to", BoundSide::To)?);
        ensure_order(from, to).context("the range is empty")?;
        Ok(Self { from, to, zero: capture.zero() })
    }

    /// Order of a frame number and time relative to a bound.
    fn compare_bound(&self, bound: RangeBound, frame: u64, time: Option<Timestamp>) -> Option<Ordering> {
        match bound {
            RangeBound::Frame(number) => Some(frame.cmp(&number)),
            RangeBound::Moment(moment) => Some(time?.cmp(&moment)),
            RangeBound::Offset(offset) => Some(time?.since(self.zero?).cmp(&offset)),
            RangeBound::Clock(_) => None,
        }
    }

    fn contains(&self, event: &Event) -> bool {
        let order = |bound| self.compare_bound(bound, event.frames.last, event.time);
        self.from.is_none_or(|from| order(from).is_some_and(Ordering::is_ge))
            && self.to.is_none_or(|to| order(to).is_none_or(Ordering::is_le))
    }

    fn is_over(&self, frame: u64, time: Option<Timestamp>) -> bool {
        self.to.is_some_and(|to| self.compare_bound(to, frame, time).is_some_and(Ordering::is_gt))
    }
}

/// A position as text: `604:2`.
fn parse_position(text: &str) -> anyhow::Result<EventPosition> {
    let parsed = text.split_once(':').and_then(|(frame, ordinal)| {
        Some(EventPosition { frame: frame.parse().ok()?, ordinal: ordinal.parse().ok()? })
    });
    parsed.with_context(|| format!("after: found {text:?}, expected the value of next, such as 604:2"))
}

/// Events of a range.
///
/// # Errors
/// An argument is not valid, or the capture cannot be read any more.
pub(super) fn range_events(capture: &OpenedCapture, arguments: &CallArguments) -> anyhow::Result<String> {
    let range = RequestRange::range_of(capture, arguments)?;
    let filter = arguments.parse_argument::<Filter>("filter")?;
    let after = arguments.text_argument("after").map(parse_position).transpose()?;
    let limit = arguments.number_argument("limit").unwrap_or(EVENTS);
    let is_all = arguments.is_set("all");
    let start = after.map_or(capture.walk_start(range.from), |after| WalkStart::Frame(after.frame));
    let mut walk = capture.indexed.walk_from(start)?;
    let begin = walk.world.frames();
    let mut found: Vec<String> = Vec::new();
    let (mut length, mut last, mut is_full) = (0_usize, after, false);
    let is_complete = loop {
        let is_left = walk.step_item(&mut |placed| {
            let is_new = after.is_none_or(|after| placed.spot > after);
            if is_full || !is_new || !(is_all || placed.is_news) || !range.contains(placed.event) {
                return;
            }
            if filter.as_ref().is_some_and(|filter| !filter.matches_event(placed.event, placed.bus, None)) {
                return;
            }
            let text = event_line(placed.event, placed.bus);
            let written = json_length(&text);
            is_full = found.len() >= limit || length.saturating_add(written) > MOST_TEXT;
            if !is_full {
                length = length.saturating_add(written);
                last = Some(placed.spot);
                found.push(text);
            }
        })?;
        let (frames, time) = (walk.world.frames(), walk.world.last_time());
        if is_full {
            break false;
        }
        if !is_left || range.is_over(frames, time) {
            break true;
        }
        if frames.saturating_sub(begin) >= MOST_FRAMES {
            last = Some(EventPosition::after_frame(frames));
            break false;
        }
    };
    let next = last.filter(|_| !is_complete).map(|last| format!("{}:{}", last.frame, last.ordinal));
    let (next, read) = (json!(next), walk.world.frames().saturating_sub(begin));
    Ok(format!(
        "{{\"events\":[{}],\"complete\":{is_complete},\"next\":{next},\"frames_read\":{read}}}",
        found.join(",")
    ))
}

/// An event as a line of `decode -f jsonl`; an event that alone is too long is shortened.
fn event_line(event: &Event, bus: &Bus) -> String {
    let object = EventObject::new(event, bus);
    let text = format_line(&object).trim_end().to_owned();
    if json_length(&text) <= MOST_TEXT {
        return text;
    }
    serde_json::to_value(&object).map_or(text, |value| fit_within(value, MOST_TEXT))
}

/// Signals over a range, or the list of all signals.
///
/// # Errors
/// An argument is not valid, no signal has the name, or the capture cannot be read any more.
pub(super) fn range_signals(capture: &OpenedCapture, arguments: &CallArguments) -> anyhow::Result<String> {
    let node = arguments.parse_argument::<NodeArg>("node")?;
    let wanted = arguments.text_argument("signal").map(str::to_lowercase);
    let is_wanted = |signal: &ListedSignal| {
        node.as_ref().is_none_or(|node| {
            signal.node == node.id.to_string() && node.bus.as_ref().is_none_or(|known| *known == signal.bus)
        }) && wanted.as_ref().is_none_or(|wanted| {
            signal.name.to_lowercase().contains(wanted)
                || signal.object.to_lowercase().starts_with(wanted.as_str())
        })
    };
    let chosen: Vec<&ListedSignal> = capture.results.signals.iter().filter(|name| is_wanted(name)).collect();
    ensure!(
        !capture.results.signals.is_empty(),
        "no signals: neither a mapping nor a profile, EDS or DBC describes the messages of this capture"
    );
    ensure!(!chosen.is_empty(), "no signal with this name or node; signals without arguments lists all");
    if wanted.is_none() {
        return Ok(fit_value(json!({"signals": chosen})));
    }
    let range = RequestRange::range_of(capture, arguments)?;
    let most = arguments.number_argument("samples").unwrap_or(SAMPLES);
    let track = |name: &&ListedSignal| ((*name).clone(), RangeSignal::new(name));
    let mut tracks: BTreeMap<ListedSignal, RangeSignal> =
        chosen.iter().take(MOST_TRACKS).map(track).collect();
    let mut walk = capture.indexed.walk_from(capture.walk_start(range.from))?;
    let begin = walk.world.frames();
    let is_complete = loop {
        let is_left = walk.step_item(&mut |placed| {
            if range.contains(placed.event) {
                add_samples(placed.event, placed.bus, &mut tracks, (range.zero, most));
            }
        })?;
        let (frames, time) = (walk.world.frames(), walk.world.last_time());
        if !is_left || range.is_over(frames, time) {
            break true;
        }
        if frames.saturating_sub(begin) >= MOST_FRAMES {
            break false;
        }
    };
    let list: Vec<_> = tracks.into_values().collect();
    let more = chosen.len().saturating_sub(list.len());
    let next = (!is_complete).then(|| format!("#{}", walk.world.frames().saturating_add(1)));
    Ok(fit_value(json!({"signals": list, "more_signals": more, "complete": is_complete, "next_from": next})))
}

fn add_samples(
    event: &Event,
    bus: &Bus,
    tracks: &mut BTreeMap<ListedSignal, RangeSignal>,
    (zero, most): (Option<Timestamp>, usize),
) {
    let node = event.node.map_or(String::new(), |node| node.to_string());
    // Most events have none of the signals.
    if !tracks.keys().any(|signal| signal.node == node) {
        return;
    }
    for signal in event.decode_signals() {
        let Some(track) = tracks.get_mut(&ListedSignal::of(event, bus, signal.field)) else { continue };
        #[expect(clippy::cast_precision_loss, reason = "only for display")]
        let seconds = event.time.zip(zero).map(|(time, zero)| time.since(zero) as f64 / 1e9);
        let number = signal.field.plot_number(&signal.value);
        let sample = RangeSample { frame: event.frames.last, seconds, value: signal.text(), number };
        track.add_sample(sample, most);
    }
}
