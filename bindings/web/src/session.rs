//! All state of the page's worker: the open captures, and the job in progress.
//!
//! ```text
//! open ─▶ Unpack ─▶ CaptureSurvey ─▶ ready ─▶ rows, state, …      at once
//!                               └────▶ filter, plot, report, export    in steps
//! ```

use std::sync::Arc;

use cobscope_decoder::answers::events::PositionRecord;
use cobscope_decoder::answers::signals::SignalCurve;
use cobscope_decoder::answers::transfers::TransferList;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{EventPosition, RowPattern};
use cobscope_decoder::rules::RuleSetup;
use serde::Serialize;
use serde_json::{Value, json};

use crate::capture::CaptureSet;
use crate::counts::BlockRowCounts;
use crate::cut::CutJob;
use crate::export::ExportJob;
use crate::files::ContentAccess;
use crate::filter::{FilterJob, FilteredEvents};
use crate::jobs::{Job, JobResult};
use crate::matcher::{self, EventMatcher};
use crate::opening::{OpeningJob, ReadCaptures};
use crate::overview::build_overview;
use crate::plot::{self, PlotJob};
use crate::report::{ReportJob, RoledFile, WrittenReport};
use crate::request::{FieldOfIdentifier, ListName, OpenRequest, PageRequest, Product, RequestPosition};
use crate::rows::{FindingMarks, RowList, event_detail};
use crate::search::{SearchJob, SearchQuestion, SearchResult};
use crate::seek::RecentCheckpoints;
use crate::state::{PositionState, known_objects};
use crate::survey::CaptureSurvey;

/// Maximum number of transfers per request.
const MOST_TRANSFERS: usize = 500;

/// State of the worker.
pub struct WorkerState {
    files: Arc<dyn ContentAccess>,
    opening: Option<OpeningJob>,
    ready: Option<ReadySession>,
}

/// Captures that were read once.
struct ReadySession {
    name: String,
    files: Vec<RoledFile>,
    captures: CaptureSet,
    setup: Arc<RuleSetup>,
    problems: Vec<String>,
    survey: CaptureSurvey,
    marks: FindingMarks,
    seek: RecentCheckpoints,
    all: EventMatcher,
    news: EventMatcher,
    filtered: Option<FilteredEvents>,
    filter: Option<String>,
    job: Option<Job>,
    curves: Option<Vec<SignalCurve>>,
    report: Option<WrittenReport>,
    bytes: Vec<u8>,
}

/// Response to a request.
pub struct Response {
    /// JSON.
    pub value: Value,
    /// Content of a product.
    pub bytes: Vec<u8>,
}

type Answer = Result<Value, String>;

impl WorkerState {
    /// Nothing is opened yet.
    pub fn new(files: Arc<dyn ContentAccess>) -> Self {
        Self { files, opening: None, ready: None }
    }

    /// Response to a request as JSON; an error has the key `error`.
    pub fn call_json(&mut self, request: &[u8]) -> Response {
        let request = serde_json::from_slice(request).map_err(|error| format!("request: {error}"));
        let answer = match request {
            Ok(PageRequest::Bytes { what }) => match self.product_bytes(what) {
                Ok(bytes) => return Response { value: json!({"length": bytes.len()}), bytes },
                Err(error) => Err(error),
            },
            Ok(request) => self.answer(request),
            Err(error) => Err(error),
        };
        let value = answer.unwrap_or_else(|error| json!({"error": error}));
        Response { value, bytes: Vec::new() }
    }

    fn answer(&mut self, request: PageRequest) -> Answer {
        match request {
            PageRequest::Open(request) => self.open(&request),
            PageRequest::Step { frames } => self.step(frames),
            PageRequest::Complete { text } => Ok(matcher::complete(&text)),
            request => {
                let files = Arc::clone(&self.files);
                self.ready_captures()?.answer(request, &files)
            }
        }
    }

