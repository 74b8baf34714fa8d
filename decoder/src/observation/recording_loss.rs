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
}

impl RecordingLoss {
    /// Estimate for a bus; `None` without a missing element, or if one sender alone misses several: then its messages were
    /// missing on the bus.
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
            elements.silences = elements.silences.max(u64::from(stream.regularity.silence_count()));
        }
        let (mut missing, mut expected, mut affected) = (0, 0, 0);
        for elements in senders.values() {
            let lost = elements.missing.saturating_sub(elements.silences);
            affected += usize::from(lost > 0);
            missing += lost;
            expected += elements.expected;
        }
        (missing == 1 || affected > 1).then_some(Self { missing, expected })
    }

    /// Most occurrences of a finding in so many checks that missing frames explain: twice the expected number, three standard
    /// deviations, and one.
    pub(crate) fn explained_count(self, checks: u64) -> u64 {
        if self.missing == 1 {
            return 1;
        }
        let frames = checks.saturating_mul(self.missing) / self.expected.max(1);
        frames.saturating_mul(2).saturating_add(frames.isqrt().saturating_mul(3)).saturating_add(1)
    }

    /// Most findings about gaps in a periodic message that missing frames explain: the single gaps that were recognised, and some
    /// that follow each other too closely to be recognised.
    pub(crate) fn explained_gaps(self, gaps: u64) -> u64 {
        if self.missing == 1 || gaps == 0 { gaps } else { gaps.saturating_add(gaps / 4).saturating_add(1) }
    }

    /// Statement for the quality of the capture.
    pub(crate) fn quality_text(self) -> String {
        let elements = count_noun(self.missing, "element");
        if self.missing == 1 {
            return format!("{elements} of a periodic message not captured: single gaps are notes");
        }
        #[expect(clippy::cast_precision_loss, reason = "a share for display")]
        let percent = self.missing as f64 * 100.0 / self.expected.max(1) as f64;
        format!(
            "about {percent:.1} % of the frames not captured ({elements} of periodic messages): single gaps are notes"
        )
    }
}
