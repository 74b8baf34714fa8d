//! Properties of whole files, and whether one continues another.

use std::collections::BTreeMap;

use super::part::PossiblePart;
use crate::frame::{CanId, Frame, Timestamp};

/// A capture on a relative clock that starts before this time does not continue another one: each recording
/// starts near zero.
const NEAR_ZERO: Timestamp = Timestamp(1_000_000_000);

/// Part of the earlier file that an overlap with consecutive names must not exceed to be reported.
const SHORT_OVERLAP: i64 = 10;

/// Largest gap between files with consecutive names that is reported, in ns.
const REPORTED: i64 = 60_000_000_000;

/// Object of a node that identifies the device: bus, node-ID, sub-index of 1018.
type IdentityKey = (String, u8, u8);

/// Properties of a whole file.
pub struct CaptureScan {
    /// Earliest and latest timestamp.
    span: Option<(Timestamp, Timestamp)>,
    first: Option<Frame>,
    last: Option<Frame>,
    pub(super) frames: u64,
    buses: Vec<String>,
    first_identities: BTreeMap<IdentityKey, u32>,
    last_identities: BTreeMap<IdentityKey, u32>,
}

/// Reason why a file does not continue another one.
pub(super) struct SeparationReason {
    pub(super) reason: String,
    /// Longest gap that joins files, if the gap is the reason.
    pub(super) max_gap: Option<String>,
    /// The file is later on the same clock and buses.
    pub(super) is_later: bool,
    /// The reason is worth a note.
    pub(super) is_close: bool,
}

impl SeparationReason {
    fn unrelated_reason() -> Self {
        Self { reason: String::new(), max_gap: None, is_later: false, is_close: false }
    }
}

impl CaptureScan {
    /// Reads a file to its end without decoding; `None` if it cannot be opened.
    pub fn scan_file(candidate: &impl PossiblePart) -> Option<Self> {
        let mut scan = Self {
            span: None,
            first: None,
            last: None,
            frames: 0,
            buses: Vec::new(),
            first_identities: BTreeMap::new(),
            last_identities: BTreeMap::new(),
        };
        let mut buses = Vec::new();
        candidate.read_batches(true, &mut |batch, names| {
            for frame in batch.frames() {
                scan.add_frame(frame, names);
            }
            if names != buses {
                buses = names.to_vec();
            }
            true
        })?;
        scan.buses = buses;
        Some(scan)
    }

    /// Earliest and latest timestamp; `None` without any.
    pub fn time_span(&self) -> Option<(Timestamp, Timestamp)> {
        self.span
    }

    fn add_frame(&mut self, frame: &Frame, names: &[String]) {
        self.frames += 1;
        if self.first.is_none() {
            self.first = Some(*frame);
        }
        self.last = Some(*frame);
        if let Some(time) = frame.time {
            let span = self.span.get_or_insert((time, time));
            *span = (span.0.min(time), span.1.max(time));
        }
        if let Some((node, sub, value)) = frame_identity(frame) {
            let bus = names.get(usize::from(frame.bus.0)).cloned().unwrap_or_default();
            self.first_identities.entry((bus.clone(), node, sub)).or_insert(value);
            self.last_identities.insert((bus, node, sub), value);
        }
    }

