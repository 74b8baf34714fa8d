//! Captures on a common time axis: opening, and walks from any checkpoint.

use std::io::Seek as _;
use std::path::Path;

use cobscope_decoder::capture::{
    Batch, CaptureError, CaptureReader, MergedCapture, MergedPosition, MergedReader, Notice, ReadOptions,
    RecorderZones,
};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{CaptureWalk, Checkpoint, ReplayState};
use cobscope_decoder::series::{
    CapturePlacement, JoinOptions, NotJoined, PossiblePart, arrange_captures, is_blank, relate_files,
};
use cobscope_decoder::session::SessionOptions;

use crate::files::{ContentSource, StoredContent};

/// One or several captures.
pub struct CaptureSet {
    contents: Vec<PlacedContent>,
    options: SessionOptions,
    /// Title of the format of the first capture.
    pub format: &'static str,
    /// Reasons why captures with consecutive names are not parts of one.
    pub notes: Vec<String>,
}

/// A capture among the others.
struct PlacedContent {
    content: StoredContent,
    place: CapturePlacement,
}

/// A capture that may be a part of a series.
struct NamedContent {
    name: String,
    content: StoredContent,
}

impl PossiblePart for NamedContent {
    fn path(&self) -> &Path {
        Path::new(&self.name)
    }

    fn is_listed(&self) -> bool {
        // Browsers pass dropped files in any order: only consecutive names join them.
        false
    }

    fn read_batches(
        &self,
        _is_whole: bool,
        take: &mut dyn FnMut(&Batch, &[String]) -> bool,
    ) -> Option<&'static str> {
        let mut reader =
            CaptureReader::open(ContentSource::new(self.content.clone(), 0), &READ_OPTIONS).ok()?;
        let mut batch = Batch::new();
        // An unreadable end is reported when the capture is decoded.
        while reader.read(&mut batch).unwrap_or(false) {
            if !take(&batch, reader.buses().names()) {
                break;
            }
        }
        Some(reader.format().name)
    }

    fn is_blank(&self) -> bool {
        is_blank(ContentSource::new(self.content.clone(), 0))
    }
}

/// Options of all readers.
pub const READ_OPTIONS: ReadOptions =
    ReadOptions { time_style: None, columns: None, time_unit: None, time_zones: RecorderZones::NONE };

impl CaptureSet {
    /// Opens captures: parts of a series follow each other, the others are merged by time.
    ///
    /// # Errors
    /// If a capture has no known format or no frame, or only some of them have dates.
    pub fn open(captures: Vec<(String, StoredContent)>, options: SessionOptions) -> Result<Self, String> {
        let candidates: Vec<_> =
            captures.into_iter().map(|(name, content)| NamedContent { name, content }).collect();
        let relations = relate_files(&candidates, JoinOptions::USUAL);
        let files = || relations.files.iter().filter_map(|index| candidates.get(*index));
        let (mut names, mut firsts, mut formats) = (Vec::new(), Vec::new(), Vec::new());
        for file in files() {
            let (first, format) =
                first_frame(&file.content).map_err(|error| format!("{}: {error}", file.name))?;
            names.push(file.name.clone());
            firsts.push(first);
            formats.push(format);
        }
        let placed =
            arrange_captures(&names, &firsts, &relations.of, false).map_err(|mixed| mixed.to_string())?;
        let format = placed.first().and_then(|place| formats.get(place.index)).copied().unwrap_or("");
        let part = |place: CapturePlacement| {
            let content = files().nth(place.index)?.content.clone();
            Some(PlacedContent { content, place })
        };
        let contents = placed.into_iter().filter_map(part).collect();
        let note = |NotJoined { text, max_gap }| match max_gap {
            Some(gap) => format!("{text}; parts of a capture follow within {gap}"),
            None => text,
        };
        let notes = relations.notes.into_iter().map(note).collect();
        Ok(Self { contents, options, format, notes })
    }

    /// Options of the decoder.
    pub fn options(&self) -> &SessionOptions {
        &self.options
    }

    /// A reader at the start.
    ///
    /// # Errors
    /// If a capture can no longer be read.
    pub fn open_reader(&self) -> Result<MergedReader<ContentSource>, CaptureError> {
        let mut all = Vec::new();
        for PlacedContent { content, place } in &self.contents {
            let reader = CaptureReader::open(ContentSource::new(content.clone(), 0), &READ_OPTIONS)?;
            let CapturePlacement { group, shift, continues, .. } = *place;
            all.push(MergedCapture { reader, group, shift, continues });
        }
        Ok(MergedReader::new(all))
    }

    /// A walk from the start.
    ///
    /// # Errors
    /// If a capture can no longer be read.
    pub fn start_walk(&self) -> Result<CaptureWalk<ContentSource>, CaptureError> {
        Ok(CaptureWalk::new(self.open_reader()?, ReplayState::new(self.options.clone())))
    }

    /// A walk from a checkpoint.
    ///
    /// # Errors
    /// If a capture can no longer be read.
    pub fn resume_walk(&self, mark: &Checkpoint) -> Result<CaptureWalk<ContentSource>, CaptureError> {
        let sources = self.sources_at(&mark.position)?;
        Ok(CaptureWalk::new(MergedReader::resume(sources, &mark.position)?, mark.world.clone()))
    }

    fn sources_at(&self, position: &MergedPosition) -> Result<Vec<ContentSource>, CaptureError> {
        let place = |(placed, offset): (&PlacedContent, u64)| {
            let mut source = ContentSource::new(placed.content.clone(), 0);
            source.seek(std::io::SeekFrom::Start(offset))?;
            Ok(source)
        };
        self.contents.iter().zip(position.offsets()).map(place).collect()
    }
}

/// Time of the first frame, and the title of the format.
fn first_frame(content: &StoredContent) -> Result<(Option<Timestamp>, &'static str), String> {
    let text = |error: CaptureError| error.to_string();
    let mut reader =
        CaptureReader::open(ContentSource::new(content.clone(), 0), &READ_OPTIONS).map_err(text)?;
    let mut batch = Batch::new();
    let mut reason = "contains no frames".to_owned();
    while batch.frames().is_empty() {
        if !reader.read(&mut batch).map_err(text)? {
            return Err(reason);
        }
        let is_cut = |(_, notice): &&(usize, Notice)| matches!(notice, Notice::CutOff { .. });
        if let Some((_, notice)) = batch.notices().iter().find(is_cut) {
            reason = notice.to_string();
        }
    }
    Ok((batch.frames().first().and_then(|frame| frame.time), reader.format().title))
}
