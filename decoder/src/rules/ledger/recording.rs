//! Findings that frames missing from the recording explain.

use super::FindingLedger;
use crate::finding::Severity;
use crate::observation::RecordingLoss;
use crate::session::{Bus, BusStream, Buses, StreamService};
use crate::wire::NodeId;

/// Reason for the lower severity of such a finding.
const NOT_CAPTURED: &str = "single frames missing from the capture may be the cause";

/// Rules whose findings one missing frame causes: a periodic message of this service, or any frame.
const MISSING_FRAMES: [(&str, Option<StreamService>); 18] = [
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
    ("sdo-toggle", None),
    ("sync-counter", None),
    ("request-unanswered", None),
    ("uds-no-response", None),
];

impl FindingLedger {
    /// Lowers the severity of findings that missing frames or absent nodes explain. Returns statements about the capture.
    pub(in crate::rules) fn lower_explained(&mut self, buses: Buses<'_>) -> Vec<String> {
        let mut texts = Vec::new();
        for bus in buses {
            if let Some(loss) = RecordingLoss::estimate(bus) {
                self.lower_by_loss(loss, bus);
                texts.push(loss.quality_text());
            }
            texts.extend(self.lower_absent(bus));
        }
        texts
    }

    fn lower_by_loss(&mut self, loss: RecordingLoss, bus: &Bus) {
        let streams: Vec<BusStream> = bus.streams().collect();
        for group in &mut self.groups {
            let is_over = group.key.bus == bus.index() && !group.lasts_to_end;
            if !is_over || group.severity == Severity::Note {
                continue;
            }
            let rule = MISSING_FRAMES.iter().find(|(rule, _)| **rule == *group.rule);
            let explained = match rule {
                None => 0,
                Some((_, Some(service))) => gap_count(&streams, *service, group.key.node),
                Some((_, None)) => {
                    let tally = self.tallies.get(usize::from(group.key.rule)).copied().unwrap_or_default();
                    loss.explained_count(tally.passed.saturating_add(tally.failed))
                }
            };
            if group.count <= explained {
                group.severity = Severity::Note;
                group.downgraded.get_or_insert_with(|| NOT_CAPTURED.to_owned());
            }
        }
    }
}

/// Number of gaps with single missing elements in the messages of a service of a node; 0 if one of them also had a longer gap.
fn gap_count(streams: &[BusStream], service: StreamService, node: Option<NodeId>) -> u64 {
    let mut owned = streams.iter().filter(|stream| stream.service == service && stream.node == node);
    let count = |sum: u64, stream: &BusStream| {
        let counts = stream.regularity;
        (counts.silence_count() == 0).then(|| sum.saturating_add(u64::from(counts.gap_count())))
    };
    owned.try_fold(0, count).unwrap_or(0)
}