    /// Whether `next` continues this file.
    pub(super) fn relate_next(&self, next: &Self, max_gap: i64) -> Result<(), SeparationReason> {
        let both = self.last.as_ref().zip(next.first.as_ref());
        let Some((last, first)) = both else { return Err(SeparationReason::unrelated_reason()) };
        let Some((end, start)) = last.time.zip(first.time) else {
            return Err(SeparationReason::unrelated_reason());
        };
        let is_relative = !start.has_date() || !end.has_date();
        if (is_relative && start < NEAR_ZERO) || !next.buses.iter().any(|bus| self.buses.contains(bus)) {
            return Err(SeparationReason::unrelated_reason());
        }
        let gap = start.since(end);
        let length_of_this = self.span.map_or(0, |(first, last)| last.since(first));
        // Files that overlap for longer come from different loggers.
        let is_close = if gap < 0 { -gap <= length_of_this / SHORT_OVERLAP } else { gap <= REPORTED };
        let apart =
            |reason: String| Err(SeparationReason { reason, max_gap: None, is_later: false, is_close });
        match () {
            () if gap < 0 => apart(format!("starts {} before its last frame", format_length(gap))),
            () if gap == 0 && is_same_frame(last, first) => {
                apart("starts with its last frame, so they overlap".into())
            }
            () if gap > max_gap => {
                let reason = format!("starts {} after its last frame", format_length(gap));
                Err(SeparationReason {
                    reason,
                    max_gap: Some(format_length(max_gap)),
                    is_later: true,
                    is_close,
                })
            }
            () => match self.find_contradiction(next) {
                Some(reason) => apart(reason),
                None => Ok(()),
            },
        }
    }

    /// Nanoseconds to add to the timestamps of `next` if the user joins it to this file, whose timestamps are shifted by
    /// `own`. A relative clock that starts again continues at the last frame: the time between is unknown.
    ///
    /// # Errors
    /// Reason why the two have no common time.
    pub(super) fn shift_of(&self, next: &Self, own: i64) -> Result<i64, String> {
        let (Some((_, end)), Some((start, _))) = (self.span, next.span) else {
            return if self.span.is_none() && next.span.is_none() {
                Ok(0)
            } else {
                Err("only one of them has timestamps".into())
            };
        };
        match (end.has_date(), start.has_date()) {
            (true, true) if start < end => {
                Err(format!("starts {} before its last frame", format_length(start.since(end))))
            }
            (true, true) => Ok(0),
            (false, false) => Ok(own.saturating_add(end.since(start).max(0))),
            _ => Err("only one of them has an absolute clock".into()),
        }
    }

    /// Node with another identity. J1939 addresses are dynamic, so a claim by another NAME is none.
    fn find_contradiction(&self, next: &Self) -> Option<String> {
        let mut both = next.first_identities.iter().filter_map(|(key, value)| {
            let before = self.last_identities.get(key)?;
            (before != value).then_some((key, before, value))
        });
        both.next().map(|((bus, node, sub), before, value)| {
            format!("1018:{sub:02X} of {bus} node {node} is {value:08X}, before {before:08X}")
        })
    }

    /// Adds buses and identities of the part before this one.
    pub(super) fn inherit_buses(&mut self, before: &Self) {
        self.buses.extend(before.buses.iter().cloned());
        for (key, value) in &before.last_identities {
            self.last_identities.entry(key.clone()).or_insert(*value);
        }
    }
}

/// Node, sub-index and value of an upload of vendor-ID, product code or serial number. CiA 301 §7.2.4.3.6: 43h
/// is the response of an expedited upload with four bytes; §7.5.2.22: sub-indexes of 1018.
fn frame_identity(frame: &Frame) -> Option<(u8, u8, u32)> {
    let CanId::Standard(id @ 0x581..=0x5FF) = frame.id else { return None };
    let [0x43, 0x18, 0x10, sub @ (1 | 2 | 4), a, b, c, d] = *frame.data() else { return None };
    let node = u8::try_from(id - 0x580).ok()?;
    Some((node, sub, u32::from_le_bytes([a, b, c, d])))
}

fn is_same_frame(one: &Frame, other: &Frame) -> bool {
    (one.time, one.id, one.flags, one.data()) == (other.time, other.id, other.flags, other.data())
}

/// `12.500 s`, without a sign.
fn format_length(nanoseconds: i64) -> String {
    let milliseconds = nanoseconds.unsigned_abs().div_ceil(1_000_000);
    format!("{}.{:03} s", milliseconds / 1_000, milliseconds % 1_000)
}