    fn ready_captures(&mut self) -> Result<&mut ReadySession, String> {
        self.ready.as_mut().ok_or_else(|| "no capture is open".to_owned())
    }

    fn product_bytes(&mut self, what: Product) -> Result<Vec<u8>, String> {
        let ready = self.ready_captures()?;
        let report = || ready.report.as_ref().ok_or_else(|| "no report was written".to_owned());
        match what {
            Product::Report => Ok(report()?.page.clone().into_bytes()),
            Product::Cut => Ok(report()?.cut.clone()),
            Product::Export => Ok(std::mem::take(&mut ready.bytes)),
        }
    }

    fn open(&mut self, request: &OpenRequest) -> Answer {
        (self.opening, self.ready) = (None, None);
        self.opening = Some(OpeningJob::new(&*self.files, request)?);
        Ok(json!({}))
    }

    fn step(&mut self, frames: u64) -> Answer {
        if let Some(opening) = &mut self.opening {
            if let Some(progress) = opening.step(&self.files, frames)? {
                return Ok(progress);
            }
            self.ready = self.opening.take().and_then(OpeningJob::finish).map(ReadySession::new);
            return Ok(json!({"phase": "ready"}));
        }
        self.ready_captures()?.step(frames)
    }
}

impl ReadySession {
    fn new(read: ReadCaptures) -> Self {
        let marks = FindingMarks::marks_of(&read.survey.findings);
        Self {
            name: read.name,
            files: read.files,
            captures: read.captures,
            setup: read.setup,
            problems: read.problems,
            survey: read.survey,
            marks,
            seek: RecentCheckpoints::default(),
            all: EventMatcher::new(false),
            news: EventMatcher::new(true),
            filtered: None,
            filter: None,
            job: None,
            curves: None,
            report: None,
            bytes: Vec::new(),
        }
    }

    fn answer(&mut self, request: PageRequest, files: &Arc<dyn ContentAccess>) -> Answer {
        let text = |error: cobscope_decoder::capture::CaptureError| error.to_string();
        match request {
            PageRequest::Overview => build_overview(&self.survey, &self.name, &self.captures, &self.problems),
            PageRequest::Rows { list, from, count } => {
                let (seek, rows) = self.row_list(list)?;
                let total = rows.counts.total();
                rows.rows(seek, from, count).map(|rows| json!({"rows": rows, "total": total})).map_err(text)
            }
            PageRequest::Locate { list, at } => self.locate(list, at),
            PageRequest::Filter { text, only_news } => self.start_filter(text, only_news),
            PageRequest::State { frame } => {
                let next = frame.saturating_add(1);
                let walk = self.seek.walk_before(&self.captures, &self.survey, next).map_err(text)?;
                to_json(&PositionState::new(&walk.world))
            }
            PageRequest::Objects { frame, bus, node } => {
                let next = frame.saturating_add(1);
                let walk = self.seek.walk_before(&self.captures, &self.survey, next).map_err(text)?;
                to_json(&known_objects(&walk.world, bus, node.into()))
            }
            PageRequest::Event { frame, ordinal } => {
                let walk = self.seek.walk_before(&self.captures, &self.survey, frame).map_err(text)?;
                let detail = event_detail(walk, EventPosition { frame, ordinal }, self.survey.zero());
                to_json(&detail.map_err(text)?)
            }
            PageRequest::Transfers { from, count } => {
                let (survey, part) = (&self.survey, (from, count.min(MOST_TRANSFERS)));
                to_json(&TransferList::new(&survey.overview, survey.end.buses(), survey.zero(), part))
            }
            PageRequest::Plot { signals, from, to } => self.start_plot(&signals, from, to),
            PageRequest::Curves => {
                to_json(&self.job.as_ref().and_then(Job::curves).or_else(|| self.curves.clone()))
            }
            PageRequest::Report { finding, page } => self.start_report(finding, page, files),
            PageRequest::Export { format, list, frames } => self.start_export(&format, list, frames),
            PageRequest::Error { from, backward } => {
                to_json(&self.survey.find_error(from.into(), backward).map(PositionRecord::from))
            }
            PageRequest::Search { text, list, from, backward } => {
                let pattern = match RowPattern::new(&text) {
                    Ok(pattern) => pattern,
                    Err(reason) => return Ok(json!({"invalid": {"reason": reason, "start": 0}})),
                };
                let matcher = self.row_list(list)?.1.matcher.clone();
                let from: EventPosition = from.into();
                let question = SearchQuestion { pattern, matcher, from, is_backward: backward };
                let (start, last) = if backward { (from.frame, from.frame) } else { (from.frame, u64::MAX) };
                self.start_search(question, start, last)
            }
            PageRequest::Open(_)
            | PageRequest::Step { .. }
            | PageRequest::Complete { .. }
            | PageRequest::Bytes { .. } => Err("request of another state".to_owned()),
        }
    }

