//! Findings that frames missing from the recording explain.

use super::FindingLedger;
use crate::finding::Severity;
use crate::frame::BusIndex;
use crate::observation::RecordingLoss;
use crate::session::{Bus, BusStream, Buses, StreamRegularity, StreamService};
use crate::wire::NodeId;

/// Reason for the lower severity of such a finding.
const NOT_CAPTURED: &str = "single frames missing from the capture may be the cause";

/// Reason for the lower severity near a report of lost frames.
const REPORTED_LOSS: &str = "lost frames in the capture may be the cause";

/// Rules whose findings one missing frame causes: a periodic message of this service, or any frame.
const MISSING_FRAMES: [(&str, Option<StreamService>); 21] = [
    ("sync-period", Some(StreamService::Sync)),
    ("node-lost", Some(StreamService::ErrorControl)),
    ("pdo-event-timer", Some(StreamService::TransmittedPdo)),
    ("pdo-lost", Some(StreamService::TransmittedPdo)),
    ("command-gap", Some(StreamService::ReceivedPdo)),
    ("dm1-period", Some(StreamService::J1939Message)),
    ("boot-up-missing", None),
    ("guard-late", None),
    ("guard-no-answer", None),
    ("guard-toggle", None),
    ("isotp-violation", None),
    ("pdo-sync-acyclic", None),
    ("pdo-sync-cyclic", None),
    ("sdo-no-response", None),
    ("sdo-answer-mismatch", None),
    ("sdo-client-does-not-wait", None),
    ("sdo-toggle", None),
    ("sync-counter", None),
    ("request-unanswered", None),
    ("transport-violation", None),
    ("uds-no-response", None),
];

impl FindingLedger {
    /// Lowers the severity of findings that missing frames or absent nodes explain. Returns statements about the capture.
    pub(in crate::rules) fn lower_explained(&mut self, buses: Buses<'_>) -> Vec<String> {
        let mut texts = Vec::new();
        for bus in buses {
            if let Some(loss) = RecordingLoss::estimate(bus) {
                let is_lowered = self.lower_by_loss(loss, bus);
                // One missing element matters only if a finding is about it.
                if is_lowered || !loss.is_single() {
                    texts.push(loss.quality_text());
                }
            }
            self.lower_near_losses(bus.index());
            texts.extend(self.lower_absent(bus));
        }
        texts
    }

    /// Whether a finding was lowered.
    fn lower_by_loss(&mut self, loss: RecordingLoss, bus: &Bus) -> bool {
        let mut is_lowered = false;
        let streams: Vec<BusStream> = bus.streams().collect();
        for group in &mut self.groups {
            let is_over = group.key.bus == bus.index() && !group.lasts_to_end;
            if !is_over || group.severity == Severity::Note {
                continue;
            }
            let rule = MISSING_FRAMES.iter().find(|(rule, _)| **rule == *group.rule);
            let place = usize::from(group.key.rule);
            let is_timing = self.rules.get(place).is_some_and(|rule| rule.is_timing);
            let explained = match rule {
                None if !is_timing => 0,
                Some((_, Some(service))) => {
                    loss.explained_gaps(gap_count(&streams, *service, group.key.node))
                }
                Some((_, None)) | None => {
                    let tally = self.tallies.get(place).copied().unwrap_or_default();
                    let checks = tally.passed.saturating_add(tally.failed);
                    if rule.is_some() || loss.is_likely_in(checks) { loss.explained_count(checks) } else { 0 }
                }
            };
            if group.count <= explained {
                group.severity = Severity::Note;
                group.downgraded.get_or_insert_with(|| NOT_CAPTURED.to_owned());
                is_lowered = true;
            }
        }
        is_lowered
    }

    /// Lowers the severity of findings whose occurrences are all near frames that the recorder reported as lost: the report may
    /// follow the finding.
    fn lower_near_losses(&mut self, bus: BusIndex) {
        let Self { groups, reported_losses, .. } = self;
        for group in groups.iter_mut().filter(|group| group.key.bus == bus && !group.lasts_to_end) {
            let is_explained = MISSING_FRAMES.iter().any(|(rule, _)| **rule == *group.rule)
                && group.first.iter().chain(&group.last).all(|at| reported_losses.is_near(bus, at));
            if is_explained && group.severity > Severity::Note {
                group.severity = Severity::Note;
                group.downgraded.get_or_insert_with(|| REPORTED_LOSS.to_owned());
            }
        }
    }
}

/// Number of gaps with single missing elements in the messages of a service of a node; 0 for a node that was also silent.
fn gap_count(streams: &[BusStream], service: StreamService, node: Option<NodeId>) -> u64 {
    let owned = streams.iter().filter(|stream| stream.service == service && stream.node == node);
    let is_silence_judged = service == StreamService::ErrorControl;
    let mut counts = owned.map(|stream| stream.regularity);
    let count = |sum: u64, counts: StreamRegularity| {
        let is_single = counts.silence_count() == 0 || !is_silence_judged;
        is_single.then(|| sum.saturating_add(u64::from(counts.gap_count())))
    };
    counts.try_fold(0, count).unwrap_or(0)
}
