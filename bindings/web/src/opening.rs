//! Opening of captures: decompression, then the first reading, in steps.

use std::sync::Arc;

use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use serde_json::{Value, json};

use crate::capture::{CaptureSet, READ_OPTIONS};
use crate::files::{ContentAccess, StoredContent};
use crate::input;
use crate::report::RoledFile;
use crate::request::{NamedFile, OpenRequest};
use crate::survey::{CaptureSurvey, SurveyJob};
use crate::unpack::{UnpackJob, is_packed};

/// Captures that are being opened and read for the first time.
pub struct OpeningJob {
    name: String,
    files: Vec<RoledFile>,
    waiting: Vec<NamedFile>,
    contents: Vec<(String, StoredContent)>,
    unpacking: Option<(NamedFile, UnpackJob)>,
    surveying: Option<(CaptureSet, SurveyJob)>,
    options: Option<SessionOptions>,
    setup: Arc<RuleSetup>,
    problems: Vec<String>,
    size: u64,
}

/// Captures after the first reading.
pub struct ReadCaptures {
    /// Names of the captures.
    pub name: String,
    /// All files with their roles.
    pub files: Vec<RoledFile>,
    /// The captures.
    pub captures: CaptureSet,
    /// Selection and tolerances of the rules.
    pub setup: Arc<RuleSetup>,
    /// Problems in the files next to the captures.
    pub problems: Vec<String>,
    /// Results of the first reading.
    pub survey: CaptureSurvey,
}

impl OpeningJob {
    /// Reads the files next to the captures.
    ///
    /// # Errors
    /// If one of them is invalid.
    pub fn new(files: &dyn ContentAccess, request: &OpenRequest) -> Result<Self, String> {
        let input = input::read_options(files, request)?;
        let names: Vec<_> = request.captures.iter().map(|file| file.name.as_str()).collect();
        let mut waiting = request.captures.clone();
        waiting.reverse();
        let role = |file: &NamedFile| match input::BesideKind::kind_of(&file.name) {
            Some(input::BesideKind::BusFile) => "bus file",
            Some(input::BesideKind::DeviceFile) => "device file",
            _ => "database",
        };
        let captures = request.captures.iter().map(|file| ("capture", file.clone()));
        let beside = request.beside.iter().map(|file| (role(file), file.clone()));
        Ok(Self {
            name: names.join(", "),
            files: captures.chain(beside).collect(),
            waiting,
            contents: Vec::new(),
            unpacking: None,
            surveying: None,
            options: Some(input.session),
            setup: input.setup,
            problems: input.problems,
            size: request.captures.iter().map(|file| file.size).sum(),
        })
    }

    /// Works on the next part; `None` when everything is read.
    ///
    /// # Errors
    /// If a capture cannot be opened.
    pub fn step(&mut self, files: &Arc<dyn ContentAccess>, frames: u64) -> Result<Option<Value>, String> {
        if let Some((file, mut unpacking)) = self.unpacking.take() {
            let mut failure = None;
            match unpacking.step() {
                Ok(true) => {
                    let progress = json!({"phase": "unpack", "bytes": unpacking.size()});
                    self.unpacking = Some((file, unpacking));
                    return Ok(Some(progress));
                }
                Ok(false) => {}
                Err((error, true)) => failure = Some(error),
                Err((error, false)) => return Err(format!("{}: {error}", file.name)),
            }
            self.contents.push((file.name, unpacking.finish(failure.as_deref())));
        } else if let Some(file) = self.waiting.pop() {
            let named = |error: String| format!("{}: {error}", file.name);
            if is_packed(&**files, file.file).map_err(named)? {
                let unpacking = UnpackJob::new(files, file.file, &READ_OPTIONS).map_err(named)?;
                self.unpacking = Some((file, unpacking));
            } else {
                let content = StoredContent::File(Arc::clone(files), file.file);
                self.contents.push((file.name, content));
            }
        } else if let Some(options) = self.options.take() {
            let captures = CaptureSet::open(std::mem::take(&mut self.contents), options)?;
            self.problems.extend(captures.notes.iter().cloned());
            let walk = captures.start_walk().map_err(|error| error.to_string())?;
            self.surveying = Some((captures, SurveyJob::new(walk, &self.setup)));
        } else if let Some((_, surveying)) = &mut self.surveying {
            let more = surveying.step(frames);
            let (frames, bytes, findings) = surveying.progress();
            let progress = json!({
                "phase": "read",
                "frames": frames,
                "bytes": bytes,
                "size": self.size,
                "findings": findings,
            });
            return Ok(more.then_some(progress));
        }
        Ok(Some(json!({"phase": "open"})))
    }

    /// The results; `None` before the end.
    pub fn finish(self) -> Option<ReadCaptures> {
        let (captures, surveying) = self.surveying?;
        let survey = surveying.finish(&captures.options().catalogue);
        let Self { name, files, setup, problems, .. } = self;
        Some(ReadCaptures { name, files, captures, setup, problems, survey })
    }
}
