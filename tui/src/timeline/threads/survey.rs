//! Surveys the whole capture in its own pass: findings, transfers, errors, load.

use std::sync::mpsc::Sender;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::Event;
use cobscope_decoder::finding::CaptureFindings;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::reading::{FrameDemand, PlacedReading, PlacedSummary, ReadingPart, Survey};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::Bus;

use super::diagnosing::{DiagnosisSchedule, diagnose_findings};
use crate::source::StoreReader;
use crate::timeline::news::TimelineNews;
use crate::timeline::shared::SharedResults;
use crate::timeline::survey::FindingOccurrence;
use crate::timeline::walk;

/// Number of frames between two publications.
const STRIDE: u64 = 65_536;

/// Interval of publications of a growing capture.
const PUBLICATION_INTERVAL: Duration = Duration::from_millis(200);

/// Surveys the whole capture.
pub(in crate::timeline) fn run_survey(
    shared: &SharedResults,
    setup: &Arc<RuleSetup>,
    news: &Sender<TimelineNews>,
) {
    if let Ok(walk) = walk::start_walk(shared) {
        let mut surveyor = Surveyor(PlacedReading::new(walk, setup, Default::default()));
        let mut next = STRIDE;
        let mut published = Instant::now();
        while !shared.is_over() {
            // The next frame may take long to arrive: until then, everything known is published.
            if surveyor.0.walk.is_drained() {
                while !shared.is_over() && surveyor.has_unpublished() {
                    if published.elapsed() >= PUBLICATION_INTERVAL {
                        published = Instant::now();
                        surveyor.publish_results(shared);
                        shared.report_growth(news);
                    }
                    if shared.waits_for_growth(surveyor.0.walk.offset(), PUBLICATION_INTERVAL) {
                        break;
                    }
                }
            }
            let has_more = surveyor.0.step();
            if let Some(error) = surveyor.0.take_failure() {
                shared.fail_reading(&error);
            }
            if !has_more {
                break;
            }
            if surveyor.0.walk.world.frames() >= next {
                next = surveyor.0.walk.world.frames() + STRIDE;
                surveyor.publish_results(shared);
            }
        }
        surveyor.publish_results(shared);
        surveyor.finish_survey(shared);
    }
    shared.survey.write().unwrap_or_else(PoisonError::into_inner).is_complete = true;
    // The application may have ended.
    let _ = news.send(TimelineNews::Surveyed);
}

/// The pass: an overview, and what was added since the last publication.
struct Surveyor(PlacedReading<StoreReader, (Survey, UnpublishedNews)>);

/// News since the last publication.
#[derive(Default)]
struct UnpublishedNews {
    diagnosing: DiagnosisSchedule,
    /// Frames or events since the last publication.
    has_news: bool,
}

impl ReadingPart for UnpublishedNews {
    fn event(&mut self, _event: &Event, _bus: &Bus) {
        self.has_news = true;
    }

    fn finding(&mut self, _event: &Event, _bus: &Bus) {
        self.diagnosing.note_change();
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Batches
    }

    fn frame(&mut self, _frame: &Frame, _names: &BusNames) {
        self.has_news = true;
    }
}

impl Surveyor {
    /// Whether something is known that the survey does not contain.
    fn has_unpublished(&self) -> bool {
        let (_, news) = self.0.part();
        news.has_news || news.diagnosing.is_pending()
    }

    fn publish_results(&mut self, shared: &SharedResults) {
        let (_, news) = self.0.part_mut();
        news.has_news = false;
        let is_due = news.diagnosing.is_due(Instant::now());
        let so_far = is_due.then(|| self.0.findings_so_far());
        let so_far = so_far.map(|(findings, zero)| diagnose_findings(&findings, zero, true));
        let mut survey = shared.survey.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(so_far) = so_far {
            survey.set_diagnosis(so_far);
        }
        survey.frames = self.0.walk.world.frames();
        let (overview, _) = self.0.part_mut();
        survey.places.extend(overview.opened.iter().map(|opened| FindingOccurrence {
            frame: opened.spot.frame,
            time: opened.time,
            id: opened.news.id,
            severity: opened.news.severity,
        }));
        overview.publish(&mut survey.overview);
    }

    fn finish_survey(self, shared: &SharedResults) {
        let names = self.0.walk.buses().names().to_vec();
        let PlacedSummary { findings, part: (mut overview, _), end } = self.0.finish();
        let places = occurrences(&findings);
        let diagnosed = diagnose_findings(&findings, end.first_time(), false);
        let mut survey = shared.survey.write().unwrap_or_else(PoisonError::into_inner);
        survey.places = places;
        survey.set_diagnosis(diagnosed);
        overview.publish(&mut survey.overview);
        survey.findings = Some(findings);
        survey.buses = names;
    }
}

/// The recorded occurrences of all findings, in order.
fn occurrences(findings: &CaptureFindings) -> Vec<FindingOccurrence> {
    let mut places = Vec::new();
    for group in findings.reported_groups() {
        places.extend(group.first.iter().chain(&group.last).map(|occurrence| FindingOccurrence {
            frame: occurrence.frames.last,
            time: occurrence.time,
            id: group.id,
            severity: group.severity,
        }));
    }
    places.sort_by_key(|place| (place.frame, place.id));
    places.dedup();
    places
}
