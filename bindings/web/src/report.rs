//! The report page of a finding, with the cut-out capture: the second reading.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::capture::{Batch, CaptureError, MergedReader};
use cobscope_decoder::diagnosis::DiagnosisContext;
use cobscope_decoder::reading;
use cobscope_decoder::report::{HashedFile, Provenance, ReportDraft, ReportGround, html};
use cobscope_decoder::session::Bus;
use cobscope_decoder::why::FaultScope;
use cobscope_decoder::{Reading, Summary};
use sha2::{Digest as _, Sha256};

use crate::capture::CaptureSet;
use crate::files::{BLOCK, ContentAccess, ContentSource};
use crate::request::NamedFile;
use crate::survey::CaptureSurvey;

/// Role of a file and the file.
pub type RoledFile = (&'static str, NamedFile);

/// A report in preparation.
pub struct ReportJob {
    reader: MergedReader<ContentSource>,
    reading: Reading<ReportDraft>,
    batch: Batch,
    is_read: bool,
    hashing: HashJob,
    page: String,
}

/// A finished report.
pub struct WrittenReport {
    /// The page.
    pub page: String,
    /// Frames around the claims, as pcapng; empty without a claim.
    pub cut: Vec<u8>,
}

impl ReportJob {
    /// Starts the second reading; `finding` selects its story.
    ///
    /// # Errors
    /// If there is no such story, or the capture can no longer be read.
    pub fn new(
        captures: &CaptureSet,
        survey: &CaptureSurvey,
        (finding, name, page): (Option<u64>, &str, String),
        (files, all): (&Arc<dyn ContentAccess>, Vec<RoledFile>),
    ) -> Result<Self, String> {
        let buses = survey.end.buses();
        let setting = DiagnosisContext { zero: survey.zero(), ..DiagnosisContext::default() };
        let mut diagnosis = reading::diagnosis(&survey.findings, setting);
        if let Some(finding) = finding {
            diagnosis.stories.retain(|story| story.findings.contains(&finding));
            if diagnosis.stories.is_empty() {
                return Err(format!("finding {finding}: a note, or no such finding; no report"));
            }
        }
        let answer = survey.why.clone().build_report(diagnosis, buses, &captures.options().catalogue);
        let draft = ReportDraft::new(&ReportGround {
            answer: &answer,
            findings: &survey.findings,
            statistics: &survey.overview.statistics,
            buses,
            first: survey.zero(),
            capture: name,
            format: captures.format,
            failure: survey.failure.as_deref(),
            scope: &FaultScope::default(),
        });
        Ok(Self {
            reader: captures.open_reader().map_err(|error| error.to_string())?,
            reading: Reading::of_options(captures.options().clone(), None, draft),
            batch: Batch::new(),
            is_read: false,
            hashing: HashJob::new(Arc::clone(files), all),
            page,
        })
    }

    /// Frames read so far.
    pub fn frames(&self) -> u64 {
        self.reading.decoder().frame_count()
    }

    /// Reads up to about `frames` more frames, then hashes the files; `false` at the end.
    pub fn step(&mut self, frames: u64) -> bool {
        let limit = self.reading.decoder().frame_count().saturating_add(frames);
        while !self.is_read && self.reading.decoder().frame_count() < limit {
            // An error that ends the capture is in the report of the first reading.
            self.is_read = !matches!(self.batch(), Ok(true));
        }
        !self.is_read || self.hashing.step()
    }

    fn batch(&mut self) -> Result<bool, CaptureError> {
        let has_more = self.reader.read(&mut self.batch)?;
        self.reading.take(&self.batch, self.reader.buses());
        Ok(has_more)
    }

    /// The page and the cut-out capture.
    ///
    /// # Errors
    /// If the cut-out capture cannot be written.
    pub fn finish(mut self) -> Result<WrittenReport, String> {
        self.reading.close(self.reader.buses());
        let Summary { part: draft, decoder, .. } = self.reading.finish();
        let mut files = self.hashing.done;
        let nodes = decoder.buses().iter().flat_map(Bus::nodes);
        let used = nodes.filter(|node| node.last_seen().0 > 0 && node.assigned_by().is_some());
        let profiles: BTreeSet<String> = used.map(|node| node.device().id.clone()).collect();
        files.extend(profiles.into_iter().map(|name| HashedFile {
            role: "profile",
            name,
            size: 0,
            sha256: "part of the program".to_owned(),
        }));
        let version = env!("CARGO_PKG_VERSION").to_owned();
        let provenance = Provenance { command: self.page, version, files };
        let (report, excerpt) = draft.finish_report(decoder.buses(), provenance);
        let cut = if excerpt.is_empty() { Ok(Vec::new()) } else { excerpt.to_pcapng() };
        let cut = cut.map_err(|error| format!("cut-out capture: {error}"))?;
        Ok(WrittenReport { page: html::write_page(&report), cut })
    }
}

/// Hashes of the files, in steps.
struct HashJob {
    files: Arc<dyn ContentAccess>,
    waiting: Vec<RoledFile>,
    current: Option<(RoledFile, u64, Sha256)>,
    done: Vec<HashedFile>,
}

impl HashJob {
    fn new(files: Arc<dyn ContentAccess>, mut waiting: Vec<RoledFile>) -> Self {
        waiting.reverse();
        Self { files, waiting, current: None, done: Vec::new() }
    }

    /// Hashes up to 8 MB; `false` at the end.
    fn step(&mut self) -> bool {
        let mut block = vec![0; BLOCK];
        for _ in 0..8 {
            let Some((file, offset, mut hash)) =
                self.current.take().or_else(|| self.waiting.pop().map(|file| (file, 0, Sha256::new())))
            else {
                return false;
            };
            match self.files.read(file.1.file, offset, &mut block) {
                Ok(0) => self.done.push(hashed_file(file, offset, hex_text(&hash.finalize()))),
                Ok(count) => {
                    hash.update(block.get(..count).unwrap_or_default());
                    self.current = Some((file, offset.saturating_add(count as u64), hash));
                }
                Err(error) => self.done.push(hashed_file(file, 0, format!("not available: {error}"))),
            }
        }
        true
    }
}

fn hashed_file((role, file): RoledFile, size: u64, sha256: String) -> HashedFile {
    HashedFile { role, name: file.name, size, sha256 }
}

fn hex_text(bytes: &[u8]) -> String {
    let mut text = String::new();
    for byte in bytes {
        // Writing to a string does not fail.
        let _ = write!(text, "{byte:02x}");
    }
    text
}
