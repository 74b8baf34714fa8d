//! Reports: one page about a capture with claim, evidence and origin, to be mailed, printed and signed.
//!
//! ```text
//! first reading  ─rules, why─▶ stories ─Draft::new─▶ frames, windows and nodes that matter
//! second reading ─Draft::frame, event, frame_decoded─▶ bytes, curves, values ─Draft::finish─▶ Report ─▶ HTML, Markdown
//! ```
//!
//! A [`CaptureReport`] contains texts only. Hashes, the command line and files belong to the program.

mod assumptions;
mod citations;
mod claims;
mod clock;
mod curves;
mod draft;
mod excerpt;
pub mod fleet;
mod glossary;
pub mod html;
pub mod markdown;
mod model;
mod quality;
mod values;
mod window;

pub use claims::SHOWN_CLAIMS;
pub use draft::{ReportDraft, ReportGround};
pub use excerpt::{COMMENT as ATTACHMENT_COMMENT, CommentedExcerpt};
pub use model::{
    Attachment, CaptureFacts, CaptureReport, ClaimLine, ClaimPlot, EvidenceFrame, HashedFile, NodeValues,
    ObjectRow, PlotMark, Provenance, ReportClaim, RuleSource, SignalCurve, VerdictCoverage,
};
