//! What the reader of a format is: [`Parser`], and how it is listed among the [`Format`]s.

use super::batch::Batch;
use super::bus_names::BusNames;
use super::error::CaptureError;

/// Input a parser may be asked to look at before it must take some, unless it says otherwise
/// ([`Parser::largest`]): longer lines and records are skipped by it piece by piece.
pub const LARGEST_RECORD: usize = 128 * 1024;

/// Meaning of candump's relative stamps, and of its stamps at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeStyle {
    /// `-t a`, `-l`, `-L`, `-t A`, `-t z`: each stamp stands for itself.
    Absolute,
    /// `-t d`: each stamp is the time since the frame before.
    Delta,
}

/// How to read what a capture leaves open.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReadOptions {
    /// What candump's relative times mean; `None` finds out from the first 1,000 lines.
    pub time_style: Option<TimeStyle>,
}

/// Reader of one format: takes bytes, gives frames. Holds no source, so that it can be cloned.
pub trait Parser: Send + Sync {
    /// Takes frames from the front of `input` into `batch` until either runs out; returns how many
    /// bytes it took. `at_end` says that nothing follows `input`.
    ///
    /// Taking nothing and giving nothing asks for more input; given [`Parser::largest`] bytes, or `at_end`
    /// with any, it takes or gives some. A parser of containers takes one only when all that is in it has
    /// been given: meanwhile it gives frames and takes nothing, and is called again with the same bytes.
    ///
    /// # Errors
    /// Only where no later byte can be read either.
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError>;

    /// Bytes it may need to see at once before it takes some.
    fn largest(&self) -> usize {
        LARGEST_RECORD
    }

    /// Buses seen so far.
    fn buses(&self) -> &BusNames;

    /// Line that was taken last, from 1; none in a binary format.
    fn line(&self) -> Option<u64> {
        None
    }

    /// A copy at the same place. It is kept for every place that is returned to, so it is small: what can
    /// be made again of the bytes not taken yet is not in it.
    fn clone_box(&self) -> Box<dyn Parser>;
}

/// One readable format.
pub struct Format {
    /// Short name, as options take it.
    pub name: &'static str,
    /// What people call it.
    pub title: &'static str,
    /// A line a frame: it can be entered behind the end of any line.
    pub is_text: bool,
    /// Whether the first bytes of a capture (up to 64 KiB) look like it.
    pub detect: fn(&[u8]) -> bool,
    /// A parser at the start of a capture.
    pub parser: fn(&ReadOptions) -> Box<dyn Parser>,
}