    fn row_list(&mut self, list: ListName) -> Result<(&mut RecentCheckpoints, RowList<'_>), String> {
        let Self { captures, survey, marks, seek, all, news, filtered, .. } = self;
        let (counts, matcher, kept): (&BlockRowCounts, &EventMatcher, _) = match list {
            ListName::All => (&survey.all, &*all, None),
            ListName::News => (&survey.news, &*news, None),
            ListName::Filter => {
                let result = filtered.as_ref().ok_or_else(|| "no filter was searched".to_owned())?;
                (&result.counts, &result.matcher, result.kept.as_deref())
            }
        };
        Ok((seek, RowList { captures, survey, marks, counts, matcher, kept }))
    }

    fn locate(&mut self, list: ListName, at: RequestPosition) -> Answer {
        let text = |error: cobscope_decoder::capture::CaptureError| error.to_string();
        let spot = match at {
            RequestPosition::Spot(spot) => spot.into(),
            RequestPosition::Time(time) => {
                let Self { captures, survey, seek, .. } = self;
                let time = to_timestamp(survey.zero(), time);
                EventPosition::before_frame(seek.frame_at(captures, survey, time).map_err(text)?)
            }
        };
        let (seek, rows) = self.row_list(list)?;
        rows.locate_row(seek, spot).map(|row| json!({"row": row, "frame": spot.frame})).map_err(text)
    }

    fn start_filter(&mut self, text: String, only_news: bool) -> Answer {
        match EventMatcher::parse(&text, only_news) {
            Ok(matcher) => {
                let walk = self.captures.start_walk().map_err(|error| error.to_string())?;
                (self.filtered, self.filter) = (None, Some(text));
                self.job = Some(Job::Filter(Box::new(FilterJob::new(walk, matcher))));
                Ok(json!({}))
            }
            Err(problem) => Ok(json!({"invalid": problem})),
        }
    }

    fn start_plot(&mut self, signals: &[FieldOfIdentifier], from: Option<f64>, to: Option<f64>) -> Answer {
        let text = |error: cobscope_decoder::capture::CaptureError| error.to_string();
        let Self { captures, survey, seek, .. } = self;
        let Some(zero) = survey.zero() else { return Err("a capture without timestamps".to_owned()) };
        let mut keys = Vec::new();
        for signal in signals.iter().take(plot::MOST_SIGNALS) {
            let walk = seek.walk_before(captures, survey, signal.frame.saturating_add(1)).map_err(text)?;
            keys.extend(plot::find_signal(&walk.world, signal));
        }
        let end = survey.end.last_time().unwrap_or(zero).0;
        let range = (
            from.map_or(zero.0, |it| to_timestamp(Some(zero), it).0),
            to.map_or(end, |it| to_timestamp(Some(zero), it).0),
        );
        let mark = survey.index.before_time(Timestamp(range.0));
        let walk = match mark {
            Some(mark) => captures.resume_walk(mark),
            None => captures.start_walk(),
        };
        self.job = Some(Job::Plot(Box::new(PlotJob::new(walk.map_err(text)?, keys, zero, range))));
        Ok(json!({}))
    }

