//! Captures on a common time axis: opening, and walks from any checkpoint.

use std::io::Seek as _;

use cobscope_decoder::capture::{
    Batch, CaptureError, MergedCapture, MergedPosition, MergedReader, Notice, ReadOptions, Reader,
};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{Checkpoint, ReplayState, Walk};
use cobscope_decoder::session::SessionOptions;

use crate::files::{Content, Source};

/// One or several captures.
pub struct Captures {
    contents: Vec<Content>,
    options: SessionOptions,
    /// Title of the format of the first capture.
    pub format: &'static str,
}

/// Options of all readers.
pub const READ_OPTIONS: ReadOptions = ReadOptions { time_style: None };

impl Captures {
    /// Opens captures and orders them by their first frames.
    ///
    /// # Errors
    /// If a capture has no known format or no frame, or only some of them have dates.
    pub fn open(named: Vec<(String, Content)>, options: SessionOptions) -> Result<Self, String> {
        let mut opened = Vec::new();
        let is_alone = named.len() == 1;
        for (name, content) in named {
            let (first, format) = first_frame(&content).map_err(|error| format!("{name}: {error}"))?;
            opened.push((first, format, content));
        }
        if !is_alone {
            let dated = opened.iter().filter(|(first, ..)| first.is_some_and(Timestamp::has_date)).count();
            if dated != 0 && dated != opened.len() {
                return Err(
                    "some of these captures have dates, others count from their start, so they have \
                            no common time axis; open them one by one"
                        .to_owned(),
                );
            }
            opened.sort_by_key(|(first, ..)| *first);
        }
        let format = opened.first().map_or("", |(_, format, _)| *format);
        let contents = opened.into_iter().map(|(.., content)| content).collect();
        Ok(Self { contents, options, format })
    }

    /// Options of the decoder.
    pub fn options(&self) -> &SessionOptions {
        &self.options
    }

    /// A reader at the start.
    ///
    /// # Errors
    /// If a capture can no longer be read.
    pub fn reader(&self) -> Result<MergedReader<Source>, CaptureError> {
        let mut all = Vec::new();
        for (group, content) in self.contents.iter().enumerate() {
            let reader = Reader::open(Source::new(content.clone(), 0), &READ_OPTIONS)?;
            all.push(MergedCapture { reader, group, shift: 0, continues: false });
        }
        Ok(MergedReader::new(all))
    }

    /// A walk from the start.
    ///
    /// # Errors
    /// If a capture can no longer be read.
    pub fn start(&self) -> Result<Walk<Source>, CaptureError> {
        Ok(Walk::new(self.reader()?, ReplayState::new(self.options.clone())))
    }

    /// A walk from a checkpoint.
    ///
    /// # Errors
    /// If a capture can no longer be read.
    pub fn resume(&self, mark: &Checkpoint) -> Result<Walk<Source>, CaptureError> {
        let sources = self.sources_at(&mark.position)?;
        Ok(Walk::new(MergedReader::resume(sources, &mark.position)?, mark.world.clone()))
    }

    fn sources_at(&self, position: &MergedPosition) -> Result<Vec<Source>, CaptureError> {
        let place = |(content, offset): (&Content, u64)| {
            let mut source = Source::new(content.clone(), 0);
            source.seek(std::io::SeekFrom::Start(offset))?;
            Ok(source)
        };
        self.contents.iter().zip(position.offsets()).map(place).collect()
    }
}

/// Time of the first frame, and the title of the format.
fn first_frame(content: &Content) -> Result<(Option<Timestamp>, &'static str), String> {
    let text = |error: CaptureError| error.to_string();
    let mut reader = Reader::open(Source::new(content.clone(), 0), &READ_OPTIONS).map_err(text)?;
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
