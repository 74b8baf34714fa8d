//! The threads of a timeline, one per file. Each fills one part of [`Shared`](super::Shared) or sends
//! [`News`](super::News), and ends with the timeline.

mod diagnosing;
pub(super) mod export;
pub(super) mod index;
pub(super) mod matches;
pub(super) mod seek;
pub(super) mod survey;
pub(super) mod traces;
pub(super) mod watch;

pub use export::ExportRequest;