    fn start_report(&mut self, finding: Option<u64>, page: String, files: &Arc<dyn ContentAccess>) -> Answer {
        let started = ReportJob::new(
            &self.captures,
            &self.survey,
            (finding, &self.name, page),
            (files, self.files.clone()),
        )?;
        self.job = Some(Job::Report(Box::new(started)));
        Ok(json!({}))
    }

    /// Searches from the last checkpoint before frame `start` to frame `last`.
    fn start_search(&mut self, question: SearchQuestion, start: u64, last: u64) -> Answer {
        let walk = match self.survey.checkpoint_at(start.saturating_sub(1)) {
            Some(mark) => self.captures.resume_walk(mark),
            None => self.captures.start_walk(),
        };
        let walk = walk.map_err(|error| error.to_string())?;
        self.job = Some(Job::Search(Box::new(SearchJob::new(walk, question, last))));
        Ok(json!({}))
    }

    fn start_export(&mut self, format: &str, list: ListName, frames: Option<(u64, u64)>) -> Answer {
        self.bytes = Vec::new();
        if format == "pcapng" {
            let reader = self.captures.open_reader().map_err(|error| error.to_string())?;
            let cutting = CutJob::new(reader, frames.unwrap_or((0, u64::MAX)))?;
            self.job = Some(Job::Cut(Box::new(cutting)));
            return Ok(json!({}));
        }
        let filter = self.filter.as_deref().filter(|_| list == ListName::Filter);
        let filter = filter.map(str::parse).transpose();
        let filter = filter.map_err(|error: cobscope_decoder::query::FilterError| error.to_string())?;
        let reader = self.captures.open_reader().map_err(|error| error.to_string())?;
        let options = (self.captures.options().clone(), &self.setup);
        let exporting = ExportJob::new(reader, options, format, (filter, frames))?;
        self.job = Some(Job::Export(Box::new(exporting)));
        Ok(json!({}))
    }

    /// Works on the job; a finished one leaves its result.
    fn step(&mut self, frames: u64) -> Answer {
        let Some(mut job) = self.job.take() else { return Ok(json!({"phase": "idle"})) };
        let (zero, size) = (self.survey.zero(), self.survey.end.frames());
        let more = job.step(frames, &self.marks, zero)?;
        self.bytes.extend(job.bytes());
        let what = job.name();
        if more {
            let value = json!({"phase": what, "frames": job.frames(), "size": size});
            self.job = Some(job);
            return Ok(value);
        }
        let (mut total, mut cut, mut place) = (None, None, None);
        match job.finish()? {
            JobResult::Filter(result) => {
                total = Some(result.counts.total());
                self.filtered = Some(result);
            }
            JobResult::Plot(curves) => self.curves = Some(curves),
            JobResult::Report(written) => {
                cut = Some(written.cut.len());
                self.report = Some(written);
            }
            JobResult::Export => {}
            JobResult::Search(SearchResult::Row(found)) => place = found.map(PositionRecord::from),
            JobResult::Search(SearchResult::Further(question, last)) => {
                self.start_search(question, last, last)?;
                return Ok(json!({"phase": what, "frames": size.saturating_sub(last), "size": size}));
            }
        }
        Ok(json!({"phase": "done", "what": what, "total": total, "cut": cut, "place": place}))
    }
}

/// An answer as JSON.
fn to_json(answer: &impl Serialize) -> Answer {
    serde_json::to_value(answer).map_err(|error| error.to_string())
}

/// Time of a number of seconds after the first frame.
fn to_timestamp(zero: Option<Timestamp>, seconds: f64) -> Timestamp {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let nanoseconds = (seconds * 1e9).round() as i64;
    zero.unwrap_or_default().plus(nanoseconds)
}
