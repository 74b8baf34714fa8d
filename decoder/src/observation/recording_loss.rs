//! Share of frames that the recorder lost, by cross-evidence: single elements of periodic messages are missing while their
//! phase is unchanged.

use std::collections::BTreeMap;

use crate::session::{Bus, BusStream};
use crate::wire::NodeId;
use crate::words::count_noun;

/// Frames that are missing from the recording of one bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RecordingLoss {
    /// Missing elements of periodic messages.
    missing: u64,
    /// Elements of these messages, with the missing ones.
    expected: u64,
}

/// Elements of all messages of one sender.
#[derive(Debug, Clone, Copy, Default)]
struct SenderElements {
    missing: u64,
    expected: u64,
    /// Longer gaps in one of its messages: in a slower one, each may look like a missing element.
    silences: u64,
    /// Time of the last gap in one of its messages, in units of 1.05 ms.
    gap_time: u32,
}

/// Gaps of several senders within this time are one gap of the bus, in units of 1.05 ms: they do not show single frames.
const SHARED: u32 = 300;

/// Missing elements that show a share of lost frames.
const MANY: u64 = 5;

impl RecordingLoss {
    /// Estimate for a bus; `None` without a missing element, if one sender alone misses several, or if all senders miss them at
    /// the same time: then the messages were missing on the bus.
    pub(crate) fn estimate(bus: &Bus) -> Option<Self> {
        Self::from_streams(bus.streams())
    }

    fn from_streams(streams: impl Iterator<Item = BusStream>) -> Option<Self> {
        let mut senders: BTreeMap<Option<NodeId>, SenderElements> = BTreeMap::new();
        for stream in streams {
            let elements = senders.entry(stream.sender()).or_default();
            let missing = u64::from(stream.regularity.missing_count());
            elements.missing += missing;
            elements.expected += u64::from(stream.regularity.regular_count()) + missing;
            if missing > 0 {
                elements.gap_time = elements.gap_time.max(stream.regularity.last_gap_time());
            }
            elements.silences = elements.silences.max(u64::from(stream.regularity.silence_count()));
        }
        let (mut missing, mut expected, mut gap_times) = (0, 0, Vec::new());
        for elements in senders.values() {
            let lost = elements.missing.saturating_sub(elements.silences);
            if lost > 0 {
                gap_times.push(elements.gap_time);
            }
            missing += lost;
            expected += elements.expected;
        }
        let (first, last) = (gap_times.iter().min()?, gap_times.iter().max()?);
        (missing == 1 || last - first > SHARED).then_some(Self { missing, expected })
    }

    /// Whether one element only is missing.
    pub(crate) fn is_single(self) -> bool {
        self.missing == 1
    }

    /// Whether one frame at least is probably missing in so many checks.
    pub(crate) fn is_likely_in(self, checks: u64) -> bool {
        self.missing >= MANY && checks.saturating_mul(self.missing) >= self.expected
    }

    /// Most occurrences of a finding in so many checks that missing frames explain: twice the expected number, three standard
    /// deviations, and one.
    pub(crate) fn explained_count(self, checks: u64) -> u64 {
        if self.is_single() {
            return 0;
        }
        let frames = checks.saturating_mul(self.missing) / self.expected.max(1);
        frames.saturating_mul(2).saturating_add(frames.isqrt().saturating_mul(3)).saturating_add(1)
    }

    /// Most findings about gaps in a periodic message that missing frames explain: the single gaps that were recognised, and some
    /// that follow each other too closely to be recognised.
    pub(crate) fn explained_gaps(self, gaps: u64) -> u64 {
        if self.is_single() || gaps == 0 { gaps } else { gaps.saturating_add(gaps / 4).saturating_add(1) }
    }

    /// Statement for the quality of the capture.
    pub(crate) fn quality_text(self) -> String {
        let elements = count_noun(self.missing, "element");
        if self.is_single() {
            return format!("{elements} of a periodic message not captured: single gaps are notes");
        }
        #[expect(clippy::cast_precision_loss, reason = "a share for display")]
        let percent = self.missing as f64 * 100.0 / self.expected.max(1) as f64;
        format!(
            "about {percent:.1} % of the frames not captured ({elements} of periodic messages): single gaps are notes"
        )
    }
}
